//! Image files, KITTI folders and bags as sources, and recordings of others. The last are skipped where the
//! data folder is absent.

use std::path::{Path, PathBuf};

use image::{ImageBuffer, Rgb, Rgba};
use modulo_bags::bag::{BagInfo, BagReader, Compression, Selection, copy};
use modulo_bags::source::{GroundTruth, Source, SourceFrame, SourceOptions, open, to_detections};
use modulo_core::{BBox, Frame, Samples, Transfer};
use modulo_images::{Coding, save_png};
use modulo_msgs::cdr;
use modulo_msgs::image::encode_frame;
use modulo_msgs::sensor_msgs::{CameraInfo, CompressedImage};
use modulo_msgs::std_msgs::{Header, Time};
use modulo_runtime::{SensorModel, StreamKind, sensor_info};
use ndarray::Array3;
use proptest::prelude::*;

use crate::{COMPRESSIONS, data, frame, read_all, temporary, write_kitti, write_messages};

const IMAGE: &str = "sensor_msgs/msg/Image";
const FILE: &str = "sensor_msgs/msg/CompressedImage";

fn packed(file: CompressedImage) -> Vec<u8> {
    cdr::to_vec(&file).expect("short")
}

fn error_of(path: &Path) -> String {
    match open(&path.display().to_string(), &SourceOptions::default()) {
        Err(error) => error.to_string(),
        Ok(mut source) => source.next().expect("a frame").expect_err("a bad frame").to_string(),
    }
}

fn frames(path: &Path, white: f32) -> Vec<SourceFrame> {
    let options = SourceOptions { coding: Coding { white, ..Coding::default() }, topic: None };
    let mut source = open(&path.display().to_string(), &options).expect("a source");
    let mut all = || std::iter::from_fn(|| source.next()).collect::<Result<Vec<_>, _>>().expect("frames");
    let first = all();
    assert_eq!(source.len, Some(first.len()));
    source.rewind();
    assert_eq!(std::iter::from_fn(|| source.next()).map(|f| f.expect("a frame")).collect::<Vec<_>>(), first);
    first
}

/// An image whose samples decide how later ones are read, or leave it open.
fn telling(kind: usize) -> Frame {
    let deep = |code: u16| Frame::from_u16(Array3::from_elem((4, 6, 1), code)).expect("4 x 6");
    let linear = |value: f32| Frame::from_f32(Array3::from_elem((4, 6, 3), value)).expect("4 x 6");
    match kind {
        0 => frame(7),
        // Nearly black, of 12 bits, of 16 bits.
        1 => deep(200),
        2 => deep(3000),
        3 => deep(60_000),
        4 => linear(0.0),
        kind => linear(kind as f32),
    }
}

fn save(image: &Frame, folder: &Path, number: usize) {
    let path = folder.join(format!("{number:06}"));
    match image.samples() {
        Samples::F32(linear) => {
            let pixel = |x: u32, y: u32| [0, 1, 2].map(|c| linear[(y as usize, x as usize, c)]);
            let image = ImageBuffer::from_fn(6, 4, |x, y| Rgb(pixel(x, y)));
            image.save(path.with_extension("exr")).expect("saved");
        }
        _ => save_png(&path.with_extension("png"), image).expect("saved"),
    }
}

