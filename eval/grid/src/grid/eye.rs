//! The detector of a cell, in lockstep, and what it said of images before: an equal image of the same frame is
//! not looked at twice.

use std::collections::HashMap;
use std::collections::hash_map::DefaultHasher;
use std::hash::{Hash, Hasher};
use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};

use modulo_core::{Detection, Frame, Samples};
use modulo_detector::{DetectorParameters, EngineChoice};
use modulo_runtime::driver::lockstep::Lockstep;
use modulo_runtime::{Clock, Message, StampedFrame};

use super::chain::{Stages, node_name, now};
use super::nodes::Nodes;
use super::{GridError, LEAST_SCORE};

/// Most answers that are kept, to bound the memory of a large data set.
const MOST_KEPT: usize = 20_000;

/// What a detector said of an image.
#[derive(Clone, Debug, Default)]
pub struct Answer {
    /// Best first; `None`: no answer.
    pub found: Option<Arc<Vec<Detection>>>,
    /// How long it took.
    pub stages: Stages,
}

/// Answers of one model at one input size, shared by its eyes.
#[derive(Default)]
pub struct Memory(Mutex<HashMap<(usize, u64), Answer>>);

/// How a detector is made.
#[derive(Clone, Debug, PartialEq)]
pub struct Lens<'a> {
    /// ONNX file, or `demo`.
    pub model: &'a Path,
    /// The inference engine.
    pub engine: EngineChoice,
    /// `auto` or `WIDTHxHEIGHT`.
    pub input: &'a str,
    /// Of one inference.
    pub threads: usize,
}

/// One detector.
pub struct Eye<'a> {
    chain: Lockstep<'a>,
    /// The engine that really runs.
    pub engine: String,
}

impl<'a> Eye<'a> {
    /// A warm detector.
    ///
    /// # Errors
    /// [`GridError`] when there is no such one.
    pub fn open(nodes: &dyn Nodes, timer: &'a dyn Clock, lens: &Lens<'_>) -> Result<Self, GridError> {
        let node = nodes.detector(&DetectorParameters {
            model: lens.model.display().to_string(),
            engine: lens.engine,
            input: "/image".to_owned(),
            input_size: lens.input.to_owned(),
            threads: lens.threads,
            score_threshold: LEAST_SCORE,
            ..DetectorParameters::default()
        })?;
        let fact = |(name, value)| (name == "engine").then_some(value);
        let engine = node.status().into_iter().find_map(fact).unwrap_or_default();
        let mut chain = Lockstep::new(timer, vec!["/detector/detections".to_owned()]);
        chain.add(node, &node_name("detector"))?;
        Ok(Self { chain, engine })
    }

    /// What it sees on the image of frame `number`.
    ///
    /// # Errors
    /// [`GridError`] when the detector cannot go on.
    pub fn look(
        &mut self,
        number: usize,
        image: Arc<StampedFrame>,
        memory: &Memory,
    ) -> Result<Answer, GridError> {
        let key = (number, digest(&image.frame));
        if let Some(answer) = memory.lock().get(&key) {
            return Ok(answer.clone());
        }
        let out = self.chain.feed("/image", Message::Image(image), now(number))?;
        let found = out.into_iter().find_map(|(_, message)| match message {
            Message::Detections(array) => Some(array),
            _ => None,
        });
        let found = found.map(|array| {
            Arc::new(array.detections.iter().filter_map(|d| d.to_detection()).collect::<Vec<_>>())
        });
        let answer = Answer { found, stages: self.chain.stages().to_vec() };
        let mut kept = memory.lock();
        if kept.len() < MOST_KEPT {
            kept.insert(key, answer.clone());
        }
        Ok(answer)
    }
}

impl Memory {
    fn lock(&self) -> std::sync::MutexGuard<'_, HashMap<(usize, u64), Answer>> {
        // Nothing is ever half written under the lock.
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

fn digest(frame: &Frame) -> u64 {
    let mut hasher = DefaultHasher::new();
    frame.dim().hash(&mut hasher);
    match frame.samples() {
        Samples::U8(pixels) => pixels.hash(&mut hasher),
        Samples::U16(pixels) => pixels.hash(&mut hasher),
        Samples::F32(pixels) => pixels.mapv(f32::to_bits).hash(&mut hasher),
    }
    hasher.finish()
}
