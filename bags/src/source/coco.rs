//! Images with COCO's labels: one JSON file with `images`, `annotations` and `categories`.
//!
//! Boxes are `x, y, width, height` in px. A crowd (`iscrowd` 1) is an area in which the objects of its class are not
//! labelled individually. An image that is listed twice has the labels of both entries. Programs write numbers as `1`, `1.0` and `"1"`.

use std::collections::{HashMap, HashSet};
use std::io::Read as _;
use std::path::{Path, PathBuf};

use modulo_core::BBox;
use modulo_images::open_regular;
use serde::Deserialize;
use serde_json::Value;

use super::folder::{FolderSource, LabelledSource, Labels, no_image, stem, warn_without_image};
use super::{CROWD, GroundTruth, SourceError, SourceOptions};
use crate::{FileError, stays_inside};

/// Images of a COCO annotation file, in its order.
pub type CocoSource = LabelledSource<CocoLabels>;

/// The objects of a COCO annotation file.
#[derive(Debug)]
pub struct CocoLabels {
    path: PathBuf,
    of_image: HashMap<PathBuf, Labelled>,
    /// For each annotation of an image that the file does not list: that image.
    without_image: Vec<String>,
}

#[derive(Debug, Default)]
struct Labelled {
    /// Width and height, of each entry that has them.
    sizes: Vec<[f64; 2]>,
    objects: Vec<GroundTruth>,
}

/// A number, or a text that is one.
#[derive(Clone, Copy, Deserialize)]
#[serde(try_from = "Value")]
struct Number(f64);

impl TryFrom<Value> for Number {
    type Error = String;

    fn try_from(value: Value) -> Result<Self, String> {
        let number = match &value {
            Value::Number(number) => number.as_f64(),
            Value::String(text) => text.trim().parse().ok(),
            Value::Bool(truth) => Some(f64::from(u8::from(*truth))),
            _ => None,
        };
        number.map(Self).ok_or_else(|| format!("{value} found, a number needed"))
    }
}

/// The id of an image or a category, a whole number or another text.
#[derive(Clone, Deserialize, PartialEq, Eq, Hash)]
#[serde(try_from = "Value")]
struct Id(String);

impl TryFrom<Value> for Id {
    type Error = String;

    fn try_from(value: Value) -> Result<Self, String> {
        match &value {
            Value::String(text) => Ok(Self(text.clone())),
            Value::Number(number) if number.is_f64() => {
                let whole = number.as_f64().filter(|number| number.fract() == 0.0 && number.abs() < 1e15);
                whole
                    .map(|number| Self((number as i64).to_string()))
                    .ok_or(format!("id {value} found, a whole number needed"))
            }
            Value::Number(number) => Ok(Self(number.to_string())),
            _ => Err(format!("id {value} found, a whole number or a text needed")),
        }
    }
}

#[derive(Deserialize)]
struct File {
    images: Vec<ImageEntry>,
    annotations: Vec<Annotation>,
    categories: Vec<Category>,
}

#[derive(Deserialize)]
struct ImageEntry {
    id: Id,
    file_name: String,
    width: Option<Number>,
    height: Option<Number>,
}

#[derive(Deserialize)]
struct Annotation {
    image_id: Id,
    category_id: Id,
    bbox: [Number; 4],
    iscrowd: Option<Number>,
}

#[derive(Deserialize)]
struct Category {
    id: Id,
    name: String,
}

