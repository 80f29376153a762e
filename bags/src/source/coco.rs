//! Images with COCO's labels: one JSON file with `images`, `annotations` and `categories`.
//!
//! Boxes are `x, y, width, height` in px; an annotation without a box has the one around its polygons. A crowd (`iscrowd` 1) is an area in which
//! the objects of its class are not labelled individually. An image that is listed twice has the labels of both entries. Programs write numbers
//! as `1`, `1.0`, `"1"` and `NaN`.

use std::collections::{HashMap, HashSet};
use std::path::{Path, PathBuf};

use modulo_core::BBox;
use modulo_runtime::input;
use serde::Deserialize;
use serde_json::Value;

use super::data_set::{below, parts, slashed};
use super::folder::stem;
use super::json::{Id, Listed, Number, quoted};
use super::labels::{ImageLabels, LabelSet, Skipped, around};
use super::{CROWD, GroundTruth, Source, SourceError, SourceOptions};
use crate::{FileError, stays_inside};

/// Size of the largest annotation file, bytes.
const LARGEST: u64 = 4 << 30;

#[derive(Deserialize)]
struct File {
    images: Vec<Listed<ImageEntry>>,
    annotations: Vec<Listed<Annotation>>,
    categories: Vec<Listed<Category>>,
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
    #[serde(default)]
    bbox: Value,
    #[serde(default)]
    segmentation: Value,
    iscrowd: Option<Number>,
}

#[derive(Deserialize)]
struct Category {
    id: Id,
    name: String,
}

/// The names of the categories by their ids; `None` for an id that has several.
type Names<'a> = HashMap<&'a Id, Option<&'a str>>;

impl Source {
    /// Opens the COCO annotation file `annotations`, whose images come in its order. They are in `images`, or, as the data set lies, beside the
    /// file, in `images` beside it, or in `../NAME` for `instances_NAME.json`. Of `options`, the topic is not used.
    ///
    /// # Errors
    /// [`SourceError`] when the file is not a COCO annotation file, and when none of its images is found.
    pub fn coco(
        annotations: &Path,
        images: Option<&Path>,
        options: &SourceOptions,
    ) -> Result<Self, SourceError> {
        let text = input::read_text(annotations, LARGEST).map_err(|why| FileError::new(annotations, why))?;
        let file: File = serde_json::from_str(&quoted(&text)).map_err(|why| {
            SourceError::label(annotations, why.line(), &format!("is no COCO annotation file: {why}"))
        })?;
        let mut unlisted = Skipped::default();
        let entries = file.images.iter().map(|entry| entry.0.as_ref());
        let entries: Vec<&ImageEntry> =
            entries.filter_map(|entry| entry.map_err(|why| unlisted.add(why)).ok()).collect();
        if entries.is_empty() {
            let why = unlisted.line("images cannot be read").unwrap_or_else(|| "lists no image".to_owned());
            return Err(SourceError::of(annotations, &why));
        }
        let folder = match images {
            Some(folder) => folder.to_owned(),
            None => folder_of(annotations, &entries)?,
        };
        let paths: Vec<PathBuf> = entries.iter().map(|image| place(&folder, &image.file_name)).collect();
        let mut labels = LabelSet::default();
        let what = format!("images of {} cannot be read and are left out", annotations.display());
        labels.warnings.extend(unlisted.line(&what));
        labels.fill(annotations, &file, &entries, &paths);
        // An image that is listed twice is one image.
        let mut listed = HashSet::new();
        let paths = paths.into_iter().filter(|path| listed.insert(path.clone())).collect();
        Self::of_images(paths, labels, false, options)
    }
}

/// Returns the place of an image in `folder`, and never outside of it: an annotation file may come from anywhere. A path of another machine
/// is looked for by its last parts.
fn place(folder: &Path, name: &str) -> PathBuf {
    let name = slashed(name);
    let found = if stays_inside(Path::new(&name)) { None } else { below(folder, &parts(&name)) };
    found.unwrap_or_else(|| folder.join(parts(&name)))
}