/// Writes the same frames as a folder, as KITTI, with YOLO's labels, with COCO's, and as bags.
fn write_sources(images: &[Frame], folder: &Path) {
    let [plain, yolo, kitti] = ["plain", "yolo/images", "kitti/image_2"].map(|name| folder.join(name));
    for place in [&plain, &yolo, &kitti] {
        std::fs::create_dir_all(place).expect("a folder");
        images.iter().enumerate().for_each(|(number, image)| save(image, place, number));
    }
    let mut files: Vec<_> = std::fs::read_dir(&plain).expect("there").flatten().map(|e| e.path()).collect();
    files.sort();
    let entry = |(id, file): (usize, &PathBuf)| {
        let name = file.file_name().expect("a name").display();
        format!(r#"{{"id": {id}, "file_name": "{name}", "width": 6, "height": 4}}"#)
    };
    let entries: Vec<String> = files.iter().enumerate().map(entry).collect();
    let text = format!(r#"{{"images": [{}], "annotations": [], "categories": []}}"#, entries.join(","));
    std::fs::write(folder.join("coco.json"), text).expect("written");
    let header = |number| Header { stamp: Time::from_ns(number), ..Header::default() };
    let raw = (1..).zip(images).map(|(number, image)| {
        let payload = encode_frame(&header(number), image).expect("short");
        ("/image", IMAGE, number, payload)
    });
    write_messages(&folder.join("raw"), raw);
    let packed = (1..).zip(&files).map(|(number, file)| {
        let data = std::fs::read(file).expect("saved above");
        (
            "/image",
            FILE,
            number,
            packed(CompressedImage { header: header(number), data, ..Default::default() }),
        )
    });
    write_messages(&folder.join("packed"), packed);
}

/// Each source of the folder that [`write_sources`] has filled, and a scene.
fn open_sources(folder: &Path) -> Vec<Source> {
    let opened = |spec: &str| open(spec, &SourceOptions::default()).expect("a source");
    let inside = |name: &str| opened(&folder.join(name).display().to_string());
    let coco =
        Source::coco(&folder.join("coco.json"), Some(&folder.join("plain")), &SourceOptions::default());
    vec![
        inside("plain"),
        inside("kitti"),
        Source::yolo(&folder.join("yolo"), &SourceOptions::default()).expect("a source"),
        coco.expect("a source"),
        inside("raw"),
        inside("packed"),
        opened("scene://day?seed=3&width=32&height=16&frames=4"),
    ]
}

/// The radiance of the frames that follow; `None` for one that is refused.
fn read_on(source: &mut Source) -> Vec<Option<Array3<f32>>> {
    source.map(|frame| frame.ok().map(|frame| frame.radiance)).collect()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(32))]

    /// After a crash a node skips the frames that it has taken. The others must not differ from those without a crash.
    #[test]
    fn frames_behind_a_crash_are_those_without_one(kinds in proptest::collection::vec(0_usize..8, 1..6)) {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let images: Vec<Frame> = kinds.iter().map(|kind| telling(*kind)).collect();
        write_sources(&images, folder.path());
        let whole: Vec<_> = open_sources(folder.path()).iter_mut().map(read_on).collect();
        for position in 0..=images.len() + 1 {
            for (index, source) in open_sources(folder.path()).iter_mut().enumerate() {
                source.pass(position as u64);
                let rest = whole[index].get(position..).unwrap_or_default();
                prop_assert_eq!(read_on(source), rest, "source {} behind {}", index, position);
            }
        }
    }
}

/// A clone without git LFS has such a text in the place of each large file.
#[test]
fn a_pointer_of_git_lfs_is_named() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    for name in ["a.png", "a.exr", "a.mcap", "a.db3"] {
        let path = folder.path().join(name);
        let text = "version https://git-lfs.github.com/spec/v1\noid sha256:4d7a\nsize 12345\n";
        std::fs::write(&path, text).expect("writable");
        let why = error_of(&path);
        assert!(why.contains(name) && why.contains("is a pointer of git LFS"), "{why}");
    }
}

/// A pipe would be waited for, and a device has no end.
#[test]
fn only_regular_files_are_read() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let images = folder.path().join("images");
    std::fs::create_dir(&images).expect("a folder");
    save_png(&images.join("0.png"), &frame(1)).expect("saved");
    let [inside, pipe, bag] =
        [images.join("a.png"), folder.path().join("a.png"), folder.path().join("a.mcap")];
    for path in [&inside, &pipe, &bag] {
        assert!(std::process::Command::new("mkfifo").arg(path).status().is_ok_and(|made| made.success()));
    }
    for path in [&images, &pipe, &bag, Path::new("/dev/zero")] {
        let named = if *path == *images { &inside } else { path };
        let why = error_of(path);
        assert!(why.contains(&named.display().to_string()) && why.contains("not a regular file"), "{why}");
    }
    for path in [&*bag, Path::new("/dev/zero")] {
        let why = BagReader::open(path).expect_err("not a file").to_string();
        assert!(why.contains("not a regular file"), "{why}");
    }
}