impl CocoSource {
    /// Opens `annotations`; its images are in `images`, or, as the data set lies, beside the file, in `images` beside
    /// it, or in `../NAME` for `instances_NAME.json`. Of `options`, the topic is not used.
    ///
    /// # Errors
    /// [`SourceError`] when the file is not a COCO annotation file, when two images or categories have one id, when it names an image outside of the folder of
    /// images, or when none of its images is found.
    pub fn open(
        annotations: &Path,
        images: Option<&Path>,
        options: &SourceOptions,
    ) -> Result<Self, SourceError> {
        let mut text = Vec::new();
        let read = open_regular(annotations).and_then(|mut file| file.read_to_end(&mut text));
        read.map_err(|why| FileError::new(annotations, why))?;
        let bad = |line, why: String| SourceError::label(annotations, line, &why);
        let text = text.strip_prefix(b"\xef\xbb\xbf").unwrap_or(&text);
        let file: File = serde_json::from_slice(text).map_err(|why| bad(why.line(), why.to_string()))?;
        // Checked before any path is joined: an annotation file may come from anywhere.
        if let Some(image) = file.images.iter().find(|image| !stays_inside(Path::new(&image.file_name))) {
            let why = "must be a path inside the folder of images, relative and without '..'";
            return Err(bad(1, format!("file_name '{}' of image {} {why}", image.file_name, image.id.0)));
        }
        let folder = match images {
            Some(folder) => folder.to_owned(),
            None => folder_of(annotations, &file.images)?,
        };
        if file.images.is_empty() {
            return Err(no_image(annotations));
        }
        let paths: Vec<PathBuf> = file.images.iter().map(|image| folder.join(&image.file_name)).collect();
        let mut labels =
            CocoLabels { path: annotations.to_owned(), of_image: HashMap::new(), without_image: Vec::new() };
        labels.fill(&file, &paths).map_err(|why| bad(1, why))?;
        // An image that is listed twice is one image.
        let mut listed = HashSet::new();
        let paths = paths.into_iter().filter(|path| listed.insert(path.clone())).collect();
        Ok(Self { frames: FolderSource::of(paths, options)?, labels })
    }
}

impl CocoLabels {
    /// Takes the entries of `file`, whose images have these paths.
    fn fill(&mut self, file: &File, paths: &[PathBuf]) -> Result<(), String> {
        let mut names: HashMap<&Id, &str> = HashMap::new();
        for Category { id, name } in &file.categories {
            if *names.entry(id).or_insert(name) != name {
                return Err(format!("two categories have the id {}; give each its own", id.0));
            }
        }
        let mut by_id: HashMap<&Id, &PathBuf> = HashMap::new();
        for (image, path) in file.images.iter().zip(paths) {
            if *by_id.entry(&image.id).or_insert(path) != path {
                return Err(format!("two images have the id {}; give each its own", image.id.0));
            }
            // An image without annotations is labelled: it contains no object.
            let labelled = self.of_image.entry(path.clone()).or_default();
            labelled.sizes.extend(image.width.zip(image.height).map(|(width, height)| [width.0, height.0]));
        }
        // The same object may be there once for each entry of its image.
        let mut entry_of: HashMap<(&PathBuf, String), &Id> = HashMap::new();
        for annotation in &file.annotations {
            let label = label(annotation, &names)?;
            let Some(path) = by_id.get(&annotation.image_id) else {
                self.without_image.push(format!("image {}", annotation.image_id.0));
                continue;
            };
            let entry = entry_of.entry((path, format!("{label:?}"))).or_insert(&annotation.image_id);
            if **entry == annotation.image_id {
                self.of_image.entry((*path).clone()).or_default().objects.push(label);
            }
        }
        Ok(())
    }
}

impl Labels for CocoLabels {
    fn labels(
        &self,
        image: &Path,
        (height, width): (usize, usize),
    ) -> Result<Option<Vec<GroundTruth>>, SourceError> {
        let Some(Labelled { sizes, objects }) = self.of_image.get(image) else { return Ok(None) };
        // Boxes on an image of another size, or before a turn by its EXIF orientation, are those of other pixels.
        match sizes.iter().find(|size| **size != [width as f64, height as f64]) {
            None => Ok(Some(objects.clone())),
            Some([w, h]) => {
                let name = image.display();
                let why = format!(
                    "{name} is listed with {w} x {h} px, but has {width} x {height} px as it is shown, so that its boxes are not those of its \
                     pixels; label it anew"
                );
                Err(SourceError::label(&self.path, 1, &why))
            }
        }
    }

    fn without_image(&self, _: &[PathBuf]) -> Vec<String> {
        warn_without_image("annotations", &self.without_image)
    }
}

