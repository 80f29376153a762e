//! [`Data`]: the labelled frames of a grid.

use std::path::{Path, PathBuf};

use modulo_bags::source::{
    self, CocoSource, FrameList, KittiFolder, KittiSource, Source, SourceError, SourceOptions, YoloSource,
};

use crate::classes::ClassMap;
use crate::results::Difficulty;

/// The place and format of labelled frames.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Data {
    /// All frames of a KITTI object folder, or the frames of a list.
    Kitti {
        /// Folder that holds `image_2` and `label_2`.
        folder: PathBuf,
        /// The frames to take, in this order. `None` takes all.
        list: Option<FrameList>,
    },
    /// KITTI drives with tracking labels, one folder for each drive.
    Sequences(Vec<PathBuf>),
    /// Images with YOLO labels.
    Yolo(PathBuf),
    /// Images with COCO labels.
    Coco {
        /// The annotation file.
        annotations: PathBuf,
        /// Folder of the images. `None` searches in the layout of the COCO data set.
        images: Option<PathBuf>,
    },
    /// Any source of the camera node that has ground truth: a bag, `scene://PRESET`.
    Any(String),
}

/// A source, and the drive that all its frames come from, if it is known.
pub(crate) type Drive = (Option<String>, Box<dyn Source>);

impl Data {
    /// Opens all sources.
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

    /// The drive of a frame, if a list names it.
    pub(crate) fn drive_of(&self, frame: &str) -> Option<String> {
        match self {
            Self::Kitti { list: Some(list), .. } => list.drive_of(frame).map(str::to_owned),
            _ => None,
        }
    }

    /// The data as it was given on the command line.
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

    /// The default class mapping: to the classes of KITTI, or the identity for labels that use the classes of the model.
    pub fn class_map(&self) -> ClassMap {
        match self {
            Self::Yolo(_) | Self::Coco { .. } => ClassMap::same(),
            _ => ClassMap::kitti(),
        }
    }

    /// The default difficulty: moderate, or all for labels without such information.
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
