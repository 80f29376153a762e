//! [`FolderSource`]: the images of a folder, sorted by name with numbers by their value; one file is a folder of one.
//! [`LabelledSource`]: the same with labels.

use std::collections::BTreeSet;
use std::ffi::OsStr;
use std::io::BufReader;
use std::path::{Path, PathBuf};

use modulo_images::{EXTENSIONS, White, check_regular, is_hidden, open_regular, read_image, sample_depth};
use modulo_runtime::input;

use super::{GroundTruth, Source, SourceError, SourceFrame, SourceOptions};
use crate::FileError;

/// A folder of images as a source. The list is taken once, when it is opened.
#[derive(Debug)]
pub struct FolderSource {
    images: Vec<PathBuf>,
    next: usize,
    white: White,
    /// The folder of which these are all images.
    folder: Option<PathBuf>,
}

impl FolderSource {
    /// Lists the images of `path`, or takes the one file that it names. Of `options`, the topic is not used.
    ///
    /// # Errors
    /// [`SourceError`] when the folder holds no image or cannot be read.
    pub fn open(path: &Path, options: &SourceOptions) -> Result<Self, SourceError> {
        let is_folder = path.is_dir();
        let images = if is_folder { list_images(path)? } else { vec![one_image(path)?] };
        Ok(Self::of(images, options)?.with_all_of(is_folder.then_some(path)))
    }

    /// Creates a source of just these images, in this order.
    pub(crate) fn of(images: Vec<PathBuf>, options: &SourceOptions) -> Result<Self, SourceError> {
        Ok(Self { images, next: 0, white: White::new(options.coding.clone())?, folder: None })
    }

    /// Says that these are all images of `folder`, so that those of other formats are left out.
    pub(super) fn with_all_of(self, folder: Option<&Path>) -> Self {
        Self { folder: folder.map(Path::to_owned), ..self }
    }
}

impl Source for FolderSource {
    fn next(&mut self) -> Option<Result<SourceFrame, SourceError>> {
        let path = self.images.get(self.next)?;
        self.next += 1;
        let radiance = read_image(path).and_then(|pixels| self.white.radiance(&pixels, path.display()));
        Some(radiance.map(|radiance| SourceFrame::new(stem(path), radiance)).map_err(SourceError::from))
    }

    /// Reads only the images that decide how the later ones are read.
    fn skip(&mut self, frames: u64) {
        let end =
            usize::try_from(frames).unwrap_or(usize::MAX).saturating_add(self.next).min(self.images.len());
        for image in &self.images[self.next..end] {
            let depth = open_regular(image).ok().and_then(|file| sample_depth(BufReader::new(file)));
            // What is no image teaches nothing, neither here nor in `next`.
            if depth.is_some_and(|depth| !self.white.is_settled(depth))
                && let Ok(pixels) = read_image(image)
            {
                self.white.learn(&pixels, image.display());
            }
        }
        self.next = end;
    }

    fn len(&self) -> Option<usize> {
        Some(self.images.len())
    }

    fn warnings(&self) -> Vec<String> {
        let unread: Vec<_> = self.folder.iter().flat_map(|folder| files_of(folder, &UNREAD)).collect();
        let warning = |first: &PathBuf| {
            let (count, first) = (unread.len(), first.display());
            format!("{count} images of other formats are left out, the first: {first}; convert them to png")
        };
        unread.first().map(warning).into_iter().collect()
    }

    fn rewind(&mut self) -> Result<(), SourceError> {
        self.next = 0;
        Ok(())
    }
}

/// The labels of a set of image files.
pub trait Labels: Send {
    /// Returns the objects in the file `image` of `size` (height, width) px; `None` when the file is not labelled.
    ///
    /// # Errors
    /// [`SourceError`] with the file and the line of a label that cannot be read.
    fn labels(&self, image: &Path, size: (usize, usize)) -> Result<Option<Vec<GroundTruth>>, SourceError>;

    /// Returns one line for each kind of label that belongs to none of the files `images`.
    fn without_image(&self, images: &[PathBuf]) -> Vec<String>;
}

/// Returns a line that counts the labels `names`, which have no image, and names the first one.
pub(super) fn warn_without_image(what: &str, names: &[String]) -> Vec<String> {
    let warning =
        |first| format!("{} {what} have no image and are left out, the first: {first}", names.len());
    names.first().map(warning).into_iter().collect()
}

/// Returns the text files in `folder` whose names are not those of `images`, sorted. A folder that does not exist has none.
pub(super) fn texts_without_image(folder: &Path, images: &[PathBuf]) -> Vec<PathBuf> {
    let stems: BTreeSet<String> = images.iter().map(|image| stem(image)).collect();
    let mut texts = files_of(folder, &["txt"]);
    texts.retain(|path| path.is_file() && !stems.contains(&stem(path)));
    texts
}

/// Returns what lies in `folder` under a name with one of these extensions, sorted. A folder that does not exist has none.
fn files_of(folder: &Path, extensions: &[&str]) -> Vec<PathBuf> {
    let paths = std::fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.path());
    let mut files: Vec<_> =
        paths.filter(|path| has_extension(path, extensions) && !is_hidden(path)).collect();
    // The order of `read_dir` depends on the file system.
    files.sort();
    files
}

