//! [`Detector`]: the node's step.

use modulo_core::{Detection, Frame};
use modulo_msgs::diagnostic_msgs::DiagnosticArray;
use modulo_msgs::std_msgs::{Header, Time};
use modulo_msgs::vision_msgs::{Detection2D, Detection2DArray, LabelInfo, VisionInfo};
use modulo_runtime::sensor::recovery::Recovery;
use modulo_runtime::sensor_info::{self, Descriptions, SensorHistory};
use modulo_runtime::topic::RECOVERY_TOPIC;
use modulo_runtime::{
    Context, Flow, Job, Message, MessageKind, Node, ParameterError, ParameterSet as _, Parameters, Part,
    PlannedInputs, StampedFrame, StepError, StreamScale, Topic, Trigger, stream_of,
};

use crate::DetectorError;
use crate::classes::ClassMap;
use crate::code_range::CodeRange;
use crate::draw::annotated;
use crate::export::ClassNumbers;
use crate::input_size::InputSize;
use crate::loaded::Loaded;
use crate::measure::FIRST_RUN;
use crate::parameter::{DetectorParameters, Settings, StreamChoice};
use crate::pre::Preprocessor;
use crate::sessions::Sessions;
use crate::trust::TrustFollower;

#[derive(Clone, Copy, PartialEq, Eq)]
enum Role {
    Image,
    Sensor,
    /// The statuses of the recovered frames.
    Recovery,
}

/// Returns the indices of the boxes and of the annotated images of a camera; behind the last camera, those of the two outputs of
/// the model.
fn outputs_at(camera: usize) -> [usize; 2] {
    [2 * camera, 2 * camera + 1]
}

/// The stream that `input: auto` reads while the recovered image is trusted: that image, exposed after the capture. On no scene that was
/// measured did a detector find less on it than on `recovered`, and on dark ones it finds far more.
pub const TRUSTED: &str = "metered";
/// The stream that `input: auto` reads while the recovered image is not trusted and the lens has no blur.
const SHARP_FALLBACK: &str = "saturated";

/// Finds objects in the images of one stream, or of one stream of each of several cameras.
///
/// ```
/// use modulo_detector::{Detector, DetectorParameters, EngineChoice};
/// use modulo_runtime::lockstep::Lockstep;
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
    /// The cameras in the order of the inputs and outputs; at least one.
    cameras: Vec<Camera>,
    /// Whether a parameter that contradicts a camera was reported.
    contradiction_reported: bool,
    /// Number of the version of the published classes and their threshold.
    version: i32,
    /// Whether this version has not been published yet.
    labels_due: bool,
}

/// A topic that is read: the index of the camera, the role of the topic, and the topic.
type Input = (usize, Role, Topic);

#[derive(Default)]
struct Camera {
    /// Its namespace, such as /front; `None` for that of the node.
    namespace: Option<String>,
    /// The sensor descriptions, as the images of an absolute topic may be those of another camera.
    described: Descriptions,
    /// The choice of `input: auto`.
    trust: TrustFollower,
    codes: CodeRange,
    /// Bits of the samples of the last image; 0 before the first one.
    bits: u8,
    /// (height, width) of the last image, or of those that its sensor makes.
    image: Option<(usize, usize)>,
    /// (height, width) of the model's input for the last image.
    size: Option<(usize, usize)>,
}

impl Camera {
    /// Returns the topic of the camera that `topic` is in its namespace.
    fn topic(&self, topic: Topic) -> Topic {
        match &self.namespace {
            Some(namespace) => Topic { name: format!("{namespace}/{}", topic.name), ..topic },
            None => topic,
        }
    }

    /// Returns the topics to read for `stream`, where the parameters ask for `input`.
    fn inputs(&self, input: &StreamChoice, stream: &str) -> impl Iterator<Item = (Role, Topic)> {
        let sensors = sensor_info::topics_for(stream).into_iter().map(|topic| (Role::Sensor, topic));
        let recovery = Topic::new(RECOVERY_TOPIC, MessageKind::Diagnostics);
        let recovery = matches!(input, StreamChoice::Auto(_)).then_some((Role::Recovery, recovery));
        let image = (Role::Image, Topic::new(stream, MessageKind::Image));
        std::iter::once(image).chain(sensors).chain(recovery).map(|(role, topic)| (role, self.topic(topic)))
    }