fn label(annotation: &Annotation, names: &HashMap<&Id, &str>) -> Result<GroundTruth, String> {
    let Annotation { image_id: Id(image), category_id, bbox, iscrowd } = annotation;
    let [x, y, width, height] = bbox.map(|number| number.0 as f32);
    let class = names.get(category_id).ok_or_else(|| {
        let category = &category_id.0;
        format!("image {image} has an object of category {category}, which `categories` does not name")
    })?;
    // One sum finds NaN and infinity in any of the four.
    if !(x + y + width + height).is_finite() || width < 0.0 || height < 0.0 {
        return Err(format!(
            "image {image} has a box {x} {y} {width} {height}, finite and not negative needed"
        ));
    }
    Ok(GroundTruth {
        bbox: BBox { x1: x, y1: y, x2: x + width, y2: y + height },
        class: (*class).to_owned(),
        truncated: -1.0,
        occluded: if iscrowd.is_some_and(|crowd| crowd.0 == 1.0) { CROWD } else { -1 },
    })
}

/// Returns the first folder with any of the images.
fn folder_of(annotations: &Path, images: &[ImageEntry]) -> Result<PathBuf, SourceError> {
    let beside = annotations.parent().unwrap_or(Path::new(""));
    let above = beside.join("..");
    let stem = stem(annotations);
    // `instances_val2017` belongs to the images in `val2017`.
    let split = stem.rsplit_once('_').map_or(stem.as_str(), |(_, split)| split);
    let folders = [
        beside.to_owned(),
        beside.join("images"),
        above.join(split),
        above.join("images").join(split),
        above.join("images"),
        above,
    ];
    let Some(first) = images.first() else { return Ok(beside.to_owned()) };
    // A single image may be missing, such as the first one.
    let has_any = |folder: &PathBuf| images.iter().any(|image| folder.join(&image.file_name).is_file());
    let needed = "none of the images of the annotation file was found; name their folder with --coco-images";
    folders
        .into_iter()
        .find(has_any)
        .ok_or_else(|| SourceError::absent(&beside.join(&first.file_name), needed))
}

#[cfg(test)]
mod tests {
    use super::super::Source;
    use super::*;

