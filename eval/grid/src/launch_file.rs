//! [`Evaluation`]: the boxes and scores of the detectors of a launch file.

mod page;
mod plan;
mod recordings;
mod scores;
mod timeline;

use std::collections::{BTreeMap, BTreeSet};
use std::ops::ControlFlow;
use std::path::Path;

use modulo_ap::Difficulty;
use modulo_bags::FileError;
use modulo_bags::source::{GroundTruth, from_detections};
use modulo_core::Detection;
use modulo_runtime::clock::nanos;
use modulo_runtime::lockstep::{Lockstep, LockstepError, OnTopic};
use modulo_runtime::output;
use serde_json::{Value, json};

pub use plan::{CameraPlan, DetectorStream, EvaluationPlan, NamedNodes};
pub use recordings::{GRID, Recordings};
pub use scores::{StreamResult, StreamScore};
use timeline::Timeline;

use crate::messages::{arrays, classes, found};
use crate::report::PAGE;

/// Boxes and ground truth of all frames so far.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Evaluation {
    /// The frames of each stream.
    pub streams: BTreeMap<String, Vec<EvaluatedFrame>>,
    /// The objects that [`Evaluation::results`] counts.
    pub difficulty: Difficulty,
    /// The frames that each camera has sent, over all its sources, by its name.
    timelines: BTreeMap<String, Timeline>,
    /// The streams of each camera, in the order of the launch file.
    cameras: BTreeMap<String, Vec<String>>,
    /// The classes that the detector of each stream knows.
    known: BTreeMap<String, BTreeSet<String>>,
    /// The number of sources so far.
    sources: usize,
}

/// A frame of a stream.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct EvaluatedFrame {
    /// The boxes; `None` where the detector gave no answer.
    pub found: Option<Vec<Detection>>,
    /// The objects; `None` for a frame without labels.
    pub truth: Option<Vec<GroundTruth>>,
    /// The number of its source among all, from 1.
    pub source: usize,
}

impl Evaluation {
    /// An evaluation without frames that will count the objects of `difficulty`.
    pub fn new(difficulty: Difficulty) -> Self {
        Self { difficulty, ..Self::default() }
    }

    /// Runs the cameras of `chain` to their ends, adds their frames, and writes `recordings`. After each frame it calls `tell`, which may
    /// stop the run.
    ///
    /// # Errors
    /// [`LockstepError`] if a node fails; the frames before stay.
    pub fn add(
        &mut self,
        chain: &mut Lockstep<'_>,
        plan: &EvaluationPlan,
        recordings: &mut Recordings,
        tell: &dyn Fn(&Lockstep<'_>) -> ControlFlow<()>,
    ) -> Result<(), LockstepError> {
        self.begin(plan);
        let mut running: Vec<&CameraPlan> = plan.cameras.iter().collect();
        // The time of the chain goes on over all sources, as in one long run. The camera whose frame is due first comes first.
        let due = |evaluation: &Self, camera: &CameraPlan| {
            let frames = evaluation.timelines.get(&camera.name).map_or(0, |timeline| timeline.frames);
            frames.saturating_mul(nanos(camera.interval))
        };
        while let Some(next) = (0..running.len()).min_by_key(|&index| due(self, running[index])) {
            let camera = running[next];
            let before = chain.position(camera.member);
            let Some(mut out) = chain.tick(camera.member, due(self, camera))? else {
                recordings.end(running.remove(next));
                continue;
            };
            // A loss that the source tells, such as the cut end of a bag, is no frame and has no number.
            if out.is_empty() && before.is_some() && chain.position(camera.member) == before {
                continue;
            }
            let timeline = self.timelines.entry(camera.name.clone()).or_default();
            let number = timeline.frames;
            timeline.place(&mut out, camera.interval);
            self.learn_classes(&out, plan);
            self.add_frame(&out, camera);
            recordings.add(plan, (camera, number), &out, next + 1 == running.len());
            if tell(chain).is_break() {
                break;
            }
        }
        Ok(())
    }

    /// Counts a source, and notes the streams of its cameras. A stream without any frame has a result, too: that no image arrived.
    fn begin(&mut self, plan: &EvaluationPlan) {
        for stream in plan.streams() {
            self.streams.entry(stream.name.clone()).or_default();
        }
        let names = |camera: &CameraPlan| camera.streams.iter().map(|stream| stream.name.clone()).collect();
        self.cameras = plan.cameras.iter().map(|camera| (camera.name.clone(), names(camera))).collect();
        self.sources += 1;
    }

    /// Notes the classes of detectors that say in `out` what they know. A detector of several cameras says it once.
    fn learn_classes(&mut self, out: &[OnTopic], plan: &EvaluationPlan) {
        for stream in plan.streams() {
            let known = stream.labels.as_deref().and_then(|topic| classes(out, topic));
            self.known.extend(known.map(|known| (stream.name.clone(), known)));
        }
    }

    fn add_frame(&mut self, out: &[OnTopic], camera: &CameraPlan) {
        let labels = camera.truth.as_deref().and_then(|topic| arrays(out, topic).next());
        let truth = labels.map(from_detections);
        for stream in &camera.streams {
            let (found, truth) = (found(out, &stream.detections), truth.clone());
            let frame = EvaluatedFrame { found, truth, source: self.sources };
            self.streams.entry(stream.name.clone()).or_default().push(frame);
        }
    }

    /// Returns the number of frames of all cameras.
    pub fn frames(&self) -> u64 {
        self.timelines.values().map(|timeline| timeline.frames).sum()
    }

    /// Whether no detector has given an answer.
    pub fn is_empty(&self) -> bool {
        self.streams.values().flatten().all(|frame| frame.found.is_none())
    }

    /// AP50 of each stream over its labelled frames, or why there is none.
    pub fn results(&self) -> BTreeMap<&str, StreamResult> {
        let result = |(stream, frames): (_, &Vec<EvaluatedFrame>)| {
            (String::as_str(stream), StreamResult::new(frames, self.known.get(stream), self.difficulty))
        };
        self.streams.iter().map(result).collect()
    }

    /// Says for each camera with several scored streams which one finds the most.
    pub fn verdicts(&self, results: &BTreeMap<&str, StreamResult>) -> Vec<String> {
        let scored = |stream: &'_ String| {
            let (stream, result) = results.get_key_value(stream.as_str())?;
            Some((*stream, result.score().ok()?))
        };
        let verdict =
            |streams: &Vec<String>| scores::verdict(&streams.iter().filter_map(scored).collect::<Vec<_>>());
        self.cameras.values().filter_map(verdict).collect()
    }

