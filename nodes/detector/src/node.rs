//! [`Detector`]: the node's step.

use std::path::Path;
use std::sync::Arc;

use modulo_core::Detection;
use modulo_msgs::std_msgs::{Header, Time};
use modulo_msgs::vision_msgs::{Detection2D, Detection2DArray, LabelInfo, VisionInfo};
use modulo_runtime::sensor_info::{self, SensorHistory};
use modulo_runtime::{
    Context, Flow, Job, Message, MessageKind, Node, ParameterError, Parameters, Part, StampedFrame,
    StepError, Topic, Trigger,
};
use ndarray::Array4;

use crate::DetectorError;
use crate::draw::annotated;
use crate::engine::{self, Engine, EngineError, OpenedEngine};
use crate::input_size::InputSize;
use crate::model::cores;
use crate::parameter::{DetectorParameters, Settings};
use crate::post::detections;
use crate::pre::Preprocessor;

const DETECTIONS: usize = 0;
const ANNOTATED: usize = 1;
const VISION_INFO: usize = 2;
const LABEL_INFO: usize = 3;

/// Finds objects in the images of one stream.
///
/// ```
/// use modulo_detector::{Detector, DetectorParameters, EngineChoice};
/// use modulo_runtime::driver::lockstep::Lockstep;
/// use modulo_runtime::{Message, NodeName, StampedFrame, SystemClock};
/// use modulo_core::Frame;
///
/// let parameters = DetectorParameters { engine: EngineChoice::Rten, ..Default::default() };
/// let clock = SystemClock::default();
/// let mut chain = Lockstep::new(&clock, vec!["/detector/detections".into()]);
/// chain.add(Box::new(Detector::new(&parameters)?), &NodeName::new("detector", "/", &[])?)?;
///
/// let frame = Frame::from_u8(ndarray::Array3::zeros((64, 96, 3)))?;
/// let image = Message::Image(StampedFrame { header: Default::default(), frame }.into());
/// let answers = chain.feed("/recovered", image, 0)?;
/// assert!(matches!(&answers[..], [(_, Message::Detections(boxes))] if boxes.detections.is_empty()));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub struct Detector {
    loaded: Loaded,
    pre: Preprocessor,
    /// The sensor descriptions that the camera has sent.
    described: SensorHistory,
    /// Whether a parameter that contradicts the camera was reported.
    contradiction_told: bool,
    /// Number of the version of the published classes and their threshold.
    version: i32,
    /// Whether this version has not been published yet.
    labels_due: bool,
    /// Bits of the sensor that made the last frame; 0: those of the encoding.
    bits: u8,
}

/// A model that has run with these parameters.
struct Loaded {
    parameters: DetectorParameters,
    settings: Settings,
    engine: OpenedEngine,
}

impl Loaded {
    /// Loads the model and runs it once at (height, width) of an image, so that the first frame is as fast as all others.
    fn new(parameters: &DetectorParameters, (height, width): (usize, usize)) -> Result<Self, DetectorError> {
        let threads = cores(parameters.threads);
        let mut engine = engine::open(parameters.model()?, parameters.engine, threads)?;
        let settings = Settings::new(parameters, &engine.layout, None)?;
        warm_up(&mut *engine.engine, settings.input_size, (height, width))?;
        tracing::info!("model {} runs on {} ({})", parameters.model, engine.name, engine.note);
        Ok(Self { parameters: parameters.clone(), settings, engine })
    }

    /// Loads the model in place of that of `last`.
    fn after(
        last: &DetectorParameters,
        parameters: &DetectorParameters,
        size: (usize, usize),
    ) -> Result<Self, ParameterError> {
        Self::new(parameters, size).map_err(|why| match why {
            DetectorError::Parameter(why) => why,
            DetectorError::Engine(why) if parameters.model != last.model => {
                ParameterError::new("model", &parameters.model, why.to_string())
            }
            DetectorError::Engine(why) if parameters.engine != last.engine => {
                ParameterError::new("engine", parameters.engine, why.to_string())
            }
            DetectorError::Engine(why) => ParameterError::new("threads", parameters.threads, why.to_string()),
        })
    }

    fn model_file(&self) -> String {
        let model = Path::new(&self.parameters.model);
        model.file_name().unwrap_or(model.as_os_str()).to_string_lossy().into_owned()
    }
}

/// (height, width) of the image of a first run.
const FIRST_RUN: (usize, usize) = (640, 640);

