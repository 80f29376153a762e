//! The layouts in which programs write labelled images, each with one car in the frame `a` for validation.

use std::path::Path;

use modulo_bags::source::{Source, SourceFrame, SourceOptions, open};
use modulo_images::save_png;

use crate::frame;

/// Makes files: images by their names, and texts.
fn written(files: &[(&str, &str)]) -> tempfile::TempDir {
    let folder = tempfile::tempdir().expect("a temporary folder");
    for (name, text) in files {
        let path = folder.path().join(name);
        std::fs::create_dir_all(path.parent().expect("a folder")).expect("made");
        match text.is_empty() {
            true => save_png(&path, &frame(1)).expect("saved"),
            false => std::fs::write(&path, text).expect("written"),
        }
    }
    folder
}

fn yolo(path: &Path) -> Result<Source, String> {
    Source::yolo(path, &SourceOptions::default()).map_err(|why| why.to_string())
}

fn all(source: &mut Source) -> Vec<SourceFrame> {
    source.map(|frame| frame.expect("readable")).collect()
}

/// A car, and beside the labels in the data set of another part a bus.
const CAR: &str = "1 0.5 0.5 0.5 0.5\n";
const BUS: &str = "0 0.5 0.5 0.5 0.5\n";
const NAMES: &str = "nc: 2\nnames: ['bus', 'car']\n";

/// Checks that the data set at `path` has just the frame `a` with a car.
fn assert_car(folder: &Path, path: &str) {
    let mut source = yolo(&folder.join(path)).expect(path);
    let frames = all(&mut source);
    let found = frames.iter().map(|frame| {
        let labels = frame.ground_truth.as_ref().expect("labelled");
        (frame.name.as_str(), labels.iter().map(|label| label.class.as_str()).collect::<Vec<_>>())
    });
    assert_eq!(found.collect::<Vec<_>>(), [("a", vec!["car"])], "{path}");
    assert_eq!([source.losses, source.warnings].concat(), [""; 0], "{path}");
}

#[test]
fn a_data_set_of_ultralytics_is_read_by_its_yaml_and_by_its_folders() {
    let yaml = |head: &str| {
        format!("{head}train: images/train\nval: images/val # people\ntest:\nnames:\n  0: bus\n  1: car\n")
    };
    for head in ["", "path: .\n", "path: ../data\n", "path: /content/gone/data\n", "path: C:\\data\n"] {
        let folder = written(&[
            ("data/images/train/b.png", ""),
            ("data/labels/train/b.txt", BUS),
            ("data/images/val/a.png", ""),
            ("data/labels/val/a.txt", CAR),
            ("data/data.yaml", &yaml(head)),
        ]);
        for path in ["data/data.yaml", "data/images/val"] {
            assert_car(folder.path(), path);
        }
        let why = yolo(&folder.path().join("data")).err().expect("two parts");
        let images = folder.path().join("data/images").display().to_string();
        assert!(
            why.ends_with(&format!("has the subfolders train, val: choose --yolo {images}/val")),
            "{why}"
        );
    }
    // A file that names only the classes describes its folder.
    let folder = written(&[("images/a.png", ""), ("labels/a.txt", CAR), ("data.yaml", NAMES)]);
    assert_car(folder.path(), "data.yaml");
    assert_car(folder.path(), "");
    // As `yolo` unpacks coco8: the file of the data set lies above.
    let folder = written(&[
        ("coco8/images/train/b.png", ""),
        ("coco8/images/val/a.png", ""),
        ("coco8/labels/val/a.txt", CAR),
        ("coco8.yaml", &yaml("path: coco8 # dataset root dir\n")),
    ]);
    assert_car(folder.path(), "coco8.yaml");
    // Folders below the one that is named, lists, and other words for the part.
    for val in [
        "val: images",
        "val: [images/x, images/y/z]",
        "validation: list.txt",
        "val: ./list.txt",
        "train: list.txt",
    ] {
        let folder = written(&[
            ("images/x/notes.md", "no image"),
            ("images/y/z/a.png", ""),
            ("labels/y/z/a.txt", CAR),
            ("list.txt", "./images/y/z/a.png\r\n\r\n"),
            ("data.yaml", &format!("{val}\n{NAMES}")),
        ]);
        assert_car(folder.path(), "data.yaml");
    }
}

#[test]
fn a_data_set_of_roboflow_is_read_by_its_yaml_and_by_its_folders() {
    let folder = written(&[
        ("set/train/images/b.png", ""),
        ("set/train/labels/b.txt", BUS),
        ("set/valid/images/a.png", ""),
        ("set/valid/labels/a.txt", CAR),
        ("set/test/images/c.png", ""),
        (
            "set/data.yaml",
            &format!("train: ../train/images\nval: ../valid/images\ntest: ../test/images\n\n{NAMES}"),
        ),
    ]);
    for path in ["set/data.yaml", "set/valid", "set/valid/images"] {
        assert_car(folder.path(), path);
    }
    let why = yolo(&folder.path().join("set")).err().expect("three parts");
    assert!(
        why.contains("has the subfolders test/images, train/images, valid/images: choose --yolo "),
        "{why}"
    );
    assert!(why.ends_with("set/valid/images"), "{why}");
}