    /// Writes `STREAM.json` for each stream with one line for each frame:
    /// `{"000000.png": [[x1, y1, x2, y2, score, "class"], ...], ...}`, and `report.html` with `results` and the picture that
    /// [`Recordings`] has made. Writes `scores.json` if there are scores. `stopped` marks them as those of a part of the frames.
    ///
    /// # Errors
    /// [`FileError`] of the first file that cannot be written; the others are written.
    pub fn write(
        &self,
        folder: &Path,
        (results, pictured): (&BTreeMap<&str, StreamResult>, Option<u64>),
        stopped: bool,
    ) -> Result<(), FileError> {
        let mut files: Vec<_> =
            self.streams.iter().map(|(name, frames)| (format!("{name}.json"), boxes(frames))).collect();
        files.push((PAGE.to_owned(), page::page(self, pictured, results, stopped)));
        let score = |(stream, result): (&&str, &StreamResult)| {
            Some(((*stream).to_owned(), result.score().ok()?.json(self.difficulty, stopped)))
        };
        let scores: BTreeMap<String, Value> = results.iter().filter_map(score).collect();
        if !scores.is_empty() {
            files.push((SCORES.to_owned(), format!("{:#}\n", json!(scores))));
        }
        let write = |(name, text): (String, String)| {
            let path = folder.join(name);
            output::replace(&path, text.as_bytes()).map_err(|why| FileError::new(&path, why))
        };
        files.into_iter().map(write).fold(Ok(()), Result::and)
    }
}

/// Name of the file of the scores.
pub const SCORES: &str = "scores.json";

fn file_name(number: u64) -> String {
    format!("{number:06}.png")
}

/// Boxes with one line for each frame, so that two runs can be compared with `diff`.
fn boxes(frames: &[EvaluatedFrame]) -> String {
    let row =
        |d: &Detection| -> Value { json!([d.bbox.x1, d.bbox.y1, d.bbox.x2, d.bbox.y2, d.score, d.class]) };
    let line = |(number, frame): (u64, &EvaluatedFrame)| {
        // The list of a frame without an answer is empty.
        let rows: Vec<Value> = frame.found.iter().flatten().map(row).collect();
        format!("  \"{}\": {}", file_name(number), Value::Array(rows))
    };
    let lines: Vec<String> = (0..).zip(frames).map(line).collect();
    format!("{{\n{}\n}}\n", lines.join(",\n"))
}
