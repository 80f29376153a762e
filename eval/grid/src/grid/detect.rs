//! [`DetectorWorker`]: the detector of a cell, in lockstep, with a cache of its outputs.

use std::collections::HashMap;
use std::collections::hash_map::DefaultHasher;
use std::hash::{Hash, Hasher};
use std::sync::{Arc, Mutex, PoisonError};

use modulo_core::{Detection, Frame, Samples};
use modulo_detector::DetectorParameters;
use modulo_runtime::lockstep::Lockstep;
use modulo_runtime::{Clock, Message, StampedFrame};

use super::pipeline::MakeDetector;
use super::pipeline::{Stages, node_name, stamp};
use super::{GridError, Request};
use crate::messages::found;
use crate::results::Point;

/// Lowest score of a detection. AP needs detections of low confidence, too.
const LEAST_SCORE: f64 = 0.001;

/// Topic of the boxes.
const DETECTIONS: &str = "/detector/detections";

/// Number of outputs that the cache keeps, which bounds its memory on a large data set.
const MOST_KEPT: usize = 20_000;

/// Detections of one image by descending score. `None` if the detector gave no answer.
pub type Found = Option<Arc<Vec<Detection>>>;

/// Detections of one model at one input size by the number of the frame and the hash of its pixels, shared by its workers: an
/// image that equals an earlier one of the same frame is not detected again.
pub type DetectionCache = Mutex<HashMap<(usize, u64), Found>>;

pub struct DetectorWorker<'a> {
    chain: Lockstep<'a>,
    pub engine: String,
    pub threads: usize,
}

impl<'a> DetectorWorker<'a> {
    /// Loads and warms up the detector of the cell at `point`, which has `threads` threads for an inference.
    pub fn open(
        request: &Request,
        make: &MakeDetector,
        timer: &'a dyn Clock,
        point: &Point,
        threads: usize,
    ) -> Result<Self, GridError> {
        let node = make(&DetectorParameters {
            model: request.model(&point.model)?.display().to_string(),
            engine: request.options.engine,
            device: request.options.device.to_string(),
            input: "/image".to_owned(),
            input_size: point.input.clone(),
            threads,
            score_threshold: LEAST_SCORE,
            ..DetectorParameters::default()
        })?;
        let status = node.status();
        let of =
            |wanted: &str| status.iter().find(|(name, _)| *name == wanted).map(|(_, value)| value.clone());
        let engine = of("engine").expect("the status of a detector names its engine");
        let threads = of("threads").and_then(|threads| threads.parse().ok());
        let threads = threads.expect("the status of a detector has the number of its threads");
        let mut chain = Lockstep::new(timer, vec![DETECTIONS.to_owned()]);
        chain.add(node, &node_name("detector"))?;
        Ok(Self { chain, engine, threads })
    }

    /// Detects objects in the image of frame `number`, or takes those of an equal image of this frame.
    pub fn detect(
        &mut self,
        number: usize,
        image: Arc<StampedFrame>,
        cache: &DetectionCache,
    ) -> Result<Found, GridError> {
        // The sharp ideal image is the same for all lenses, and a recovered image is often the same for several
        // methods.
        let key = (number, digest(&image.frame));
        // The map is complete after every single operation, so that a panic of another worker does not harm it.
        let lock = || cache.lock().unwrap_or_else(PoisonError::into_inner);
        // The lock is not held during the inference. Two workers never have the same frame, so that no image is
        // detected twice.
        if let Some(found) = lock().get(&key) {
            return Ok(found.clone());
        }
        let (found, _) = self.infer(number, image)?;
        let mut kept = lock();
        if kept.len() < MOST_KEPT {
            kept.insert(key, found.clone());
        }
        Ok(found)
    }

    /// Detects objects in the image of frame `number`. Returns the durations of the stages as well.
    pub fn infer(&mut self, number: usize, image: Arc<StampedFrame>) -> Result<(Found, Stages), GridError> {
        let out = self.chain.feed("/image", Message::Image(image), stamp(number))?;
        Ok((found(&out, DETECTIONS).map(Arc::new), self.chain.stages().to_vec()))
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
