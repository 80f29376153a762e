//! KITTI folders: `image_2` with `label_2` (object set), `image_02` with `label_object` and `label_track` (a drive), or
//! `image_02/DRIVE` of the tracking set beside `label_02/DRIVE.txt`; labels optional per frame.
//!
//! Label lines are `type truncated occluded alpha x1 y1 x2 y2 h w l x y z ry` (15 columns, object development kit); a
//! tracking line has the frame and the track in front of that (17 columns). Results have a score behind it (16 and 18 columns), and so
//! have labels of some programs, which is not used.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use modulo_core::BBox;

use super::folder::{list_images, stem};
use super::labels::{ImageLabels, LabelSet, Skipped, kept, rows, texts_without_image, without_image};
use super::{GroundTruth, Source, SourceError, SourceOptions};

/// Folders of a KITTI folder: images, and labels by preference.
const LAYOUTS: [(&str, &[&str]); 2] =
    [("image_2", &["label_2"]), ("image_02", &["label_object", "label_track"])];

/// Where the labels of a KITTI folder are.
enum LabelFiles {
    /// One file for each frame, in folders by preference.
    Folders(Vec<PathBuf>),
    /// One file for a drive.
    Drive(PathBuf),
}

/// Returns whether `path` has KITTI's folder of images.
pub(super) fn is_at(path: &Path) -> bool {
    layout(path).is_some() || tracking_file(path).is_some()
}

impl Source {
    /// Opens a KITTI folder, which holds `image_2` or `image_02`, or is a drive of the tracking set; with a `list` only its frames, in that
    /// order, of which a frame without an image is one that cannot be read. Of `options`, the topic is not used.
    ///
    /// # Errors
    /// [`SourceError`] when there is no such folder or no image in it, when the labels of a drive cannot be read, and for a `white` that is not a
    /// valid radiance.
    pub fn kitti(
        path: &Path,
        list: Option<&FrameList>,
        options: &SourceOptions,
    ) -> Result<Self, SourceError> {
        let (images, files) = match (layout(path), tracking_file(path)) {
            (Some((images, labels)), _) => {
                let folders = labels.iter().map(|name| path.join(name)).collect();
                (list_images(&path.join(images))?, LabelFiles::Folders(folders))
            }
            (None, Some(file)) => (list_images(path)?, LabelFiles::Drive(file)),
            (None, None) => return Err(absent(path)),
        };
        let Some(list) = list else {
            let labels = files.read(&images, true)?;
            return Self::of_images(images, labels, true, options);
        };
        let by_name: BTreeMap<String, &PathBuf> = images.iter().map(|image| (stem(image), image)).collect();
        let folder = images.first().and_then(|image| image.parent()).unwrap_or(path);
        let image = |frame: &String| {
            by_name.get(frame).map_or_else(|| folder.join(format!("{frame}.png")), |image| (*image).clone())
        };
        let images: Vec<_> = list.frames.iter().map(image).collect();
        let labels = files.read(&images, false)?;
        Self::of_images(images, labels, false, options)
    }
}

impl LabelFiles {
    /// Reads the labels of `images`, which are `all` of their folder or some.
    fn read(&self, images: &[PathBuf], all: bool) -> Result<LabelSet, SourceError> {
        let (mut labels, without) = match self {
            Self::Folders(folders) => {
                let places = |image: &Path| {
                    folders.iter().map(|folder| folder.join(image.file_name().unwrap_or_default())).collect()
                };
                let files = texts_without_image(folders, images).into_iter();
                let without = without_image("label files", files.map(|file| file.display().to_string()));
                (LabelSet::of_texts(images, places, parse_label, false), without)
            }
            Self::Drive(file) => {
                let mut labels = LabelSet::default();
                let mut frames = read_drive(file, &mut labels.unread)?;
                for image in images {
                    // A frame of a drive without a line is labelled as empty; only a name without a number has no labels.
                    let Ok(number) = stem(image).parse() else { continue };
                    let objects = frames.get(&number).cloned().unwrap_or_default();
                    labels.of_image.insert(image.clone(), ImageLabels::of(objects));
                }
                let there: BTreeSet<u64> =
                    images.iter().filter_map(|image| stem(image).parse().ok()).collect();
                frames.retain(|frame, _| !there.contains(frame));
                let names = frames.keys().map(|frame| format!("frame {frame}"));
                (labels, without_image("labelled frames", names))
            }
        };
        // Where only some images are taken, the labels of the others are left out on purpose.
        labels.warnings.extend(without.filter(|_| all));
        Ok(labels)
    }
}

