//! [`SourceError`]: why there is no frame.

use std::path::PathBuf;

use modulo_images::ImageError;

use crate::FileError;
use crate::bag::BagError;

/// Why a frame could not be had: the file, what was found, what is possible.
#[derive(Debug, thiserror::Error)]
pub enum SourceError {
    /// Nothing is there.
    #[error(
        "{}: no such path; possible are scene://PRESET, an image (png, jpg, jpeg, exr, hdr), a folder of images, \
         a KITTI folder (image_2 or image_02 inside), a .mcap, .db3 or ROS 1 .bag file or a bag folder", path.display()
    )]
    Missing {
        /// The path that was asked for.
        path: PathBuf,
    },
    /// An address that is no scene.
    #[error(transparent)]
    Scene(#[from] modulo_scene::SpecError),
    /// A folder without a single image.
    #[error("{}: no image in this folder, at least one png, jpg, jpeg, exr or hdr is needed", path.display())]
    Empty {
        /// The folder.
        path: PathBuf,
    },
    /// A file that is not an image by its name.
    #[error("{}: not an image, possible are png, jpg, jpeg, exr, hdr, .mcap, .db3 and .bag", path.display())]
    Extension {
        /// The file.
        path: PathBuf,
    },
    /// The system refused.
    #[error(transparent)]
    Io(#[from] FileError),
    /// An image that cannot be had.
    #[error(transparent)]
    Image(#[from] ImageError),
    /// A label line that cannot be read.
    #[error("{}:{line}: {why}", path.display())]
    Label {
        /// The label file.
        path: PathBuf,
        /// Line, from 1.
        line: usize,
        /// What was found and what is needed.
        why: String,
    },
    /// The bag has not exactly one image topic, or not the one asked for.
    #[error("{}: {found}; image topics here: {topics}", path.display())]
    Topic {
        /// The bag.
        path: PathBuf,
        /// What was asked for.
        found: String,
        /// What there is.
        topics: String,
    },
    /// A bag that cannot be read.
    #[error(transparent)]
    Bag(#[from] BagError),
}