#[test]
fn codes_return_as_fractions_of_the_peak() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let deep = Array3::from_shape_fn((3, 5, 1), |(y, x, _)| (y * 20_000 + x * 999) as u16);
    let deep = Frame::from_u16(deep).expect("3 x 5 x 1");
    save_png(&folder.path().join("b.png"), &deep).expect("saved");
    save_png(&folder.path().join("a.PNG"), &frame(3)).expect("saved");
    std::fs::write(folder.path().join("notes.txt"), "no image").expect("written");
    let frames = frames(folder.path(), 0.0);
    assert_eq!(frames.iter().map(|f| f.name.as_str()).collect::<Vec<_>>(), ["a", "b"]);
    assert_eq!(frames[0].radiance.mapv(|v| (v * 255.0).round()), frame(3).to_f32());
    assert_eq!(frames[1].radiance.mapv(|v| (v * 65536.0).round()), deep.to_f32());
}

#[test]
fn numbers_in_names_are_in_order_of_their_value() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let names = ["1", "2", "9", "10", "a2", "a010", "a10", "b1_9", "b1_10", "b2"];
    for name in names {
        save_png(&folder.path().join(format!("{name}.png")), &frame(1)).expect("saved");
    }
    let found = frames(folder.path(), 0.0);
    assert_eq!(found.iter().map(|f| f.name.as_str()).collect::<Vec<_>>(), names);
}

#[test]
fn hidden_files_are_no_images_and_other_formats_are_counted() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = |name: &str| folder.path().join(name);
    save_png(&path("1.png"), &frame(1)).expect("saved");
    for name in ["._1.png", ".DS_Store", "Thumbs.db", "2.webp", "3.BMP", "._3.bmp"] {
        std::fs::write(path(name), "no image").expect("written");
    }
    assert_eq!(frames(folder.path(), 0.0).len(), 1);
    let source = open(&folder.path().display().to_string(), &SourceOptions::default()).expect("a source");
    let [warning] = &source.warnings[..] else { panic!("one line") };
    assert!(warning.contains("2 images of other formats") && warning.contains("2.webp"), "{warning}");
    let of_one = open(&path("1.png").display().to_string(), &SourceOptions::default()).expect("a source");
    assert!(of_one.warnings.is_empty(), "nobody asked for the folder");
}

#[test]
fn a_file_that_is_no_image_is_named_with_a_remedy_that_works() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = |name: &str| folder.path().join(name);
    let write = |name: &str, content: &[u8]| std::fs::write(path(name), content).expect("written");
    for (name, content, expected) in [
        ("a.gif", &b"GIF89a\x01\0\x01\0"[..], "GIF is not read; convert it to PNG"),
        ("b.pgm", b"P5\n2 2\n255\n\0\0\0\0", "(PBM, PGM or PPM) is not read; convert it to PNG"),
        ("c.NEF", b"MM\0*", "the raw file of a camera (NEF), which is not read; write its raw codes as TIFF"),
    ] {
        write(name, content);
        let why = error_of(&path(name));
        assert!(why.contains(expected) && why.contains(name) && !why.contains("video:"), "{why}");
    }
    let others = error_of(folder.path());
    assert!(
        others.contains("no image in this folder") && others.contains("3 images of other formats"),
        "{others}"
    );
    // The content tells the format.
    save_png(&path("d.png"), &frame(1)).expect("saved");
    std::fs::rename(path("d.png"), path("d.img")).expect("renamed");
    assert_eq!(frames(&path("d.img"), 0.0).len(), 1);
    if let Err(why) = modulo_video::version() {
        return data::skip(&why);
    }
    let video = path("clip.dat");
    let made = "-nostdin -v error -f lavfi -i testsrc=s=64x48 -frames:v 2 -c:v ffv1 -f matroska";
    let made = std::process::Command::new("ffmpeg").args(made.split(' ')).arg(&video).status();
    assert!(made.expect("ffmpeg starts").success());
    let why = error_of(&video);
    let (_, remedy) = why.split_once("such as ").expect("a remedy");
    assert_eq!(frames(Path::new(remedy), 0.0).len(), 2, "{why}");
}

