//! [`DetectorWorker`]: the detector of a cell, in lockstep, with a cache of its outputs.

use std::collections::HashMap;
use std::collections::hash_map::DefaultHasher;
use std::hash::{Hash, Hasher};
use std::path::Path;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use modulo_core::{Detection, Frame, Samples};
use modulo_detector::{DetectorParameters, EngineChoice, EngineDevice};
use modulo_runtime::lockstep::Lockstep;
use modulo_runtime::{Clock, Message, StampedFrame};

use super::GridError;
use super::pipeline::Nodes;
use super::pipeline::{Stages, node_name, stamp};

/// Lowest score of a detection. AP needs detections of low confidence, too.
const LEAST_SCORE: f64 = 0.001;

/// Number of outputs that the cache keeps, which bounds its memory on a large data set.
const MOST_KEPT: usize = 20_000;

/// The detections of one image.
#[derive(Clone, Debug, Default)]
pub struct DetectorOutput {
    /// Detections by descending score. `None` if the detector gave no answer.
    pub found: Option<Arc<Vec<Detection>>>,
    /// Durations of the stages. Empty if the detections were known.
    pub stages: Stages,
}

/// Detections by the number of the frame and the hash of its pixels, as in [`DetectorOutput::found`].
type KnownDetections = HashMap<(usize, u64), Option<Arc<Vec<Detection>>>>;

/// Detections of one model at one input size, shared by its workers: an image that equals an earlier one of the same frame
/// is not detected again.
#[derive(Default)]
pub struct DetectionCache(Mutex<KnownDetections>);

/// The settings of a detector.
#[derive(Clone, Debug, PartialEq)]
pub struct DetectorConfig<'a> {
    /// ONNX file, or `demo`.
    pub model: &'a Path,
    /// The inference engine.
    pub engine: EngineChoice,
    /// The device that runs the model.
    pub device: EngineDevice,
    /// `auto` or `WIDTHxHEIGHT`.
    pub input: &'a str,
    /// Threads of one inference.
    pub threads: usize,
}

/// One detector.
pub struct DetectorWorker<'a> {
    chain: Lockstep<'a>,
    /// The engine in use.
    pub engine: String,
    /// Threads of one inference.
    pub threads: usize,
}

impl<'a> DetectorWorker<'a> {
    /// Loads and warms up a detector.
    pub fn open(
        nodes: &dyn Nodes,
        timer: &'a dyn Clock,
        config: &DetectorConfig<'_>,
    ) -> Result<Self, GridError> {
        let node = nodes.detector(&DetectorParameters {
            model: config.model.display().to_string(),
            engine: config.engine,
            device: config.device.to_string(),
            input: "/image".to_owned(),
            input_size: config.input.to_owned(),
            threads: config.threads,
            score_threshold: LEAST_SCORE,
            ..DetectorParameters::default()
        })?;
        let status = node.status();
        let of =
            |wanted: &str| status.iter().find(|(name, _)| *name == wanted).map(|(_, value)| value.clone());
        let engine = of("engine").expect("the status of a detector names its engine");
        let threads = of("threads").and_then(|threads| threads.parse().ok());
        let threads = threads.expect("the status of a detector has the number of its threads");
        let mut chain = Lockstep::new(timer, vec!["/detector/detections".to_owned()]);
        chain.add(node, &node_name("detector"))?;
        Ok(Self { chain, engine, threads })
    }

    /// Detects objects in the image of frame `number`, or takes the output of an equal image of this frame.
    pub fn detect(
        &mut self,
        number: usize,
        image: Arc<StampedFrame>,
        cache: &DetectionCache,
    ) -> Result<DetectorOutput, GridError> {
        // The sharp ideal image is the same for all lenses, and a recovered image is often the same for several
        // methods.
        let key = (number, digest(&image.frame));
        // The lock is not held during the inference. Two workers never have the same frame, so that no image is
        // detected twice.
        if let Some(found) = cache.lock().get(&key) {
            return Ok(DetectorOutput { found: found.clone(), stages: Stages::new() });
        }
        let output = self.infer(number, image)?;
        let mut kept = cache.lock();
        if kept.len() < MOST_KEPT {
            kept.insert(key, output.found.clone());
        }
        Ok(output)
    }

    /// Detects objects in the image of frame `number`.
    pub fn infer(&mut self, number: usize, image: Arc<StampedFrame>) -> Result<DetectorOutput, GridError> {
        let out = self.chain.feed("/image", Message::Image(image), stamp(number))?;
        let found = out.into_iter().find_map(|(_, message)| match message {
            Message::Detections(array) => Some(array),
            _ => None,
        });
        let found = found.map(|array| {
            Arc::new(array.detections.iter().filter_map(|d| d.to_detection()).collect::<Vec<_>>())
        });
        Ok(DetectorOutput { found, stages: self.chain.stages().to_vec() })
    }
}

impl DetectionCache {
    fn lock(&self) -> MutexGuard<'_, KnownDetections> {
        // The map is complete after every single operation, so that a panic of another worker does not harm it.
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

fn digest(frame: &Frame) -> u64 {
    let mut hasher = DefaultHasher::new();
    frame.dim().hash(&mut hasher);
    match frame.samples() {
        Samples::U8(pixels) => pixels.hash(&mut hasher),
        Samples::U16(pixels) => pixels.hash(&mut hasher),
        // Floats have no hash, because NaN differs from itself. Their bits have one.
        Samples::F32(pixels) => pixels.mapv(f32::to_bits).hash(&mut hasher),
    }
    hasher.finish()
}
