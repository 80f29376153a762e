//! The `modulo_camera` node: a simulated modulo sensor over any source of frames (images, a video, KITTI, a bag, a scene, a live
//! camera, or an image topic of a running stack).
//!
//! One exposure gives the modulo, the saturated and the ideal stream, and a second one that of a normal camera with automatic exposure; each
//! is made only while it has a reader. The node
//! never unwraps and never paces itself: its period is a request to the driver.

mod calibration;
mod exposure;

use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use modulo_bags::source;
use modulo_bags::source::{FRAME_ID, Source, SourceError, SourceFrame, SourceOptions, to_detections};
use modulo_core::sensor::Sensor;
use modulo_core::{AutoExposure, Frame};
use modulo_images::{Coding, White};
use modulo_msgs::diagnostic_msgs::DiagnosticArray;
use modulo_msgs::std_msgs::{Header, Time};
use modulo_runtime::name::NameError;
use modulo_runtime::parameter::file as parameter_file;
use modulo_runtime::ros_args::ArgsError;
use modulo_runtime::secret::without_secrets;
use modulo_runtime::sensor::recovery::Recovery;
use modulo_runtime::topic::{ImageCompression, RECOVERY_TOPIC, camera_info_topic};
use modulo_runtime::{
    Context, Flow, Job, Message, MessageKind, Node, NodeName, ParameterError, ParameterSet as _, Parameters,
    Part, PlannedInputs, SensorModel, StampedFrame, StepError, StreamKind, SystemClock, Topic, Trigger,
    sensor_info,
};
use modulo_video::{LiveCounts, LiveVideo, VideoAddress};
use ndarray::{Array3, Axis};

use calibration::Calibration;
use exposure::TrustedExposure;

/// Output indices, in the order of [`Node::outputs`].
const MODULO: usize = 0;
const SATURATED: usize = 1;
const IDEAL: usize = 2;
const GROUND_TRUTH: usize = 3;
const SENSOR_INFO: usize = 4;
const CAMERA_INFO: usize = 5;
const AUTO_EXPOSED: usize = 6;

/// The images that the description of the sensor covers.
const STREAMS: [(usize, StreamKind); 4] = [
    (MODULO, StreamKind::Modulo),
    (SATURATED, StreamKind::Saturated),
    (IDEAL, StreamKind::Ideal),
    (AUTO_EXPOSED, StreamKind::AutoExposed),
];

/// A step waits this long for a frame of a live camera. Between two steps the node answers requests.
const LIVE_PATIENCE: Duration = Duration::from_millis(100);
/// Least period of a live camera: with a period of zero, its readers would set its pace.
const LIVE_PERIOD: Duration = Duration::from_millis(1);

/// The camera as a node.
pub struct ModuloCamera {
    input: CameraInput,
    /// That of the source.
    calibration: Calibration,
    sensor: Sensor,
    /// The normal camera beside it.
    auto_exposure: AutoExposure,
    /// The sensor of the next frame, which is described to the nodes that read it: that of the parameters, but for its exposure.
    model: SensorModel,
    /// The largest alpha up to which this sensor is fit.
    fit: Option<f64>,
    control: Option<TrustedExposure>,
    parameters: CameraParameters,
    /// Frames taken from this source since the launch, those that could not be read included.
    frames_read: u64,
    /// Frames sensed in this life of the node.
    sensed: u64,
}

impl ModuloCamera {
    /// Opens the source and prepares the sensor.
    ///
    /// # Errors
    /// [`ParameterError`] with the parameter that is not possible, such as a `source` that is not there.
    pub fn new(parameters: &CameraParameters) -> Result<Self, ParameterError> {
        Self::with(CameraInput::open(parameters)?, parameters)
    }

