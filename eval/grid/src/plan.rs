//! [`Variant`]: the nodes of a launch file with one value of everything that varies; and its [`Cell`]s, the streams that its detectors read.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use std::time::Duration;

use modulo_camera::{CameraParameters, ModuloCamera};
use modulo_core::{Psf, TwoGains};
use modulo_detector::{Detector, DetectorParameters, TRUSTED};
use modulo_runtime::topic::{RECOVERY_TOPIC, addresses};
use modulo_runtime::{
    Address, MessageKind, Node, NodeName, ParameterSet as _, Parameters, SensorModel, Topic, Value,
};
use modulo_unwrap::{UnwrapNode, UnwrapParameters};

use crate::GridError;
use crate::makers::{self, SPUD_AS_PUBLISHED};
use crate::results::{CellKey, Point};

/// Time between two frames of a source that has neither time stamps nor a rate.
const NOMINAL_INTERVAL: Duration = Duration::from_millis(100);

/// The executable of a camera.
pub const CAMERA: &str = "modulo_camera";
/// The executable of an unwrapping node.
pub const UNWRAP: &str = "unwrap";
/// The executable of a detector.
pub const DETECTOR: &str = "detector";

/// A node of a launch file.
#[derive(Clone, Debug, PartialEq)]
pub struct PlannedNode {
    /// Its executable, such as `unwrap`.
    pub executable: &'static str,
    /// Its name.
    pub name: NodeName,
    /// Its parameters.
    pub parameters: Parameters,
}

impl PlannedNode {
    /// Makes the node.
    pub(crate) fn make(&self) -> Result<Box<dyn Node>, GridError> {
        Ok(match self.executable {
            CAMERA => Box::new(ModuloCamera::new(&(&self.parameters).into())?),
            UNWRAP => Box::new(UnwrapNode::new(&(&self.parameters).into())?),
            _ => Box::new(Detector::new(&(&self.parameters).into())?),
        })
    }
}

/// The nodes of a launch file with one value of everything that varies.
#[derive(Clone, Debug, PartialEq)]
pub struct Variant {
    /// The nodes, in the order of the file.
    pub nodes: Vec<PlannedNode>,
    /// The streams that are evaluated; `None` for all that a detector reads.
    pub wanted: Option<Vec<String>>,
}

/// A detector and the image stream that it reads.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct DetectorStream {
    /// Its name: the image topic without the leading slash and with `.` for `/`, its last part `auto` for a detector that selects
    /// its stream by trust, and behind it the name of the detector where several read the topic.
    pub name: String,
    /// Topic of the images.
    pub images: String,
    /// Topic of the boxes.
    pub detections: String,
    /// Topic of the values that the detector uses.
    pub state: String,
    /// Topic of the images with the boxes drawn.
    pub annotated: Option<String>,
    /// Topic of the classes that the detector knows.
    pub labels: Option<String>,
    /// Whether the detector selects its stream by the trust in the frames before.
    pub is_auto: bool,
    /// The places of the nodes that lead to the boxes: the camera, those that its images pass, and the detector.
    pub way: Vec<usize>,
    /// The topics of the unwrapping node on this way, if there is one.
    pub unwrapped: Option<Unwrapped>,
}

/// The topics of an unwrapping node.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Unwrapped {
    /// The recovered image for a detector.
    pub picture: String,
    /// The counts.
    pub counts: String,
    /// What the node says of each image.
    pub recovery: String,
}

/// A camera with the detectors that read its images.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct CameraPlan {
    /// Full name of its node.
    pub name: String,
    /// Place of its node.
    pub member: usize,
    /// Time between two frames of a source without time stamps.
    pub interval: Duration,
    /// The detectors. There is none where only other topics of the camera are of interest.
    pub streams: Vec<DetectorStream>,
}

/// A stream of a variant.
#[derive(Clone, Debug)]
pub struct Cell<'a> {
    /// All that decides its boxes. The frames and the hash of the model are noted when these are opened.
    pub key: CellKey,
    /// The nodes of its variant.
    pub nodes: &'a [PlannedNode],
    /// Time between two frames of a source without time stamps.
    pub interval: Duration,
    /// The detector.
    pub stream: DetectorStream,
}

impl Cell<'_> {
    /// The node of its camera.
    pub fn camera(&self) -> &PlannedNode {
        &self.nodes[self.stream.way[0]]
    }

    /// The parameters of its camera.
    pub fn sensing(&self) -> CameraParameters {
        (&self.camera().parameters).into()
    }

    /// The parameters of its detector.
    pub fn detecting(&self) -> DetectorParameters {
        let detector = self.stream.way.last().expect("a way ends at a detector");
        (&self.nodes[*detector].parameters).into()
    }

    /// Returns the parameters by which sessions of detectors differ: the model, the input size, the engine and the device.
    pub fn session(&self) -> [String; 4] {
        let DetectorParameters { model, engine, device, input_size, .. } = self.detecting();
        [model, input_size, engine.word().to_owned(), device]
    }

    /// Whether its images depend on the frames before them.
    pub fn follows(&self) -> bool {
        self.stream.images.ends_with("auto_exposed") || self.sensing().exposure
    }
}

