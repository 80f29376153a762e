//! Images with YOLO's labels: a text file an image, lines `class cx cy width height` as shares of the image, or `class
//! x y x y ...`, a polygon or a rotated box, of which the box is taken. Where the data set has `kpt_shape`, key points follow the box,
//! and are not used.
//!
//! Labels lie where ultralytics looks for them: in `labels` beside `images`, else beside the image.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use modulo_core::BBox;

use super::classes::YoloClasses;
use super::data_set::images_of;
use super::kitti::{number, whole};
use super::labels::{LabelSet, around, read_text, texts_without_image, without_image};
use super::{GroundTruth, Source, SourceError, SourceOptions};

impl Source {
    /// Opens the YOLO data set at `path`: a folder that holds `images` and `labels`, a folder of images whose path has a part `images`, one with
    /// images and labels side by side, a `data.yaml` or `obj.data`, of which the part for validation is read, or a list of images. A class is
    /// called by its number where no file names the classes. Of `options`, the topic is not used.
    ///
    /// # Errors
    /// [`SourceError`] when there is no image, when several subfolders have images, or when the names cannot be read.
    pub fn yolo(path: &Path, options: &SourceOptions) -> Result<Self, SourceError> {
        let (images, is_whole) = images_of(path)?;
        let folders: BTreeSet<PathBuf> = images
            .iter()
            .flat_map(|image| places(image))
            .filter_map(|place| Some(place.parent()?.to_owned()))
            .collect();
        let folders: Vec<PathBuf> = folders.into_iter().filter(|folder| folder.is_dir()).collect();
        let image = images.first().map_or(path, PathBuf::as_path);
        let classes = YoloClasses::of(path, image, &folders)?;
        let labels = labels(&images, &folders, &classes, is_whole);
        Self::of_images(images, labels, is_whole, options)
    }
}

/// Reads the labels of `images` in `folders`, which have no others where the images are all of theirs.
fn labels(images: &[PathBuf], folders: &[PathBuf], classes: &YoloClasses, is_whole: bool) -> LabelSet {
    let label = |text: &str| {
        let (class, bbox) = parse(text, classes.key_points)?;
        Ok(GroundTruth { bbox, class: classes.name(class)?, truncated: -1.0, occluded: -1 })
    };
    let mut labels = LabelSet::of_texts(images, places, label, true);
    if is_whole {
        let texts = texts_without_image(folders, images).into_iter();
        // Other texts, such as lists of names, may lie beside the labels.
        let is_label = |line: &str| line.trim().is_empty() || parse(line, classes.key_points).is_ok();
        let texts = texts.filter(|path| read_text(path).is_ok_and(|text| text.lines().all(is_label)));
        labels.warnings.extend(without_image("label files", texts.map(|path| path.display().to_string())));
    }
    labels
}

/// Returns the places beside which the labels of `image` may lie.
fn places(image: &Path) -> Vec<PathBuf> {
    let parts: Vec<_> = image.components().collect();
    // The last part of this name, as ultralytics replaces it: a folder above may be called `images`, too.
    let last = parts.iter().rposition(|part| part.as_os_str() == "images");
    let swapped = last.map(|last| {
        let swap = |(place, part): (usize, &std::path::Component<'_>)| match place {
            place if place == last => std::ffi::OsString::from("labels"),
            _ => part.as_os_str().to_owned(),
        };
        parts.iter().enumerate().map(swap).collect::<PathBuf>()
    });
    swapped.into_iter().chain([image.to_owned()]).collect()
}

/// Returns the number of the class and the box of a line, in shares of the image. `key_points` are the numbers that follow a box.
fn parse(line: &str, key_points: Option<usize>) -> Result<(usize, BBox), String> {
    let mut words = line.split_whitespace();
    let class = whole("class", words.next().unwrap_or_default())?;
    let numbers = words.map(number).collect::<Result<Vec<f32>, String>>()?;
    let count = numbers.len();
    let shape = match key_points {
        Some(more) if count == 4 + more => &numbers[..4],
        Some(more) if count != 4 => {
            return Err(format!("{} columns found, {} needed by kpt_shape", count + 1, 5 + more));
        }
        // Corners are pairs, of which a polygon needs three at least.
        None if count != 4 && (count < 6 || count % 2 == 1) => {
            return Err(format!(
                "{} columns found, 5 needed (7, 9, ... for a polygon; key points need kpt_shape in data.yaml)",
                count + 1
            ));
        }
        _ => &numbers[..],
    };
    if let Some(far) = shape.iter().find(|share| !SHARES.contains(share)) {
        return Err(format!("{far} found, but all columns are shares of the image, 0 to 1"));
    }
    let bbox = match *shape {
        [cx, cy, w, h] if w >= 0.0 && h >= 0.0 => BBox::from_centre((cx, cy), (w, h)),
        [_, _, w, h] => return Err(format!("box of {w} x {h} found, 0 or more needed")),
        _ => around(shape.chunks_exact(2).map(|corner| [corner[0], corner[1]])),
    };
    Ok((class, bbox))
}

/// The shares that are read: rounding may carry them a little beyond the image.
const SHARES: std::ops::RangeInclusive<f32> = -0.01..=1.01;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn boxes_are_shares_of_the_image() {
        let (class, bbox) = parse("2 0.5 0.5 0.25 0.5", None).expect("five columns");
        assert_eq!((class, bbox), (2, BBox { x1: 0.375, y1: 0.25, x2: 0.625, y2: 0.75 }));
        let (_, bbox) = parse("0.0 0.1 0.2 0.5 0.9 0.3 0.4", None).expect("a polygon");
        assert_eq!(bbox, BBox { x1: 0.1, y1: 0.2, x2: 0.5, y2: 0.9 });
    }

    #[test]
    fn bad_lines_say_what_is_needed() {
        for (line, expected) in [
            ("car 0 0 1 1", "'car'"),
            ("0 0 0 1", "4 columns found, 5 needed"),
            ("0 0 0 nan 1", "'nan'"),
            ("0 0.5 0.5 -0.005 1", "-0.005 x 1"),
            ("0 0.5 0.5 20 12", "20 found, but all columns are shares"),
            ("0 0.5 0.5 0.2 0.2 0.9", "6 columns found"),
            ("0 0.5 0.5 0.2 0.2 0.4 0.4 2 0.6 0.6 2", "2 found"),
            ("1.5 0.5 0.5 0.2 0.2", "'1.5'"),
        ] {
            let why = parse(line, None).expect_err(line);
            assert!(why.contains(expected), "{why}");
        }
    }

    #[test]
    fn key_points_are_read_as_far_as_the_data_set_tells_their_number() {
        let pose = "0 0.5 0.5 0.2 0.4 0.45 0.4 0.55 0.4 0.5 0.6";
        let (_, bbox) = parse(pose, Some(6)).expect("a box and three points");
        assert_eq!(bbox, BBox::from_centre((0.5, 0.5), (0.2, 0.4)));
        let why = parse("0 0.5 0.5 0.2 0.4 0.45 0.4", Some(6)).expect_err("two numbers more");
        assert!(why.contains("7 columns found, 11 needed by kpt_shape"), "{why}");
    }

    #[test]
    fn labels_lie_where_ultralytics_looks() {
        assert_eq!(
            places(Path::new("/data/images/val/1.jpg")),
            [Path::new("/data/labels/val/1.jpg"), Path::new("/data/images/val/1.jpg")]
        );
        assert_eq!(places(Path::new("a/1.png")), [Path::new("a/1.png")]);
    }
}
