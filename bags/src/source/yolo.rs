//! Images with YOLO's labels: a text file an image, lines `class cx cy width height` as shares of the image, or `class
//! x y x y ...`, a polygon or a rotated box, of which the box is taken. Where the data set has `kpt_shape`, key points follow the box,
//! and are not used.
//!
//! Labels lie where ultralytics looks for them: in `labels` beside `images`, else beside the image.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use modulo_core::BBox;
use modulo_runtime::yaml::{self, Content, Item};

use super::folder::{
    FolderSource, LabelledSource, Labels, list_images, read_lines, read_text, texts_without_image,
    warn_without_image,
};
use super::kitti::{number, whole};
use super::{GroundTruth, SourceError, SourceOptions};

/// Files that may contain the names of the classes.
const NAME_FILES: [&str; 4] = ["data.yaml", "dataset.yaml", "classes.txt", "labels/classes.txt"];

/// A folder of images with YOLO's labels.
pub type YoloSource = LabelledSource<YoloLabels>;

/// How YOLO's labels of a data set are read.
#[derive(Debug, Default)]
pub struct YoloLabels {
    /// The names of the classes, by number.
    names: BTreeMap<usize, String>,
    /// Numbers of the key points of an object.
    key_points: Option<usize>,
}

impl YoloSource {
    /// Opens `folder`: one that holds `images` and `labels`, a folder of images whose path has a part `images`, or one
    /// with images and labels side by side. Class names come from `data.yaml`, `dataset.yaml` or `classes.txt` there or
    /// up to two folders above; a class is called by its number where no
    /// names are given. Of `options`, the topic is not used.
    ///
    /// # Errors
    /// [`SourceError`] when there is no image, or the names cannot be read.
    pub fn open(folder: &Path, options: &SourceOptions) -> Result<Self, SourceError> {
        if folder.is_file() {
            return Err(SourceError::of(
                folder,
                "is a file; the folder of images with YOLO labels is needed",
            ));
        }
        if !folder.is_dir() {
            return Err(SourceError::absent(folder, "a folder of images with YOLO labels is needed"));
        }
        let inside = folder.join("images");
        let images = if inside.is_dir() { &inside } else { folder };
        let frames = FolderSource::of(list_images(images)?, options)?.with_all_of(Some(images));
        Ok(Self { frames, labels: YoloLabels::of(folder)? })
    }
}

impl Labels for YoloLabels {
    fn labels(
        &self,
        image: &Path,
        (height, width): (usize, usize),
    ) -> Result<Option<Vec<GroundTruth>>, SourceError> {
        let Some(path) = label_files(image).into_iter().find(|path| path.is_file()) else { return Ok(None) };
        let label = |text: &str| {
            let (class, bbox) = parse(text, (width as f32, height as f32), self.key_points)?;
            Ok(GroundTruth { bbox, class: self.name(class)?, truncated: -1.0, occluded: -1 })
        };
        read_lines(&path, label).map(Some)
    }

    fn without_image(&self, images: &[PathBuf]) -> Vec<String> {
        let folders = images.iter().flat_map(|image| label_files(image));
        let folders: BTreeSet<PathBuf> = folders.filter_map(|file| Some(file.parent()?.to_owned())).collect();
        let texts = folders.iter().flat_map(|folder| texts_without_image(folder, images));
        // Other texts, such as lists of names, may lie beside the labels.
        let is_label =
            |line: &str| line.trim().is_empty() || parse(line, (1.0, 1.0), self.key_points).is_ok();
        let labels = texts.filter(|path| read_text(path).is_ok_and(|text| text.lines().all(is_label)));
        warn_without_image("label files", &labels.map(|path| path.display().to_string()).collect::<Vec<_>>())
    }
}