impl Detector {
    /// Loads the model and runs it once, so that the first frame is as fast as all others and a model that cannot work
    /// is known now.
    ///
    /// # Errors
    /// [`DetectorError::Parameter`] for a parameter that is not possible (with this model), [`DetectorError::Engine`]
    /// for a model that does not run.
    pub fn new(parameters: &DetectorParameters) -> Result<Self, DetectorError> {
        Ok(Self {
            loaded: Loaded::new(parameters, FIRST_RUN)?,
            pre: Preprocessor::default(),
            described: SensorHistory::default(),
            contradiction_told: false,
            version: 1,
            labels_due: true,
            bits: 0,
        })
    }

    /// Takes another model or other settings between two frames.
    fn change(&mut self, change: impl FnOnce(&mut Loaded)) {
        let labels = |loaded: &Loaded| {
            let Settings { classes, score_threshold, .. } = &loaded.settings;
            (loaded.model_file(), classes.labels(), *score_threshold)
        };
        let before = labels(&self.loaded);
        change(&mut self.loaded);
        if labels(&self.loaded) != before {
            (self.version, self.labels_due) = (self.version.saturating_add(1), true);
        }
        self.contradiction_told = false;
    }

    /// Publishes the meaning of the class ids, once for each version.
    fn tell_labels(&mut self, header: &Header, cx: &mut Context<'_>) {
        if !std::mem::take(&mut self.labels_due) {
            return;
        }
        let info = VisionInfo {
            header: header.clone(),
            method: self.loaded.model_file(),
            database_location: format!("{}/label_info", cx.node()),
            database_version: self.version,
        };
        let Settings { classes, score_threshold, .. } = &self.loaded.settings;
        let labels =
            LabelInfo { header: header.clone(), class_map: classes.labels(), threshold: *score_threshold };
        cx.emit(VISION_INFO, Message::VisionInfo(Arc::new(info)));
        cx.emit(LABEL_INFO, Message::LabelInfo(Arc::new(labels)));
    }

    fn detect(&mut self, image: &StampedFrame, cx: &mut Context<'_>) -> Result<(), String> {
        self.bits = self.bits(image.header.stamp);
        let Self { loaded: Loaded { settings, engine, .. }, pre, bits, .. } = self;
        let bits = *bits;
        let letterbox = cx.stage("pre", || pre.fill(&image.frame, bits, settings.input_size))?;
        let rows =
            cx.stage("infer", || engine.engine.run(pre.tensor())).map_err(|error| error.to_string())?;
        let found = cx.stage("post", || detections(&rows, &letterbox, settings));
        if cx.wanted(ANNOTATED) {
            let frame = cx.stage("draw", || annotated(&image.frame, bits, &found))?;
            let image = StampedFrame { header: image.header.clone(), frame };
            cx.emit(ANNOTATED, Message::Image(Arc::new(image)));
        }
        let header = &image.header;
        tracing::debug!("{}", line(image.header.stamp, &found));
        let detections =
            found.iter().map(|detection| Detection2D::from_detection(detection, header)).collect();
        let array = Detection2DArray { header: header.clone(), detections };
        cx.emit(DETECTIONS, Message::Detections(Arc::new(array)));
        Ok(())
    }

    /// Bits of the sensor that made the frame of `stamp`; 0: those of the encoding.
    fn bits(&mut self, stamp: Time) -> u8 {
        let camera = self.described.of(stamp).or(self.described.latest()).map(|sensor| sensor.bits);
        match (self.loaded.settings.bits, camera) {
            (0, camera) => camera.unwrap_or(0),
            (own, Some(camera)) if own != camera => {
                if !std::mem::replace(&mut self.contradiction_told, true) {
                    tracing::warn!("the parameter bits {own} overrides the camera's {camera} bits");
                }
                own
            }
            (own, _) => own,
        }
    }

    fn shown_size(&self) -> String {
        match (self.loaded.settings.input_size, self.pre.size()) {
            (InputSize::Auto, Some((height, width))) => format!("auto {width}x{height}"),
            (size, _) => size.to_string(),
        }
    }
}

/// Returns the log line of a frame: stamp, count, and for each box class, score and (x1 y1 x2 y2) in px.
fn line(stamp: Time, found: &[Detection]) -> String {
    let boxes = found.iter().map(|Detection { bbox: b, score, class }| {
        format!("{class} {score:.2} ({:.0} {:.0} {:.0} {:.0})", b.x1, b.y1, b.x2, b.y2)
    });
    let boxes = boxes.collect::<Vec<_>>().join(", ");
    format!("{}.{:09} {} boxes: {boxes}", stamp.sec, stamp.nanosec, found.len())
}

