//! [`Evaluation`]: the boxes and scores of the detectors of a launch file.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::Duration;

use modulo_ap::Difficulty;
use modulo_ap::average::{ScoredFrame, by_class, mean_over_classes};
use modulo_bags::FileError;
use modulo_bags::bag::{BagError, BagTopic, BagWriter};
use modulo_bags::source::{GroundTruth, from_detections};
use modulo_core::{Detection, Frame};
use modulo_draw::{Picture, RgbImage, distinct, sheet};
use modulo_images::{SaveError, save_png};
use modulo_msgs::cdr::CdrError;
use modulo_msgs::std_msgs::Time;
use modulo_msgs::vision_msgs::Detection2DArray;
use modulo_runtime::clock::nanos;
use modulo_runtime::lockstep::{Lockstep, LockstepError, OnTopic};
use modulo_runtime::{Message, Qos, sensor_info};
use modulo_video::VideoError;
use ndarray::Array3;
use serde_json::{Value, json};

use crate::video::AnnotatedVideo;

/// Time between two frames of a source that has neither time stamps nor a rate.
const NOMINAL_INTERVAL: Duration = Duration::from_millis(100);

/// A detector and the image stream that it reads.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct DetectorStream {
    /// Name of its files: the image topic without the leading slash and with `.` for `/`.
    pub name: String,
    /// Topic of the images.
    pub images: String,
    /// Topic of the boxes.
    pub detections: String,
    /// Topic of the images with the boxes drawn, if the detector publishes them.
    pub annotated: Option<String>,
    /// Topic of what the unwrapper says about each image, if one makes the images.
    pub recovery: Option<String>,
}

impl DetectorStream {
    /// The stream with images on topic `images` and boxes on topic `detections`.
    pub fn new(images: String, detections: String, annotated: Option<String>) -> Self {
        let name = images.trim_start_matches('/').replace('/', ".");
        Self { name, images, detections, annotated, recovery: None }
    }
}

/// Error of an evaluation.
#[derive(Debug, thiserror::Error)]
pub enum EvalError {
    /// A node failed.
    #[error(transparent)]
    Run(#[from] LockstepError),
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
    /// The video could not be written.
    #[error(transparent)]
    Video(#[from] VideoError),
}

/// The streams of an evaluation and the place of its files.
#[derive(Clone, Debug)]
pub struct EvaluationPlan {
    /// Time between two frames of a source without time stamps. Zero means 100 ms.
    pub interval: Duration,
    /// The detectors.
    pub streams: Vec<DetectorStream>,
    /// Topic of the ground truth.
    pub truth: Option<String>,
    /// Whether images are saved: `FOLDER/STREAM/NUMBER.png`, and `FOLDER/grid.png` with the last frame of every stream
    /// and its boxes, in two columns and in the order of the detectors, with a legend of the classes.
    pub save_images: bool,
    /// Folder for images and results.
    pub folder: PathBuf,
    /// Topics that are written into the bag, if there is one.
    pub bagged: Vec<String>,
}

/// The recordings of an evaluation.
#[derive(Default)]
pub struct Recordings {
    /// The messages on the topics of the plan.
    pub bag: Option<BagWriter>,
    /// The annotated images of all streams.
    pub video: Option<AnnotatedVideo>,
}

/// Boxes and ground truth of all frames so far. A frame without an answer has no boxes.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Evaluation {
    /// For each stream a list of boxes for each frame.
    pub boxes: BTreeMap<String, Vec<Vec<Detection>>>,
    /// Objects of each frame. `None` for a frame without labels.
    pub truth: Vec<Option<Vec<GroundTruth>>>,
    /// The objects that [`Evaluation::scores`] counts.
    pub difficulty: Difficulty,
    timeline: Timeline,
}

/// AP50 of one stream.
#[derive(Clone, Debug, PartialEq)]
pub struct StreamScore {
    /// Mean over the classes.
    pub ap50: f64,
    /// The objects that are counted.
    pub difficulty: Difficulty,
    /// AP50 and number of objects of each class.
    pub classes: BTreeMap<String, (f64, usize)>,
}

impl Evaluation {
    /// An evaluation without frames that will count the objects of `difficulty`.
    pub fn new(difficulty: Difficulty) -> Self {
        Self { difficulty, ..Self::default() }
    }

