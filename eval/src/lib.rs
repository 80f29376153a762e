//! Evaluation in lockstep: a source's frames go through the same steps as in a
//! live run, each once, in order, and every detector's boxes come out and are
//! scored against the ground truth, where there is one.
//!
//! Nothing here goes through a transport or reads a clock; the same frames and
//! parameters give the same files.

pub mod budget;
pub mod chart;
pub mod classes;
pub mod data;
pub mod grid;
pub mod metric;
mod mosaic;
mod pareto;
mod published;
mod record;
pub mod report;
pub mod results;
pub mod store;
mod table;
mod wording;
mod write;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::Duration;

use modulo_bags::FileError;
use modulo_bags::bag::{BagError, BagWriter};
use modulo_bags::source::{GroundTruth, from_detections};
use modulo_core::{Detection, Frame};
use modulo_images::{SaveError, save_png};
use modulo_msgs::cdr::CdrError;
use modulo_msgs::vision_msgs::Detection2DArray;
use modulo_runtime::Message;
use modulo_runtime::clock::nanos;
use modulo_runtime::driver::RunError;
use modulo_runtime::driver::lockstep::{Lockstep, OnTopic};

use metric::average_precision::{Scored, by_class, mean};
use results::Difficulty;

/// Time between two frames of a source that has neither stamps nor a rate.
const NOMINAL_INTERVAL: Duration = Duration::from_millis(100);

/// A detector of the chain and the image stream it reads.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Stream {
    /// Name of its files: the image topic without the leading slash, `.` for `/`.
    pub name: String,
    /// Topic of the images.
    pub images: String,
    /// Topic of the boxes.
    pub detections: String,
    /// Topic of the images with the boxes drawn, where the detector has one.
    pub annotated: Option<String>,
}

impl Stream {
    /// The stream of images on `images` with boxes on `detections`.
    pub fn new(images: String, detections: String, annotated: Option<String>) -> Self {
        let name = images.trim_start_matches('/').replace('/', ".");
        Self { name, images, detections, annotated }
    }
}

/// What is kept of the images that the detectors saw.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Images {
    /// Nothing.
    Discard,
    /// `FOLDER/STREAM/NUMBER.png`, and `FOLDER/grid.png`: the last frame of every
    /// stream with its boxes, two columns, in the order of the detectors.
    Save,
}

