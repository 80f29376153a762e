//! [`DataOptions`]: the frames of an evaluation, as the command line or a camera names them.

use std::path::PathBuf;

use clap::Args;
use modulo_bags::source::{self, FrameList, Source, SourceError, SourceOptions, is_endless};
use modulo_camera::CameraParameters;
use serde::{Deserialize, Serialize};

use crate::GridError;
use crate::frames::Frames;

/// The frames of an evaluation. Without any, they are those of the cameras.
#[derive(Args, Clone, Debug, Default, PartialEq)]
pub struct DataOptions {
    /// Source of frames, such as a bag, a video or scene://PRESET, in place of that of the camera (repeatable: each is a drive)
    #[arg(long, value_name = "SOURCE")]
    pub source: Vec<String>,
    /// KITTI object folder (image_2, label_2)
    #[arg(long, value_name = "FOLDER", conflicts_with_all = ["sequence", "yolo", "coco", "source"])]
    pub kitti: Option<PathBuf>,
    /// File of the frames of --kitti to take.
    #[arg(
        long,
        value_name = "FILE",
        requires = "kitti",
        help = "Frames of --kitti to take: a file of lines FRAME [DRIVE]"
    )]
    pub list: Option<PathBuf>,
    /// KITTI drives with tracking labels, one folder for each drive
    #[arg(long, value_name = "FOLDER", num_args = 1.., conflicts_with_all = ["yolo", "coco", "source"])]
    pub sequence: Vec<PathBuf>,
    /// Images with YOLO labels: a folder (subfolders images and labels, or both side by side), the data.yaml of a data set, of which val is
    /// taken, or a list of images (.txt)
    #[arg(long, value_name = "PATH", conflicts_with_all = ["coco", "source"])]
    pub yolo: Option<PathBuf>,
    /// COCO annotation file
    #[arg(long, value_name = "JSON", conflicts_with = "source")]
    pub coco: Option<PathBuf>,
    /// Folder of the images of --coco, if they are not in the usual place
    #[arg(long, value_name = "FOLDER", requires = "coco")]
    pub coco_images: Option<PathBuf>,
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

impl DataOptions {
    /// Returns the sources and files from which the frames are read; `None` for the frames of the cameras.
    pub fn named(&self) -> Option<Vec<String>> {
        if !self.source.is_empty() {
            return Some(self.source.clone());
        }
        let files = [&self.kitti, &self.yolo, &self.coco].into_iter().flatten().chain(&self.sequence);
        let files: Vec<String> = files.map(|path| path.display().to_string()).collect();
        (!files.is_empty()).then_some(files)
    }

    /// Opens the frames, or where none are named, those of `camera`, with its number of frames and whether they start again.
    pub(crate) fn open(
        &self,
        camera: &CameraParameters,
        options: &SourceOptions,
    ) -> Result<Frames, GridError> {
        let name = self.named().unwrap_or_default().join(", ");
        if let Some(stills) = self.stills(&name, options)? {
            return Ok(stills);
        }
        if !self.sequence.is_empty() {
            let drive = |folder: &PathBuf| {
                let name = folder.file_name().map(|name| name.to_string_lossy().into_owned());
                Ok((name, Source::kitti(folder, None, options)?))
            };
            let drives = self.sequence.iter().map(drive).collect::<Result<_, SourceError>>()?;
            let mut frames = Frames::new(name, drives);
            frames.is_labelled = true;
            return Ok(frames);
        }
        if let Some(endless) = self.source.iter().find(|source| is_endless(source)) {
            let why = "has no end, but an evaluation needs one; give the number of frames as well, such as";
            return Err(GridError::Request(format!("--source {endless} {why} scene://day?frames=60")));
        }
        if !self.source.is_empty() {
            let name_of = |source: &String| Some(source.clone()).filter(|_| self.source.len() > 1);
            let drive = |source: &String| Ok((name_of(source), source::open(source, options)?));
            let drives = self.source.iter().map(drive).collect::<Result<_, SourceError>>()?;
            return Ok(Frames::new(name, drives));
        }
        let topic = Some(camera.source_topic.clone()).filter(|topic| !topic.is_empty());
        let source = source::open(&camera.source, &SourceOptions { topic, ..options.clone() })?;
        let mut frames = Frames::new(camera.source.clone(), vec![(None, source)]);
        frames.most = usize::try_from(camera.frames).ok().filter(|frames| *frames > 0);
        frames.repeats = camera.r#loop;
        Ok(frames)
    }

    /// Opens single images with labels.
    fn stills(&self, name: &str, options: &SourceOptions) -> Result<Option<Frames>, SourceError> {
        if let Some(folder) = &self.kitti {
            let list = self.list.as_deref().map(FrameList::read).transpose()?;
            let source = Source::kitti(folder, list.as_ref(), options)?;
            let name = list.as_ref().map_or(name.to_owned(), |list| format!("{name} ({})", list.name));
            let mut frames = Frames::of_stills(name, LabelNames::Kitti, source);
            frames.list = list;
            return Ok(Some(frames));
        }
        let source = match (&self.yolo, &self.coco) {
            (Some(path), _) => Source::yolo(path, options)?,
            (None, Some(file)) => Source::coco(file, self.coco_images.as_deref(), options)?,
            (None, None) => return Ok(None),
        };
        Ok(Some(Frames::of_stills(name.to_owned(), LabelNames::Model, source)))
    }
}
