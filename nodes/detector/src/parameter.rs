//! The parameters of the `detector` node, and their check against a model.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use modulo_runtime::input::in_home;
use modulo_runtime::{NodeName, ParameterError, ParameterSet as _, StreamKind};

use crate::classes::{ClassMap, Classes};
use crate::engine::{CudnnSearch, EngineChoice, EngineDevice, EngineOptions};
use crate::input_size::InputSize;
use crate::model::{DEMO, ModelLayout};

/// The word for an input that follows the trust of the unwrapper.
const AUTO: &str = "auto";

modulo_runtime::parameters! {
    /// The parameters of the `detector` node.
    pub struct DetectorParameters {
        /// Path of the ONNX model, or demo for the embedded demonstration model, which is not made for roads.
        model: String = DEMO.to_owned(),
        /// Inference engine: ONNX Runtime (ort), ONNX Runtime with OpenVINO (openvino, or openvino_f32 with 32 bits), rten, or
        /// auto: ort where its library is found, and rten elsewhere.
        engine: EngineChoice = EngineChoice::Auto => EngineChoice::WORDS,
        /// Device that runs the model: cpu, cuda or tensorrt, the last two with ort only and with the number of a GPU where it is
        /// not the first, such as cuda:1. A device that is not there is an error.
        device: String = "cpu".to_owned(),
        /// How cuDNN chooses its algorithms on device cuda: heuristic, by rules, or exhaustive, by a trial of all of them, which takes
        /// seconds at each size of the input.
        cudnn_search: CudnnSearch = CudnnSearch::Heuristic => CudnnSearch::WORDS,
        /// Stream that the detector reads (the paper's p): modulo, recovered, metered, saturated, auto_exposed, ideal, an absolute
        /// topic such as /camera/image_raw, or auto: metered while unwrap trusts the recovered image, else that of fallback.
        input: String = "recovered".to_owned(),
        /// Stream that input: auto reads while unwrap does not trust the recovered image: modulo, recovered, metered, saturated,
        /// auto_exposed, ideal, an absolute topic, or auto: what was measured to be best, saturated where the lens has no blur, else metered.
        fallback: String = AUTO.to_owned(),
        /// Namespaces of the cameras whose streams are read by turns, such as [/front, /rear]. The results of /front are on
        /// ~/front/detections and ~/front/annotated. Empty: one camera, in the namespace of the detector.
        cameras: Vec<String> = Vec::new(); fixed,
        /// Detections with a lower score are not published.
        score_threshold: f64 = 0.25 => 0.0..=1.0,
        /// Largest number of detections of a frame. Those with the best scores are kept.
        max_det: usize = 300 => 1..=1000,
        /// Of two boxes of a class whose intersection over union is larger, the one with the lower score is removed. It counts for
        /// models that do not remove overlapping boxes themselves.
        nms_iou: f64 = 0.7 => 0.0..=1.0,
        /// Size of the model's input in px: auto (padded to multiples of its stride, 32 in general, never resized) or WIDTHxHEIGHT
        /// (centred, never enlarged).
        input_size: String = "auto".to_owned(),
        /// Names of the classes to publish, as they are called after class_map. Empty: all classes.
        classes: Vec<String> = Vec::new(),
        /// Path of a file with lines 'from: to' that renames classes and drops all others. Empty: no renaming.
        class_map: String = String::new(),
        /// Number of threads of one inference. 0: as many as the machine has cores.
        threads: usize = 0 => 0..=64,
        /// Bits of the codes of modulo, saturated, or a topic of another camera. 0: those of the camera's sensor description for its
        /// own streams, else the whole range of the encoding, 8 or 16 bits. The pictures recovered and ideal always have 8 bits.
        bits: u8 = 0 => 0..=16,
    }
}

impl DetectorParameters {
    pub(crate) fn model(&self) -> Result<PathBuf, ParameterError> {
        self.check()?;
        if self.model.is_empty() {
            let why = "must be demo, or the path of an ONNX detector, such as model:=/data/yolov10n.onnx";
            return Err(ParameterError::new("model", "''", why));
        }
        Ok(in_home(Path::new(&self.model)))
    }

    pub(crate) fn engine_options(&self) -> Result<EngineOptions, ParameterError> {
        let refuse = |why: String| ParameterError::new("device", &self.device, why);
        let device = self.device.parse().map_err(refuse)?;
        let &Self { engine, cudnn_search, threads, .. } = self;
        if cudnn_search == CudnnSearch::Exhaustive && !matches!(device, EngineDevice::Cuda(_)) {
            let why = format!("needs device cuda, and the device is {device}");
            return Err(ParameterError::new("cudnn_search", "exhaustive", why));
        }
        Ok(EngineOptions { engine, device, cudnn_search, threads })
    }

