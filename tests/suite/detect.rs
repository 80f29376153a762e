//! `modulo detect`: pictures as they are, with their names, and the boxes of a model on them.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use image::{GrayImage, Luma, Rgb, RgbImage};
use modulo_bags::bag::{BagTopic, BagWriter, Compression};
use modulo_core::{Frame, Mosaic};
use modulo_msgs::image::encode_frame;
use modulo_msgs::std_msgs::Header;
use modulo_runtime::Qos;
use ndarray::Array3;
use serde_json::json;

use super::outputs::files;
use crate::harness::{Bench, assert_has, data};

/// Boxes of no score at all are drawn.
const NO_BOX: &str = "score_threshold:=1.0";

fn noise(x: u32, y: u32) -> u8 {
    (x.wrapping_mul(7919) ^ y.wrapping_mul(104_729)).wrapping_mul(2_654_435_761).to_be_bytes()[0]
}

/// Writes pictures of noise with these names, whose extensions tell their formats.
fn pictures(folder: &Path, names: &[&str]) {
    for name in names {
        let path = folder.join(name);
        std::fs::create_dir_all(path.parent().expect("a folder")).expect("writable");
        let colour = RgbImage::from_fn(96, 64, |x, y| Rgb([noise(x, y), noise(y, x), noise(x + 1, y)]));
        colour.save(path).expect("writable");
    }
}

fn rgb(path: PathBuf) -> RgbImage {
    image::open(&path).unwrap_or_else(|why| panic!("{}: {why}", path.display())).into_rgb8()
}

/// The names of all files below a folder.
fn names(folder: &Path) -> BTreeSet<String> {
    let name = |path: &PathBuf| path.strip_prefix(folder).expect("below").display().to_string();
    files(folder).keys().map(name).collect()
}

#[test]
fn pictures_keep_their_pixels_names_and_folders() {
    let bench = Bench::new();
    let folder = bench.path("in");
    let coloured = ["000010.png", "left/000010.png", "left/far/1.5 m.png", "right/b.PNG", "c.jpg"];
    pictures(&folder, &coloured);
    GrayImage::from_fn(40, 30, |x, y| Luma([noise(x, y)])).save(folder.join("grey.png")).expect("writable");
    let before = files(&folder);
    let message = bench.says(0, &format!("detect @/in --model % -o @/out {NO_BOX}"));
    assert_has(&message, &["out/left/far/1.5 m.png: no object", "6 pictures, 0 objects"]);
    assert_eq!(files(&folder), before, "the source is only read");
    let expected = ["000010", "c", "grey", "left/000010", "left/far/1.5 m", "right/b"];
    assert_eq!(names(&bench.path("out")), expected.map(|name| format!("{name}.png")).into());
    for name in coloured.iter().chain(&["grey.png"]).filter(|name| **name != "c.jpg") {
        let written = bench.path("out").join(name).with_extension("png");
        assert_eq!(rgb(written), rgb(folder.join(name)), "{name}");
    }
    // The results of an earlier run in the folder are no pictures of it.
    let again = |number: u32| {
        let mut run = bench.modulo(&["detect", ".", "--model", &bench.words("%")[0], NO_BOX]);
        let output = run.current_dir(&folder).output().expect("it starts");
        assert_has(
            &crate::harness::text(&output),
            &[&format!("6 pictures, 0 objects: runs/detect/{number}")],
        );
    };
    again(1);
    again(2);
    assert_eq!(files(&folder).len(), before.len() + 12, "nothing else is written");
}

