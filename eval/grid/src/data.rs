//! [`Data`]: the labelled frames of an evaluation, and which of them can be scored.

use std::path::{Path, PathBuf};

use modulo_bags::source::{
    self, CocoSource, FrameList, KittiFolder, KittiSource, Source, SourceError, SourceOptions, YoloSource,
};

use crate::classes::ClassMap;
use crate::results::Difficulty;

/// Where labelled frames are.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Data {
    /// A KITTI object folder, all of it or the frames of a list.
    Kitti {
        /// Folder that holds `image_2` and `label_2`.
        folder: PathBuf,
        /// Frames to take, in this order.
        list: Option<FrameList>,
    },
    /// KITTI drives with tracking labels; each is a drive of its own.
    Sequences(Vec<PathBuf>),
    /// Images with YOLO's labels.
    Yolo(PathBuf),
    /// Images with COCO's labels.
    Coco {
        /// The annotation file.
        annotations: PathBuf,
        /// Where its images are; `None`: beside it, as the data set lies.
        images: Option<PathBuf>,
    },
    /// Whatever a camera can read and that brings its ground truth: a bag, `scene://PRESET`.
    Any(String),
}

/// A source and the drive that all of its frames come from, if it is known.
pub(crate) type Drive = (Option<String>, Box<dyn Source>);

impl Data {
    /// All its sources, at their first frames.
    pub(crate) fn open(&self) -> Result<Vec<Drive>, SourceError> {
        match self {
            Self::Kitti { folder, list: None } => Ok(vec![(None, Box::new(KittiSource::open(folder, 0.0)?))]),
            Self::Kitti { folder, list: Some(list) } => {
                let folder = KittiFolder::listed(folder, &list.frames)?;
                Ok(vec![(None, Box::new(KittiSource::of(folder, 0.0)?))])
            }
            Self::Sequences(folders) => folders.iter().map(|folder| sequence(folder)).collect(),
            Self::Yolo(folder) => Ok(vec![(None, Box::new(YoloSource::open(folder)?))]),
            Self::Coco { annotations, images } => {
                Ok(vec![(None, Box::new(CocoSource::open(annotations, images.as_deref())?))])
            }
            Self::Any(spec) => Ok(vec![(None, source::open(spec, &SourceOptions::default())?)]),
        }
    }

    /// The drive of a frame, where a list says it.
    pub(crate) fn drive_of(&self, frame: &str) -> Option<String> {
        match self {
            Self::Kitti { list: Some(list), .. } => list.drive_of(frame).map(str::to_owned),
            _ => None,
        }
    }

    /// As it was given, for people.
    pub fn name(&self) -> String {
        let path = |path: &Path| path.display().to_string();
        match self {
            Self::Kitti { folder, list: None } => path(folder),
            Self::Kitti { folder, list: Some(list) } => format!("{} ({})", path(folder), list.name),
            Self::Sequences(folders) => {
                folders.iter().map(|folder| path(folder)).collect::<Vec<_>>().join(", ")
            }
            Self::Yolo(folder) => path(folder),
            Self::Coco { annotations, .. } => path(annotations),
            Self::Any(spec) => spec.clone(),
        }
    }

    /// KITTI's names unless the data set brings a model's own.
    pub fn class_map(&self) -> ClassMap {
        match self {
            Self::Yolo(_) | Self::Coco { .. } => ClassMap::same(),
            _ => ClassMap::kitti(),
        }
    }

    /// KITTI's usual step where labels tell it.
    pub fn difficulty(&self) -> Difficulty {
        match self {
            Self::Yolo(_) | Self::Coco { .. } => Difficulty::All,
            _ => Difficulty::Moderate,
        }
    }
}

fn sequence(folder: &Path) -> Result<Drive, SourceError> {
    let drive = folder.file_name().map(|name| name.to_string_lossy().into_owned());
    Ok((drive, Box::new(KittiSource::open(folder, 0.0)?)))
}