fn warm_up(
    engine: &mut dyn Engine,
    size: InputSize,
    (height, width): (usize, usize),
) -> Result<(), EngineError> {
    let (height, width) = size.tensor(height, width);
    engine.run(Array4::zeros((1, 3, height, width)).view()).map(|_| ())
}

/// Returns the topics that a detector publishes.
pub fn outputs() -> Vec<Topic> {
    vec![
        Topic::new("~/detections", MessageKind::Detections),
        Topic::new("~/annotated", MessageKind::Image),
        Topic::new("~/vision_info", MessageKind::VisionInfo),
        Topic::new("~/label_info", MessageKind::LabelInfo),
    ]
}

impl Node for Detector {
    fn inputs(&self) -> Vec<Topic> {
        vec![Topic::new(&self.loaded.settings.input, MessageKind::Image), sensor_info::topic()]
    }

    fn outputs(&self) -> Vec<Topic> {
        outputs()
    }

    fn configure(&mut self, parameters: &Parameters) -> Result<(), ParameterError> {
        let parameters = DetectorParameters::from(parameters);
        let size = self.pre.size().unwrap_or(FIRST_RUN);
        let Loaded { parameters: last, settings, engine } = &mut self.loaded;
        if !parameters.same_engine(last) {
            let next = Loaded::after(last, &parameters, size)?;
            self.change(|loaded| *loaded = next);
            return Ok(());
        }
        let next = Settings::new(&parameters, &engine.layout, Some(settings))?;
        if next.input_size != settings.input_size {
            warm_up(&mut *engine.engine, next.input_size, size)
                .map_err(|error| ParameterError::new("input_size", next.input_size, error.to_string()))?;
        }
        self.change(|loaded| (loaded.parameters, loaded.settings) = (parameters, next));
        Ok(())
    }

    fn prepare(&self, now: &Parameters, next: &Parameters) -> Option<Job> {
        let [now, next] = [now, next].map(DetectorParameters::from);
        if next.same_engine(&now) {
            return None;
        }
        let size = self.pre.size().unwrap_or(FIRST_RUN);
        Some(Box::new(move || Ok(Box::new(Loaded::after(&now, &next, size)?))))
    }

    fn exchange(&mut self, parameters: &Parameters, part: Part) -> Result<(), ParameterError> {
        let typed = DetectorParameters::from(parameters);
        match part.downcast::<Loaded>() {
            Ok(loaded) if loaded.parameters.same_engine(&typed) => {
                // Other parameters may have changed while the model was loaded.
                let settings = Settings::new(&typed, &loaded.engine.layout, None)?;
                let next = Loaded { parameters: typed, settings, engine: loaded.engine };
                self.change(|loaded| *loaded = next);
                Ok(())
            }
            _ => self.configure(parameters),
        }
    }

    fn step(&mut self, trigger: Trigger, cx: &mut Context<'_>) -> Result<Flow, StepError> {
        match trigger {
            Trigger::Message { message: Message::Image(image), .. } => {
                self.detect(&image, cx).map(|()| self.tell_labels(&image.header, cx))
            }
            Trigger::Message { message: Message::Diagnostics(info), .. } => {
                self.described.note(&info).map_err(|why| why.to_string())
            }
            Trigger::Message { .. } | Trigger::Tick => Err("the detector only answers images".to_owned()),
        }
        .map_err(StepError::Skip)?;
        Ok(Flow::Continue)
    }

    fn state(&self) -> Vec<(&'static str, String)> {
        let Loaded { parameters, settings, engine } = &self.loaded;
        vec![
            ("engine", engine.name.to_owned()),
            ("engine_from", engine.note.clone()),
            ("model", self.loaded.model_file()),
            ("model_path", parameters.model.clone()),
            ("input_size", self.shown_size()),
            ("threads", cores(parameters.threads).to_string()),
            ("score_threshold", settings.score_threshold.to_string()),
            ("bits", self.bits.to_string()),
        ]
    }

    fn status(&self) -> Vec<(&'static str, String)> {
        let mut status = self.state();
        status.push(("stream", self.loaded.settings.input.clone()));
        status
    }
}