/// Returns the error of a folder that is not KITTI's, with the one below it that may be meant.
fn absent(path: &Path) -> SourceError {
    let inside = std::fs::read_dir(path).into_iter().flatten().flatten().map(|entry| entry.path());
    let mut inside: Vec<_> = inside.filter(|path| is_at(path)).collect();
    inside.sort();
    let needed = "a KITTI folder has its images in image_2 or image_02";
    match inside.first() {
        Some(meant) => SourceError::of(path, &format!("{needed}, as {} has", meant.display())),
        None => SourceError::absent(&path.join(LAYOUTS[0].0), needed),
    }
}

fn layout(path: &Path) -> Option<&'static (&'static str, &'static [&'static str])> {
    LAYOUTS.iter().find(|(images, _)| path.join(images).is_dir())
}

/// Returns `label_02/DRIVE.txt` for `image_02/DRIVE`, if that file exists.
fn tracking_file(path: &Path) -> Option<PathBuf> {
    let drive = path.file_name()?.to_str()?;
    let file = path.parent()?.parent()?.join("label_02").join(format!("{drive}.txt"));
    (path.is_dir() && file.is_file()).then_some(file)
}

fn read_drive(path: &Path, unread: &mut Skipped) -> Result<BTreeMap<u64, Vec<GroundTruth>>, SourceError> {
    let parse = |text: &str| {
        let frame = whole("frame", text.split_whitespace().next().unwrap_or_default())?;
        Ok((frame, parse_label(text)?))
    };
    let mut frames: BTreeMap<u64, Vec<GroundTruth>> = BTreeMap::new();
    for (frame, label) in kept(rows(path, parse)?, unread) {
        frames.entry(frame).or_default().push(label);
    }
    Ok(frames)
}

fn parse_label(line: &str) -> Result<GroundTruth, String> {
    let mut columns: Vec<&str> = line.split_whitespace().collect();
    match columns.len() {
        15 | 16 => {}
        17 | 18 => drop(columns.drain(..2)),
        found => {
            return Err(format!(
                "{found} columns found, 15 needed (17 for tracking, and one more with a score)"
            ));
        }
    }
    if number(columns[0]).is_ok() {
        return Err(format!(
            "'{}' found in {} columns, where a class is needed",
            columns[0],
            line.split_whitespace().count()
        ));
    }
    // All columns are read, so that a damaged line is found even where its box is readable.
    let numbers = columns[1..].iter().map(|c| number(c)).collect::<Result<Vec<f32>, String>>()?;
    let [truncated, _, _, x1, y1, x2, y2, ..] = numbers[..] else {
        return Err(format!("{} columns found, 15 needed", columns.len()));
    };
    // A box with swapped corners has an area of 0 and no detection could match it.
    if x1 > x2 || y1 > y2 {
        return Err(format!("box {x1} {y1} {x2} {y2} found, x1 <= x2 and y1 <= y2 needed"));
    }
    let occluded = whole("occluded", columns[2])?;
    let class = columns[0].to_ascii_lowercase();
    Ok(GroundTruth { bbox: BBox { x1, y1, x2, y2 }, class, truncated, occluded })
}

/// Reads a column that has a whole number, which some programs write as `1.00`. `what` is its name in the error.
pub(super) fn whole<T: TryFrom<i64>>(what: &str, column: &str) -> Result<T, String> {
    let value = column.parse::<f64>().ok().filter(|value| value.fract() == 0.0 && value.abs() < 1e15);
    let value = value.and_then(|value| T::try_from(value as i64).ok());
    value.ok_or_else(|| format!("{what} '{column}' found, a whole number needed"))
}

pub(super) fn number(column: &str) -> Result<f32, String> {
    let value = column.parse().ok().filter(|v: &f32| v.is_finite());
    value.ok_or_else(|| format!("'{column}' found, a finite number needed"))
}

/// A list of frames of a folder in some order, with the drives that they come from.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FrameList {
    /// Name for people: the file.
    pub name: String,
    /// Names of the image files without extension.
    pub frames: Vec<String>,
    drives: BTreeMap<String, String>,
}

