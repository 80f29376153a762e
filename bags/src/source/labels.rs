//! [`LabelSet`]: the labels of image files. All are read when a source is opened, so that what is left out is known before the first
//! frame. A label that cannot be read costs only itself.

use std::collections::{BTreeSet, HashMap};
use std::path::{Path, PathBuf};

use modulo_core::BBox;
use modulo_runtime::input;

use super::folder::{files_of, stem};
use super::{GroundTruth, SourceError};
use crate::FileError;

/// Things of one kind that are left out.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Skipped {
    count: usize,
    first: String,
}

impl Skipped {
    /// Counts one more, and keeps the description of the first one.
    pub fn add(&mut self, one: impl Into<String>) {
        if self.count == 0 {
            self.first = one.into();
        }
        self.count += 1;
    }

    /// Returns a line that says how many there are of `what`, and which is the first; `None` without one.
    pub fn line(&self, what: &str) -> Option<String> {
        (self.count > 0).then(|| format!("{} {what}, the first: {}", self.count, self.first))
    }
}

impl<T: Into<String>> FromIterator<T> for Skipped {
    fn from_iter<I: IntoIterator<Item = T>>(all: I) -> Self {
        let mut left_out = Self::default();
        all.into_iter().for_each(|one| left_out.add(one));
        left_out
    }
}

/// The labels of one image.
#[derive(Debug)]
pub(super) struct ImageLabels {
    /// The objects, or why they are not known.
    pub objects: Result<Vec<GroundTruth>, String>,
    /// Whether the boxes are shares of the image, and not px.
    pub in_shares: bool,
    /// Width and height that the labels say the image has, px.
    pub sizes: Vec<[f64; 2]>,
}

impl ImageLabels {
    /// Returns labels in px.
    pub fn of(objects: Vec<GroundTruth>) -> Self {
        Self { objects: Ok(objects), in_shares: false, sizes: Vec::new() }
    }

    /// Returns the objects in px of the image `name`, which has this height and width.
    pub fn on(&self, name: &Path, (height, width): (usize, usize)) -> Result<Vec<GroundTruth>, SourceError> {
        let objects = self.objects.clone().map_err(SourceError::Unreadable)?;
        // Boxes on an image of another size, or before a turn by its EXIF orientation, are those of other pixels.
        if let Some([w, h]) = self.sizes.iter().find(|size| **size != [width as f64, height as f64]) {
            let why = format!(
                "is listed with {w} x {h} px, but has {width} x {height} px as it is shown, so that its boxes are not those of its pixels; \
                 label it anew"
            );
            return Err(SourceError::of(name, &why));
        }
        let (w, h) = if self.in_shares { (width as f32, height as f32) } else { (1.0, 1.0) };
        let scaled = |label: GroundTruth| {
            let BBox { x1, y1, x2, y2 } = label.bbox;
            GroundTruth { bbox: BBox { x1: x1 * w, y1: y1 * h, x2: x2 * w, y2: y2 * h }, ..label }
        };
        Ok(objects.into_iter().map(scaled).collect())
    }
}

/// The labels of a set of images.
#[derive(Debug, Default)]
pub(super) struct LabelSet {
    /// Those of each image that is labelled.
    pub of_image: HashMap<PathBuf, ImageLabels>,
    /// Labels that cannot be read.
    pub unread: Skipped,
    /// Lines about labels of no image, and the like.
    pub warnings: Vec<String>,
}

impl LabelSet {
    /// Reads the text of labels of each image, which lies beside the first of its `places` that has one. Its lines are read by `parse`.
    pub fn of_texts(
        images: &[PathBuf],
        places: impl Fn(&Path) -> Vec<PathBuf>,
        parse: impl Fn(&str) -> Result<GroundTruth, String>,
        in_shares: bool,
    ) -> Self {
        let mut labels = Self::default();
        for image in images {
            let Some(file) = places(image).iter().find_map(|place| text_beside(place)) else { continue };
            let rows = rows(&file, &parse).map_err(|why| why.to_string());
            let objects = rows.map(|rows| kept(rows, &mut labels.unread));
            labels.of_image.insert(image.clone(), ImageLabels { objects, in_shares, sizes: Vec::new() });
        }
        labels
    }
}

/// Returns a line that counts the labels `names`, which have no image, and names the first one.
pub(super) fn without_image<T: Into<String>>(
    what: &str,
    names: impl IntoIterator<Item = T>,
) -> Option<String> {
    names.into_iter().collect::<Skipped>().line(&format!("{what} have no image and are left out"))
}

/// Returns the text files in `folders` whose names are not those of `images`, sorted. A folder that does not exist has none.
pub(super) fn texts_without_image(folders: &[PathBuf], images: &[PathBuf]) -> Vec<PathBuf> {
    let stems: BTreeSet<String> = images.iter().map(|image| stem(image)).collect();
    let mut texts: Vec<_> = folders.iter().flat_map(|folder| files_of(folder, &["txt"])).collect();
    texts.retain(|path| path.is_file() && !stems.contains(&stem(path)));
    texts
}

/// Returns the file of labels beside `path`, which has another extension; programs of Windows may write that of labels in capitals.
fn text_beside(path: &Path) -> Option<PathBuf> {
    ["txt", "TXT"].map(|extension| path.with_extension(extension)).into_iter().find(|path| path.is_file())
}

/// Returns the box around corners, of which there is at least one.
pub(super) fn around(corners: impl IntoIterator<Item = [f32; 2]>) -> BBox {
    let start = BBox { x1: f32::INFINITY, y1: f32::INFINITY, x2: f32::NEG_INFINITY, y2: f32::NEG_INFINITY };
    corners.into_iter().fold(start, |b, [x, y]| BBox {
        x1: b.x1.min(x),
        y1: b.y1.min(y),
        x2: b.x2.max(x),
        y2: b.y2.max(y),
    })
}

/// Size of the largest text of labels, bytes.
const LARGEST_LABELS: u64 = 256 << 20;

/// Reads a text of labels, or of names.
pub(super) fn read_text(path: &Path) -> Result<String, FileError> {
    input::read_text(path, LARGEST_LABELS).map_err(|why| FileError::new(path, why))
}

/// Reads each line of a text of labels that is not blank with `parse`. An error names the file and the line.
pub(super) fn rows<T>(
    path: &Path,
    parse: impl Fn(&str) -> Result<T, String>,
) -> Result<Vec<Result<T, String>>, FileError> {
    let text = read_text(path)?;
    // Numbered before blank lines are left out, so that errors name the line of the file.
    let lines = (1..).zip(text.lines()).filter(|(_, text)| !text.trim().is_empty());
    let named = |line, why: String| SourceError::label(path, line, &why).to_string();
    Ok(lines.map(|(line, text)| parse(text).map_err(|why| named(line, why))).collect())
}

/// Returns the rows that could be read, and counts the others.
pub(super) fn kept<T>(rows: Vec<Result<T, String>>, unread: &mut Skipped) -> Vec<T> {
    rows.into_iter().filter_map(|row| row.map_err(|why| unread.add(why)).ok()).collect()
}