    const TEXT: &str = r#"{"images": [{"id": 7, "file_name": "b.png"}, {"id": 3, "file_name": "a.png"}],
        "annotations": [{"image_id": 7, "category_id": 2, "bbox": [1, 2, 3, 4]},
                        {"image_id": 7, "category_id": 1, "bbox": [0, 0, 8, 8], "iscrowd": 1}],
        "categories": [{"id": 1, "name": "person"}, {"id": 2, "name": "car"}]}"#;

    fn write(text: &str) -> tempfile::TempDir {
        let folder = tempfile::tempdir().expect("a folder");
        std::fs::create_dir(folder.path().join("annotations")).expect("made");
        std::fs::create_dir(folder.path().join("val")).expect("made");
        std::fs::write(folder.path().join("annotations/instances_val.json"), text).expect("written");
        for name in ["a.png", "b.png"] {
            image::GrayImage::new(8, 8).save(folder.path().join("val").join(name)).expect("written");
        }
        folder
    }

    #[test]
    fn images_come_in_the_order_of_the_file_with_their_boxes() {
        let folder = write(TEXT);
        let mut source = CocoSource::open(
            &folder.path().join("annotations/instances_val.json"),
            None,
            &SourceOptions::default(),
        )
        .expect("readable");
        let first = source.next().expect("two").expect("readable");
        let truth = first.ground_truth.expect("labelled");
        assert_eq!(first.name, "b");
        assert_eq!(truth[0].bbox, BBox { x1: 1.0, y1: 2.0, x2: 4.0, y2: 6.0 });
        assert_eq!((truth[0].class.as_str(), truth[0].occluded, truth[1].occluded), ("car", -1, CROWD));
        assert_eq!(source.next().expect("two").expect("readable").ground_truth, Some(vec![]));
        assert!(source.next().is_none());
    }

    #[test]
    fn what_is_no_annotation_file_says_so() {
        for (text, expected) in [
            ("{}", "images"),
            (&TEXT.replace("\"id\": 2", "\"id\": 9"), "category 2"),
            (&TEXT.replace("3, 4]", "-3, 4]"), "not negative"),
            (&TEXT.replace("a.png", "/etc/a.png"), "'/etc/a.png' of image 3"),
            (&TEXT.replace("a.png", "x/../../val/a.png"), "without '..'"),
            (&TEXT.replace("\"id\": 3", "\"id\": 7"), "two images have the id 7"),
            (&TEXT.replace("{\"id\": 1,", "{\"id\": 2,"), "two categories have the id 2"),
            (&TEXT.replace("3, 4]", "3, \"wide\"]"), "a number needed"),
            (&TEXT.replace("\"image_id\": 7", "\"image_id\": 7.5"), "id 7.5 found"),
        ] {
            let folder = write(text);
            let path = folder.path().join("annotations/instances_val.json");
            let why =
                CocoSource::open(&path, None, &SourceOptions::default()).expect_err(expected).to_string();
            assert!(why.contains(expected) && why.contains("instances_val.json"), "{why}");
        }
    }

    fn objects(text: &str) -> Vec<Result<Vec<GroundTruth>, String>> {
        let folder = write(text);
        let path = folder.path().join("annotations/instances_val.json");
        let mut source = CocoSource::open(&path, None, &SourceOptions::default()).expect("readable");
        let frames = std::iter::from_fn(|| source.next());
        frames
            .map(|frame| Ok(frame.map_err(|why| why.to_string())?.ground_truth.expect("labelled")))
            .collect()
    }

    #[test]
    fn an_image_that_is_listed_twice_has_the_labels_of_both_entries() {
        let twice =
            TEXT.replace("\"id\": 3, \"file_name\": \"a.png\"", "\"id\": 3, \"file_name\": \"b.png\"");
        let twice = twice.replacen("\"image_id\": 7", "\"image_id\": 3", 1);
        let both = objects(&twice);
        assert_eq!(both.iter().map(|labels| labels.as_ref().map(Vec::len)).collect::<Vec<_>>(), [Ok(2)]);
        // An object of both entries is one object.
        let copy = "{\"image_id\": 3, \"category_id\": 1, \"bbox\": [0, 0, 8, 8], \"iscrowd\": 1}, {\"image_id\": 3,";
        let copied = twice.replacen("{\"image_id\": 3,", copy, 1);
        assert_eq!(objects(&copied)[0].as_ref().map(Vec::len), Ok(2));
    }

    #[test]
    fn a_size_that_is_not_that_of_the_image_is_named() {
        let sized = |size: &str| TEXT.replace("\"a.png\"", &format!("\"a.png\", {size}"));
        for size in [
            "\"width\": 8, \"height\": 8",
            "\"width\": \"8\", \"height\": 8.0",
            "\"width\": null, \"height\": 8",
        ] {
            assert_eq!(objects(&sized(size))[1], Ok(vec![]), "{size}");
        }
        for size in
            ["\"width\": 16, \"height\": 16", "\"width\": 8, \"height\": 6", "\"width\": 0, \"height\": 0"]
        {
            let read = objects(&sized(size));
            let why = read[1].as_ref().expect_err(size);
            assert!(
                read[0].is_ok() && why.contains("a.png") && why.contains("8 x 8 px as it is shown"),
                "{why}"
            );
        }
    }

    #[test]
    fn numbers_may_be_floats_or_text_behind_a_byte_order_mark() {
        let text = TEXT.replace("\"image_id\": 7", "\"image_id\": 7.0").replace("\"id\": 7", "\"id\": \"7\"");
        let text =
            text.replace("[1, 2, 3, 4]", "[\"1\", 2.0, 3, 4]").replace("\"iscrowd\": 1", "\"iscrowd\": true");
        assert_eq!(objects(&format!("\u{feff}{text}")), objects(TEXT));
    }
}