    /// Returns the topic of the images to read now, where the parameters ask for `input`.
    fn image_topic(&self, input: &StreamChoice) -> String {
        self.topic(Topic::new(self.stream(input), MessageKind::Image)).name
    }

    /// Returns the stream to read now, where the parameters ask for `input`.
    fn stream<'a>(&self, input: &'a StreamChoice) -> &'a str {
        match input {
            StreamChoice::Stream(stream) => stream,
            StreamChoice::Auto(_) if !self.trust.falls_back => TRUSTED,
            StreamChoice::Auto(Some(stream)) => stream,
            // Measured (docs/research/trust.md): without blur an image that is not trusted is worse than the saturated one; with
            // blur it is better.
            StreamChoice::Auto(None) => {
                let trusted = self.topic(Topic::new(TRUSTED, MessageKind::Image)).name;
                match self.described.of(&trusted).1.and_then(SensorHistory::latest) {
                    Some(sensor) if sensor.is_sharp() => SHARP_FALLBACK,
                    _ => TRUSTED,
                }
            }
        }
    }
}

impl Detector {
    /// Loads the model and runs it once, so that a model that cannot work is known now. A driver of live nodes has it run at the size of
    /// the first frame as well, where a camera tells it, so that this frame is as fast as all others.
    ///
    /// # Errors
    /// [`DetectorError::Parameter`] for a parameter that is not possible (with this model), [`DetectorError::Engine`]
    /// for a model that does not run.
    pub fn new(parameters: &DetectorParameters) -> Result<Self, DetectorError> {
        Self::sharing(parameters, &Sessions::default())
    }

    /// Creates a detector whose model is one of `sessions`, which load it if none of them has it.
    ///
    /// # Errors
    /// The same as those of [`Detector::new`].
    pub fn sharing(parameters: &DetectorParameters, sessions: &Sessions) -> Result<Self, DetectorError> {
        Ok(Self {
            loaded: Loaded::new(parameters, &[FIRST_RUN], sessions)?,
            pre: Preprocessor::default(),
            cameras: cameras(parameters),
            contradiction_reported: false,
            version: 1,
            labels_due: true,
        })
    }

    /// Finds the objects in a picture of 8 bits, grey or red, green and blue, without messages: the best one first.
    ///
    /// # Errors
    /// A text for a picture that is too large, or on which the model does not run.
    pub fn find(&mut self, picture: &Frame) -> Result<Vec<Detection>, String> {
        let Self { loaded, pre, .. } = self;
        let letterbox = pre.fill(picture, 255.0, loaded.settings.input_size)?;
        let output = loaded.infer(pre.tensor().expect("it was filled"))?;
        Ok(loaded.detections(&output, &letterbox))
    }

    /// Returns the numbers of the classes, for files of boxes.
    pub fn class_numbers(&self) -> ClassNumbers {
        ClassNumbers::of(&self.loaded.settings.classes)
    }

    /// Takes the parameters with the `part` that was made for them, another model or class map.
    fn take(&mut self, parameters: &Parameters, part: Option<Part>) -> Result<(), ParameterError> {
        let parameters = DetectorParameters::from(parameters);
        let (model, map) = match part.map(|part| part.downcast::<Loaded>()) {
            None => (None, None),
            Some(Ok(model)) => (Some(*model), None),
            Some(Err(part)) => {
                (None, Some(*part.downcast().expect("a part of this node is a model or a class map")))
            }
        };
        let now = model.as_ref().unwrap_or(&self.loaded);
        let map: ClassMap = map.unwrap_or_else(|| now.settings.classes.map.clone());
        let again = |name, value: &str| Err(ParameterError::new(name, value, "was not loaded; set it again"));
        // Other parameters may have changed while a part of this change was loaded.
        if !parameters.same_engine(&now.settings.parameters) {
            return again("model", &parameters.model);
        }
        if parameters.class_map != map.file {
            return again("class_map", &parameters.class_map);
        }
        let settings = Settings::new(&parameters, &now.engine.layout, map)?;
        self.change(|loaded| {
            if let Some(model) = model {
                *loaded = model;
            }
            loaded.settings = settings;
        });
        Ok(())
    }