/// The model finds boxes at known places: `nodes/detector/tests/data/make_models.py`.
#[test]
fn boxes_are_drawn_and_written_as_other_programs_read_them() {
    let bench = Bench::new();
    pictures(&bench.path("in"), &["000010.png"]);
    let wanted = "detect @/in --model % -o @/out --save-txt --save-conf --save-coco classes:=[car]";
    assert_has(&bench.says(0, wanted), &["out/000010.png: 1 car", "1 picture, 1 object"]);
    let (drawn, plain) = (rgb(bench.path("out/000010.png")), rgb(bench.path("in/000010.png")));
    let entry = bench.json("out/predictions.json")[0].clone();
    let [x, y, w, h] = [0, 1, 2, 3].map(|at| entry["bbox"][at].as_f64().expect("a number"));
    assert_eq!(entry["image_id"], json!(10));
    assert_eq!((&entry["category_name"], &entry["file_name"]), (&json!("car"), &json!("000010.png")));
    let inside = |px: u32, py: u32| {
        let (px, py) = (f64::from(px), f64::from(py));
        // The line around a box, and its label, are at most 24 px wide.
        px > x - 3.0 && px < x + w + 60.0 && py > y - 24.0 && py < y + h + 24.0
    };
    let changed = drawn.enumerate_pixels().filter(|(x, y, pixel)| *pixel != plain.get_pixel(*x, *y));
    let changed: Vec<_> = changed.map(|(x, y, _)| (x, y)).collect();
    assert!(
        !changed.is_empty() && changed.iter().all(|(x, y)| inside(*x, *y)),
        "{x} {y} {w} {h}: {changed:?}"
    );
    let text = std::fs::read_to_string(bench.path("out/labels/000010.txt")).expect("written");
    let fields: Vec<f64> = text.split_whitespace().map(|field| field.parse().expect("a number")).collect();
    let score = entry["score"].as_f64().expect("a number");
    let expected = [2.0, (x + w / 2.0) / 96.0, (y + h / 2.0) / 64.0, w / 96.0, h / 64.0, score];
    assert_eq!((text.lines().count(), fields.len()), (1, 6), "{text}");
    assert!(fields.iter().zip(expected).all(|(is, shall)| (is - shall).abs() < 1e-4), "{text}: {expected:?}");
    assert_eq!(entry["category_id"], json!(3), "counted from 1 where the model is none of COCO");
}

#[test]
fn a_damaged_picture_is_named_and_counted() {
    let bench = Bench::new();
    pictures(&bench.path("in"), &["a.png", "b.png"]);
    let whole = std::fs::read(bench.path("in/a.png")).expect("there");
    std::fs::write(bench.path("in/a.png"), &whole[..whole.len() / 2]).expect("writable");
    let message = bench.says(3, "detect @/in --model % -o @/out");
    assert_has(&message, &["in/a.png: is truncated", "cannot be read: 1", "1 picture, "]);
    assert_eq!(names(&bench.path("out")), ["b.png".to_owned()].into());
    bench.says(3, "detect @/in/a.png --model % -o @/none");
    assert!(!bench.path("none").exists());
}

#[test]
fn what_cannot_be_detected_is_refused_before_anything_is_written() {
    let bench = Bench::new();
    pictures(&bench.path("in"), &["a.png"]);
    pictures(&bench.path("twice"), &["a.png", "a.jpg"]);
    pictures(&bench.path("numbers"), &["1.png", "01.png"]);
    std::fs::create_dir(bench.path("empty")).expect("writable");
    std::fs::write(bench.path("note.txt"), "no picture").expect("writable");
    for (line, named) in [
        ("@/none.png --model %", &["none.png", "no such path"][..]),
        ("@/empty --model %", &["empty", "no image"]),
        ("@/note.txt --model %", &["note.txt", "not an image"]),
        ("@/twice --model %", &["a.jpg and ", "a.png", "rename"]),
        ("@/numbers --model % --save-coco", &["01.png", "rename"]),
        ("@/in", &["rendered scenes", "modulo model fetch yolov10n", "--model yolov10n.onnx"]),
        ("@/in/a.png --model demo", &["rendered scenes"]),
        ("@/in --model /no.onnx", &["/no.onnx", "No such file"]),
        ("@/in --model % alhpa:=4", &["alhpa"]),
        ("@/in --model % input:=recovered", &["input:=recovered", "modulo eval"]),
        ("@/in @/in --model %", &["second source"]),
        ("@/in --model % score_threshold=0.5", &["write score_threshold:=0.5"]),
        ("@/in --model % white:=much", &["white:=much"]),
        ("@/in --model % white:=-5", &["white = -5"]),
        ("@/in --model % --save-conf", &["--save-txt"]),
    ] {
        assert_has(&bench.says(2, &format!("detect {line} -o @/out")), named);
        assert!(!bench.path("out").exists(), "{line}");
    }
    let before = files(&bench.path("in"));
    assert_has(&bench.says(2, "detect @/in --model % -o @/in"), &["not empty"]);
    assert_eq!(files(&bench.path("in")), before);
    bench.says(0, "detect @/numbers --model % -o @/out");
}

