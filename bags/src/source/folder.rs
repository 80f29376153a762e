//! [`FolderSource`]: the images of a folder, sorted by name; one file is a
//! folder of one.

use std::path::{Path, PathBuf};

use modulo_images::{EXTENSIONS, White, read_image};

use super::{FRAME_ID, Source, SourceError, SourceFrame};

/// A folder of images as a source. The list is taken once, when it is opened.
#[derive(Debug)]
pub struct FolderSource {
    images: Vec<PathBuf>,
    next: usize,
    white: White,
}

impl FolderSource {
    /// Lists the images of `path`, or takes the one file that it names.
    /// `white` as in [`super::SourceOptions`].
    ///
    /// # Errors
    /// [`SourceError`] when the folder holds no image or cannot be read.
    pub fn open(path: &Path, white: f32) -> Result<Self, SourceError> {
        let images = if path.is_dir() { list_images(path)? } else { vec![one_image(path)?] };
        Self::of(images, white)
    }

    /// A source of just these images, in this order.
    pub(crate) fn of(images: Vec<PathBuf>, white: f32) -> Result<Self, SourceError> {
        Ok(Self { images, next: 0, white: White::new(white)? })
    }

    /// The file that the next frame comes from.
    pub(crate) fn upcoming(&self) -> Option<&Path> {
        self.images.get(self.next).map(PathBuf::as_path)
    }
}

impl Source for FolderSource {
    fn next(&mut self) -> Option<Result<SourceFrame, SourceError>> {
        let path = self.images.get(self.next)?;
        self.next += 1;
        let frame = read_image(path).map(|pixels| SourceFrame {
            radiance: self.white.radiance(pixels),
            name: stem(path),
            stamp_ns: None,
            frame_id: FRAME_ID.to_owned(),
            ground_truth: None,
        });
        Some(frame.map_err(SourceError::from))
    }

    fn len(&self) -> Option<usize> {
        Some(self.images.len())
    }

    fn rewind(&mut self) -> Result<(), SourceError> {
        self.next = 0;
        Ok(())
    }
}

/// The images of a folder, by name; at least one.
pub(crate) fn list_images(folder: &Path) -> Result<Vec<PathBuf>, SourceError> {
    let io = |e| SourceError::io(folder, e);
    let mut images = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(io)? {
        let path = entry.map_err(io)?.path();
        if is_image(&path) {
            images.push(path);
        }
    }
    images.sort();
    if images.is_empty() { Err(SourceError::Empty { path: folder.to_owned() }) } else { Ok(images) }
}

/// The file name without its extension.
pub(crate) fn stem(path: &Path) -> String {
    path.file_stem().unwrap_or_default().to_string_lossy().into_owned()
}

fn one_image(path: &Path) -> Result<PathBuf, SourceError> {
    if is_image(path) { Ok(path.to_owned()) } else { Err(SourceError::Extension { path: path.to_owned() }) }
}

fn is_image(path: &Path) -> bool {
    let extension = path.extension().map(|e| e.to_string_lossy().to_ascii_lowercase());
    path.is_file() && extension.is_some_and(|e| EXTENSIONS.contains(&e.as_str()))
}