    /// Takes another model or other settings between two frames.
    fn change(&mut self, change: impl FnOnce(&mut Loaded)) {
        let labels = |loaded: &Loaded| {
            let Settings { classes, parameters, .. } = &loaded.settings;
            (loaded.model_file(), classes.labels(), parameters.score_threshold)
        };
        let (before, input) = (labels(&self.loaded), self.loaded.settings.input.clone());
        change(&mut self.loaded);
        if self.loaded.settings.input != input {
            for camera in &mut self.cameras {
                (camera.trust, camera.codes) = Default::default();
            }
        }
        if labels(&self.loaded) != before {
            (self.version, self.labels_due) = (self.version.saturating_add(1), true);
        }
        self.contradiction_reported = false;
    }

    /// Returns the topics that are read now.
    fn reads(&self) -> impl Iterator<Item = Input> {
        reads(&self.cameras, &self.loaded.settings.input, None)
    }

    fn publish_labels(&mut self, header: &Header, cx: &mut Context<'_>) {
        if !std::mem::take(&mut self.labels_due) {
            return;
        }
        let info = VisionInfo {
            header: header.clone(),
            method: self.loaded.model_file(),
            database_location: format!("{}/label_info", cx.node()),
            database_version: self.version,
        };
        let Settings { classes, parameters, .. } = &self.loaded.settings;
        let [vision_info, label_info] = outputs_at(self.cameras.len());
        cx.emit(vision_info, info);
        let (header, class_map) = (header.clone(), classes.labels());
        cx.emit(label_info, LabelInfo { header, class_map, threshold: parameters.score_threshold as f32 });
    }

    /// Finds the objects in an image of `stream` of the camera with this index.
    fn detect(
        &mut self,
        (camera, stream): (usize, &str),
        image: &StampedFrame,
        cx: &mut Context<'_>,
    ) -> Result<(), String> {
        let scale = self.scale((camera, stream), image)?;
        let [boxes_out, annotated_out] = outputs_at(camera);
        let (height, width, _) = image.frame.dim();
        self.cameras[camera].image = Some((height, width));
        let images = self.images();
        let Self { loaded, pre, cameras, .. } = self;
        let size = loaded.size_for((height, width), &images, cx);
        let (frame, letterbox) = cx.stage("pre", || {
            let frame = image.frame.demosaiced();
            pre.fill(&frame, scale.most, size).map(|letterbox| (frame, letterbox))
        })?;
        (cameras[camera].bits, cameras[camera].size) = (scale.bits(), pre.size());
        let tensor = pre.tensor().expect("it was filled");
        let output = cx.stage("infer", || loaded.infer(tensor))?;
        let found = cx.stage("post", || loaded.detections(&output, &letterbox));
        if cx.wanted(annotated_out) {
            let frame = cx.stage("draw", || annotated(&frame, scale, &found))?;
            cx.emit(annotated_out, StampedFrame { header: image.header.clone(), frame });
        }
        let header = &image.header;
        tracing::debug!("{}", line(header.stamp, &found));
        let detections =
            found.iter().map(|detection| Detection2D::from_detection(detection, header)).collect();
        cx.emit(boxes_out, Detection2DArray { header: header.clone(), detections });
        Ok(())
    }

    /// Returns (height, width) of the last image of each camera, as far as they are known, else that of a first run.
    fn images(&self) -> Vec<(usize, usize)> {
        let known: Vec<_> = self.cameras.iter().filter_map(|camera| camera.image).collect();
        if known.is_empty() { vec![FIRST_RUN] } else { known }
    }

    /// Returns what the samples of an image mean, and warns once where that is doubtful.
    fn scale(
        &mut self,
        (camera, stream): (usize, &str),
        image: &StampedFrame,
    ) -> Result<StreamScale, String> {
        let (bits, camera) = (&self.loaded.settings.parameters.bits, &mut self.cameras[camera]);
        let (kind, described) = camera.described.of(stream);
        let sensor = described.and_then(|described| described.nearest(image.header.stamp));
        let of = |bits| StreamScale::of(kind, image.frame.depth(), sensor, bits);
        let scale = of(*bits).ok_or(
            "image has 32-bit float samples, of which no range is known: set `bits` to the sensor's",
        )?;
        if *bits == 0
            && scale.light.is_none()
            && let Some(warning) = camera.codes.note(&image.frame, sensor.map(|sensor| sensor.bits))
        {
            tracing::warn!("{warning}");
        }
        if let (Some(described), Some(sensor)) = (of(0).filter(|described| *described != scale), sensor)
            && described.light.is_some()
            && !std::mem::replace(&mut self.contradiction_reported, true)
        {
            tracing::warn!("the parameter bits {bits} overrides the camera's {} bits", sensor.bits);
        }
        Ok(scale)
    }