/// Image files with their labels as a source.
#[derive(Debug)]
pub struct LabelledSource<L> {
    pub(super) frames: FolderSource,
    pub(super) labels: L,
}

impl<L: Labels> Source for LabelledSource<L> {
    fn next(&mut self) -> Option<Result<SourceFrame, SourceError>> {
        // Taken first, because the next call moves on to another path.
        let image = self.frames.images.get(self.frames.next)?.clone();
        let frame = self.frames.next()?;
        Some(frame.and_then(|frame| {
            let (height, width, _) = frame.radiance.dim();
            let ground_truth = self.labels.labels(&image, (height, width))?;
            Ok(SourceFrame { ground_truth, ..frame })
        }))
    }

    fn skip(&mut self, frames: u64) {
        self.frames.skip(frames);
    }

    fn len(&self) -> Option<usize> {
        self.frames.len()
    }

    fn warnings(&self) -> Vec<String> {
        [self.labels.without_image(&self.frames.images), self.frames.warnings()].concat()
    }

    fn rewind(&mut self) -> Result<(), SourceError> {
        self.frames.rewind()
    }
}

/// Returns the images of a folder, sorted by [`natural`]; at least one.
pub(crate) fn list_images(folder: &Path) -> Result<Vec<PathBuf>, SourceError> {
    let io = |e| FileError::new(folder, e);
    let mut images = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(io)? {
        let path = entry.map_err(io)?.path();
        if is_image(&path) && !is_hidden(&path) {
            check_regular(&path).map_err(|why| FileError::new(&path, why))?;
            images.push(path);
        }
    }
    // The path decides between names that differ only in leading zeros.
    images.sort_by_cached_key(|path| (path.file_name().map(natural), path.clone()));
    if images.is_empty() { Err(no_image(folder)) } else { Ok(images) }
}

/// Returns a key that sorts names with numbers by their value: `2.png` before `10.png`.
fn natural(name: &OsStr) -> Vec<u8> {
    let runs = name.as_encoded_bytes().chunk_by(|a, b| a.is_ascii_digit() && b.is_ascii_digit());
    let key = |run: &[u8]| {
        let zeros = run.iter().take_while(|&&digit| digit == b'0').count();
        let number = &run[zeros..];
        // Of two numbers without leading zeros the one with more digits is larger.
        let digits = (number.len() as u64).to_be_bytes();
        if run[0].is_ascii_digit() { [b"0", &digits[..], number].concat() } else { run.to_vec() }
    };
    runs.flat_map(key).collect()
}

/// Returns the name of a file without its extension.
pub(crate) fn stem(path: &Path) -> String {
    path.file_stem().expect("the path of a file ends in a name").to_string_lossy().into_owned()
}

fn one_image(path: &Path) -> Result<PathBuf, SourceError> {
    open_regular(path).map_err(|why| FileError::new(path, why))?;
    if is_image(path) {
        return Ok(path.to_owned());
    }
    let possible = "not an image, possible are png, jpg, jpeg, tif, tiff, exr, hdr, .mcap and .db3; a video is read with";
    let why = format!("{possible} 'video:' before its path, such as video:{}", path.display());
    Err(SourceError::of(path, &why))
}

pub(super) fn no_image(path: &Path) -> SourceError {
    SourceError::of(
        path,
        "no image in this folder, at least one png, jpg, jpeg, tif, tiff, exr or hdr is needed",
    )
}

fn is_image(path: &Path) -> bool {
    path.exists() && !path.is_dir() && has_extension(path, &EXTENSIONS)
}

/// File name extensions of images that are not read, in lower case.
const UNREAD: [&str; 14] =
    ["bmp", "webp", "gif", "heic", "heif", "avif", "jp2", "jxl", "pgm", "ppm", "pnm", "pfm", "tga", "dng"];

/// Returns whether the name of `path` ends in one of these, in either case.
fn has_extension(path: &Path, extensions: &[&str]) -> bool {
    let extension = path.extension().map(|e| e.to_string_lossy().to_ascii_lowercase());
    extension.is_some_and(|e| extensions.contains(&e.as_str()))
}

/// Size of the largest file of labels, bytes.
const LARGEST_LABELS: u64 = 256 << 20;

/// Reads a text of labels, or of names. A byte order mark is no part of it.
pub(super) fn read_text(path: &Path) -> Result<String, FileError> {
    let text = input::read_text(path, LARGEST_LABELS).map_err(|why| FileError::new(path, why))?;
    Ok(text.strip_prefix('\u{feff}').map_or_else(|| text.clone(), str::to_owned))
}

/// Reads each line of a text of labels that is not blank with `parse`.
pub(super) fn read_lines<T>(
    path: &Path,
    parse: impl Fn(&str) -> Result<T, String>,
) -> Result<Vec<T>, SourceError> {
    let text = read_text(path)?;
    // Numbered before blank lines are left out, so that errors name the line of the file.
    let lines = (1..).zip(text.lines()).filter(|(_, text)| !text.trim().is_empty());
    lines.map(|(line, text)| parse(text).map_err(|why| SourceError::label(path, line, &why))).collect()
}