/// A file does not tell that its pixels are a mosaic, but the message does.
#[test]
fn a_compressed_mosaic_is_the_mosaic() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let grey = Array3::from_shape_fn((8, 8, 1), |(y, x, _)| (90 * (y % 2) + 60 * (x % 2)) as u8);
    let grey = Frame::from_u8(grey).expect("8 x 8");
    let png = modulo_images::encode(&grey, modulo_images::FileFormat::Png).expect("encoded");
    let read = |name: &str, type_name: &str, payload: Vec<u8>| {
        let path = folder.path().join(name);
        write_messages(&path, [("/image", type_name, 1, payload)]);
        let coding = Coding { mosaic: Some(modulo_core::Mosaic::Rggb), ..Coding::default() };
        let mut source =
            open(&path.display().to_string(), &SourceOptions { coding, topic: None }).expect("a source");
        source.next().expect("a frame").map(|frame| frame.radiance).map_err(|why| why.to_string())
    };
    let mosaic = grey.clone().with_mosaic(modulo_core::Mosaic::Rggb).expect("a mosaic");
    let raw = encode_frame(&Header::default(), &mosaic).expect("short");
    let raw = read("raw", IMAGE, raw).expect("readable");
    assert_eq!(raw.dim(), (8, 8, 1));
    let mut other =
        open(&folder.path().join("raw").display().to_string(), &SourceOptions::default()).expect("a source");
    let why = other.next().expect("a frame").expect_err("no sensor with a mosaic").to_string();
    assert!(why.contains("set mosaic to rggb"), "{why}");
    let compressed = |name: &str, format: &str| {
        let message = CompressedImage { format: format.into(), data: png.clone(), ..Default::default() };
        read(name, FILE, packed(message))
    };
    assert_eq!(compressed("bayer", "bayer_rggb8; png compressed "), Ok(raw));
    for (name, format) in [("grey", "mono8; png compressed "), ("plain", "png")] {
        assert_eq!(compressed(name, format).expect(format).dim(), (8, 8, 1));
    }
    for (name, format) in
        [("deep", "mono16; jpeg compressed "), ("deep_bayer", "bayer_rggb16; jpeg compressed ")]
    {
        let why = compressed(name, format).expect_err(format);
        assert!(why.contains(format) && why.contains("8 bits"), "{why}");
    }
}

/// The first image ends early, although with an end marker, as from a camera that was unplugged.
#[test]
fn a_damaged_compressed_image_is_named_and_the_next_one_still_comes() {
    let (_guard, path) = temporary("bag");
    let pixels = Array3::from_shape_fn((48, 64, 3), |(y, x, c)| (3 * y + 2 * x + 40 * c) as u8);
    let whole = Frame::from_u8(pixels).expect("48 x 64");
    let whole = modulo_images::encode(&whole, modulo_images::FileFormat::Jpeg).expect("encoded");
    let cut = [&whole[..whole.len() - whole.len() / 4], &[0xff, 0xd9]].concat();
    let file = |data| packed(CompressedImage { format: "jpeg".into(), data, ..Default::default() });
    write_messages(&path, [("/image", FILE, 1, file(cut)), ("/image", FILE, 2, file(whole))]);
    let mut source = open(&path.display().to_string(), &SourceOptions::default()).expect("a source");
    let why = source.next().expect("two").expect_err("the first one is cut").to_string();
    assert!(why.contains("/image at 1") && why.contains("end early"), "{why}");
    assert_eq!(source.next().expect("two").expect("a whole one").radiance.dim(), (48, 64, 3));
}

#[test]
fn linear_values_are_scaled_by_white_and_alpha_is_dropped() {
    let (_folder, path) = temporary("sky.exr");
    ImageBuffer::from_fn(2, 1, |x, _| Rgba([x as f32, 2.0, 4.0, 0.5])).save(&path).expect("saved");
    let frame = frames(&path, 8.0).remove(0);
    assert_eq!(frame.radiance.as_slice(), Some(&[0.0, 0.25, 0.5, 0.125, 0.25, 0.5][..]));
    assert!(frames(&path, 0.0)[0].radiance.iter().all(|v| (0.0..1.0).contains(v)));
}