impl LabelSet {
    /// Takes the labels of `file` at `path`, whose readable `entries` of images have the paths `images`.
    fn fill(&mut self, path: &Path, file: &File, entries: &[&ImageEntry], images: &[PathBuf]) {
        let mut by_id: HashMap<&Id, &PathBuf> = HashMap::new();
        let mut names: HashMap<&PathBuf, PathBuf> = HashMap::new();
        for (entry, image) in entries.iter().zip(images) {
            // An image without annotations is labelled: it contains no object.
            let labels = self.of_image.entry(image.clone()).or_insert_with(|| ImageLabels::of(Vec::new()));
            let size = entry.width.zip(entry.height).map(|(width, height)| [width.0, height.0]);
            labels.sizes.extend(size.filter(|size| size.iter().all(|side| side.is_finite())));
            let (id, name) = (&entry.id.0, parts(&slashed(&entry.file_name)));
            let same_id = *by_id.entry(&entry.id).or_insert(image);
            let same_file = names.entry(image).or_insert_with(|| name.clone());
            let why = if same_id != image {
                format!("another image has its id {id}, too; give each its own")
            } else if *same_file != name {
                format!("it is found for {} and {}", same_file.display(), name.display())
            } else {
                continue;
            };
            for image in [same_id, image] {
                let why = format!("{}: its labels are not known, since {why}", image.display());
                self.of_image.entry(image.clone()).and_modify(|labels| labels.objects = Err(why));
            }
        }
        self.add_objects(path, file, &by_id);
    }

    fn add_objects(&mut self, path: &Path, file: &File, by_id: &HashMap<&Id, &PathBuf>) {
        let names = names(file);
        // The same object may be there once for each entry of its image.
        let mut entry_of: HashMap<(&PathBuf, String), &Id> = HashMap::new();
        let mut unplaced = Skipped::default();
        for (number, entry) in (1..).zip(&file.annotations) {
            let read = entry.0.as_ref().map_err(|why| format!("annotation {number}: {why}"));
            let (annotation, label) = match read.and_then(|one| Ok((one, label(one, &names)?))) {
                Ok(read) => read,
                Err(why) => {
                    self.unread.add(format!("{}: {why}", path.display()));
                    continue;
                }
            };
            let Some(image) = by_id.get(&annotation.image_id) else {
                unplaced.add(format!("image {}", annotation.image_id.0));
                continue;
            };
            let entry = entry_of.entry((image, format!("{label:?}"))).or_insert(&annotation.image_id);
            let labels = self.of_image.get_mut(*image).filter(|_| **entry == annotation.image_id);
            let objects = labels.and_then(|labels| labels.objects.as_mut().ok());
            objects.into_iter().for_each(|objects| objects.push(label.clone()));
        }
        self.warnings.extend(unplaced.line("annotations have no image and are left out"));
    }
}

/// Returns the names of the categories.
fn names(file: &File) -> Names<'_> {
    let mut names = Names::new();
    for Category { id, name } in file.categories.iter().filter_map(|entry| entry.0.as_ref().ok()) {
        let known = names.entry(id).or_insert(Some(name));
        *known = known.filter(|known| known == name);
    }
    names
}

fn label(annotation: &Annotation, names: &Names<'_>) -> Result<GroundTruth, String> {
    let (image, category) = (&annotation.image_id.0, &annotation.category_id.0);
    let class = names.get(&annotation.category_id).ok_or_else(|| {
        format!("image {image} has an object of category {category}, which `categories` does not name")
    })?;
    let class = class.ok_or_else(|| {
        format!("image {image} has an object of category {category}, which has several names in `categories`")
    })?;
    let bbox = bbox(annotation).map_err(|why| format!("image {image} has {why}"))?;
    let is_crowd = annotation.iscrowd.is_some_and(|crowd| crowd.0 == 1.0);
    let occluded = if is_crowd { CROWD } else { -1 };
    Ok(GroundTruth { bbox, class: class.to_owned(), truncated: -1.0, occluded })
}

/// Returns the box of an annotation, or that around its polygons. The error says what it has instead.
fn bbox(annotation: &Annotation) -> Result<BBox, String> {
    let Annotation { bbox, segmentation, .. } = annotation;
    let is_empty = bbox.is_null() || bbox.as_array().is_some_and(Vec::is_empty);
    if !is_empty {
        let numbers = <[Number; 4]>::deserialize(bbox).map_err(|why| format!("a box {bbox}: {why}"))?;
        let [x, y, width, height] = numbers.map(|number| number.0 as f32);
        // One sum finds NaN and infinity in any of the four.
        if !(x + y + width + height).is_finite() || width < 0.0 || height < 0.0 {
            return Err(format!("a box {x} {y} {width} {height}, finite and not negative needed"));
        }
        return Ok(BBox { x1: x, y1: y, x2: x + width, y2: y + height });
    }
    let polygons = match segmentation {
        Value::Object(_) => return Err("a mask without a box, but a box or polygons are needed".to_owned()),
        _ => Vec::<Vec<Number>>::deserialize(segmentation).unwrap_or_default(),
    };
    let corners: Vec<f32> = polygons.iter().flatten().map(|number| number.0 as f32).collect();
    // A polygon has three corners of two numbers at least.
    let is_polygon = |polygon: &Vec<Number>| polygon.len() >= 6 && polygon.len().is_multiple_of(2);
    if polygons.is_empty() || !polygons.iter().all(is_polygon) || !corners.iter().all(|v| v.is_finite()) {
        return Err("neither a box nor polygons of finite numbers".to_owned());
    }
    Ok(around(corners.chunks_exact(2).map(|corner| [corner[0], corner[1]])))
}