/// The topics of a node by what they are for.
struct Ports {
    name: String,
    /// The period of a source of frames.
    period: Option<Duration>,
    images_in: Vec<String>,
    /// The images of input n, where there are several inputs, go out on output n.
    images_out: Vec<String>,
    boxes: Vec<String>,
    unwrapped: Option<Unwrapped>,
    labels: Option<String>,
    /// Whether the node selects its stream by trust.
    is_auto: bool,
    published: Vec<String>,
}

/// The topics that a node reads and writes, and the period of a source.
type Declared = (Vec<Topic>, Vec<Topic>, Option<Duration>);

fn declared(node: &PlannedNode) -> Result<Declared, GridError> {
    Ok(match node.executable {
        CAMERA => {
            let period = CameraParameters::from(&node.parameters).period();
            (Vec::new(), modulo_camera::outputs(), Some(period))
        }
        UNWRAP => (vec![Topic::new("modulo", MessageKind::Image)], modulo_unwrap::outputs(), None),
        DETECTOR => {
            let (inputs, outputs) = modulo_detector::topics(&(&node.parameters).into())?;
            (inputs, outputs, None)
        }
        _ => (Vec::new(), vec![makers::output()], Some(Duration::ZERO)),
    })
}

impl Ports {
    fn of(node: &PlannedNode) -> Result<Self, GridError> {
        let (inputs, outputs, period) = declared(node)?;
        let is_auto =
            node.executable == DETECTOR && DetectorParameters::from(&node.parameters).input == "auto";
        let recovery = outputs.iter().position(|topic| topic.name == RECOVERY_TOPIC);
        let resolved = |topics: &[Topic]| {
            addresses(&node.name, topics).map_err(|why| GridError::Request(why.to_string()))
        };
        let (inputs, outputs) = (resolved(&inputs)?, resolved(&outputs)?);
        let topics = |of: &[Address], kind: MessageKind| -> Vec<String> {
            of.iter().filter(|address| address.kind == kind).map(|address| address.topic.clone()).collect()
        };
        let images_out = topics(&outputs, MessageKind::Image);
        let unwrapped = recovery.map(|place| Unwrapped {
            picture: images_out[0].clone(),
            counts: images_out[1].clone(),
            recovery: outputs[place].topic.clone(),
        });
        Ok(Self {
            name: node.name.fully_qualified(),
            period,
            images_in: topics(&inputs, MessageKind::Image),
            images_out,
            boxes: topics(&outputs, MessageKind::Detections),
            unwrapped,
            labels: topics(&outputs, MessageKind::LabelInfo).pop(),
            is_auto,
            published: outputs.iter().map(|address| address.topic.clone()).collect(),
        })
    }
}

/// Finds the cameras among `nodes` and the detectors of each.
///
/// # Errors
/// [`GridError::Request`] with the reason and its remedy where a detector would get no image, or it is not known from which camera, or
/// no node publishes one of the topics `bagged`.
pub fn cameras(nodes: &[PlannedNode], bagged: &[String]) -> Result<Vec<CameraPlan>, GridError> {
    let ports = nodes.iter().map(Ports::of).collect::<Result<Vec<_>, _>>()?;
    let refuse = |why: String| Err(GridError::Request(why));
    let mut names = BTreeSet::new();
    if let Some(Ports { name, .. }) = ports.iter().find(|node| !names.insert(&node.name)) {
        return refuse(format!(
            "two nodes are called {name}; give each node a name or a namespace of its own"
        ));
    }
    let known: BTreeSet<&String> = ports.iter().flat_map(|node| &node.published).collect();
    if let Some(topic) = bagged.iter().find(|topic| !known.contains(topic)) {
        let known = known.into_iter().map(String::as_str).collect::<Vec<_>>().join(", ");
        return refuse(format!(
            "--topics {topic}: no node of the launch file publishes it; these topics are there: {known}"
        ));
    }
    let camera = |(member, node): (usize, &Ports)| {
        let period = node.period?;
        let interval = if period.is_zero() { NOMINAL_INTERVAL } else { period };
        Some(CameraPlan { name: node.name.clone(), member, interval, streams: Vec::new() })
    };
    let mut cameras: Vec<CameraPlan> = ports.iter().enumerate().filter_map(camera).collect();
    if cameras.is_empty() {
        return refuse("no node of the launch file is a source of frames: a modulo_camera is needed".into());
    }
    for stream in streams(&ports)? {
        let camera = cameras.iter_mut().find(|camera| camera.member == stream.way[0]);
        camera.expect("a stream comes from a source, and each is a camera").streams.push(stream);
    }
    if cameras.iter().all(|camera| camera.streams.is_empty()) {
        return refuse("no node of the launch file turns images into boxes: a detector is needed".into());
    }
    Ok(cameras)
}