#[test]
fn codes_are_decoded_and_linear_values_are_not() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let picture = ImageBuffer::from_pixel(2, 1, Rgb([188u8, 188, 188]));
    picture.save(folder.path().join("0.png")).expect("saved");
    let linear = ImageBuffer::from_pixel(2, 1, Rgb([0.5f32, 0.5, 0.5]));
    linear.save(folder.path().join("1.exr")).expect("saved");
    let coding = Coding { transfer: Transfer::Srgb, ..Coding::default() };
    let options = SourceOptions { coding, topic: None };
    let mut source = open(&folder.path().display().to_string(), &options).expect("a source");
    let mut radiance = || source.next().expect("a frame").expect("readable").radiance[(0, 0, 0)];
    let decoded = radiance();
    assert!((decoded - 0.503).abs() < 0.004, "{decoded}");
    assert!(radiance() > 0.99, "the brightest value of an image of one value is full scale");
}

#[test]
fn a_pixel_that_is_not_finite_is_named() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    for (name, value) in [("nan.exr", f32::NAN), ("inf.exr", f32::INFINITY)] {
        let path = folder.path().join(name);
        let pixel = |x, y| if (x, y) == (2, 1) { Rgb([1.0, value, 1.0]) } else { Rgb([1.0; 3]) };
        ImageBuffer::from_fn(4, 3, pixel).save(&path).expect("saved");
        let error = error_of(&path);
        assert!(error.contains(name) && error.contains("row 1, column 2, channel 1"), "{error}");
    }
}

#[test]
fn a_cut_png_is_named_and_the_next_image_still_comes() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let cut = folder.path().join("a.png");
    save_png(&cut, &frame(1)).expect("saved");
    save_png(&folder.path().join("b.png"), &frame(2)).expect("saved");
    let bytes = std::fs::read(&cut).expect("read");
    for length in 0..bytes.len() - 12 {
        std::fs::write(&cut, &bytes[..length]).expect("written");
        assert!(error_of(&cut).contains("a.png"), "{length} bytes");
    }
    let mut source = open(&folder.path().display().to_string(), &SourceOptions::default()).expect("a source");
    assert!(source.next().expect("the cut one").is_err());
    assert_eq!(source.next().expect("another").expect("a whole one").name, "b");
    assert!(source.next().is_none());
}

#[test]
fn what_is_not_there_is_named_with_what_is_possible() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let missing = error_of(&folder.path().join("nowhere"));
    assert!(
        missing.contains("nowhere") && missing.contains("folder of images") && missing.contains("topic:NAME"),
        "{missing}"
    );
    let empty = error_of(folder.path());
    assert!(empty.contains("no image") && empty.contains("png"), "{empty}");
    let text = folder.path().join("a.txt");
    std::fs::write(&text, "text").expect("written");
    assert!(error_of(&text).contains("not an image"));
    let white = SourceOptions { coding: Coding { white: -1.0, ..Coding::default() }, topic: None };
    save_png(&folder.path().join("a.png"), &frame(1)).expect("saved");
    let error = open(&folder.path().display().to_string(), &white).err().expect("refused").to_string();
    assert!(error.contains("white = -1"), "{error}");
}

#[test]
fn labels_come_with_their_frames() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    write_kitti(folder.path(), 3);
    let frames = frames(folder.path(), 0.0);
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
    let classes: Vec<_> = frames(folder.path(), 0.0)
        .into_iter()
        .map(|f| f.ground_truth.expect("labelled")[0].class.clone())
        .collect();
    assert_eq!(classes, ["car", "van"]);
}

/// Writes the frames of [`write_kitti`] and their labels as a bag, 10 Hz.
fn bag_of(kitti: &Path, out: &Path) {
    let messages = (0..).zip(frames(kitti, 0.0)).flat_map(|(number, read)| {
        let stamp = u64::from(number) * 100_000_000;
        let header = Header { stamp: Time::from_ns(stamp), frame_id: "camera_optical".into() };
        let labels = read.ground_truth.map(|labels| {
            let message = cdr::to_vec(&to_detections(&labels, &header)).expect("short");
            ("/ground_truth", "vision_msgs/msg/Detection2DArray", stamp, message)
        });
        let image = encode_frame(&header, &frame(number)).expect("short");
        [("/camera/image_raw", IMAGE, stamp, image)].into_iter().chain(labels)
    });
    write_messages(out, messages);
}