    /// Runs source `source` of `chain` to its end, adds its frames, and writes `recordings`. After each frame it calls `tell`.
    ///
    /// # Errors
    /// [`EvalError`] if a node fails or a file cannot be written.
    pub fn add(
        &mut self,
        chain: &mut Lockstep<'_>,
        source: usize,
        plan: &EvaluationPlan,
        recordings: &mut Recordings,
        tell: &dyn Fn(&Lockstep<'_>),
    ) -> Result<(), EvalError> {
        let images = plan.streams.iter().filter(|_| plan.save_images);
        for folder in images.map(|s| plan.folder.join(&s.name)).chain([plan.folder.clone()]) {
            std::fs::create_dir_all(&folder).map_err(|why| FileError::new(&folder, why))?;
        }
        let interval = if plan.interval.is_zero() { NOMINAL_INTERVAL } else { plan.interval };
        loop {
            // The time of the chain goes on over all sources, as in one long run.
            let now = (self.truth.len() as u64).saturating_mul(nanos(interval));
            let Some(mut out) = chain.tick(source, now)? else { break };
            self.timeline.place(&mut out, interval);
            if let Some(recorder) = &mut recordings.bag {
                record(recorder, &out, &plan.bagged)?;
            }
            self.add_frame(&out, plan)?;
            if let (Some(video), Some(sheet)) = (&mut recordings.video, self.sheet(&out, plan)) {
                video.add(sheet, out.first().map_or(now, |(_, message)| message.stamp().as_ns()))?;
            }
            tell(chain);
        }
        Ok(())
    }

    fn add_frame(&mut self, out: &[OnTopic], plan: &EvaluationPlan) -> Result<(), EvalError> {
        let number = self.truth.len();
        for stream in &plan.streams {
            // A frame without an answer gets an empty list: the lists of all streams must have one entry for each frame.
            let arrays = arrays(out, &stream.detections);
            let found = arrays.flat_map(|a| a.detections.iter().filter_map(|d| d.to_detection())).collect();
            self.boxes.entry(stream.name.clone()).or_default().push(found);
            if plan.save_images {
                save(out, stream, &plan.folder, number)?;
            }
        }
        if plan.save_images {
            self.save_sheet(out, plan)?;
        }
        let truth = plan.truth.as_deref().and_then(|topic| arrays(out, topic).next());
        self.truth.push(truth.map(from_detections));
        Ok(())
    }

    /// Returns the annotated images of the last frame as one, each below the name of its stream and what the unwrapper says about it; `None` for
    /// a frame without them.
    fn sheet(&self, out: &[OnTopic], plan: &EvaluationPlan) -> Option<RgbImage> {
        let mut pictures = Vec::new();
        for stream in &plan.streams {
            let annotated = stream.annotated.as_deref().and_then(|topic| image(out, topic));
            let said = stream.recovery.as_deref().and_then(|topic| recovery(out, topic));
            let title = said.map_or_else(|| stream.name.clone(), |said| format!("{}: {said}", stream.name));
            pictures.extend(annotated.and_then(picture).map(|picture| (title, picture)));
        }
        let found = self.boxes.values().filter_map(|frames| frames.last()).flatten();
        sheet(&pictures, &distinct(found.map(|d| d.class.as_str())))
    }

    /// Writes the annotated images of the last frame as one.
    fn save_sheet(&self, out: &[OnTopic], plan: &EvaluationPlan) -> Result<(), EvalError> {
        let Some(sheet) = self.sheet(out, plan) else { return Ok(()) };
        let size = (sheet.height() as usize, sheet.width() as usize, 3);
        let pixels = Array3::from_shape_vec(size, sheet.into_raw()).expect("three samples a pixel");
        let frame = Frame::from_u8(pixels).expect("a sheet has three channels");
        Ok(save_png(&plan.folder.join("grid.png"), &frame)?)
    }

    /// AP50 of each stream over the labelled frames.
    pub fn scores(&self) -> BTreeMap<String, StreamScore> {
        let score = |(stream, frames): (&String, &Vec<Vec<Detection>>)| {
            // In a frame without labels, every box would count as wrong.
            let labelled = frames.iter().zip(&self.truth);
            let scored: Vec<ScoredFrame> =
                labelled.filter_map(|(found, truth)| Some((found.clone(), truth.clone()?))).collect();
            let classes = by_class(&scored, self.difficulty);
            Some((
                stream.clone(),
                StreamScore { ap50: mean_over_classes(&classes)?, difficulty: self.difficulty, classes },
            ))
        };
        self.boxes.iter().filter_map(score).collect()
    }

    /// Writes `STREAM.json` for each stream with one line for each frame:
    /// `{"000000.png": [[x1, y1, x2, y2, score, "class"], ...], ...}`. Writes `scores.json` if there is a ground truth.
    ///
    /// # Errors
    /// [`EvalError::File`] if a file cannot be written.
    pub fn write(&self, folder: &Path) -> Result<(), EvalError> {
        let file = |name: String, text: String| {
            let path = folder.join(name);
            std::fs::write(&path, text).map_err(|why| FileError::new(&path, why))
        };
        for (name, frames) in &self.boxes {
            file(format!("{name}.json"), boxes(frames))?;
        }
        let scores = self.scores();
        if scores.is_empty() {
            return Ok(());
        }
        Ok(file("scores.json".to_owned(), scores_json(&scores))?)
    }
}

fn arrays<'a>(out: &'a [OnTopic], topic: &'a str) -> impl Iterator<Item = &'a Detection2DArray> {
    out.iter().filter(move |(name, _)| name == topic).filter_map(|(_, message)| match message {
        Message::Detections(array) => Some(&**array),
        _ => None,
    })
}

fn save(out: &[OnTopic], stream: &DetectorStream, folder: &Path, number: usize) -> Result<(), EvalError> {
    if let Some(frame) = image(out, &stream.images) {
        save_png(&folder.join(&stream.name).join(file_name(number)), frame)?;
    }
    Ok(())
}

fn image<'a>(out: &'a [OnTopic], topic: &str) -> Option<&'a Frame> {
    out.iter().filter(|(name, _)| name == topic).find_map(|(_, message)| match message {
        Message::Image(image) => Some(&image.frame),
        _ => None,
    })
}

