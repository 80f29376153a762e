//! [`Pictures`]: what a source shows, picture by picture as it is, for a detector or a person: no sensor sees it.

use std::collections::{BTreeSet, VecDeque};
use std::fmt::Display;
use std::path::{Path, PathBuf};
use std::{iter, mem};

use modulo_core::{Frame, Range, Transfer, tone};
use modulo_images::{Coding, ImageError, White, read_image};
use modulo_runtime::embedded::locate;
use modulo_video::VideoAddress;
use ndarray::Array3;

use super::folder::{images_below, is_image, no_image, one_image, others, stem};
use super::{BagSource, SourceError, SourceOptions, open};
use crate::FileError;

/// A picture of 8 bits.
#[derive(Debug, PartialEq)]
pub struct Picture {
    /// Its path without an extension: of an image in a folder, that below this folder; of a frame, its number or its stamp.
    pub name: PathBuf,
    /// Grey, or red, green and blue. The codes of a file of 8 bits are unchanged.
    pub pixels: Frame,
}

/// The pictures of a source, one after the other. The error of one that cannot be read names it, and the next one comes all the same.
pub struct Pictures {
    /// The name and the path of each picture that is a file and is not read yet.
    pub files: VecDeque<(PathBuf, PathBuf)>,
    coding: Coding,
    frames: Box<dyn Iterator<Item = Result<Picture, SourceError>>>,
    /// A line for each kind of file that is left out.
    pub warnings: Vec<String>,
    /// A line for each part of the source that cannot be read.
    pub losses: Vec<String>,
}

impl Pictures {
    /// Opens what `spec` names: the images in a folder and in all folders below it, or whatever [`open`] reads.
    ///
    /// # Errors
    /// [`SourceError`] of a source that cannot be opened, and of a folder without an image.
    pub fn open(spec: &str, options: &SourceOptions) -> Result<Self, SourceError> {
        let path = locate(Path::new(spec)).map_err(|why| FileError::new(Path::new(spec), why))?;
        let (coding, files) = (options.coding.clone(), VecDeque::new());
        let (warnings, losses) = (Vec::new(), Vec::new());
        let mut opened = Self { files, coding, frames: Box::new(iter::empty()), warnings, losses };
        if !spec.contains("://") && crate::bag::is_bag(&path) {
            let mut bag = BagSource::open(&path, options)?;
            opened.losses = mem::take(&mut bag.losses);
            opened.frames = Box::new(iter::from_fn(move || bag.next_picture()));
        } else if path.is_dir() {
            opened.take_folder(&path)?;
        } else if path.is_file() && is_image(&path) {
            opened.files.push_back((PathBuf::from(stem(&path)), one_image(&path)?));
        } else {
            let mut source = open(spec, options)?;
            (opened.warnings, opened.losses) =
                (mem::take(&mut source.warnings), mem::take(&mut source.losses));
            // The frames of a video have nothing but numbers.
            let before = match VideoAddress::of(spec)? {
                Some(VideoAddress::File(_)) => format!("{}_", stem(&path)),
                _ => String::new(),
            };
            opened.frames = Box::new(source.map(move |frame| {
                let frame = frame?;
                let name = format!("{before}{}", frame.name).into();
                Ok(Picture { name, pixels: of_radiance(&frame.radiance, Transfer::Linear) })
            }));
        }
        Ok(opened)
    }

    /// Takes the images in a folder and in all folders below it.
    fn take_folder(&mut self, folder: &Path) -> Result<(), SourceError> {
        let images = images_below(folder)?;
        if images.is_empty() {
            return Err(no_image(folder, "", &[]));
        }
        let folders: BTreeSet<_> = images.iter().filter_map(|image| image.parent()).collect();
        self.warnings.extend(others(folders));
        let name = |image: &PathBuf| {
            image.strip_prefix(folder).expect("it was found below the folder").with_extension("")
        };
        self.files.extend(images.iter().map(|image| (name(image), image.clone())));
        Ok(())
    }
}

impl Iterator for Pictures {
    type Item = Result<Picture, SourceError>;

    fn next(&mut self) -> Option<Self::Item> {
        let Some((name, file)) = self.files.pop_front() else { return self.frames.next() };
        // A white for each file: with a common one, a picture would depend on those before it.
        let white = White::new(self.coding.clone());
        let pixels = read_image(&file).and_then(|image| match image.depth() {
            8 => Ok(image),
            _ => eight_bits(&image, &mut white?, file.display()),
        });
        Some(pixels.map(|pixels| Picture { name, pixels }).map_err(SourceError::from))
    }
}

/// Returns the codes of 8 bits as they are, 16 bits by their upper ones or the white, and radiance as a screen shows it.
pub(super) fn eight_bits(
    image: &Frame,
    white: &mut White,
    origin: impl Display,
) -> Result<Frame, ImageError> {
    let transfer = if image.depth() == 32 { Transfer::Srgb } else { Transfer::Linear };
    Ok(of_radiance(&white.radiance(image, origin)?, transfer))
}

/// Returns the picture of the radiance of a source, in [0, 1). With the linear transfer, the codes of 8 bits that it was read from are returned.
pub fn of_radiance(radiance: &Array3<f32>, transfer: Transfer) -> Frame {
    let range = Range::new(8, 1.0).expect("one peak of 8 bits is possible");
    tone::picture(&radiance.mapv(|share| share * 256.0), range, transfer).expect("a source gives images")
}