impl YoloLabels {
    /// Reads how the labels of `folder` are to be read. A split such as `images/val` lies two folders below the file of the data set.
    fn of(folder: &Path) -> Result<Self, SourceError> {
        let files = folder.ancestors().take(3).flat_map(|folder| NAME_FILES.map(|name| folder.join(name)));
        let Some(path) = files.into_iter().find(|path| path.is_file()) else { return Ok(Self::default()) };
        let text = read_text(&path)?;
        if path.extension().is_some_and(|extension| extension == "txt") {
            let names = text.lines().map(|line| line.trim().to_owned()).enumerate().collect();
            return Ok(Self { names, key_points: None });
        }
        let bad = |why| SourceError::label(&path, 1, &format!("no readable `names`: {why}"));
        listed(&text).map_err(bad)
    }

    /// Returns the name of class `number`, or the number itself if the data set names no class.
    fn name(&self, number: usize) -> Result<String, String> {
        let (Some((first, _)), Some((last, _))) = (self.names.first_key_value(), self.names.last_key_value())
        else {
            return Ok(number.to_string());
        };
        let unnamed =
            || format!("class {number} found, but the data set has names for the classes {first} to {last}");
        self.names.get(&number).cloned().ok_or_else(unnamed)
    }
}

fn label_files(image: &Path) -> Vec<PathBuf> {
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
    swapped.into_iter().chain([image.to_owned()]).map(|path| path.with_extension("txt")).collect()
}

/// Returns the box around corners, each of which is two numbers.
fn around(corners: &[f32]) -> BBox {
    let start = BBox { x1: corners[0], y1: corners[1], x2: corners[0], y2: corners[1] };
    corners.chunks_exact(2).fold(start, |b, point| BBox {
        x1: b.x1.min(point[0]),
        y1: b.y1.min(point[1]),
        x2: b.x2.max(point[0]),
        y2: b.y2.max(point[1]),
    })
}

/// Returns the number of the class and the box in px of a line. `key_points` are the numbers that follow a box.
fn parse(
    line: &str,
    (width, height): (f32, f32),
    key_points: Option<usize>,
) -> Result<(usize, BBox), String> {
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
        _ => around(shape),
    };
    Ok((class, BBox { x1: bbox.x1 * width, y1: bbox.y1 * height, x2: bbox.x2 * width, y2: bbox.y2 * height }))
}

/// The shares that are read: rounding may carry them a little beyond the image.
const SHARES: std::ops::RangeInclusive<f32> = -0.01..=1.01;

