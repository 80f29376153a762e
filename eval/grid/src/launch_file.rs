//! [`Evaluation`]: the boxes and scores of the detectors of a launch file.

mod plan;
mod recordings;
mod timeline;

use std::collections::BTreeMap;
use std::ops::ControlFlow;
use std::path::Path;

use modulo_ap::Difficulty;
use modulo_ap::average::{ScoredFrame, by_class, mean_over_classes};
use modulo_bags::FileError;
use modulo_bags::source::{GroundTruth, from_detections};
use modulo_core::Detection;
use modulo_runtime::clock::nanos;
use modulo_runtime::lockstep::{Lockstep, LockstepError, OnTopic};
use serde_json::{Value, json};

pub use plan::{CameraPlan, DetectorStream, EvaluationPlan, NamedNodes};
pub use recordings::Recordings;
use timeline::Timeline;

use crate::messages::{arrays, found};

/// Boxes and ground truth of all frames so far.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Evaluation {
    /// The frames of each stream.
    pub streams: BTreeMap<String, Vec<EvaluatedFrame>>,
    /// The objects that [`Evaluation::results`] counts.
    pub difficulty: Difficulty,
    /// The frames that each camera has sent, over all its sources, by its name.
    timelines: BTreeMap<String, Timeline>,
}

/// A frame of a stream.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct EvaluatedFrame {
    /// The boxes; `None` where the detector gave no answer.
    pub found: Option<Vec<Detection>>,
    /// The objects; `None` for a frame without labels.
    pub truth: Option<Vec<GroundTruth>>,
}

/// The result of a stream.
#[derive(Clone, Debug, PartialEq)]
pub enum StreamResult {
    /// Its boxes were compared with labels.
    Scored(StreamScore),
    /// The detector gave no answer, since no image arrived.
    NoImage,
    /// None of its frames has labels.
    NoLabels,
    /// The labels have no object that counts.
    NoObject,
}

/// AP50 of one stream.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct StreamScore {
    /// Mean over the classes.
    pub ap50: f64,
    /// AP50 and number of objects of each class.
    pub classes: BTreeMap<String, (f64, usize)>,
    /// Number of frames with labels. Those without an answer of the detector count as frames without a box.
    pub frames: usize,
    /// Number of those without an answer of the detector.
    pub unanswered: usize,
    /// Number of other frames, without labels or unreadable, which are not scored.
    pub unlabelled: usize,
}

impl StreamResult {
    /// Whether something of the stream should have been scored and was not.
    pub fn lost(&self) -> bool {
        match self {
            Self::Scored(score) => score.unanswered > 0 || score.unlabelled > 0,
            Self::NoImage | Self::NoObject => true,
            Self::NoLabels => false,
        }
    }
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
        // A stream without any frame has a result, too: that no image arrived.
        for stream in plan.streams() {
            self.streams.entry(stream.name.clone()).or_default();
        }
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
            self.add_frame(&out, camera);
            recordings.add(plan, (camera, number), &out, next + 1 == running.len());
            if tell(chain).is_break() {
                break;
            }
        }
        Ok(())
    }

    fn add_frame(&mut self, out: &[OnTopic], camera: &CameraPlan) {
        let labels = camera.truth.as_deref().and_then(|topic| arrays(out, topic).next());
        let truth = labels.map(from_detections);
        for stream in &camera.streams {
            let frame = EvaluatedFrame { found: found(out, &stream.detections), truth: truth.clone() };
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
        self.streams.iter().map(|(stream, frames)| (stream.as_str(), self.result(frames))).collect()
    }

    fn result(&self, frames: &[EvaluatedFrame]) -> StreamResult {
        if frames.iter().all(|frame| frame.found.is_none()) {
            return StreamResult::NoImage;
        }
        // In a frame without labels, every box would count as wrong.
        let labelled = || frames.iter().filter_map(|frame| Some((&frame.found, frame.truth.as_ref()?)));
        let scored = labelled().map(|(found, truth)| (found.clone().unwrap_or_default(), truth.clone()));
        let scored: Vec<ScoredFrame> = scored.collect();
        if scored.is_empty() {
            return StreamResult::NoLabels;
        }
        let classes = by_class(&scored, self.difficulty);
        let Some(ap50) = mean_over_classes(&classes) else { return StreamResult::NoObject };
        StreamResult::Scored(StreamScore {
            ap50,
            classes,
            frames: scored.len(),
            unanswered: labelled().filter(|(found, _)| found.is_none()).count(),
            unlabelled: frames.len() - scored.len(),
        })
    }

    /// Writes `STREAM.json` for each stream with one line for each frame:
    /// `{"000000.png": [[x1, y1, x2, y2, score, "class"], ...], ...}`. Writes `scores.json` if there are scores; those of an earlier run do
    /// not stay. `stopped` marks them as those of a part of the frames.
    ///
    /// # Errors
    /// [`FileError`] of the first file that cannot be written; the others are written.
    pub fn write(&self, folder: &Path, stopped: bool) -> Result<(), FileError> {
        let mut files: Vec<_> =
            self.streams.iter().map(|(name, frames)| (format!("{name}.json"), boxes(frames))).collect();
        let scores: BTreeMap<&str, Value> = self
            .results()
            .into_iter()
            .filter_map(|(stream, result)| match result {
                StreamResult::Scored(score) => Some((stream, self.score_json(&score, stopped))),
                _ => None,
            })
            .collect();
        if scores.is_empty() {
            // It fails where there is none.
            let _ = std::fs::remove_file(folder.join(SCORES));
        } else {
            files.push((SCORES.to_owned(), format!("{:#}\n", json!(scores))));
        }
        let write = |(name, text): (String, String)| {
            let path = folder.join(name);
            std::fs::write(&path, text).map_err(|why| FileError::new(&path, why))
        };
        files.into_iter().map(write).fold(Ok(()), Result::and)
    }

    /// `{"ap50": f, "difficulty": "moderate", "frames": n, "classes": {"CLASS": {"ap50": f, "objects": n}}}`, with `"stopped": true` where the
    /// run was stopped.
    fn score_json(&self, score: &StreamScore, stopped: bool) -> Value {
        let class = |(ap50, objects): &(f64, usize)| json!({ "ap50": ap50, "objects": objects });
        let classes: BTreeMap<&String, Value> = score.classes.iter().map(|(k, v)| (k, class(v))).collect();
        let mut value = json!({ "ap50": score.ap50, "difficulty": self.difficulty, "frames": score.frames, "classes": classes });
        if stopped {
            value["stopped"] = true.into();
        }
        value
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
