//! [`open`]: the images of a folder, sorted by name with numbers by their value; one file is a folder of one.

use std::collections::{BTreeSet, HashMap};
use std::fs::DirEntry;
use std::io::{BufRead as _, BufReader};
use std::path::{Path, PathBuf};

use modulo_images::{
    EXTENSIONS, RAW_EXTENSIONS, White, check_regular, has_extension, is_hidden, open_regular, read_image,
    sample_depth, unread,
};
use modulo_video::VideoFile;

use super::labels::{ImageLabels, LabelSet, Skipped};
use super::order::by_number;
use super::{ReadFrames, Source, SourceError, SourceFrame, SourceOptions};
use crate::FileError;

/// Lists the images of `path`, or takes the one file that it names. Of `options`, the topic is not used.
pub(super) fn open(path: &Path, options: &SourceOptions) -> Result<Source, SourceError> {
    let (images, is_whole) =
        if path.is_dir() { (list_images(path)?, true) } else { (vec![one_image(path)?], false) };
    Source::of_images(images, LabelSet::default(), is_whole, options)
}

/// Image files as frames, with their labels.
struct ImageFiles {
    images: Vec<PathBuf>,
    next: usize,
    white: White,
    labels: HashMap<PathBuf, ImageLabels>,
}

impl Source {
    /// Creates a source of these images, in this order. Where they are all of their folders, those of other formats there are left out.
    pub(super) fn of_images(
        images: Vec<PathBuf>,
        labels: LabelSet,
        is_whole: bool,
        options: &SourceOptions,
    ) -> Result<Self, SourceError> {
        let white = White::new(options.coding.clone())?;
        let folders: BTreeSet<_> = images.iter().filter(|_| is_whole).filter_map(|i| i.parent()).collect();
        let warnings = labels.warnings.into_iter().chain(others(folders)).collect();
        let losses = labels.unread.line("labels cannot be read and are left out").into_iter().collect();
        let len = Some(images.len());
        let frames = Self::over(ImageFiles { images, next: 0, white, labels: labels.of_image });
        Ok(Self { len, warnings, losses, ..frames })
    }
}

impl ImageFiles {
    fn frame(&mut self, path: &Path) -> Result<SourceFrame, SourceError> {
        let radiance = self.white.radiance(&read_image(path)?, path.display())?;
        let (height, width, _) = radiance.dim();
        let labels = self.labels.get(path).map(|labels| labels.on(path, (height, width)));
        Ok(SourceFrame { ground_truth: labels.transpose()?, ..SourceFrame::new(stem(path), radiance) })
    }
}

impl ReadFrames for ImageFiles {
    fn next(&mut self) -> Option<Result<SourceFrame, SourceError>> {
        let path = self.images.get(self.next)?.clone();
        self.next += 1;
        Some(self.frame(&path))
    }

    /// Reads only the images that decide how the later ones are read.
    fn pass(&mut self, frames: u64) {
        let end =
            usize::try_from(frames).unwrap_or(usize::MAX).saturating_add(self.next).min(self.images.len());
        for image in &self.images[self.next..end] {
            let depth = open_regular(image).ok().and_then(|file| sample_depth(BufReader::new(file)));
            // Unreadable files do not affect the white level, neither here nor in `next`.
            if depth.is_some_and(|depth| !self.white.is_settled(depth))
                && let Ok(pixels) = read_image(image)
            {
                self.white.learn(&pixels, image.display());
            }
        }
        self.next = end;
    }

    fn rewind(&mut self) {
        self.next = 0;
    }
}

/// Returns what lies in `folder` under a name with one of these extensions, sorted. A folder that does not exist has none.
pub(super) fn files_of(folder: &Path, extensions: &[&str]) -> Vec<PathBuf> {
    let paths = std::fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.path());
    let mut files: Vec<_> =
        paths.filter(|path| has_extension(path, extensions) && !is_hidden(path)).collect();
    // The order of `read_dir` depends on the file system.
    files.sort();
    files
}

/// Returns the images of a folder, sorted by [`by_number`]; at least one. Those of a camera of KITTI raw or EuRoC lie in `data` below it.
pub(super) fn list_images(folder: &Path) -> Result<Vec<PathBuf>, SourceError> {
    let (mut images, data) = (images_in(folder)?, folder.join("data"));
    if images.is_empty() && data.is_dir() {
        images = images_in(&data)?;
    }
    if images.is_empty() { Err(no_image(folder, "", &folders_of_images(folder).0)) } else { Ok(images) }
}

/// Returns the images of a folder, in the order of the numbers in their names, and a line that counts those of other formats.
///
/// # Errors
/// [`SourceError`] when the folder holds no image or cannot be read.
pub fn images_of(folder: &Path) -> Result<(Vec<PathBuf>, Option<String>), SourceError> {
    Ok((list_images(folder)?, others([folder])))
}

/// Returns the images that lie in `folder` itself, sorted by [`by_number`].
pub(super) fn images_in(folder: &Path) -> Result<Vec<PathBuf>, SourceError> {
    let entries = std::fs::read_dir(folder).and_then(Iterator::collect::<Result<Vec<_>, _>>);
    let entries = entries.map_err(|why| FileError::new(folder, why))?;
    let images = entries.iter().map(DirEntry::path);
    let mut images: Vec<_> = images.filter(|path| is_image(path) && !is_hidden(path)).collect();
    // A link to nowhere, such as git-annex leaves, is an image that cannot be read.
    for image in images.iter().filter(|image| image.exists()) {
        check_regular(image).map_err(|why| FileError::new(image, why))?;
    }
    // The path decides between names that differ only in zeros without a value.
    images.sort_by_cached_key(|path| (path.file_stem().map(by_number), path.clone()));
    Ok(images)
}