#[test]
fn a_bag_of_a_folder_is_the_folder() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let (kitti, bag) = (folder.path().join("kitti"), folder.path().join("bag"));
    write_kitti(&kitti, 15);
    bag_of(&kitti, &bag);
    for compression in COMPRESSIONS {
        let out = folder.path().join(format!("{compression:?}"));
        copy(&BagReader::open(&bag).expect("a bag"), &out, compression).expect("copied");
        let (from_files, from_bag) = (frames(&kitti, 0.0), frames(&out, 0.0));
        assert_eq!(from_files.len(), from_bag.len());
        for (i, (file, bag)) in from_files.iter().zip(&from_bag).enumerate() {
            assert_eq!(bag.stamp_ns, Some(i as u64 * 100_000_000));
            assert_eq!(bag.radiance, file.radiance);
            assert_eq!(bag.ground_truth, file.ground_truth);
            assert_eq!(bag.frame_id, "camera_optical");
        }
        let bag = BagReader::open(&out).expect("a bag");
        assert_eq!(read_all(&bag, &Selection::of(["/ground_truth"])).len(), 8);
    }
}

#[test]
fn a_bad_label_costs_only_itself() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    write_kitti(folder.path(), 1);
    let whole = frames(folder.path(), 0.0);
    let label = folder.path().join("label_2/000000.txt");
    let text = std::fs::read_to_string(&label).expect("read");
    std::fs::write(&label, format!("Car 0 0 1 2 3\n\n{text}Van top\n")).expect("written");
    assert_eq!(frames(folder.path(), 0.0), whole);
    let source = open(&folder.path().display().to_string(), &SourceOptions::default()).expect("a source");
    let [line] = &source.losses[..] else { panic!("one line") };
    assert!(line.starts_with("2 labels cannot be read and are left out, the first: "), "{line}");
    assert!(
        line.ends_with(
            "000000.txt:1: 6 columns found, 15 needed (17 for tracking, and one more with a score)"
        ),
        "{line}"
    );
    // Where nothing of a file can be read, it is not known what is on the image.
    std::fs::write(&label, [0xff, 0xc0]).expect("written");
    let why = error_of(folder.path());
    assert!(why.contains("000000.txt: is no UTF-8 text"), "{why}");
}

#[test]
fn an_unknown_topic_names_those_there_are() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let (kitti, out) = (folder.path().join("kitti"), folder.path().join("out"));
    write_kitti(&kitti, 1);
    bag_of(&kitti, &out);
    let refusal = |path: &Path, topic: Option<&str>| {
        let options = SourceOptions { topic: topic.map(str::to_owned), ..SourceOptions::default() };
        open(&path.display().to_string(), &options).err().expect("refused").to_string()
    };
    let error = refusal(&out, Some("/image"));
    assert!(error.contains("'/image'") && error.contains("/camera/image_raw"), "{error}");

    let two = folder.path().join("two");
    write_messages(&two, ["/left/image_raw", "/right/image_raw"].map(|name| (name, IMAGE, 1, Vec::new())));
    let error = refusal(&two, None);
    let way = "2 image topics; image topics here: /left/image_raw, /right/image_raw; choose one by \
               'source_topic:=/left/image_raw' behind a launch file, or by -p 'source_topic:=/left/image_raw'";
    assert!(error.contains(way), "{error}");
}

/// Opens the source, reads it whole, returns (frames, labelled objects).
fn walk(path: &Path, topic: Option<&str>) -> (usize, usize) {
    let options = SourceOptions { topic: topic.map(str::to_owned), ..SourceOptions::default() };
    let mut source = open(&path.display().to_string(), &options).unwrap_or_else(|e| panic!("{e}"));
    let (mut frames, mut objects) = (0, 0);
    for frame in source.by_ref() {
        let frame = frame.unwrap_or_else(|e| panic!("{e}"));
        assert!(frame.radiance.iter().all(|v| (0.0..1.0).contains(v)), "{}", frame.name);
        assert!(frame.radiance.iter().any(|v| *v > 0.1), "{} is dark", frame.name);
        let labels = frame.ground_truth.unwrap_or_default();
        frames += 1;
        objects += labels.iter().filter(|label| label.class != "dontcare").count();
    }
    assert_eq!(source.len, Some(frames));
    (frames, objects)
}

