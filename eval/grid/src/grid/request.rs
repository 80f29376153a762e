//! [`Request`]: the data and the settings of a grid run, as the command line gives them. [`GridEvent`]: its progress.

use std::path::{Path, PathBuf};

use clap::Parser;
use clap::builder::{PossibleValuesParser, RangedU64ValueParser, TypedValueParser};
use modulo_ap::Difficulty;
use modulo_bags::source::{self, FrameList, LabelledSource, Light, Source, SourceError, SourceOptions};
use modulo_detector::{EngineChoice, EngineDevice};
use modulo_runtime::sensor::options::CodingOptions;
use sha2::{Digest as _, Sha256};

use super::Axes;
use crate::GridError;
use crate::classes::{ClassGroups, ClassMap};
use crate::results::{FIGURES, Point, Protocol, Provenance, Setup};

/// Everything that determines a grid run.
#[derive(Clone, Debug)]
pub struct Request {
    /// The labelled frames.
    pub data: Data,
    /// The settings.
    pub options: GridOptions,
    /// Where and by which command the results are made.
    pub provenance: Provenance,
    /// Folder for the results.
    pub out: PathBuf,
}

/// Progress of a grid run.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum GridEvent<'a> {
    /// A cell begins.
    Cell {
        /// Number of processed frames, and of all frames, over all cells of this run.
        frames: (u64, u64),
        /// Description of the cell.
        name: &'a str,
    },
    /// A frame of the cell is finished.
    Frame,
    /// A problem that does not end the run, or what the folder already holds.
    Warning(&'a str),
}

/// The settings of a grid run, as options of a command line.
#[derive(Clone, Debug, Parser)]
pub struct GridOptions {
    /// How a frame reaches the detector: through the nodes of the suite, or as in the scripts of the paper
    #[arg(long, value_enum, default_value_t)]
    pub protocol: Protocol,
    /// The values that the cells combine.
    #[command(flatten)]
    pub axes: Axes,
    /// Inference engine
    #[arg(long, default_value = "auto", value_parser = words(EngineChoice::WORDS))]
    pub engine: EngineChoice,
    /// Device that runs the model: cpu, cuda or tensorrt, the last two with the number of a GPU where it is not the first
    #[arg(long, default_value = "cpu")]
    pub device: EngineDevice,
    /// Threads of one inference where times are measured. 0: one for each core, as the detector node has it
    #[arg(long, default_value_t = 0, value_parser = RangedU64ValueParser::<usize>::new().range(..=64))]
    pub threads: usize,
    /// Number of frames on which the times of each cell are measured, after all cells are scored; the first frames of the data,
    /// all of them again where there are fewer. 0: no times, and no chart of accuracy against time
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub time_frames: usize,
    /// Number of frames that are scored in parallel. 0: one for each core
    #[arg(long, default_value_t = 0, value_parser = RangedU64ValueParser::<usize>::new().range(..=1024))]
    pub jobs: usize,
    /// How the samples of the images stand for radiance.
    #[command(flatten)]
    pub coding: CodingOptions,
    /// Seed of the noise and of the bootstrap
    #[arg(long, default_value_t = 0)]
    pub seed: u64,
    /// Objects that are scored, also with FILE [default: moderate; all for YOLO and COCO labels]
    #[arg(long, value_parser = words(Difficulty::WORDS))]
    pub difficulty: Option<Difficulty>,
    /// File of lines `class of the model: class of the labels`, instead of the mapping from COCO to KITTI
    #[arg(long, value_name = "FILE")]
    pub class_map: Option<PathBuf>,
    /// File of lines `class of the labels: group`, instead of the groups vehicle and person
    #[arg(long, value_name = "FILE")]
    pub groups: Option<PathBuf>,
    /// Process all cells anew, even if the folder holds results
    #[arg(long)]
    pub fresh: bool,
}

impl Default for GridOptions {
    /// The defaults of the command line.
    fn default() -> Self {
        Self::parse_from(["grid"])
    }
}