/// Two images of one stamp have names of their own, and a raw mosaic has colours.
#[test]
fn images_of_a_bag_are_shown_as_recorded() {
    let bench = Bench::new();
    let colour = Array3::from_shape_fn((64, 96, 3), |(y, x, c)| noise(x as u32 + 100 * c as u32, y as u32));
    let colour = Frame::from_u8(colour).expect("a frame");
    let grey = Frame::from_u8(Array3::from_elem((64, 96, 1), 99)).expect("a frame");
    let raw = grey.with_mosaic(Mosaic::Rggb).expect("one channel");
    let mut bag = BagWriter::create(&bench.path("bag"), Compression::None).expect("a new bag");
    let topic = bag.topic(&BagTopic::new("/raw", "sensor_msgs/msg/Image", Qos::Images)).expect("a topic");
    for (time, frame) in [(1, &colour), (2, &raw)] {
        let image = encode_frame(&Header::default(), frame).expect("short");
        bag.write(topic, time, time, &image).expect("writable");
    }
    bag.finish().expect("writable");
    bench.says(0, &format!("detect @/bag --model % -o @/out {NO_BOX}"));
    assert_eq!(names(&bench.path("out")), ["0.png", "0_1.png"].map(str::to_owned).into());
    let written = rgb(bench.path("out/0.png"));
    assert!(written.into_raw() == colour.as_u8().expect("8 bits").as_slice().expect("in order"));
    assert!(rgb(bench.path("out/0_1.png")).pixels().all(|pixel| pixel.0 == [99; 3]));
}

#[test]
fn the_embedded_model_looks_at_scenes() {
    let bench = Bench::new();
    let message =
        bench.says(0, "detect scene://day?seed=1&frames=2&width=640&height=192 -o @/out engine:=rten");
    assert_has(&message, &["out/000000.png: ", "out/000001.png: ", " car", "2 pictures"]);
    assert_eq!(rgb(bench.path("out/000000.png")).dimensions(), (640, 192));
}

#[test]
fn the_limit_of_the_embedded_model_is_told_once() {
    let bench = Bench::new();
    bench.images(2);
    let (scene, file) =
        ("scene://day?seed=1&frames=2&width=320&height=192", "launch/compare.launch.yaml engine:=rten");
    let images = bench.folder.path().join("images");
    let images = images.display();
    for (line, times) in [
        (format!("eval {file} source:={images} -o @/a"), 1),
        (format!("eval {file} source:={images} model:=% -o @/b"), 0),
        (format!("eval {file} source:={scene} -o @/c"), 0),
        (format!("eval --source {images} --engine rten -o @/d"), 1),
        (format!("eval --source {scene} --engine rten -o @/e"), 0),
        (format!("launch {file} source:={images}"), 1),
        (format!("launch {file} source:={scene}"), 0),
    ] {
        let message = bench.says(0, &line);
        assert_eq!(message.matches("knows rendered scenes").count(), times, "{line}\n{message}");
    }
}

/// The number of boxes is that which ONNX Runtime of PyPI finds in Python on the same pictures, with the letterbox of the detector.
#[test]
fn real_pictures_have_the_boxes_of_onnx_runtime() {
    let (Some(folder), Some(model)) =
        (data::shared("data/kitti_object"), data::shared("models/yolov10n_dyn_w16.onnx"))
    else {
        return;
    };
    let bench = Bench::new();
    let (folder, model) = (folder.display().to_string(), model.display().to_string());
    let out = bench.path("out").display().to_string();
    let message = bench.ends(0, &["detect", &folder, "--model", &model, "-o", &out, "--save-coco"]);
    assert_has(&message, &["20 pictures, 160 objects"]);
    let pictures = names(&bench.path("out"));
    let source: BTreeSet<_> =
        names(Path::new(&folder)).into_iter().filter(|name| name.ends_with("png")).collect();
    assert_eq!(pictures.into_iter().filter(|name| name.ends_with("png")).collect::<BTreeSet<_>>(), source);
}
