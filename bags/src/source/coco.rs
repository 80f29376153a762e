//! Images with COCO's labels: one JSON file with `images`, `annotations` and `categories`.
//!
//! Boxes are `x, y, width, height` in px. A crowd (`iscrowd` 1) is an area in which the objects of its class are not
//! labelled individually.

use std::collections::HashMap;
use std::io::Read as _;
use std::path::{Path, PathBuf};

use modulo_core::BBox;
use modulo_images::open_regular;
use serde::Deserialize;

use super::folder::{FolderSource, LabelledSource, Labels, stem, warn_without_image};
use super::{CROWD, GroundTruth, SourceError, SourceOptions};
use crate::{FileError, stays_inside};

/// Images of a COCO annotation file, in its order.
pub type CocoSource = LabelledSource<CocoLabels>;

/// The objects of a COCO annotation file.
#[derive(Debug)]
pub struct CocoLabels {
    of_image: HashMap<PathBuf, Vec<GroundTruth>>,
    /// For each annotation of an image that the file does not list: that image.
    without_image: Vec<String>,
}

#[derive(Deserialize)]
struct File {
    images: Vec<ImageEntry>,
    annotations: Vec<Annotation>,
    categories: Vec<Category>,
}

#[derive(Deserialize)]
struct ImageEntry {
    id: u64,
    file_name: String,
}

#[derive(Deserialize)]
struct Annotation {
    image_id: u64,
    category_id: u64,
    bbox: [f32; 4],
    #[serde(default)]
    iscrowd: u8,
}

#[derive(Deserialize)]
struct Category {
    id: u64,
    name: String,
}

impl CocoSource {
    /// Opens `annotations`; its images are in `images`, or, as the data set lies, beside the file, in `images` beside
    /// it, or in `../NAME` for `instances_NAME.json`. Of `options`, the topic is not used.
    ///
    /// # Errors
    /// [`SourceError`] when the file is not a COCO annotation file, when it names an image outside of the folder of
    /// images, or when none of its images is found.
    pub fn open(
        annotations: &Path,
        images: Option<&Path>,
        options: &SourceOptions,
    ) -> Result<Self, SourceError> {
        let mut text = Vec::new();
        let read = open_regular(annotations).and_then(|mut file| file.read_to_end(&mut text));
        read.map_err(|why| FileError::new(annotations, why))?;
        let bad = |line, why: String| SourceError::Label { path: annotations.to_owned(), line, why };
        let file: File = serde_json::from_slice(&text).map_err(|why| bad(why.line(), why.to_string()))?;
        // Checked before any path is joined: an annotation file may come from anywhere.
        if let Some(image) = file.images.iter().find(|image| !stays_inside(Path::new(&image.file_name))) {
            let why = "must be a path inside the folder of images, relative and without '..'";
            return Err(bad(1, format!("file_name '{}' of image {} {why}", image.file_name, image.id)));
        }
        let folder = match images {
            Some(folder) => folder.to_owned(),
            None => folder_of(annotations, &file.images)?,
        };
        let names: HashMap<u64, &str> = file.categories.iter().map(|c| (c.id, c.name.as_str())).collect();
        let mut by_image: HashMap<u64, Vec<GroundTruth>> = HashMap::new();
        for annotation in &file.annotations {
            let label = label(annotation, &names).map_err(|why| bad(1, why))?;
            by_image.entry(annotation.image_id).or_default().push(label);
        }
        let paths: Vec<PathBuf> = file.images.iter().map(|image| folder.join(&image.file_name)).collect();
        if paths.is_empty() {
            return Err(SourceError::Empty(annotations.to_owned()));
        }
        // An image without annotations is labelled: it contains no object.
        let truth = |image: &ImageEntry| by_image.remove(&image.id).unwrap_or_default();
        let of_image = paths.iter().cloned().zip(file.images.iter().map(truth)).collect();
        // The images that are listed have been taken out.
        let unlisted =
            file.annotations.iter().filter(|annotation| by_image.contains_key(&annotation.image_id));
        let without_image = unlisted.map(|annotation| format!("image {}", annotation.image_id)).collect();
        let labels = CocoLabels { of_image, without_image };
        Ok(Self { frames: FolderSource::of(paths, options)?, labels })
    }
}

impl Labels for CocoLabels {
    fn labels(&self, image: &Path, _: (usize, usize)) -> Result<Option<Vec<GroundTruth>>, SourceError> {
        Ok(self.of_image.get(image).cloned())
    }

    fn without_image(&self, _: &[PathBuf]) -> Vec<String> {
        warn_without_image("annotations", &self.without_image)
    }
}

fn label(annotation: &Annotation, names: &HashMap<u64, &str>) -> Result<GroundTruth, String> {
    let Annotation { image_id, category_id, bbox: [x, y, width, height], iscrowd } = annotation;
    let class = names.get(category_id).ok_or_else(|| {
        format!("image {image_id} has an object of category {category_id}, which `categories` does not name")
    })?;
    // One sum finds NaN and infinity in any of the four.
    if !(x + y + width + height).is_finite() || *width < 0.0 || *height < 0.0 {
        return Err(format!(
            "image {image_id} has a box {x} {y} {width} {height}, finite and not negative needed"
        ));
    }
    Ok(GroundTruth {
        bbox: BBox { x1: *x, y1: *y, x2: x + width, y2: y + height },
        class: (*class).to_owned(),
        truncated: -1.0,
        occluded: if *iscrowd == 1 { CROWD } else { -1 },
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
        .ok_or_else(|| SourceError::Absent(beside.join(&first.file_name), needed))
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
        for (text, told) in [
            ("{}", "images"),
            (&TEXT.replace("\"id\": 2", "\"id\": 9"), "category 2"),
            (&TEXT.replace("3, 4]", "-3, 4]"), "not negative"),
            (&TEXT.replace("a.png", "/etc/a.png"), "'/etc/a.png' of image 3"),
            (&TEXT.replace("a.png", "x/../../val/a.png"), "without '..'"),
        ] {
            let folder = write(text);
            let path = folder.path().join("annotations/instances_val.json");
            let why = CocoSource::open(&path, None, &SourceOptions::default()).expect_err(told).to_string();
            assert!(why.contains(told) && why.contains("instances_val.json"), "{why}");
        }
    }
}