/// Returns the stream of every detector.
fn streams(nodes: &[Ports]) -> Result<Vec<DetectorStream>, GridError> {
    let dotted = |topic: &str| topic.trim_start_matches('/').replace('/', ".");
    let mut streams: Vec<(&str, DetectorStream)> = Vec::new();
    // A source answers no image, although it publishes the boxes of its labels.
    for (member, node) in nodes.iter().enumerate().filter(|(_, node)| node.period.is_none()) {
        for (place, (images, detections)) in node.images_in.iter().zip(&node.boxes).enumerate() {
            let mut way = way_to(nodes, (&node.name, images)).map_err(GridError::Request)?;
            let unwrapped = way.iter().find_map(|&member| nodes[member].unwrapped.clone());
            way.push(member);
            let auto = images.strip_suffix(TRUSTED).filter(|_| node.is_auto);
            let name = auto.map_or_else(|| dotted(images), |namespace| dotted(&format!("{namespace}auto")));
            let stream = DetectorStream {
                name,
                images: images.clone(),
                detections: detections.clone(),
                state: format!("{}/state", node.name),
                annotated: node.images_out.get(place).cloned(),
                labels: node.labels.clone(),
                is_auto: node.is_auto,
                way,
                unwrapped,
            };
            streams.push((&node.name, stream));
        }
    }
    let of_topic = |images: &str| streams.iter().filter(|(_, stream)| stream.images == images).count();
    let shared: Vec<bool> = streams.iter().map(|(_, stream)| of_topic(&stream.images) > 1).collect();
    let named = streams.into_iter().zip(shared).map(|((node, mut stream), is_shared)| {
        if is_shared {
            stream.name = format!("{}.{}", stream.name, dotted(node));
        }
        stream
    });
    Ok(named.collect())
}

/// Follows the images on the topic that a node reads back to their camera, and returns the places of the nodes on the way, the camera
/// first.
fn way_to(nodes: &[Ports], (reader, wanted): (&str, &str)) -> Result<Vec<usize>, String> {
    let missing = || {
        format!(
            "{reader} would get no image: no camera of the launch file leads to the topic {wanted}, which it reads"
        )
    };
    let (mut topic, mut way) = (wanted, Vec::new());
    // An image passes a node at most once.
    for _ in nodes {
        let mut makers =
            nodes.iter().enumerate().filter(|(_, node)| node.images_out.iter().any(|t| t == topic));
        let (member, maker) = makers.next().ok_or_else(missing)?;
        if let Some((_, other)) = makers.next() {
            let (first, second) = (&maker.name, &other.name);
            return Err(format!(
                "{first} and {second} both publish {topic}; give each camera with its nodes a namespace of its own"
            ));
        }
        way.insert(0, member);
        if maker.period.is_some() {
            return Ok(way);
        }
        let place = maker.images_out.iter().position(|made| made == topic).expect("it publishes the topic");
        topic = match &maker.images_in[..] {
            [only] => only,
            several => several.get(place).ok_or_else(missing)?,
        };
    }
    Err(missing())
}

/// Returns the cells of `variants`: each stream of each, but those that another variant has, too.
///
/// # Errors
/// That of [`cameras`], and [`GridError::Request`] of a wanted stream that no detector reads.
pub fn cells(variants: &[Variant]) -> Result<Vec<Cell<'_>>, GridError> {
    let mut cells: Vec<Cell<'_>> = Vec::new();
    for Variant { nodes, wanted } in variants {
        let cameras = cameras(nodes, &[])?;
        let names: Vec<&str> =
            cameras.iter().flat_map(|camera| &camera.streams).map(|stream| stream.name.as_str()).collect();
        if let Some(unknown) = wanted.iter().flatten().find(|wanted| !names.contains(&wanted.as_str())) {
            return Err(GridError::value("stream", unknown, format!("one of {}", names.join(", "))));
        }
        for CameraPlan { interval, streams, .. } in cameras {
            for stream in streams {
                if wanted.as_ref().is_some_and(|wanted| !wanted.contains(&stream.name)) {
                    continue;
                }
                let key = CellKey { point: point(nodes, &stream), ..CellKey::default() };
                let cell = Cell { key, nodes, interval, stream };
                let Some(other) = cells.iter().find(|other| other.key == cell.key) else {
                    cells.push(cell);
                    continue;
                };
                let [own, other] = [&cell, other].map(|cell| source(cell.camera()));
                if own != other {
                    return Err(GridError::Request(format!(
                        "{} varies between {other} and {own}, whose cells cannot be told apart; give each --source, or evaluate them \
                         into folders of their own",
                        cell.stream.name
                    )));
                }
            }
        }
    }
    cells.sort_by(|a, b| a.key.point.order(&b.key.point));
    Ok(cells)
}