    /// Creates a camera over frames that others have opened; the parameter `source` is not looked at.
    ///
    /// # Errors
    /// [`ParameterError`] with the parameter that is not possible.
    pub fn over(
        frames: impl source::ReadFrames + 'static,
        parameters: &CameraParameters,
    ) -> Result<Self, ParameterError> {
        Self::with(CameraInput::of(Source::over(frames), parameters.r#loop), parameters)
    }

    fn with(input: CameraInput, parameters: &CameraParameters) -> Result<Self, ParameterError> {
        parameters.check()?;
        let control = parameters.control();
        let model = parameters.model(control.as_ref());
        Ok(Self {
            calibration: input.calibration(),
            input,
            sensor: model.simulated()?,
            fit: model.fit_up_to(),
            model,
            control,
            auto_exposure: parameters.sensor.auto_exposure()?,
            parameters: parameters.clone(),
            frames_read: 0,
            sensed: 0,
        })
    }

    /// Takes `parameters`, and another source from its first frame on.
    fn take(
        &mut self,
        parameters: CameraParameters,
        input: Option<CameraInput>,
    ) -> Result<(), ParameterError> {
        // The only steps that can fail come first, so that a set that is refused changes nothing.
        // The control goes on, unless alpha was set.
        let goes_on = parameters.sensor.alpha == self.parameters.sensor.alpha;
        let control = if goes_on { self.control.clone() } else { parameters.control() };
        let model = parameters.model(control.as_ref());
        let (sensor, mut auto_exposure) = (model.simulated()?, parameters.sensor.auto_exposure()?);
        match input {
            Some(input) => {
                self.calibration = input.calibration();
                (self.input, self.frames_read) = (input, 0);
            }
            None => auto_exposure.go_on_from(&self.auto_exposure),
        }
        (self.sensor, self.auto_exposure) = (sensor, auto_exposure);
        (self.fit, self.model, self.control) = (model.fit_up_to(), model, control);
        self.parameters = parameters;
        Ok(())
    }

    /// Returns whether as many frames were taken as were asked for.
    fn is_over(&self) -> bool {
        self.parameters.frames > 0 && self.frames_read >= self.parameters.frames.unsigned_abs()
    }

    fn next_frame(&mut self) -> Result<Option<SourceFrame>, StepError> {
        if self.is_over() {
            return Ok(None);
        }
        let CameraInput::Frames(reader) = &mut self.input else { return Ok(None) };
        // Reported before the first frame, so that no limit hides it; it is no frame, so it has no number.
        if let Some(why) = reader.source.losses.pop() {
            return Err(StepError::Skip(why));
        }
        let frame = reader.next_frame();
        // A frame that cannot be read is taken as well: after a crash it must not be tried again.
        self.frames_read += u64::from(!matches!(frame, Ok(None) | Err(StepError::Fatal(_))));
        frame
    }

    /// Exposes to the frame that was taken last and sends the streams that are wanted. Noise is seeded by its number, so that a
    /// frame looks the same whatever came before it.
    fn sense(&mut self, radiance: &Array3<f32>, header: &Header, cx: &mut Context<'_>) -> Result<(), String> {
        // All seeds are allowed, so their sum with the number may pass the end of the range.
        let seed = self.parameters.seed.unsigned_abs().wrapping_add(self.frames_read - 1);
        self.sensed += 1;
        if let Some(control) = &mut self.control {
            control.exposed(header.stamp);
        }
        self.describe(radiance, header, cx);
        if !self.calibration.is_on_topic_of(cx.node()) && cx.wanted(CAMERA_INFO) {
            let side = |axis| u32::try_from(radiance.len_of(Axis(axis))).unwrap_or(u32::MAX);
            let info = self.calibration.of((side(0), side(1)), header);
            cx.emit(CAMERA_INFO, info);
        }
        let (sensor, normal, view) = (&self.sensor, &mut self.auto_exposure, radiance.view());
        if [MODULO, SATURATED, IDEAL].iter().any(|&output| cx.wanted(output)) {
            let exposure = cx.stage("sense", || sensor.expose(view, seed)).map_err(|why| why.to_string())?;
            send(cx, header, MODULO, || exposure.modulo());
            send(cx, header, SATURATED, || exposure.saturated());
            send(cx, header, IDEAL, || exposure.ideal());
        }
        if cx.wanted(AUTO_EXPOSED) {
            let image =
                cx.stage("auto_expose", || normal.expose(view, seed)).map_err(|why| why.to_string())?;
            send(cx, header, AUTO_EXPOSED, || image);
        }
        Ok(())
    }

    /// Sends the description of the sensor before the frame that it describes, also when there is no reader now: late ones get it.
    fn describe(&self, radiance: &Array3<f32>, header: &Header, cx: &mut Context<'_>) {
        let (height, width, channels) = radiance.dim();
        let sensor = self.model.of_channels(channels);
        cx.emit(SENSOR_INFO, sensor_info::message_of((header, (height, width)), &sensor, cx, &STREAMS));
    }

    /// Follows the trust of the unwrapper in a frame.
    fn follow(&mut self, recovery: &DiagnosticArray) -> Result<(), StepError> {
        let Some(control) = &mut self.control else { return Ok(()) };
        // A method that makes no claim trusts nothing.
        if control.note(recovery.header.stamp, Recovery::of(recovery).trusted == Some(true)) {
            let model = self.parameters.model(Some(control));
            self.sensor = model.simulated().map_err(|why| StepError::Fatal(why.to_string()))?;
            (self.fit, self.model) = (model.fit_up_to(), model);
        }
        Ok(())
    }

    /// Returns the header of a frame of `stamp`, which its source has taken in the coordinate frame `frame_id`.
    fn header(&self, stamp: Time, frame_id: &str) -> Header {
        let own = &self.parameters.frame_id;
        Header { stamp, frame_id: if own.is_empty() { frame_id } else { own }.to_owned() }
    }

    fn publish(&mut self, frame: &SourceFrame, cx: &mut Context<'_>) -> Result<(), StepError> {
        // Recorded frames keep their stamps; images of a folder have none.
        let stamp = Time::from_ns(frame.stamp_ns.unwrap_or_else(|| cx.now_ns()));
        let header = self.header(stamp, &frame.frame_id);
        // Published before the images: an evaluation of a frame has its ground truth by then.
        if let Some(truth) = frame.ground_truth.as_deref().filter(|_| cx.wanted(GROUND_TRUTH)) {
            cx.emit(GROUND_TRUTH, to_detections(truth, &header));
        }
        let radiance = frame.radiance_for(&self.model).map_err(|why| why.to_string());
        let sensed = radiance.and_then(|radiance| self.sense(&radiance, &header, cx));
        let CameraInput::Frames(reader) = &mut self.input else { return Ok(()) };
        sensed.map_err(|why| reader.refuse(format!("frame {}: {why}", frame.name)))?;
        reader.given = true;
        Ok(())
    }

    /// Sends the newest frame of a live camera, if there is a new one.
    fn step_live(&mut self, cx: &mut Context<'_>) -> Result<(), StepError> {
        let CameraInput::Live(video, coding) = &self.input else { return Ok(()) };
        let Some(live) = video.newest(LIVE_PATIENCE) else { return Ok(()) };
        let live = live.map_err(|why| StepError::Skip(why.to_string()))?;
        self.frames_read += 1;
        let radiance = live.pixels.radiance(coding, self.frames_read).map_err(|why| why.to_string());
        let header = self.header(Time::from_ns(live.stamp_ns), FRAME_ID);
        let sensed = radiance.and_then(|radiance| self.sense(&radiance, &header, cx));
        sensed.map_err(StepError::Skip)
    }
}

/// Sends an image, which is not even computed for an output without a reader.
fn send(cx: &mut Context<'_>, header: &Header, output: usize, frame: impl FnOnce() -> Frame) {
    if cx.wanted(output) {
        cx.emit(output, StampedFrame { header: header.clone(), frame: frame() });
    }
}

/// Returns the topics that a camera publishes.
pub fn outputs() -> Vec<Topic> {
    vec![
        // Any change of a value destroys its wraps.
        Topic { compression: ImageCompression::Lossless, ..Topic::new("modulo", MessageKind::Image) },
        Topic::new("saturated", MessageKind::Image),
        Topic::new("ideal", MessageKind::Image),
        Topic::new("ground_truth", MessageKind::Detections),
        sensor_info::topic(),
        Topic::new("camera_info", MessageKind::CameraInfo),
        Topic::new("auto_exposed", MessageKind::Image),
    ]
}

impl Node for ModuloCamera {
    fn inputs(&self) -> Vec<Topic> {
        let mut topics = match &self.input {
            CameraInput::Topic { name, .. } => calibration::topics(name),
            CameraInput::Frames(_) | CameraInput::Live(..) => Vec::new(),
        };
        topics.extend(self.parameters.feedback());
        topics
    }

    fn inputs_with(&self, next: &Parameters) -> Result<PlannedInputs, ParameterError> {
        let next = CameraParameters::from(next);
        if next.source == self.parameters.source {
            return Ok(PlannedInputs { first: self.inputs(), later: Vec::new() });
        }
        let topics = topic_of(&next.source)?.map(calibration::topics);
        let first = [topics.unwrap_or_default(), next.feedback().into_iter().collect()].concat();
        Ok(PlannedInputs { first, later: Vec::new() })
    }

    fn outputs(&self) -> Vec<Topic> {
        outputs()
    }

    fn period(&self) -> Option<Duration> {
        match self.input {
            CameraInput::Topic { .. } => None,
            CameraInput::Frames(_) => Some(self.parameters.period()),
            CameraInput::Live(..) => Some(self.parameters.period().max(LIVE_PERIOD)),
        }
    }

    fn position(&self) -> Option<u64> {
        (!matches!(self.input, CameraInput::Topic { .. })).then_some(self.frames_read)
    }

    fn resume(&mut self, position: u64) {
        match &mut self.input {
            CameraInput::Frames(reader) => reader.skip(position),
            CameraInput::Live(..) => {}
            CameraInput::Topic { .. } => return,
        }
        self.frames_read = position;
    }

    fn introduce(&mut self, cx: &mut Context<'_>) {
        if self.is_over() {
            return;
        }
        let CameraInput::Frames(reader) = &mut self.input else { return };
        reader.ahead = reader.ahead.take().or_else(|| Some(reader.source.next()));
        let CameraInput::Frames(reader) = &self.input else { return };
        let Some(Some(Ok(frame))) = &reader.ahead else { return };
        // Images of a folder get their stamp when they are sent.
        let header = self.header(Time::from_ns(frame.stamp_ns.unwrap_or(0)), &frame.frame_id);
        self.describe(&frame.radiance, &header, cx);
    }

    fn configure(&mut self, parameters: &Parameters) -> Result<(), ParameterError> {
        let parameters = CameraParameters::from(parameters);
        if parameters.source != self.parameters.source {
            return Err(not_opened(&parameters.source));
        }
        self.take(parameters, None)
    }

    fn prepare(&self, now: &Parameters, next: &Parameters) -> Option<Job> {
        let [now, next] = [now, next].map(CameraParameters::from);
        // A folder of many images or a long bag takes long to open.
        (next.source != now.source).then(|| -> Job {
            Box::new(move || Ok(Box::new((next.source.clone(), CameraInput::open(&next)?))))
        })
    }

    fn exchange(&mut self, parameters: &Parameters, part: Part) -> Result<(), ParameterError> {
        let typed = CameraParameters::from(parameters);
        match part.downcast::<(String, CameraInput)>() {
            Ok(opened) if opened.0 == typed.source => self.take(typed, Some(opened.1)),
            _ => Err(not_opened(&typed.source)),
        }
    }

    fn step(&mut self, trigger: Trigger, cx: &mut Context<'_>) -> Result<Flow, StepError> {
        match trigger {
            Trigger::Tick if matches!(self.input, CameraInput::Live(..)) => self.step_live(cx)?,
            Trigger::Tick => {
                let Some(frame) = self.next_frame()? else { return Ok(Flow::Done) };
                self.publish(&frame, cx)?;
            }
            Trigger::Message { message: Message::Image(image), .. } => {
                let CameraInput::Topic { white, name } = &mut self.input else { return Ok(Flow::Continue) };
                // The scale of float images is kept from message to message, as within a folder.
                let radiance = white.radiance(&image.frame, &name);
                self.frames_read += 1;
                let radiance = radiance.map_err(|why| StepError::Skip(why.to_string()))?;
                let header = self.header(image.header.stamp, &image.header.frame_id);
                self.sense(&radiance, &header, cx).map_err(StepError::Skip)?;
            }
            Trigger::Message { message: Message::CameraInfo(info), .. } => self.calibration.info = Some(info),
            Trigger::Message { message: Message::Diagnostics(recovery), .. } => self.follow(&recovery)?,
            Trigger::Message { .. } => {}
        }
        Ok(if self.is_over() { Flow::Done } else { Flow::Continue })
    }

    fn state(&self) -> Vec<(&'static str, String)> {
        let source = without_secrets(&self.parameters.source).into_owned();
        [vec![("source", source)], self.model.to_text()].concat()
    }

    fn status(&self) -> Vec<(&'static str, String)> {
        let mut status = vec![("role", "source".into()), ("frames", self.sensed.to_string())];
        status.extend(self.auto_exposure.exposure().map(|exposure| ("auto_exposure", exposure.to_string())));
        status.extend(self.control.as_ref().map(|control| ("alpha", control.alpha.to_string())));
        status.extend(self.fit.map(|fit| ("fit_up_to_alpha", fit.to_string())));
        if let CameraInput::Live(video, _) = &self.input {
            let LiveCounts { arrived, replaced, connections } = video.counts();
            let counts = format!("{arrived} frames arrived, {replaced} replaced, {connections} connections");
            status.push(("live", counts));
        }
        status
    }
}

/// Returns the name of the topic that `source` stands for; `None` for frames that are read.
fn topic_of(source: &str) -> Result<Option<&str>, ParameterError> {
    let Some(name) = source.strip_prefix("topic:") else { return Ok(None) };
    let refuse = |why: NameError| {
        ParameterError::new("source", source, format!("{why}; write it as in topic:/camera/image_raw"))
    };
    NodeName::default().resolve(name).map_err(refuse)?;
    Ok(Some(name))
}

fn not_opened(source: &str) -> ParameterError {
    ParameterError::new("source", source, "was not opened; set it again")
}

/// A source of frames, or a topic that brings them.
enum CameraInput {
    /// Read frame by frame.
    Frames(Box<FrameReader>),
    /// A camera whose newest frame is taken.
    Live(LiveVideo, Coding),
    /// Brought by a topic.
    Topic {
        /// Name of the topic.
        name: String,
        /// The scale of its float images.
        white: White,
    },
}

/// A source that is read once or again and again.
struct FrameReader {
    source: Source,
    /// The next answer of the source, if it was asked for it before the frame was due.
    ahead: Option<Option<Result<SourceFrame, SourceError>>>,
    repeat: bool,
    /// Whether a frame of this round was good.
    given: bool,
    /// The fault of the last bad frame.
    bad: Option<String>,
}

impl CameraInput {
    /// Returns the frames of `source` from its first one on; after its last one it is over, or starts again.
    fn of(source: Source, repeat: bool) -> Self {
        Self::Frames(Box::new(FrameReader { source, ahead: None, repeat, given: false, bad: None }))
    }

    fn open(parameters: &CameraParameters) -> Result<Self, ParameterError> {
        let (spec, coding) = (&parameters.source, parameters.coding()?);
        let refuse = |why: String| ParameterError::new("source", spec, why);
        if let Some(name) = topic_of(spec)? {
            let white = White::new(coding).map_err(|why| refuse(why.to_string()))?;
            return Ok(Self::Topic { name: name.to_owned(), white });
        }
        if let Ok(Some(VideoAddress::Live(address))) = VideoAddress::of(spec) {
            let video = LiveVideo::open(address, Arc::new(SystemClock::default()));
            return Ok(Self::Live(video.map_err(|why| refuse(why.to_string()))?, coding));
        }
        let topic = Some(parameters.source_topic.clone()).filter(|t| !t.is_empty());
        let options = SourceOptions { coding, topic };
        let source = source::open(spec, &options).map_err(|why| refuse(why.to_string()))?;
        source.warnings.iter().for_each(|warning| tracing::warn!("{warning}"));
        Ok(Self::of(source, parameters.r#loop))
    }

    /// Returns the calibration of the camera that has taken the images.
    fn calibration(&self) -> Calibration {
        let (topic, info) = match self {
            Self::Frames(reader) => (None, reader.source.camera_info.clone()),
            Self::Live(..) => (None, None),
            Self::Topic { name, .. } => (Some(camera_info_topic(name)), None),
        };
        Calibration { topic, info, ..Calibration::default() }
    }
}

impl FrameReader {
    /// Returns the next frame; `None` at the end.
    ///
    /// # Errors
    /// [`StepError::Skip`] for a frame that cannot be read, [`StepError::Fatal`] when the source is over and its only frame was not
    /// good, and when it is to start again, but no frame of it was good.
    fn next_frame(&mut self) -> Result<Option<SourceFrame>, StepError> {
        let mut next = self.ahead.take().unwrap_or_else(|| self.source.next());
        if next.is_none() {
            // A source without a single good frame would repeat its errors without end.
            let is_vain = !self.given && (self.repeat || self.source.len == Some(1));
            if let Some(why) = self.bad.take().filter(|_| is_vain) {
                return Err(StepError::Fatal(format!("no frame of the source is good: {why}")));
            }
            if self.repeat {
                self.source.rewind();
                self.given = false;
                next = self.source.next();
            }
        }
        next.transpose().map_err(|why| self.refuse(why.to_string()))
    }

    /// Notes the fault of the last frame, and returns the error that skips it.
    fn refuse(&mut self, why: String) -> StepError {
        self.bad = Some(why.clone());
        StepError::Skip(why)
    }

    /// Resumes after the first `frames` frames, good and bad ones, of all rounds.
    fn skip(&mut self, frames: u64) {
        // The position counts on over all rounds of a loop, so only its rest lies in this round.
        let round = self.source.len.map(|frames| frames as u64).filter(|frames| self.repeat && *frames > 0);
        let mut rest = frames;
        if let Some(round) = round.filter(|round| frames >= *round) {
            // Any frame of the rounds before may have decided how this one is read.
            self.source.pass(round);
            self.source.rewind();
            rest = frames % round;
        }
        self.source.pass(rest);
        // An earlier life has sent frames, so the source is not without a good one.
        self.given = frames > 0;
    }
}

modulo_runtime::parameters! {
    /// The parameters of the `modulo_camera` node.
    pub struct CameraParameters {
        /// Source of the frames: a folder of images (png, jpg, tif, exr, hdr), one image, a video (mp4, mkv, avi, mov, webm, or video:PATH), a
        /// KITTI folder, a bag, scene://NAME, a spike recording (PATH.npz?window=N), rtsp://, http:// or https:// with a stream, /dev/videoN, or
        /// topic:NAME for an Image topic of a running stack. Another source starts with its first frame.
        source: String = String::new(),
        /// The image topic to read from a source that is a bag. Empty: the only image topic of the bag.
        source_topic: String = String::new(); fixed,
        /// Value that becomes full scale, for EXR, HDR and 16-bit images. 0: the 99.9th percentile of the first EXR or
        /// HDR image, and 65536 for 16-bit images.
        white: f64 = 0.0 => 0.0..=1e12; fixed,
        /// Value without light (the black level) in the images of a source, whose radiance is 0.
        black: f64 = 0.0 => 0.0..=1e12; fixed,
        /// Knee points of the companded codes of raw images, CODE:VALUE with rising codes and linear values, as data sheets list them,
        /// such as 1023:1023, 2559:4095, 3455:32767, 3967:65535. The last value is full scale. Empty: transfer says what codes mean.
        knees: String = String::new(); fixed,
        /// Seed of the noise.
        seed: i64 = 0 => 0..=i64::MAX,
        /// Frames per second. 0: the next frame as soon as every reader has taken the last one, and each frame of a live camera.
        rate: f64 = 0.0 => 0.0..=10_000.0,
        /// Starts again at the first frame after the last one.
        r#loop: bool = false; fixed,
        /// Number of frames of the source to send before the node ends. 0: all of them.
        frames: i64 = 0 => 0..=i64::MAX,
        /// Coordinate frame of the images, with the axes of an optical frame of REP 103 (z forward, x right, y down).
        /// Empty: that of the source, and camera_optical for a source without one.
        frame_id: String = String::new(),
        /// Exposure of the modulo sensor. fixed: the saturation factor is alpha. trusted: it starts at alpha and becomes as large, up to
        /// alpha_most, as unwrap trusts the frames (on the topic recovery), so that the sensor collects as much light as can be unwrapped.
        exposure: bool = false => [("fixed", false), ("trusted", true)]; fixed,
        /// Largest saturation factor of exposure: trusted.
        alpha_most: f64 = 8.0 => 1.0..=256.0; fixed,
        ..sensor: SensorModel,
    }
}

impl CameraParameters {
    /// Returns the sensor that the parameter file at `path` describes for a node `/modulo_camera`; all that the file does not set
    /// has its default.
    ///
    /// # Errors
    /// [`ArgsError::File`] of a file that cannot be read, that has no parameter of that node, or one that does not belong to
    /// the chip or the lens, such as `alpha`, and of a value that is not possible.
    pub fn read_sensor(path: &Path) -> Result<SensorModel, ArgsError> {
        let wrong = |why: String| ArgsError::File(path.display().to_string(), why);
        let node_name = NodeName::new("modulo_camera", "/", &[]).expect("a name without a remapping");
        let pairs = parameter_file::read(path, &node_name)?;
        if pairs.is_empty() {
            return Err(wrong("it has no parameter of the node /modulo_camera".to_owned()));
        }
        let of_chip = SensorModel::of_chip();
        if let Some((name, _)) = pairs.iter().find(|(name, _)| !of_chip.contains(&name.as_str())) {
            let possible = of_chip.join(", ");
            let why = format!("'{name}' does not describe the chip or the lens; these do: {possible}");
            return Err(wrong(why));
        }
        SensorModel::from_text(&pairs).map_err(|why| wrong(why.to_string()))
    }

    /// Returns how the samples of the source stand for radiance.
    ///
    /// # Errors
    /// [`ParameterError`] of knee points that are no curve.
    pub fn coding(&self) -> Result<Coding, ParameterError> {
        let Self { white, black, knees, sensor: SensorModel { transfer, mosaic, .. }, .. } = self;
        let knees = Some(knees)
            .filter(|text| !text.is_empty())
            .map(|text| text.parse().map_err(|why: String| ParameterError::new("knees", text, why)));
        let (knees, white, black) = (knees.transpose()?, *white as f32, *black as f32);
        Ok(Coding { white, black, knees, transfer: *transfer, mosaic: *mosaic })
    }

    /// Returns the exposure control, if there is one. Pixels of a given lower gain must not wrap.
    fn control(&self) -> Option<TrustedExposure> {
        let Self { sensor: SensorModel { alpha, gains, gain_ratio, .. }, alpha_most, .. } = *self;
        // A little less, since 1 / (1 / ratio) may be below the ratio.
        let of_gains = gain_ratio.filter(|_| gains).map_or(f64::INFINITY, |ratio| 0.999 / ratio);
        let most = alpha_most.min(of_gains);
        self.exposure.then(|| TrustedExposure::new(alpha, most))
    }

    /// Returns the sensor with the exposure of `control`.
    fn model(&self, control: Option<&TrustedExposure>) -> SensorModel {
        let alpha = control.map_or(self.sensor.alpha, |control| control.alpha);
        SensorModel { alpha, ..self.sensor.clone() }
    }

    /// Returns the topic that an exposure control follows.
    fn feedback(&self) -> Option<Topic> {
        self.exposure.then(|| Topic::new(RECOVERY_TOPIC, MessageKind::Diagnostics))
    }

    /// Returns the time between two frames. Zero: as fast as its readers take them.
    pub fn period(&self) -> Duration {
        if self.rate == 0.0 { Duration::ZERO } else { Duration::from_secs_f64(1.0 / self.rate.max(1e-6)) }
    }
}