#[test]
fn a_data_set_of_cvat_or_darknet_is_read_by_its_folder_its_list_and_its_description() {
    for line in [
        "data/obj_train_data/sub/a.png",
        "C:\\data\\obj_train_data\\sub\\a.png",
        "/gone/obj_train_data/sub/a.png",
    ] {
        let folder = written(&[
            ("set/obj_train_data/sub/a.png", ""),
            ("set/obj_train_data/sub/a.TXT", CAR),
            ("set/obj.names", "bus\ncar\n"),
            (
                "set/obj.data",
                "classes = 2\ntrain = data/train.txt\nnames = data/obj.names\nbackup = backup/\n",
            ),
            ("set/train.txt", &format!("\u{feff}{line}\r\n")),
        ]);
        for path in ["set", "set/train.txt", "set/obj.data", "set/obj_train_data"] {
            assert_car(folder.path(), path);
        }
    }
    // Side by side, as Roboflow exports for darknet.
    let folder = written(&[("a.png", ""), ("a.txt", CAR), ("_darknet.labels", "bus\ncar\n")]);
    assert_car(folder.path(), "");
}

#[test]
fn a_part_that_is_not_there_is_named() {
    for (text, expected) in [
        ("val: images/val\n", "val: 'images/val' is found neither in"),
        ("train: a\ntest: b\n", "has no `val` but train, test; give the folder of the images"),
        ("names: [car]\n", "no image in this folder, at least one png"),
        ("val: .\n", "val has no image"),
        ("val: [", "data.yaml:2: not YAML"),
    ] {
        let folder = written(&[("data.yaml", text)]);
        let why = yolo(&folder.path().join("data.yaml")).err().expect(text);
        assert!(why.contains(expected) && why.contains(&folder.path().display().to_string()), "{why}");
    }
    let folder = written(&[("list.txt", "a.png\ngone.png\n"), ("a.png", ""), ("a.txt", CAR), ("b.txt", BUS)]);
    let mut source = yolo(&folder.path().join("list.txt")).expect("one image");
    assert!(source.next().expect("two").is_ok());
    let why = source.next().expect("two").expect_err("gone").to_string();
    assert!(why.contains("gone.png: No such file"), "{why}");
    assert_eq!(source.warnings, [""; 0], "labels of other images are left out on purpose");
    for (path, expected) in [("a.png", "its data.yaml, or a list"), ("gone", "no such file or folder")] {
        assert!(yolo(&folder.path().join(path)).err().expect(path).contains(expected));
    }
}

#[test]
fn a_row_that_cannot_be_read_costs_only_itself() {
    let rows = "1 0.5 0.5 0.5\r\n1 0.5 0.5 0.5 0.5 0.5\r\ncar 0.5 0.5 0.5 0.5\r\n1 0.5 0.5 1.5 0.5\r\n9 0.5 0.5 0.5 0.5\r\n1 0.5 nan 0.5 0.5\r\n";
    let folder =
        written(&[("images/a.PNG", ""), ("labels/a.txt", &format!("{rows}{CAR}")), ("data.yaml", NAMES)]);
    let mut source = yolo(folder.path()).expect("an image");
    assert_eq!(all(&mut source)[0].ground_truth.as_ref().map(Vec::len), Some(1));
    let [line] = &source.losses[..] else { panic!("one line") };
    assert!(line.starts_with("6 labels cannot be read and are left out, the first: "), "{line}");
    assert!(line.contains("a.txt:1: 4 columns found"), "{line}");
}

#[test]
fn the_images_of_a_camera_may_lie_in_data_below_it() {
    let folder = written(&[
        ("drive/image_00/data/0.png", ""),
        ("drive/image_02/data/0000000000.png", ""),
        ("drive/image_02/timestamps.txt", "2011-09-26 13:02:25\n"),
        ("mav0/cam0/data/1403636579763555584.png", ""),
        ("mav0/cam1/data/1403636579763555584.png", ""),
        ("mav0/cam0/data.csv", "#timestamp\n"),
        ("root/training/image_2/000000.png", ""),
    ]);
    let opened =
        |path: &str| open(&folder.path().join(path).display().to_string(), &SourceOptions::default());
    for path in ["drive", "drive/image_02", "drive/image_02/data", "mav0/cam1"] {
        assert_eq!(all(&mut opened(path).expect(path)).len(), 1, "{path}");
    }
    let named = opened("mav0").err().expect("two cameras").to_string();
    assert!(named.contains("has the subfolders cam0/data, cam1/data: choose "), "{named}");
    let named = opened("root").err().expect("a folder above").to_string();
    assert!(named.contains("training/image_2"), "{named}");
    let kitti = Source::kitti(&folder.path().join("root"), None, &SourceOptions::default());
    let named = kitti.err().expect("a folder above").to_string();
    assert!(named.contains("as ") && named.ends_with("root/training has"), "{named}");
}