#[test]
fn recordings_of_others_are_read_whole() {
    let Some(data) = data::shared("data") else { return };
    let folder = tempfile::tempdir().expect("a temporary folder");
    for (name, storage, messages) in [
        ("rerun_rosbag2_2025_09_10-13_03_56_0.mcap", "mcap", 194),
        ("rosbag2/rosbag2_py/test/resources/mcap/talker", "mcap", 20),
        ("rosbag2/rosbag2_tests/resources/mcap/cdr_test", "mcap", 7),
        ("rosbags-rs/test_bag_mcap", "mcap", 188),
        ("derived_kitti/drive_0011_5f_png_mcap", "mcap", 5),
        ("rosbag2/rosbag2_py/test/resources/sqlite3/talker", "sqlite3", 20),
        ("rosbag2/rosbag2_tests/resources/sqlite3/cdr_test", "sqlite3", 7),
        ("rosbags-rs/test_bag_sqlite3", "sqlite3", 188),
        ("rosbags-rs/test_bag_sqlite3/test_bag_sqlite3.db3", "sqlite3", 188),
    ] {
        let bag = BagReader::open(&data.join("bags").join(name)).unwrap_or_else(|e| panic!("{e}"));
        let read = read_all(&bag, &Selection::default());
        assert_eq!((read.len(), bag.message_count()), (messages, messages as u64), "{name}");
        assert!(read.is_sorted_by_key(|m| m.log_time), "{name}");
        assert!(read.iter().all(|m| m.data.starts_with(&[0, 1, 0, 0])), "{name}");
        assert!(!bag.warnings().iter().any(|w| w.is_loss()), "{name}: {:?}", bag.warnings());
        let info = BagInfo(&bag).to_string();
        for line in [format!("Storage id:        {storage}"), format!("Messages:          {messages}")] {
            assert!(info.lines().any(|l| l == line), "{name}: {line}\nnot in\n{info}");
        }
        let out = folder.path().join(name.replace(['/', '.'], "_"));
        copy(&bag, &out, Compression::Zstd).expect("copied");
        assert_eq!(BagReader::open(&out).expect("a bag").message_count(), messages as u64, "{name}");
    }
}

#[test]
fn both_storages_hold_the_same() {
    let Some(data) = data::shared("data") else { return };
    for (mcap, sqlite) in [
        ("rosbag2/rosbag2_tests/resources/mcap/cdr_test", "rosbag2/rosbag2_tests/resources/sqlite3/cdr_test"),
        ("rosbag2/rosbag2_py/test/resources/mcap/talker", "rosbag2/rosbag2_py/test/resources/sqlite3/talker"),
    ] {
        let [mcap, sqlite] = [mcap, sqlite].map(|name| {
            let bag = BagReader::open(&data.join("bags").join(name)).unwrap_or_else(|e| panic!("{e}"));
            let mut all: Vec<_> = read_all(&bag, &Selection::default())
                .into_iter()
                .map(|m| (m.log_time, m.topic.name.clone(), m.topic.type_name.clone(), m.data))
                .collect();
            all.sort();
            all
        });
        assert!(!mcap.is_empty() && mcap == sqlite);
    }
}

#[test]
fn images_of_recordings_are_frames() {
    let Some(data) = data::shared("data") else { return };
    let rerun = data.join("bags/rerun_rosbag2_2025_09_10-13_03_56_0.mcap");
    let error = open(&rerun.display().to_string(), &SourceOptions::default()).err().expect("two topics");
    assert!(error.to_string().contains("/compressed_image, /image"), "{error}");
    for topic in ["/compressed_image", "/image"] {
        assert!(walk(&rerun, Some(topic)).0 > 0, "{topic}");
    }
    assert_eq!(walk(&data.join("bags/derived_kitti/drive_0011_5f_png_mcap"), None), (5, 0));
}

#[test]
fn kitti_folders_are_read_whole() {
    let Some(data) = data::shared("data") else { return };
    for (name, frames, objects) in
        [("kitti_object", 20, 105), ("kitti_object_crop", 3, 12), ("kitti_seq/drive_0011", 21, 37)]
    {
        assert_eq!(walk(&data.join(name), None), (frames, objects), "{name}");
    }
}