/// The parameters of a camera that say which frames it takes, as one text.
fn source(camera: &PlannedNode) -> String {
    let values = ["source", "source_topic", "frames", "loop"]
        .map(|name| camera.parameters.get(name).map(Value::plain));
    values.into_iter().flatten().filter(|value| !value.is_empty()).collect::<Vec<_>>().join(" ")
}

/// Parameters that decide no box: those of times, and the lowest score, which is that of the stored boxes.
pub const WITHOUT_EFFECT: [&str; 4] = ["rate", "frame_id", "threads", "score_threshold"];
/// Parameters that a point has as fields of its own, or that say which frames there are.
const UNNAMED: [&str; 10] = [
    "source",
    "source_topic",
    "loop",
    "frames",
    "method",
    "deblur",
    "model",
    "input",
    "input_size",
    "cameras",
];

/// Returns all that decides the boxes of a stream. What has no effect on it has its default.
fn point(nodes: &[PlannedNode], stream: &DetectorStream) -> Point {
    let on_way = || stream.way.iter().map(|&member| &nodes[member]);
    let of = |executable: &str| on_way().find(|node| node.executable == executable);
    let camera = CameraParameters::from(&nodes[stream.way[0]].parameters);
    let detector = of(DETECTOR).map(|node| DetectorParameters::from(&node.parameters)).unwrap_or_default();
    let unwrap = of(UNWRAP).map(|node| UnwrapParameters::from(&node.parameters));
    let sensor = sensor_of(&camera.sensor, stream);
    let kind = stream.images.rsplit('/').next().unwrap_or_default();
    let method = match &unwrap {
        // The gains have a method of their own, which the node takes whatever the parameter.
        _ if sensor.gains && (unwrap.is_some() || kind == "saturated") => Some(TwoGains::NAME.to_owned()),
        Some(_) => of(UNWRAP).and_then(|node| Some(node.parameters.get("method")?.plain())),
        None => of(SPUD_AS_PUBLISHED).map(|_| SPUD_AS_PUBLISHED.to_owned()),
    };
    Point {
        stream: stream.name.clone(),
        method,
        deblur: unwrap.is_some_and(|unwrap| unwrap.deblur) && sensor.psf() != Psf::None,
        sensor,
        model: model_name(Path::new(&detector.model)),
        input: detector.input_size,
        more: on_way().flat_map(unnamed).collect(),
    }
}

/// The parameters of a sensor that have an effect on a stream.
fn sensor_of(sensor: &SensorModel, stream: &DetectorStream) -> SensorModel {
    match stream.images.rsplit('/').next().unwrap_or_default() {
        "auto_exposed" => sensor.clone(),
        "metered" => sensor.reset(&SensorModel::FOLLOWING),
        // Two gains are those of codes, and no matter of the exposure itself.
        "ideal" => sensor.reset(&SensorModel::EXPOSURE_CONTROL).reset(&["gains", "gain_ratio"]),
        _ => sensor.reset(&SensorModel::EXPOSURE_CONTROL),
    }
}

/// The parameters of a node that differ from their defaults, decide its images or boxes, and have no field in a point.
fn unnamed(node: &PlannedNode) -> BTreeMap<String, String> {
    let (own, executable) = match node.executable {
        CAMERA | SPUD_AS_PUBLISHED => (CameraParameters::descriptors(), CAMERA),
        UNWRAP => (UnwrapParameters::descriptors(), UNWRAP),
        DETECTOR => (DetectorParameters::descriptors(), DETECTOR),
        _ => (Vec::new(), ""),
    };
    let of_sensor = SensorModel::descriptors();
    let is_field = |name: &str| {
        UNNAMED.contains(&name)
            || WITHOUT_EFFECT.contains(&name)
            || executable == CAMERA && of_sensor.iter().any(|parameter| parameter.name == name)
    };
    let differing = own.into_iter().filter(|parameter| !is_field(parameter.name)).filter_map(|parameter| {
        let value = node.parameters.get(parameter.name).filter(|value| **value != parameter.default)?;
        Some((format!("{executable}.{}", parameter.name), value.plain()))
    });
    differing.collect()
}

/// The name of a model in cells: its file name without extension.
pub fn model_name(model: &Path) -> String {
    model.file_stem().unwrap_or(model.as_os_str()).to_string_lossy().into_owned()
}
