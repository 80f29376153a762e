//! Image files as a source.

use std::path::Path;

use image::{ImageBuffer, Rgb, Rgba};
use modulo_bags::source::{SourceFrame, SourceOptions, open};
use modulo_core::Frame;
use modulo_images::save_png;
use ndarray::Array3;

use crate::writing::{frame, temporary};

fn error_of(path: &Path) -> String {
    match open(&path.display().to_string(), &SourceOptions::default()) {
        Err(error) => error.to_string(),
        Ok(mut source) => source.next().expect("a frame").expect_err("a bad frame").to_string(),
    }
}

fn frames(path: &Path, white: f32) -> Vec<SourceFrame> {
    let options = SourceOptions { white, topic: None };
    let mut source = open(&path.display().to_string(), &options).expect("a source");
    let mut all = || std::iter::from_fn(|| source.next()).collect::<Result<Vec<_>, _>>().expect("frames");
    let first = all();
    assert_eq!(source.len(), Some(first.len()));
    source.rewind().expect("rewound");
    assert_eq!(std::iter::from_fn(|| source.next()).map(|f| f.expect("a frame")).collect::<Vec<_>>(), first);
    first
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
    assert_eq!(&frames[0].radiance * 256.0, frame(3).to_f32());
    assert_eq!(&frames[1].radiance * 65536.0, deep.to_f32());
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
fn linear_values_are_scaled_by_white_and_alpha_is_dropped() {
    let (_folder, path) = temporary("sky.exr");
    ImageBuffer::from_fn(2, 1, |x, _| Rgba([x as f32, 2.0, 4.0, 0.5])).save(&path).expect("saved");
    let frame = frames(&path, 8.0).remove(0);
    assert_eq!(frame.radiance.as_slice(), Some(&[0.0, 0.25, 0.5, 0.125, 0.25, 0.5][..]));
    assert!(frames(&path, 0.0)[0].radiance.iter().all(|v| (0.0..1.0).contains(v)));
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
    assert!(missing.contains("nowhere") && missing.contains("png") && missing.contains(".mcap"), "{missing}");
    let empty = error_of(folder.path());
    assert!(empty.contains("no image") && empty.contains("png"), "{empty}");
    let text = folder.path().join("a.txt");
    std::fs::write(&text, "text").expect("written");
    assert!(error_of(&text).contains("not an image"));
    let white = SourceOptions { white: -1.0, topic: None };
    save_png(&folder.path().join("a.png"), &frame(1)).expect("saved");
    let error = open(&folder.path().display().to_string(), &white).err().expect("refused").to_string();
    assert!(error.contains("white = -1"), "{error}");
}