impl FrameList {
    /// Reads lines `FRAME [DRIVE]`; `#` opens a comment.
    ///
    /// # Errors
    /// [`SourceError`] when the file cannot be read or names no frame.
    pub fn read(path: &Path) -> Result<Self, SourceError> {
        let parse = |text: &str| {
            // Comments may also follow an entry.
            let entry = text.split_once('#').map_or(text, |(entry, _comment)| entry);
            match entry.split_whitespace().collect::<Vec<_>>()[..] {
                [] => Ok(None),
                [frame] => Ok(Some((frame.to_owned(), None))),
                [frame, drive] => Ok(Some((frame.to_owned(), Some(drive.to_owned())))),
                _ => Err(format!("'{text}' found, FRAME or FRAME DRIVE needed")),
            }
        };
        let entries = rows(path, parse)?.into_iter().collect::<Result<Vec<_>, String>>();
        let entries: Vec<_> = entries.map_err(SourceError::Unreadable)?.into_iter().flatten().collect();
        let frames: Vec<_> = entries.iter().map(|(frame, _)| frame.clone()).collect();
        let drives = entries.into_iter().filter_map(|(frame, drive)| Some((frame, drive?))).collect();
        if frames.is_empty() {
            return Err(SourceError::label(path, 1, "the list is empty, at least one frame is needed"));
        }
        Ok(Self { name: path.display().to_string(), frames, drives })
    }

    /// Returns the drive of a frame, if the list names it.
    pub fn drive_of(&self, frame: &str) -> Option<&str> {
        self.drives.get(frame).map(String::as_str)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const CAR: &str = "Car 0.08 1 2.25 0.00 171.72 149.30 236.40 1.78 1.60 4.29 -16.40 1.78 22.09 1.62";

    #[test]
    fn object_and_tracking_lines_are_the_same_label() {
        let label = parse_label(CAR).expect("15 columns");
        for (line, columns) in [
            (format!("3 7 {CAR}"), "17 columns"),
            (format!("{CAR} 0.9"), "16 columns"),
            (format!("3 7 {CAR} 0.9\r"), "18 columns"),
            (CAR.replace(" 1 ", " 1.00 "), "a number with digits behind the point"),
        ] {
            assert_eq!(parse_label(&line).as_ref(), Ok(&label), "{columns}");
        }
        let bbox = BBox { x1: 0.0, y1: 171.72, x2: 149.3, y2: 236.4 };
        assert_eq!(label, GroundTruth { bbox, class: "car".into(), truncated: 0.08, occluded: 1 });
    }

    #[test]
    fn bad_lines_say_what_was_found_and_what_is_needed() {
        for (line, found, needed) in [
            ("Car 0.0 1", "3 columns", "15 needed"),
            (&format!("{CAR} 0.9 1 1 1"), "19 columns", "17 for tracking"),
            (&format!("3 {CAR}"), "'3'", "class"),
            (&format!("{CAR} good"), "'good'", "number"),
            (&CAR.replace("171.72", "top"), "'top'", "number"),
            (&CAR.replace("171.72", "NaN"), "'NaN'", "finite"),
            (&CAR.replace(" 1 ", " 0.5 "), "'0.5'", "whole"),
            (&CAR.replace("149.30", "-1"), "-1", "x1 <= x2"),
        ] {
            let why = parse_label(line).expect_err(line);
            assert!(why.contains(found) && why.contains(needed), "{why}");
        }
    }

    fn read(text: &str) -> Result<FrameList, String> {
        let file = tempfile::NamedTempFile::new().expect("a file");
        std::fs::write(file.path(), text).expect("written");
        FrameList::read(file.path()).map_err(|why| why.to_string())
    }

    #[test]
    fn a_frame_may_have_a_drive() {
        let list = read("000003 # first\n\n000001 drive_0011\n").expect("two frames");
        assert_eq!(list.frames, ["000003", "000001"]);
        assert_eq!((list.drive_of("000003"), list.drive_of("000001")), (None, Some("drive_0011")));
    }

    #[test]
    fn an_empty_list_is_an_error() {
        assert!(read("# nothing\n").expect_err("empty").contains("at least one frame"));
        assert!(read("1 2 3\n").expect_err("three words").contains("FRAME DRIVE"));
    }
}