/// Returns the method that has unwrapped the image of this frame, and whether it trusts its result.
fn recovery(out: &[OnTopic], topic: &str) -> Option<String> {
    let said = out.iter().filter(|(name, _)| name == topic).find_map(|(_, message)| match message {
        Message::Diagnostics(said) => said.status.first(),
        _ => None,
    })?;
    let value = |key: &str| said.values.iter().find(|pair| pair.key == key).map(|pair| pair.value.as_str());
    let trust = match value("trusted") {
        Some("true") => ", trusted",
        Some(_) => ", not trusted",
        None => "",
    };
    Some(format!("{}{trust}", value("method_used")?))
}

/// An annotated frame. `None` unless it is 8-bit RGB.
fn picture(frame: &Frame) -> Option<Picture> {
    let pixels = frame.as_u8()?;
    let (height, width, _) = pixels.dim();
    let [width, height] = [width, height].map(|side| u32::try_from(side).ok());
    Picture::new(width?, height?, pixels.iter().copied().collect(), Vec::new()).ok()
}

/// File name of the image of a frame.
fn file_name(number: usize) -> String {
    format!("{number:06}.png")
}

/// Boxes with one line for each frame, so that two runs can be compared with `diff`.
fn boxes(frames: &[Vec<Detection>]) -> String {
    let row =
        |d: &Detection| -> Value { json!([d.bbox.x1, d.bbox.y1, d.bbox.x2, d.bbox.y2, d.score, d.class]) };
    let line = |(number, frame): (usize, &Vec<Detection>)| {
        let rows: Vec<Value> = frame.iter().map(row).collect();
        format!("  \"{}\": {}", file_name(number), Value::Array(rows))
    };
    let lines: Vec<String> = frames.iter().enumerate().map(line).collect();
    format!("{{\n{}\n}}\n", lines.join(",\n"))
}

/// Scores as `{"STREAM": {"ap50": f, "difficulty": "moderate", "classes": {"CLASS": {"ap50": f, "objects": n}}}}`.
fn scores_json(scores: &BTreeMap<String, StreamScore>) -> String {
    let class = |(ap50, objects): &(f64, usize)| json!({ "ap50": ap50, "objects": objects });
    let score = |score: &StreamScore| {
        let classes: BTreeMap<&String, Value> = score.classes.iter().map(|(k, v)| (k, class(v))).collect();
        json!({ "ap50": score.ap50, "difficulty": score.difficulty, "classes": classes })
    };
    let all: BTreeMap<&String, Value> = scores.iter().map(|(stream, s)| (stream, score(s))).collect();
    format!("{:#}\n", json!(all))
}

/// Writes the messages on `topics`. Log time and publish time are the stamp of the message.
fn record(recorder: &mut BagWriter, out: &[OnTopic], topics: &[String]) -> Result<(), EvalError> {
    for (topic, message) in out.iter().filter(|(topic, _)| topics.contains(topic)) {
        let bytes = message.encode()?;
        // The stamp, and not the wall clock: the same run must give the same bytes.
        let stamp = message.stamp().as_ns();
        let kind = message.kind();
        let qos = if sensor_info::is_topic(topic) { Qos::Latched } else { Qos::usual(kind) };
        let bag_topic = BagTopic::new(topic, kind.type_name(), qos);
        recorder.record(&bag_topic, stamp, stamp, &bytes)?;
    }
    Ok(())
}

/// Moves the time stamps of several sources so that each frame is later than the one before it.
#[derive(Clone, Debug, Default, PartialEq)]
struct Timeline {
    /// Time stamp of the last frame, ns.
    last: Option<u64>,
    /// Time that is added to the stamps of the current source, ns.
    shift: u64,
}

impl Timeline {
    /// Moves the stamps of the messages of a frame to `interval` after the frame before, if they are not later than that
    /// frame. Sources were recorded independently, and a repeated source starts again at its first stamp, but labels and
    /// images are matched by their stamps: no two frames may share a stamp. All later frames of the source are moved by
    /// the same time, so that the intervals within a source do not change.
    fn place(&mut self, out: &mut [OnTopic], interval: Duration) {
        let Some((_, first)) = out.first() else { return };
        // All messages of a frame carry the stamp of its image.
        let stamp = first.stamp().as_ns();
        if let Some(last) = self.last.filter(|last| stamp.saturating_add(self.shift) <= *last) {
            self.shift = last.saturating_add(nanos(interval)) - stamp;
        }
        self.last = Some(stamp.saturating_add(self.shift));
        if self.shift > 0 {
            for (_, message) in out {
                message.set_stamp(Time::from_ns(message.stamp().as_ns().saturating_add(self.shift)));
            }
        }
    }
}