/// Reads one of the words of `table` from a command line as the value beside it.
pub fn words<T, const N: usize>(table: [(&'static str, T); N]) -> impl TypedValueParser<Value = T>
where
    T: Clone + Send + Sync + 'static,
{
    PossibleValuesParser::new(table.each_ref().map(|(word, _)| *word)).map(move |given| {
        let found = table.iter().find(|(word, _)| *word == given);
        found.map(|(_, value)| value.clone()).expect("clap takes only the words of the table")
    })
}

impl Request {
    /// The mapping from the classes of a model to those of the labels.
    pub(super) fn class_map(&self) -> Result<ClassMap, GridError> {
        match (&self.options.class_map, self.options.protocol) {
            (Some(file), _) => ClassMap::read(file),
            (None, Protocol::Paper) => Ok(ClassMap::paper()),
            (None, Protocol::Suite) if self.data.has_classes_of_model() => Ok(ClassMap::same()),
            (None, Protocol::Suite) => Ok(ClassMap::kitti()),
        }
    }

    /// The groups in which classes of the labels are scored.
    pub(super) fn groups(&self) -> Result<ClassGroups, GridError> {
        self.options.groups.as_deref().map_or_else(|| Ok(ClassGroups::default()), ClassGroups::read)
    }

    pub(super) fn source(&self) -> SourceOptions {
        let GridOptions { coding, axes, .. } = &self.options;
        let sensors = axes.sensor.sensors(&["mosaic"]);
        let mut coding = coding.of(&sensors[0]);
        // A raw mosaic can be seen by a sensor with the same colour filters only, and so by no other cell.
        coding.mosaic =
            coding.mosaic.filter(|_| sensors.iter().all(|sensor| sensor.mosaic == sensors[0].mosaic));
        SourceOptions { coding, topic: None }
    }

    pub(super) fn difficulty(&self) -> Difficulty {
        // These labels have no information on it.
        let of_data = if self.data.has_classes_of_model() { Difficulty::All } else { Difficulty::Moderate };
        self.options.difficulty.unwrap_or(of_data)
    }

    /// The file of the model with this name in cells.
    pub(super) fn model(&self, name: &str) -> Result<&Path, GridError> {
        let model = self.options.axes.model.iter().find(|path| Axes::model_name(path) == name);
        model.map(PathBuf::as_path).ok_or_else(|| GridError::empty("the list of models"))
    }

    /// The settings with the cells at `points`. Reads the files of the models.
    pub(super) fn setup(
        &self,
        map: &ClassMap,
        groups: &ClassGroups,
        points: &[Point],
    ) -> Result<Setup, GridError> {
        let options = &self.options;
        let model = |path: &PathBuf| Ok((Axes::model_name(path), sha256(path)?));
        Ok(Setup {
            version: env!("CARGO_PKG_VERSION").to_owned(),
            figures: FIGURES,
            protocol: options.protocol,
            source: self.data.name(),
            bits: options.axes.sensor.first().bits,
            seed: options.seed,
            difficulty: self.difficulty(),
            engine: match options.device {
                EngineDevice::Cpu => options.engine.word().to_owned(),
                device => format!("{} on {device}", options.engine.word()),
            },
            class_map: map.table.clone(),
            groups: groups.0.clone(),
            models: options.axes.model.iter().map(model).collect::<Result<_, GridError>>()?,
            grid: points.to_vec(),
        })
    }

    /// Number of frames that are processed in parallel, at least 1.
    pub(super) fn jobs(&self) -> usize {
        match self.options.jobs {
            0 => std::thread::available_parallelism().map_or(1, usize::from),
            jobs => jobs,
        }
    }
}

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
    /// Any sources of the camera node that have ground truth: a bag, `scene://PRESET`. Each of several is a drive.
    Any(Vec<String>),
}

/// A source, and the drive that all its frames come from, if it is known.
pub(super) type Drive = (Option<String>, Box<dyn Source>);

impl Data {
    pub(super) fn open(&self, options: &SourceOptions) -> Result<Vec<Drive>, SourceError> {
        let source: Box<dyn Source> = match self {
            Self::Kitti { folder, list } => Box::new(LabelledSource::kitti(folder, list.as_ref(), options)?),
            Self::Yolo(path) => Box::new(LabelledSource::yolo(path, options)?),
            Self::Coco { annotations, images } => {
                Box::new(LabelledSource::coco(annotations, images.as_deref(), options)?)
            }
            Self::Sequences(folders) => {
                let name = |folder: &PathBuf| Some(folder.file_name()?.to_string_lossy().into_owned());
                let drive = |folder| {
                    Ok((name(folder), Box::new(LabelledSource::kitti(folder, None, options)?) as Box<_>))
                };
                return folders.iter().map(drive).collect();
            }
            Self::Any(specs) => {
                let name = |spec: &String| Some(spec.clone()).filter(|_| specs.len() > 1);
                return specs.iter().map(|spec| Ok((name(spec), source::open(spec, options)?))).collect();
            }
        };
        Ok(vec![(None, source)])
    }

    /// The drive of a frame, if a list names it.
    pub(super) fn drive_of(&self, frame: &str) -> Option<String> {
        match self {
            Self::Kitti { list: Some(list), .. } => list.drive_of(frame).map(str::to_owned),
            _ => None,
        }
    }

    /// How the light of the drive with this index changes.
    pub(super) fn light_of(&self, drive: usize) -> Option<Light> {
        match self {
            Self::Any(specs) => source::light_of(specs.get(drive)?),
            _ => None,
        }
    }

    /// The data as it was given on the command line.
    pub(super) fn name(&self) -> String {
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
        }
    }

    /// Whether its labels have the classes of the model, and not those of KITTI.
    fn has_classes_of_model(&self) -> bool {
        matches!(self, Self::Yolo(_) | Self::Coco { .. })
    }

    /// Whether its frames are single images, which do not follow each other.
    pub(super) fn is_still(&self) -> bool {
        matches!(self, Self::Kitti { .. } | Self::Yolo(_) | Self::Coco { .. })
    }
}

fn sha256(model: &Path) -> Result<String, GridError> {
    let refused = |why| {
        GridError::value("--model", model.display(), format!("demo or a file that can be read ({why})"))
    };
    let parts = modulo_detector::model_parts(model).map_err(refused)?;
    // As `cat model.onnx model.onnx.data | sha256sum` gives it.
    let hash = parts.iter().fold(Sha256::new(), |hash, (_, bytes)| hash.chain_update(bytes));
    Ok(modulo_models::hex(&hash.finalize()))
}