/// Returns the first folder with any of the images.
fn folder_of(annotations: &Path, images: &[&ImageEntry]) -> Result<PathBuf, SourceError> {
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
    // A single image may be missing, such as the first one.
    let has_any = |folder: &PathBuf| images.iter().any(|image| place(folder, &image.file_name).is_file());
    let needed = "none of the images of the annotation file was found; name their folder with --coco-images";
    let first = images.first().map_or_else(PathBuf::new, |image| place(beside, &image.file_name));
    folders.into_iter().find(has_any).ok_or_else(|| SourceError::absent(&first, needed))
}

#[cfg(test)]
mod tests {
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
        let mut source = open(&folder).expect("readable");
        let first = source.next().expect("two").expect("readable");
        let truth = first.ground_truth.expect("labelled");
        assert_eq!(first.name, "b");
        assert_eq!(truth[0].bbox, BBox { x1: 1.0, y1: 2.0, x2: 4.0, y2: 6.0 });
        assert_eq!((truth[0].class.as_str(), truth[0].occluded, truth[1].occluded), ("car", -1, CROWD));
        assert_eq!(source.next().expect("two").expect("readable").ground_truth, Some(vec![]));
        assert!(source.next().is_none());
    }

    fn open(folder: &tempfile::TempDir) -> Result<Source, SourceError> {
        let path = folder.path().join("annotations/instances_val.json");
        Source::coco(&path, None, &SourceOptions::default())
    }

    #[test]
    fn what_is_no_annotation_file_says_so() {
        for (text, expected) in [
            ("{}", "is no COCO annotation file: missing field `images`"),
            ("[{\"image_id\": 7}]", "is no COCO annotation file"),
            (&TEXT.replace("\"categories\"", "\"classes\""), "missing field `categories`"),
            (&TEXT[..200], "EOF"),
            ("{\"images\": [], \"annotations\": [], \"categories\": []}", "lists no image"),
            (
                "{\"images\": [7], \"annotations\": [], \"categories\": []}",
                "1 images cannot be read, the first: ",
            ),
        ] {
            let why = open(&write(text)).err().expect(expected).to_string();
            assert!(why.contains(expected) && why.contains("instances_val.json"), "{why}");
        }
    }

    type Objects = Vec<Result<Vec<GroundTruth>, String>>;

    /// The objects of b.png and a.png, and the lines about what is left out.
    fn read(text: &str) -> (Objects, Vec<String>) {
        let folder = write(text);
        let mut source = open(&folder).expect("readable");
        let objects = source
            .by_ref()
            .map(|frame| Ok(frame.map_err(|why| why.to_string())?.ground_truth.expect("labelled")));
        let objects = objects.collect();
        (objects, [source.losses, source.warnings].concat())
    }

    fn objects(text: &str) -> Objects {
        let (objects, lines) = read(text);
        assert_eq!(lines, [""; 0]);
        objects
    }

    #[test]
    fn a_bad_annotation_costs_only_itself() {
        for (bad, expected) in [
            (r#""category_id": 9, "bbox": [1, 2, 3, 4]"#, "image 7 has an object of category 9, which"),
            (r#""category_id": 2, "bbox": [1, 2, -3, 4]"#, "not negative needed"),
            (r#""category_id": 2, "bbox": [1, 2, NaN, 4]"#, "a box 1 2 NaN 4, finite"),
            (r#""category_id": 2, "bbox": [-Infinity, 2, 3, 4]"#, "a box -inf 2 3 4, finite"),
            (r#""category_id": 2, "bbox": [1, 2, 3, "wide"]"#, "a number needed"),
            (r#""category_id": 2, "bbox": [1, 2, 3]"#, "image 7 has a box [1,2,3]: "),
            (r#""category_id": 2, "bbox": [1, 2, 3, 4, 30]"#, "image 7 has a box [1,2,3,4,30]: "),
            (r#""category_id": 2, "bbox": null"#, "image 7 has neither a box nor polygons"),
            (
                r#""category_id": 2, "segmentation": {"counts": [9], "size": [3, 3]}"#,
                "has a mask without a box",
            ),
            (r#""category_id": 2, "segmentation": [[1, 2, 3, 4]]"#, "neither a box nor polygons"),
            (r#""category_id": 2, "segmentation": [[1, 2, 3, 4, 5, NaN]]"#, "polygons of finite numbers"),
            (r#""category_id": null, "bbox": [1, 2, 3, 4]"#, "annotation 1: id null found"),
            (r#""bbox": [1, 2, 3, 4]"#, "annotation 1: missing field `category_id`"),
        ] {
            let text =
                TEXT.replacen("{\"image_id\"", &format!("{{\"image_id\": 7, {bad}}}, {{\"image_id\""), 1);
            let (with, lines) = read(&text);
            assert_eq!(with, objects(TEXT), "{bad}");
            let [line] = &lines[..] else { panic!("{bad}: {lines:?}") };
            assert!(line.starts_with("1 labels cannot be read and are left out, the first: "), "{line}");
            assert!(line.contains("instances_val.json: ") && line.contains(expected), "{line}");
        }
        // What is no object at all, and an image that is not listed.
        let (with, lines) = read(&TEXT.replacen("\"annotations\": [", "\"annotations\": [null, 7, [],", 1));
        assert_eq!(with, objects(TEXT));
        assert!(lines[0].starts_with("3 labels cannot be read"), "{lines:?}");
        let (_, lines) = read(&TEXT.replacen("\"image_id\": 7", "\"image_id\": 8", 1));
        assert_eq!(lines, ["1 annotations have no image and are left out, the first: image 8"]);
    }

    #[test]
    fn an_annotation_of_polygons_has_the_box_around_them() {
        let polygons = r#""bbox": [], "segmentation": [[1, 3, "4", 2, 2, 5], [0, 4, 1, 4, 1, 6.5]]"#;
        for polygons in [polygons, &polygons.replace("[],", "null,"), &polygons.replace("\"bbox\": [],", "")]
        {
            let read = objects(&TEXT.replace("\"bbox\": [1, 2, 3, 4]", polygons));
            let boxes: Vec<_> = read[0].iter().flatten().map(|label| label.bbox).collect();
            assert_eq!(boxes[0], BBox { x1: 0.0, y1: 2.0, x2: 4.0, y2: 6.5 });
        }
        // A box counts where there are both.
        let both = TEXT.replace("[1, 2, 3, 4]", "[1, 2, 3, 4], \"segmentation\": [[0, 0, 1, 0, 1, 1]]");
        assert_eq!(objects(&both), objects(TEXT));
    }

    #[test]
    fn an_image_whose_labels_are_not_certain_is_left_out() {
        let whole = objects(TEXT);
        for (text, expected) in [
            (TEXT.replace("\"id\": 3", "\"id\": 7"), "another image has its id 7"),
            (TEXT.replace("\"b.png", "\"C:\\\\x\\\\a.png"), "it is found for x/a.png and a.png"),
        ] {
            let (read, _) = read(&text);
            assert!(
                read.iter().all(|labels| labels.as_ref().is_err_and(|why| why.contains(expected))),
                "{read:?}"
            );
        }
        // A category with two names costs its own objects.
        let (read_twice, lines) = read(&TEXT.replace("{\"id\": 1,", "{\"id\": 2,"));
        assert!(
            read_twice[0] == Ok(vec![])
                && lines[0].starts_with("2 labels")
                && lines[0].contains("several names"),
            "{lines:?}"
        );
        // An entry that is no image costs its own labels.
        let (one, lines) = read(&TEXT.replace("\"file_name\": \"a.png\"", "\"file\": \"a.png\""));
        assert_eq!(one, whole[..1]);
        assert!(
            lines[0].starts_with("1 images of ") && lines[0].contains("missing field `file_name`"),
            "{lines:?}"
        );
    }

    #[test]
    fn paths_of_other_machines_are_found_in_the_folder_and_never_outside() {
        for name in [
            "C:\\\\data\\\\val\\\\a.png",
            "/content/data/a.png",
            ".\\\\a.png",
            "./a.png",
            "x/../../val/a.png",
            "\\\\\\\\server\\\\a.png",
        ] {
            assert_eq!(objects(&TEXT.replace("\"a.png", &format!("\"{name}"))), objects(TEXT), "{name}");
        }
        let folder = Path::new("images");
        for name in ["/etc/passwd", "../../etc/passwd", "C:\\etc\\passwd"] {
            assert_eq!(place(folder, name), Path::new("images/etc/passwd"));
        }
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
