//! KITTI folders as a source and as a bag.

use modulo_bags::bag::{BagReader, Compression, Selection};
use modulo_bags::import::{ImportReport, import_kitti};
use modulo_bags::source::{GroundTruth, SourceFrame, SourceOptions, open};
use modulo_core::BBox;

use crate::writing::{COMPRESSIONS, read_all, write_kitti};

fn frames(path: &std::path::Path) -> Vec<SourceFrame> {
    let mut source = open(&path.display().to_string(), &SourceOptions::default()).expect("a source");
    std::iter::from_fn(|| source.next()).collect::<Result<_, _>>().expect("frames")
}

#[test]
fn labels_come_with_their_frames() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    write_kitti(folder.path(), 3);
    let frames = frames(folder.path());
    let car = |y1| GroundTruth {
        bbox: BBox { x1: 0.0, y1, x2: 2.3, y2: 3.4 },
        class: "car".into(),
        truncated: 0.08,
        occluded: 1,
    };
    let ignored = GroundTruth {
        bbox: BBox { x1: 1.0, y1: 1.0, x2: 5.0, y2: 3.0 },
        class: "dontcare".into(),
        truncated: -1.0,
        occluded: -1,
    };
    let labels: Vec<_> = frames.into_iter().map(|f| f.ground_truth).collect();
    assert_eq!(labels, [Some(vec![car(0.5), ignored.clone()]), None, Some(vec![car(0.52), ignored])]);
}

#[test]
fn a_drive_prefers_object_labels_and_falls_back_to_tracking() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    write_kitti(folder.path(), 2);
    let path = |name: &str| folder.path().join(name);
    std::fs::rename(path("image_2"), path("image_02")).expect("renamed");
    std::fs::rename(path("label_2"), path("label_object")).expect("renamed");
    std::fs::create_dir(path("label_track")).expect("a folder");
    let van = "0 5 Van 0 0 1.0 1 1 2 2 1 1 1 1 1 1 1\n";
    for name in ["label_track/000000.txt", "label_track/000001.txt"] {
        std::fs::write(path(name), van).expect("written");
    }
    let classes: Vec<_> = frames(folder.path())
        .into_iter()
        .map(|f| f.ground_truth.expect("labelled")[0].class.clone())
        .collect();
    assert_eq!(classes, ["car", "van"]);
}

#[test]
fn an_imported_folder_is_the_folder() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let kitti = folder.path().join("kitti");
    write_kitti(&kitti, 15);
    for compression in COMPRESSIONS {
        let out = folder.path().join(format!("{compression:?}"));
        let report = import_kitti(&kitti, &out, compression).expect("imported");
        assert_eq!(report, ImportReport { frames: 15, labelled: 8, objects: 16 });
        let (from_files, from_bag) = (frames(&kitti), frames(&out));
        assert_eq!(from_files.len(), from_bag.len());
        for (i, (file, bag)) in from_files.iter().zip(&from_bag).enumerate() {
            assert_eq!(bag.stamp_ns, Some(1_316_995_200_000_000_000 + i as u64 * 100_000_000));
            assert_eq!(bag.radiance, file.radiance);
            assert_eq!(bag.ground_truth, file.ground_truth);
            assert_eq!(bag.frame_id, "camera");
        }
        let bag = BagReader::open(&out).expect("a bag");
        assert_eq!(read_all(&bag, &Selection::of(["/ground_truth"])).len(), 8);
    }
}

#[test]
fn the_same_folder_gives_the_same_bytes() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let kitti = folder.path().join("kitti");
    write_kitti(&kitti, 12);
    let files = ["a", "b"].map(|parent| {
        let out = folder.path().join(parent).join("bag");
        import_kitti(&kitti, &out, Compression::Zstd).expect("imported");
        let read = |name| std::fs::read(out.join(name)).expect("a file");
        [read("bag_0.mcap"), read("metadata.yaml")]
    });
    assert!(files[0] == files[1]);
}

#[test]
fn a_bad_label_names_file_and_line_and_leaves_no_bag() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let kitti = folder.path().join("kitti");
    write_kitti(&kitti, 3);
    let label = kitti.join("label_2/000002.txt");
    let text = std::fs::read_to_string(&label).expect("read");
    std::fs::write(&label, text + "Car 0 0 1 2 3\n").expect("written");
    let out = folder.path().join("out");
    let error = import_kitti(&kitti, &out, Compression::None).expect_err("a bad line").to_string();
    assert!(error.contains("000002.txt:3: 6 columns found, 15 needed"), "{error}");
    assert!(!out.exists());
}

#[test]
fn an_unknown_topic_names_those_there_are() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let (kitti, out) = (folder.path().join("kitti"), folder.path().join("out"));
    write_kitti(&kitti, 1);
    import_kitti(&kitti, &out, Compression::None).expect("imported");
    let options = SourceOptions { white: 0.0, topic: Some("/image".into()) };
    let error = open(&out.display().to_string(), &options).err().expect("refused").to_string();
    assert!(error.contains("'/image'") && error.contains("/camera/image_raw"), "{error}");
}
