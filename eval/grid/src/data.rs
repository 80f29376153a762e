//! [`Data`]: the frames of an evaluation, as the command line or a camera names them.

use std::path::{Path, PathBuf};

use modulo_bags::source::{self, FrameList, Frames, Source, SourceError, SourceFrame, SourceOptions};
use modulo_camera::CameraParameters;
use serde::{Deserialize, Serialize};

/// The place and format of frames.
#[derive(Clone, Debug, PartialEq)]
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
    /// Any sources of the camera node: a bag, `scene://PRESET`. Each of several is a drive.
    Any(Vec<String>),
    /// The source of a camera of the launch file, with its number of frames and whether it starts again.
    Own(Box<CameraParameters>),
}

/// The names of the classes of labels.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum LabelNames {
    /// Those of KITTI.
    #[default]
    Kitti,
    /// Those of the model.
    Model,
}

/// A source, and the drive that all its frames come from, if it is known.
pub type Drive = (Option<String>, Source);

impl Data {
    /// Opens the sources, each of which is a drive or has frames that belong to none.
    pub(crate) fn open(&self, options: &SourceOptions) -> Result<Vec<Drive>, SourceError> {
        let source = match self {
            Self::Kitti { folder, list } => Source::kitti(folder, list.as_ref(), options)?,
            Self::Yolo(path) => Source::yolo(path, options)?,
            Self::Coco { annotations, images } => Source::coco(annotations, images.as_deref(), options)?,
            Self::Sequences(folders) => {
                let name = |folder: &PathBuf| Some(folder.file_name()?.to_string_lossy().into_owned());
                let drive = |folder| Ok((name(folder), Source::kitti(folder, None, options)?));
                return folders.iter().map(drive).collect();
            }
            Self::Any(specs) => {
                let name = |spec: &String| Some(spec.clone()).filter(|_| specs.len() > 1);
                return specs.iter().map(|spec| Ok((name(spec), source::open(spec, options)?))).collect();
            }
            Self::Own(camera) => {
                let topic = Some(camera.source_topic.clone()).filter(|topic| !topic.is_empty());
                let options = SourceOptions { topic, ..options.clone() };
                let mut source = source::open(&camera.source, &options)?;
                let [warnings, losses] = [&mut source.warnings, &mut source.losses].map(std::mem::take);
                let (most, repeats) = (usize::try_from(camera.frames).ok().filter(|n| *n > 0), camera.r#loop);
                let all = source.len.filter(|_| !repeats);
                let len = all.into_iter().chain(most).min();
                let mut limited = Source::over(Limited { source, most, repeats, taken: 0, is_vain: true });
                (limited.len, limited.warnings, limited.losses) = (len, warnings, losses);
                limited
            }
        };
        Ok(vec![(None, source)])
    }

    /// The drive of a frame, if a list names it.
    pub(crate) fn drive_of(&self, frame: &str) -> Option<String> {
        match self {
            Self::Kitti { list: Some(list), .. } => list.drive_of(frame).map(str::to_owned),
            _ => None,
        }
    }

    /// The data as it was given.
    pub(crate) fn name(&self) -> String {
        let path = |path: &Path| path.display().to_string();
        match self {
            Self::Kitti { folder, list: None } => path(folder),
            Self::Kitti { folder, list: Some(list) } => format!("{} ({})", path(folder), list.name),
            Self::Sequences(folders) => {
                folders.iter().map(|folder| path(folder)).collect::<Vec<_>>().join(", ")
            }
            Self::Yolo(folder) => path(folder),
            Self::Coco { annotations, .. } => path(annotations),
            Self::Any(specs) => specs.join(", "),
            Self::Own(camera) => camera.source.clone(),
        }
    }

    /// The names of the classes of its labels.
    pub(crate) fn label_names(&self) -> LabelNames {
        match self {
            Self::Yolo(_) | Self::Coco { .. } => LabelNames::Model,
            _ => LabelNames::Kitti,
        }
    }

    /// Whether its frames are single images, which do not follow each other.
    pub(crate) fn is_still(&self) -> bool {
        matches!(self, Self::Kitti { .. } | Self::Yolo(_) | Self::Coco { .. })
    }

    /// Whether each of its frames should have labels, and be there once.
    pub(crate) fn is_labelled(&self) -> bool {
        !matches!(self, Self::Own(_) | Self::Any(_))
    }
}

/// A source of a number of frames, which may start again for them.
struct Limited {
    source: Source,
    most: Option<usize>,
    repeats: bool,
    taken: usize,
    /// Whether no frame of this round was good: then there would be no end.
    is_vain: bool,
}

impl Frames for Limited {
    fn next(&mut self) -> Option<Result<SourceFrame, SourceError>> {
        if self.most.is_some_and(|most| self.taken >= most) {
            return None;
        }
        let mut next = self.source.next();
        if next.is_none() && self.repeats && !self.is_vain {
            self.is_vain = true;
            self.source.rewind();
            next = self.source.next();
        }
        self.taken += 1;
        self.is_vain &= !matches!(next, Some(Ok(_)));
        next
    }

    fn rewind(&mut self) {
        (self.taken, self.is_vain) = (0, true);
        self.source.rewind();
    }
}