    /// Takes a description of the sensor, or the status of a recovered frame; both may lead to another stream.
    fn note(
        &mut self,
        (camera, role, stream): (usize, Role, String),
        info: &DiagnosticArray,
        now_ns: u64,
    ) -> Result<Flow, String> {
        let (camera, wanted) = (&mut self.cameras[camera], &self.loaded.settings.input);
        let before = camera.stream(wanted).to_owned();
        if role == Role::Recovery {
            // A method without a claim is no reason to leave its image.
            camera.trust.note(Recovery::of(info).trusted != Some(false), now_ns);
        } else {
            camera.described.note(&stream, info).map_err(|why| why.to_string())?;
            let sensor = camera.described.of(&camera.image_topic(wanted)).1;
            camera.image = sensor.and_then(SensorHistory::size).or(camera.image);
        }
        let stream = camera.image_topic(wanted);
        if camera.stream(wanted) == before {
            return Ok(Flow::Continue);
        }
        let trust = if camera.trust.falls_back { "not trusted" } else { "trusted" };
        tracing::info!("input: auto reads {stream} from now on: the recovered images are {trust}");
        Ok(Flow::NewInputs)
    }

    /// Returns a value of the cameras: one where it is the same for all that have one.
    fn of_cameras(&self, value: impl Fn(&Camera) -> Option<String>) -> String {
        let values: Vec<String> = self.cameras.iter().filter_map(value).collect();
        match &values[..] {
            [first, others @ ..] if others.iter().all(|other| other == first) => first.clone(),
            _ => values.join(", "),
        }
    }