/// Reads a data set's file: `names`, a list or a mapping by number, and `kpt_shape`, a list of two numbers.
fn listed(text: &str) -> Result<YoloLabels, String> {
    let file = yaml::read(text).map_err(|why| why.to_string())?;
    let names =
        file.entry("names").ok_or("no value of 'names' at the top of the file, where it is needed")?;
    let names: Vec<(usize, &Item)> = match &names.content {
        Content::List(list) => list.iter().enumerate().collect(),
        Content::Map(entries) => {
            let number =
                |text: &str| text.parse().map_err(|_| format!("class '{text}' found, a whole number needed"));
            let numbered = entries.iter().map(|(key, name)| Ok((number(&key.name)?, name)));
            numbered.collect::<Result<_, String>>()?
        }
        Content::Scalar(..) => {
            return Err("a list of names, or a mapping from numbers to names is needed".to_owned());
        }
    };
    let text = |(number, name): (usize, &Item)| Some((number, name.text()?.to_owned()));
    let bad = "a name of a class is empty, a list or a mapping; a word is needed";
    let names = names.into_iter().map(text).collect::<Option<_>>().ok_or(bad)?;
    let key_points = file.entry("kpt_shape").map(|shape| {
        let Content::List(sides) = &shape.content else { return None };
        let sides = sides.iter().map(|side| side.text()?.parse().ok()).collect::<Option<Vec<usize>>>()?;
        (sides.len() == 2).then(|| sides[0].checked_mul(sides[1])).flatten()
    });
    let key_points =
        key_points.map(|count| count.ok_or("kpt_shape must be a list of two numbers, such as [17, 3]"));
    Ok(YoloLabels { names, key_points: key_points.transpose()? })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn boxes_are_shares_of_the_image() {
        let (class, bbox) = parse("2 0.5 0.5 0.25 0.5", (200.0, 100.0), None).expect("five columns");
        assert_eq!((class, bbox), (2, BBox { x1: 75.0, y1: 25.0, x2: 125.0, y2: 75.0 }));
        let (_, bbox) = parse("0.0 0.1 0.2 0.5 0.9 0.3 0.4", (100.0, 100.0), None).expect("a polygon");
        assert!((bbox.x1 - 10.0).abs() < 1e-4 && (bbox.y2 - 90.0).abs() < 1e-4, "{bbox:?}");
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
            let why = parse(line, (10.0, 10.0), None).expect_err(line);
            assert!(why.contains(expected), "{why}");
        }
    }

    #[test]
    fn key_points_are_read_as_far_as_the_data_set_tells_their_number() {
        let labels = listed("names: [person]\nkpt_shape: [3, 2]\n").expect("readable");
        let pose = "0 0.5 0.5 0.2 0.4 0.45 0.4 0.55 0.4 0.5 0.6";
        let (_, bbox) = parse(pose, (100.0, 100.0), labels.key_points).expect("a box and three points");
        assert_eq!(
            (bbox.x1.round(), bbox.y1.round(), bbox.x2.round(), bbox.y2.round()),
            (40.0, 30.0, 60.0, 70.0)
        );
        let why =
            parse("0 0.5 0.5 0.2 0.4 0.45 0.4", (1.0, 1.0), labels.key_points).expect_err("two numbers more");
        assert!(why.contains("7 columns found, 11 needed by kpt_shape"), "{why}");
        assert!(listed("names: [person]\nkpt_shape: 17\n").is_err());
    }

    #[test]
    fn labels_lie_where_ultralytics_looks() {
        let files = label_files(Path::new("/data/images/val/1.jpg"));
        assert_eq!(files, [Path::new("/data/labels/val/1.txt"), Path::new("/data/images/val/1.txt")]);
        assert_eq!(label_files(Path::new("a/1.png")), [Path::new("a/1.txt")]);
    }

    #[test]
    fn names_that_cannot_be_read_say_what_is_needed() {
        for (text, expected) in [
            ("", "no value of 'names'"),
            ("names: car", "a list of names"),
            ("names: {car: 0}", "class 'car' found, a whole number needed"),
            ("names: [[car]]", "a word is needed"),
            ("names: [~]", "a word is needed"),
            ("names: [car", "line "),
            (
                "a: &a [x,x,x,x,x,x,x,x,x]\nb: &b [*a,*a,*a,*a,*a,*a,*a,*a,*a]\nc: &c [*b,*b,*b,*b,*b,*b,*b,*b,*b]\n\
              d: &d [*c,*c,*c,*c,*c,*c,*c,*c,*c]\ne: &e [*d,*d,*d,*d,*d,*d,*d,*d,*d]\nnames: [*e,*e,*e,*e]",
                "alias",
            ),
        ] {
            let why = listed(text).expect_err(text);
            assert!(why.contains(expected), "{why}");
        }
    }

    #[test]
    fn names_may_be_a_list_or_numbered() {
        for (text, last) in [
            ("names: [car, person]", "person"),
            ("path: x\nnames:\n  0: car\n  1: bus\n", "bus"),
            ("names: [car, 1]", "1"),
        ] {
            let folder = tempfile::tempdir().expect("a folder");
            std::fs::write(folder.path().join("data.yaml"), text).expect("written");
            let names = YoloLabels::of(folder.path()).expect("readable").names;
            assert_eq!((names[&0].as_str(), names[&1].as_str()), ("car", last));
        }
    }
}