/// Returns the images that lie in `folder` and in all folders below it, as Ultralytics reads it; there may be none.
///
/// # Errors
/// [`SourceError`] of a folder that cannot be read, or that has too many folders below it to search all of them.
pub(super) fn images_below(folder: &Path) -> Result<Vec<PathBuf>, SourceError> {
    let (below, is_all) = folders_of_images(folder);
    if !is_all {
        return Err(SourceError::of(folder, "has too many folders below it; give one with images itself"));
    }
    let mut images = images_in(folder)?;
    for folder in below {
        images.extend(images_in(&folder)?);
    }
    Ok(images)
}

/// The largest number of folders that are searched for images.
const MOST_FOLDERS: usize = 10_000;
/// How far below a folder images are searched: links may lead back to it.
const DEPTH: usize = 8;

/// Returns the folders below `folder` that have images in them, sorted, and whether all of them were searched.
pub(super) fn folders_of_images(folder: &Path) -> (Vec<PathBuf>, bool) {
    let (mut level, mut left, mut found) = (vec![folder.to_owned()], MOST_FOLDERS, Vec::new());
    for _ in 0..DEPTH {
        let entries = level.iter().filter_map(|folder| std::fs::read_dir(folder).ok()).flatten().flatten();
        let folders = entries.map(|entry| entry.path()).filter(|path| path.is_dir() && !is_hidden(path));
        level = folders.take(left).collect();
        left -= level.len();
        let has_images = |folder: &&PathBuf| {
            // One that cannot be read may have some: who reads its images is told why.
            std::fs::read_dir(folder).map_or(true, |entries| {
                entries.flatten().any(|entry| is_image(&entry.path()) && !is_hidden(&entry.path()))
            })
        };
        found.extend(level.iter().filter(has_images).cloned());
    }
    found.sort();
    (found, left > 0 && level.is_empty())
}

/// Returns the name of a file without its extension.
pub(crate) fn stem(path: &Path) -> String {
    path.file_stem().expect("the path of a file ends in a name").to_string_lossy().into_owned()
}

pub(super) fn one_image(path: &Path) -> Result<PathBuf, SourceError> {
    let io = |why| FileError::new(path, why);
    let mut file = BufReader::new(open_regular(path).map_err(io)?);
    if let Some(why) = unread(path, file.fill_buf().map_err(io)?) {
        return Err(SourceError::of(path, &why));
    }
    // The content of an image tells its format.
    if is_image(path) || sample_depth(file).is_some() {
        return Ok(path.to_owned());
    }
    Err(SourceError::of(
        path,
        &match VideoFile::open(path) {
            Ok(_) => format!("is a video; put 'video:' before its path, such as video:{}", path.display()),
            Err(_) => "not an image, possible are png, jpg, jpeg, tif, tiff, exr, hdr, .mcap, .db3 and .npz"
                .to_owned(),
        },
    ))
}

/// The number of folders that an error names.
const NAMED: usize = 6;

/// Returns the error of a folder without images, of which one of `inside`, folders below it, may be meant. `option` stands before a path
/// on the command line.
pub(super) fn no_image(folder: &Path, option: &str, inside: &[PathBuf]) -> SourceError {
    let needed = "no image in this folder";
    // People try a model on the images that it was not trained on.
    let is_for_validation =
        |path: &&PathBuf| path.strip_prefix(folder).is_ok_and(|part| part.to_string_lossy().contains("val"));
    let best = inside.iter().find(is_for_validation);
    let Some(best) = best.or(inside.first()) else {
        let others = others([folder]).map_or_else(String::new, |others| format!("; {others}"));
        let needed =
            format!("{needed}, at least one png, jpg, jpeg, tif, tiff, exr or hdr is needed{others}");
        return SourceError::of(folder, &needed);
    };
    let name = |path: &PathBuf| path.strip_prefix(folder).unwrap_or(path).display().to_string();
    let names = inside.iter().take(NAMED).map(name).collect::<Vec<_>>().join(", ");
    let more = if inside.len() > NAMED { ", ..." } else { "" };
    let why = format!("{needed}, which has the subfolders {names}{more}: choose {option}{}", best.display());
    SourceError::of(folder, &why)
}

/// Returns a line that counts the images of other formats in `folders`.
pub(super) fn others(folders: impl IntoIterator<Item = impl AsRef<Path>>) -> Option<String> {
    let extensions = [&UNREAD[..], &RAW_EXTENSIONS].concat();
    let files = folders.into_iter().flat_map(|folder| files_of(folder.as_ref(), &extensions));
    let others: Skipped = files.map(|file| file.display().to_string()).collect();
    others.line("images of other formats are left out (convert them to png)")
}

pub(super) fn is_image(path: &Path) -> bool {
    !path.is_dir() && has_extension(path, &EXTENSIONS)
}

/// File name extensions of images that are not read, in lower case.
const UNREAD: [&str; 13] =
    ["bmp", "webp", "gif", "heic", "heif", "avif", "jp2", "jxl", "pgm", "ppm", "pnm", "pfm", "tga"];

/// Returns the extension of the name of a file in lower case; empty for a name without one.
pub(super) fn extension_of(path: &Path) -> String {
    path.extension().unwrap_or_default().to_string_lossy().to_ascii_lowercase()
}