/// Why an evaluation ended early.
#[derive(Debug, thiserror::Error)]
pub enum EvalError {
    /// A step.
    #[error(transparent)]
    Run(#[from] RunError),
    /// An image could not be written.
    #[error(transparent)]
    Save(#[from] SaveError),
    /// The bag could not be written.
    #[error(transparent)]
    Bag(#[from] BagError),
    /// A message is too large for CDR.
    #[error(transparent)]
    Cdr(#[from] CdrError),
    /// A file or folder could not be written.
    #[error(transparent)]
    File(#[from] FileError),
}

/// What is evaluated, and where its files go.
#[derive(Clone, Debug)]
pub struct Plan {
    /// Time between two frames whose source has no stamps; 100 ms in place of zero.
    pub interval: Duration,
    /// The detectors.
    pub streams: Vec<Stream>,
    /// Topic of the ground truth.
    pub truth: Option<String>,
    /// Whether images are kept.
    pub images: Images,
    /// For images and results.
    pub folder: PathBuf,
    /// Topics that go into the bag, if there is one.
    pub bagged: Vec<String>,
}

/// Boxes and truth of every frame so far; a frame without an answer has none.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Evaluation {
    /// Boxes by stream, a list a frame.
    pub boxes: BTreeMap<String, Vec<Vec<Detection>>>,
    /// Objects of each frame; `None` where nobody labelled it.
    pub truth: Vec<Option<Vec<GroundTruth>>>,
    /// Which of these objects count in [`Evaluation::scores`].
    pub difficulty: Difficulty,
    timeline: record::Timeline,
}

/// AP50 of one stream.
#[derive(Clone, Debug, PartialEq)]
pub struct Score {
    /// Mean over classes.
    pub ap50: f64,
    /// Which objects count.
    pub difficulty: Difficulty,
    /// AP50 and number of objects by class.
    pub classes: BTreeMap<String, (f64, usize)>,
}

impl Evaluation {
    /// Without a frame; objects of `difficulty` will count.
    pub fn new(difficulty: Difficulty) -> Self {
        Self { difficulty, ..Self::default() }
    }

    /// Drives source `source` of `chain` to its end and adds its frames, and
    /// the messages on `plan.bagged` to `bag`.
    ///
    /// # Errors
    /// [`EvalError`] when a step fails or a file cannot be written.
    pub fn add(
        &mut self,
        chain: &mut Lockstep<'_>,
        source: usize,
        plan: &Plan,
        mut bag: Option<&mut BagWriter>,
    ) -> Result<(), EvalError> {
        let images = plan.streams.iter().filter(|_| plan.images == Images::Save);
        for folder in images.map(|s| plan.folder.join(&s.name)).chain([plan.folder.clone()]) {
            std::fs::create_dir_all(&folder).map_err(|why| FileError::new(&folder, why))?;
        }
        let interval = if plan.interval.is_zero() { NOMINAL_INTERVAL } else { plan.interval };
        loop {
            // The frames of all sources are on one timeline.
            let now = (self.truth.len() as u64).saturating_mul(nanos(interval));
            let Some(mut out) = chain.tick(source, now)? else { break };
            self.timeline.place(&mut out, interval);
            if let Some(recorder) = bag.as_deref_mut() {
                record::record(recorder, &out, &plan.bagged)?;
            }
            self.add_frame(&out, plan)?;
        }
        Ok(())
    }

    fn add_frame(&mut self, out: &[OnTopic], plan: &Plan) -> Result<(), EvalError> {
        let number = self.truth.len();
        for stream in &plan.streams {
            let arrays = arrays(out, &stream.detections);
            let found = arrays.flat_map(|a| a.detections.iter().filter_map(|d| d.to_detection())).collect();
            self.boxes.entry(stream.name.clone()).or_default().push(found);
            if plan.images == Images::Save {
                save(out, stream, &plan.folder, number)?;
            }
        }
        if plan.images == Images::Save {
            let topics = plan.streams.iter().filter_map(|s| s.annotated.as_deref());
            let frames: Vec<&Frame> = topics.filter_map(|topic| image(out, topic)).collect();
            if let Some(picture) = mosaic::mosaic(&frames) {
                save_png(&plan.folder.join("grid.png"), &picture)?;
            }
        }
        let truth = plan.truth.as_deref().and_then(|topic| arrays(out, topic).next());
        self.truth.push(truth.map(from_detections));
        Ok(())
    }

    /// AP50 by stream over the frames that have a truth.
    pub fn scores(&self) -> BTreeMap<String, Score> {
        let score = |(stream, frames): (&String, &Vec<Vec<Detection>>)| {
            let labelled = frames.iter().zip(&self.truth);
            let scored: Vec<Scored> =
                labelled.filter_map(|(found, truth)| Some((found.clone(), truth.clone()?))).collect();
            let classes = by_class(&scored, self.difficulty);
            Some((stream.clone(), Score { ap50: mean(&classes)?, difficulty: self.difficulty, classes }))
        };
        self.boxes.iter().filter_map(score).collect()
    }

    /// Writes `STREAM.json` for each stream, one line a frame:
    /// `{"000000.png": [[x1, y1, x2, y2, score, "class"], ...], ...}`, and, when
    /// there is a truth, `scores.json`.
    ///
    /// # Errors
    /// [`EvalError::File`] when one cannot be written.
    pub fn write(&self, folder: &Path) -> Result<(), EvalError> {
        let file = |name: String, text: String| {
            let path = folder.join(name);
            std::fs::write(&path, text).map_err(|why| FileError::new(&path, why))
        };
        for (name, frames) in &self.boxes {
            file(format!("{name}.json"), write::boxes(frames))?;
        }
        let scores = self.scores();
        if scores.is_empty() {
            return Ok(());
        }
        Ok(file("scores.json".to_owned(), write::scores(&scores))?)
    }
}

fn arrays<'a>(out: &'a [OnTopic], topic: &'a str) -> impl Iterator<Item = &'a Detection2DArray> {
    out.iter().filter(move |(name, _)| name == topic).filter_map(|(_, message)| match message {
        Message::Detections(array) => Some(&**array),
        _ => None,
    })
}

fn save(out: &[OnTopic], stream: &Stream, folder: &Path, number: usize) -> Result<(), EvalError> {
    if let Some(frame) = image(out, &stream.images) {
        save_png(&folder.join(&stream.name).join(write::file_name(number)), frame)?;
    }
    Ok(())
}

fn image<'a>(out: &'a [OnTopic], topic: &str) -> Option<&'a Frame> {
    out.iter().filter(|(name, _)| name == topic).find_map(|(_, message)| match message {
        Message::Image(image) => Some(&image.frame),
        _ => None,
    })
}