#[test]
fn high_dynamic_range_files_load() {
    let Some(data) = data::shared("data") else { return };
    assert_eq!(walk(&data.join("hdr/polyhaven"), None), (4, 0));
    assert_eq!(walk(&data.join("hdr/openexr_images/ScanLines_Desk.exr"), None), (1, 0));
    assert_eq!(walk(&data.join("bdd/unlabelled"), None), (3, 0));
}

/// The calibration in a bag is that of the camera whose images are read, also where these are files.
#[test]
fn a_bag_has_the_camera_info_beside_its_images() {
    const INFO: &str = "sensor_msgs/msg/CameraInfo";
    let (_guard, path) = temporary("calibrated");
    let info = |width| CameraInfo { width, k: [500.0; 9], ..CameraInfo::default() };
    let encoded = |width| cdr::to_vec(&info(width)).expect("encodes");
    let image = encode_frame(&Header::default(), &frame(1)).expect("encodes");
    let file = packed(CompressedImage { format: "png".into(), ..CompressedImage::default() });
    let messages = [
        ("/front/image_raw", IMAGE, 5, image.clone()),
        ("/image", IMAGE, 5, image),
        ("/rear/image/compressed", FILE, 5, file),
        ("/front/camera_info", INFO, 12, encoded(6)),
        ("/front/camera_info", INFO, 13, encoded(7)),
        ("/rear/camera_info", INFO, 14, encoded(8)),
    ];
    write_messages(&path, messages);
    for (topic, expected) in
        [("/front/image_raw", Some(info(6))), ("/rear/image/compressed", Some(info(8))), ("/image", None)]
    {
        let options = SourceOptions { topic: Some(topic.into()), ..SourceOptions::default() };
        let source = open(&path.display().to_string(), &options).expect("a source");
        assert_eq!(source.camera_info.as_deref(), expected.as_ref(), "{topic}");
    }
}

/// The largest code of a stream is full scale, whatever its encoding could hold.
#[test]
fn recorded_codes_have_the_bits_of_the_sensor_beside_them() {
    let (_guard, path) = temporary("described");
    let (mut topics, mut messages) = (Vec::new(), Vec::new());
    for (camera, bits) in [("/six", 6), ("/fourteen", 14)] {
        let sensor = SensorModel { bits, alpha: 2.0, headroom: 1.0, ..SensorModel::default() };
        // The rest is told by names, as in bags of earlier versions.
        let odd = format!("/odd{camera}");
        let streams = [(&*odd, StreamKind::Saturated)];
        let info = sensor_info::message((&Header::default(), (2, 3)), &sensor, camera, streams)
            .encode()
            .expect("encodes");
        messages.push((format!("{camera}/sensor_info"), "diagnostic_msgs/msg/DiagnosticArray", info));
        for (stream, code) in
            [("saturated", 1u16 << (bits - 1)), ("hdr", 1 << bits), ("ideal", 128), ("image", 128)]
        {
            let pixels = Array3::from_elem((2, 3, 1), code);
            let is_deep = stream == "hdr" || (stream == "saturated" && bits > 8);
            let frame =
                if is_deep { Frame::from_u16(pixels) } else { Frame::from_u8(pixels.mapv(|v| v as u8)) };
            let image = encode_frame(&Header::default(), &frame.expect("a frame")).expect("encodes");
            let names = [format!("{camera}/{stream}"), odd.clone()];
            for topic in names.into_iter().take(if stream == "saturated" { 2 } else { 1 }) {
                topics.push(topic.clone());
                messages.push((topic, IMAGE, image.clone()));
            }
        }
    }
    write_messages(&path, messages.iter().map(|(topic, name, data)| (&**topic, *name, 5, data.clone())));
    for topic in topics {
        let options = SourceOptions { topic: Some(topic.clone()), ..SourceOptions::default() };
        let mut source = open(&path.display().to_string(), &options).expect("a source");
        let radiance = source.next().expect("a frame").expect("readable").radiance[(0, 0, 0)];
        assert!((radiance - 0.5).abs() < 0.02, "{topic}: {radiance}");
    }
}