    /// Returns the stream to read, and the topic of `fallback` unless that is auto.
    pub(crate) fn streams(&self) -> Result<(StreamChoice, Option<String>), ParameterError> {
        let fallback = stream("fallback", &self.fallback)?;
        Ok(match stream("input", &self.input)? {
            None => (StreamChoice::Auto(fallback.clone()), fallback),
            Some(input) => (StreamChoice::Stream(input), fallback),
        })
    }

    /// Refuses cameras that are no namespaces, are named twice, or whose streams `input` and `fallback` do not name.
    fn check_cameras(&self) -> Result<(), ParameterError> {
        let refuse = |why: &str| Err(ParameterError::new("cameras", self.cameras.join(", "), why));
        let is_namespace = |name: &String| name.starts_with('/') && NodeName::default().resolve(name).is_ok();
        if !self.cameras.iter().all(is_namespace) {
            return refuse("must be absolute namespaces, such as [/front, /rear]");
        }
        let unique: BTreeSet<_> = self.cameras.iter().collect();
        if unique.len() < self.cameras.len() {
            return refuse("must name each namespace once");
        }
        if !self.cameras.is_empty() && [&self.input, &self.fallback].iter().any(|name| name.starts_with('/'))
        {
            return refuse("needs an input that each camera has, such as recovered, and no absolute topic");
        }
        Ok(())
    }

    /// Returns whether `other` needs the same loaded model. A model has run once at its size of the input.
    pub(crate) fn same_engine(&self, other: &Self) -> bool {
        let engine = |of: &Self| (of.model.clone(), of.engine_options(), of.input_size.clone());
        engine(self) == engine(other)
    }
}

/// The stream that a detector reads: a stream's name or an absolute topic.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum StreamChoice {
    /// Always this one.
    Stream(String),
    /// `metered` while the unwrapper trusts the recovered image, else this one; `None` selects it by the lens of the sensor.
    Auto(Option<String>),
}

/// The parameters that may change between two frames, and what follows from them for a model.
#[derive(Clone, Debug, PartialEq)]
pub struct Settings {
    pub parameters: DetectorParameters,
    pub input: StreamChoice,
    pub input_size: InputSize,
    pub classes: Classes,
}

impl Settings {
    /// Returns the settings that the parameters give for a model of this `layout`, with the class `map` that they name.
    pub fn new(
        parameters: &DetectorParameters,
        layout: &ModelLayout,
        map: ClassMap,
    ) -> Result<Self, ParameterError> {
        parameters.check()?;
        parameters.check_cameras()?;
        let size = &parameters.input_size;
        Ok(Self {
            input: parameters.streams()?.0,
            input_size: InputSize::parse(size, layout.size, layout.stride)
                .map_err(|why| ParameterError::new("input_size", size, why))?,
            classes: Classes::new(&layout.names, map, &parameters.classes)?,
            parameters: parameters.clone(),
        })
    }
}

/// Returns the stream that `name`, the value of `parameter`, stands for; `None` for auto.
fn stream(parameter: &str, name: &str) -> Result<Option<String>, ParameterError> {
    if name == AUTO {
        return Ok(None);
    }
    let mut streams = StreamKind::for_detectors();
    if streams.any(|stream| stream == name)
        || (name.starts_with('/') && NodeName::default().resolve(name).is_ok())
    {
        return Ok(Some(name.to_owned()));
    }
    let streams = StreamKind::for_detectors().collect::<Vec<_>>().join(", ");
    let why = format!("must be one of {streams}, auto, or an absolute topic such as /camera/image_raw");
    Err(ParameterError::new(parameter, name, why))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_input_is_a_stream_or_a_topic() {
        for possible in
            ["modulo", "recovered", "metered", "saturated", "auto_exposed", "ideal", "/image", "/_a/b2"]
        {
            assert_eq!(stream("input", possible), Ok(Some(possible.to_owned())));
        }
        for bad in ["", "p", "Recovered", "image", "/", "//a", "/a/", "/a b", "/2a", "~/a"] {
            let why = stream("input", bad).expect_err(bad).to_string();
            assert!(
                why.contains("modulo, recovered, metered, saturated, auto_exposed, ideal")
                    && why.contains("absolute"),
                "{why}"
            );
        }
    }
}