    fn shown_size(&self) -> String {
        let size = self.loaded.settings.input_size;
        match self.of_cameras(|camera| camera.size.map(|(height, width)| format!("{width}x{height}"))) {
            sizes if matches!(size, InputSize::Auto(_)) && !sizes.is_empty() => format!("auto {sizes}"),
            _ => size.to_string(),
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

/// Returns the topics to read where the parameters ask for `input`: of `stream`, or of that which each camera has chosen.
fn reads<'a>(
    cameras: &'a [Camera],
    input: &'a StreamChoice,
    stream: Option<&'a str>,
) -> impl Iterator<Item = Input> {
    cameras.iter().enumerate().flat_map(move |(at, camera)| {
        let inputs = camera.inputs(input, stream.unwrap_or_else(|| camera.stream(input)));
        inputs.map(move |(role, topic)| (at, role, topic))
    })
}

/// Returns the topics of inputs.
fn topics_of(inputs: impl Iterator<Item = Input>) -> Vec<Topic> {
    inputs.map(|(.., topic)| topic).collect()
}

fn cameras(parameters: &DetectorParameters) -> Vec<Camera> {
    if parameters.cameras.is_empty() {
        return vec![Camera::default()];
    }
    let namespaces = parameters.cameras.iter().cloned();
    namespaces.map(|namespace| Camera { namespace: Some(namespace), ..Camera::default() }).collect()
}

/// Returns the topics that a detector of these parameters reads first, and those that it publishes.
///
/// # Errors
/// [`ParameterError`] of a stream that is no topic.
pub fn topics(parameters: &DetectorParameters) -> Result<(Vec<Topic>, Vec<Topic>), ParameterError> {
    let (input, _) = parameters.streams()?;
    let cameras = cameras(parameters);
    Ok((topics_of(reads(&cameras, &input, None)), outputs_of(&cameras)))
}

/// Returns the topics that a detector of one camera publishes.
pub fn outputs() -> Vec<Topic> {
    outputs_of(&[Camera::default()])
}

fn outputs_of(cameras: &[Camera]) -> Vec<Topic> {
    let of_camera = |camera: &Camera| {
        let own = camera.namespace.as_deref().unwrap_or_default();
        [("detections", MessageKind::Detections), ("annotated", MessageKind::Image)]
            .map(|(name, kind)| Topic::new(format!("~{own}/{name}"), kind))
    };
    let of_model = [("vision_info", MessageKind::VisionInfo), ("label_info", MessageKind::LabelInfo)]
        .map(|(name, kind)| Topic::new(format!("~/{name}"), kind));
    cameras.iter().flat_map(of_camera).chain(of_model).collect()
}

impl Node for Detector {
    fn inputs(&self) -> Vec<Topic> {
        topics_of(self.reads())
    }

    fn inputs_with(&self, next: &Parameters) -> Result<PlannedInputs, ParameterError> {
        let (input, fallback) = DetectorParameters::from(next).streams()?;
        let all = |stream: &str| topics_of(reads(&self.cameras, &input, Some(stream)));
        let first = match &input {
            same if *same == self.loaded.settings.input => self.inputs(),
            StreamChoice::Stream(stream) => all(stream),
            StreamChoice::Auto(_) => all(TRUSTED),
        };
        Ok(PlannedInputs { first, later: all(fallback.as_deref().unwrap_or(SHARP_FALLBACK)) })
    }

    fn outputs(&self) -> Vec<Topic> {
        outputs_of(&self.cameras)
    }

    fn get_ready(&mut self) -> Vec<Topic> {
        let images = self.images();
        self.loaded.warm_up(&images);
        let Settings { input, input_size, .. } = &self.loaded.settings;
        // A fixed size was run when the model was loaded.
        let follows = matches!(input_size, InputSize::Auto(_));
        let is_untold = |(camera, role, _): &Input| {
            let camera = &self.cameras[*camera];
            *role == Role::Sensor && camera.described.of(&camera.image_topic(input)).1.is_none()
        };
        topics_of(self.reads().filter(|input| follows && is_untold(input)))
    }

    fn configure(&mut self, parameters: &Parameters) -> Result<(), ParameterError> {
        self.take(parameters, None)
    }

    fn prepare(&self, now: &Parameters, next: &Parameters) -> Option<Job> {
        let [before, after] = [now, next].map(DetectorParameters::from);
        if !after.same_engine(&before) {
            let (now, next, images) = (now.clone(), next.clone(), self.images());
            return Some(Box::new(move || Ok(Box::new(Loaded::after(&now, &next, &images)?))));
        }
        let names = self.loaded.engine.layout.names.clone();
        (after.class_map != before.class_map)
            .then(|| -> Job { Box::new(move || Ok(Box::new(ClassMap::read(&after.class_map, &names)?))) })
    }

    fn exchange(&mut self, parameters: &Parameters, part: Part) -> Result<(), ParameterError> {
        self.take(parameters, Some(part))
    }

    fn step(&mut self, trigger: Trigger, cx: &mut Context<'_>) -> Result<Flow, StepError> {
        let stream = cx.stream.map(str::to_owned).or_else(|| stream_of(self, &trigger)).unwrap_or_default();
        let (source, message) = match trigger {
            Trigger::Message { input, message } => (self.reads().nth(input), Some(message)),
            Trigger::Tick => (None, None),
        };
        match (source, message) {
            (Some((camera, Role::Image, _)), Some(Message::Image(image))) => {
                self.detect((camera, &stream), &image, cx).map_err(StepError::Skip)?;
                self.publish_labels(&image.header, cx);
                Ok(Flow::Continue)
            }
            (Some((camera, role, _)), Some(Message::Diagnostics(info))) => {
                self.note((camera, role, stream), &info, cx.now_ns()).map_err(StepError::Skip)
            }
            _ => Err(StepError::Skip("the detector only answers images".to_owned())),
        }
    }

    fn state(&self) -> Vec<(&'static str, String)> {
        let Loaded { settings: Settings { parameters, .. }, engine, .. } = &self.loaded;
        let mut state = vec![
            ("engine", engine.name.to_owned()),
            ("engine_from", engine.note.clone()),
            ("device", parameters.device.clone()),
            ("model", self.loaded.model_file()),
            ("model_path", parameters.model.clone()),
            ("input_size", self.shown_size()),
            ("threads", engine.threads.to_string()),
            ("score_threshold", parameters.score_threshold.to_string()),
            ("bits", self.of_cameras(|camera| Some(camera.bits.to_string()))),
            ("input", parameters.input.clone()),
        ];
        let rest = ["max_det", "nms_iou", "classes", "class_map"];
        state.extend(parameters.to_text().into_iter().filter(|(name, _)| rest.contains(name)));
        state
    }

    fn status(&self) -> Vec<(&'static str, String)> {
        let mut status = self.state();
        let input = &self.loaded.settings.input;
        let streams = self.cameras.iter().map(|camera| camera.image_topic(input));
        status.push(("stream", streams.collect::<Vec<_>>().join(", ")));
        status
    }
}
