//! [`EvaluationPlan`]: which camera each detector of a launch file reads, so that its boxes are scored against the objects of that
//! camera.

use std::collections::BTreeSet;
use std::time::Duration;

use modulo_detector::TRUSTED;
use modulo_runtime::name::NameError;
use modulo_runtime::topic::{RECOVERY_TOPIC, addresses};
use modulo_runtime::{MessageKind, Node, NodeName};

/// Time between two frames of a source that has neither time stamps nor a rate.
const NOMINAL_INTERVAL: Duration = Duration::from_millis(100);

/// Nodes with their names, in the order of the chain.
pub type NamedNodes = Vec<(Box<dyn Node>, NodeName)>;

/// A detector and the image stream that it reads.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct DetectorStream {
    /// Name of its files: the image topic without the leading slash and with `.` for `/`, its last part `auto` for a detector that selects
    /// its stream by trust, and behind it the name of the detector where several read the topic.
    pub name: String,
    /// Topic of the images.
    pub images: String,
    /// Topic of the boxes.
    pub detections: String,
    /// Topic of the images with the boxes drawn, if the detector publishes them.
    pub annotated: Option<String>,
    /// Topic of what the unwrapper says about each image, if one makes the images.
    pub recovery: Option<String>,
    /// Topic of the classes that the detector knows, if it publishes them.
    pub labels: Option<String>,
}

/// A camera with the detectors that read its images.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct CameraPlan {
    /// Full name of its node.
    pub name: String,
    /// Place of its node in the chain.
    pub member: usize,
    /// Time between two frames of a source without time stamps.
    pub interval: Duration,
    /// Topic of the ground truth.
    pub truth: Option<String>,
    /// The detectors. There is none where only other topics of the camera are of interest.
    pub streams: Vec<DetectorStream>,
}

/// The cameras of an evaluation.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct EvaluationPlan {
    /// The cameras, each with its detectors.
    pub cameras: Vec<CameraPlan>,
    /// Topics that are written into the bag, if there is one.
    pub bagged: Vec<String>,
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
    recovery: Option<String>,
    labels: Option<String>,
    /// Whether the node selects its stream by trust.
    is_auto: bool,
    published: Vec<String>,
}

impl Ports {
    fn of((node, node_name): &(Box<dyn Node>, NodeName)) -> Result<Self, NameError> {
        let (inputs, outputs) =
            (addresses(node_name, &node.inputs())?, addresses(node_name, &node.outputs())?);
        let topics = |of: &[modulo_runtime::Address], kind: MessageKind| -> Vec<String> {
            of.iter().filter(|address| address.kind == kind).map(|address| address.topic.clone()).collect()
        };
        let recovery = node.outputs().iter().position(|topic| topic.name == RECOVERY_TOPIC);
        Ok(Self {
            name: node_name.fully_qualified(),
            period: node.period(),
            images_in: topics(&inputs, MessageKind::Image),
            images_out: topics(&outputs, MessageKind::Image),
            boxes: topics(&outputs, MessageKind::Detections),
            recovery: recovery.map(|place| outputs[place].topic.clone()),
            labels: topics(&outputs, MessageKind::LabelInfo).pop(),
            is_auto: node.state().contains(&("input", "auto".to_owned())),
            published: outputs.iter().map(|address| address.topic.clone()).collect(),
        })
    }
}

impl EvaluationPlan {
    /// Finds the cameras among `nodes` and the detectors of each. Messages on `bagged` go into a bag.
    ///
    /// # Errors
    /// The reason with its remedy where a detector would get no image, or it is not known from which camera.
    pub fn new(nodes: &NamedNodes, bagged: Vec<String>) -> Result<Self, String> {
        let ports =
            nodes.iter().map(Ports::of).collect::<Result<Vec<_>, _>>().map_err(|why| why.to_string())?;
        let mut names = BTreeSet::new();
        if let Some(Ports { name, .. }) = ports.iter().find(|node| !names.insert(&node.name)) {
            return Err(format!(
                "two nodes are called {name}; give each node a name or a namespace of its own"
            ));
        }
        let known: BTreeSet<&String> = ports.iter().flat_map(|node| &node.published).collect();
        if let Some(topic) = bagged.iter().find(|topic| !known.contains(topic)) {
            let known = known.into_iter().map(String::as_str).collect::<Vec<_>>().join(", ");
            return Err(format!(
                "--topics {topic}: no node of the launch file publishes it; these topics are there: {known}"
            ));
        }
        let mut cameras = Vec::new();
        for (member, node) in ports.iter().enumerate() {
            let Some(period) = node.period else { continue };
            cameras.push(CameraPlan {
                name: node.name.clone(),
                member,
                interval: if period.is_zero() { NOMINAL_INTERVAL } else { period },
                truth: node.boxes.first().cloned(),
                streams: Vec::new(),
            });
        }
        if cameras.is_empty() {
            return Err("no node of the launch file is a source of frames: a modulo_camera is needed".into());
        }
        for (member, stream) in streams(&ports)? {
            let camera = cameras.iter_mut().find(|camera| camera.member == member);
            camera.expect("a stream comes from a source, and each is a camera").streams.push(stream);
        }
        if cameras.iter().all(|camera| camera.streams.is_empty()) {
            let why = "no node of the launch file turns images into boxes: a detector is needed";
            return Err(why.to_owned());
        }
        Ok(Self { cameras, bagged })
    }

    /// Returns the detectors of all cameras.
    pub fn streams(&self) -> impl Iterator<Item = &DetectorStream> {
        self.cameras.iter().flat_map(|camera| &camera.streams)
    }
}

/// Returns the stream of every detector, with the place of the camera that it comes from.
fn streams(nodes: &[Ports]) -> Result<Vec<(usize, DetectorStream)>, String> {
    let dotted = |topic: &str| topic.trim_start_matches('/').replace('/', ".");
    let mut streams = Vec::new();
    // A source answers no image, although it publishes the boxes of its labels.
    for node in nodes.iter().filter(|node| node.period.is_none()) {
        for (place, (images, detections)) in node.images_in.iter().zip(&node.boxes).enumerate() {
            let camera = camera_of(nodes, (&node.name, images))?;
            let maker = nodes.iter().find(|other| other.images_out.contains(images));
            let auto = images.strip_suffix(TRUSTED).filter(|_| node.is_auto);
            let name = auto.map_or_else(|| dotted(images), |namespace| dotted(&format!("{namespace}auto")));
            let stream = DetectorStream {
                name,
                images: images.clone(),
                detections: detections.clone(),
                annotated: node.images_out.get(place).cloned(),
                recovery: maker.and_then(|maker| maker.recovery.clone()),
                labels: node.labels.clone(),
            };
            streams.push((camera, &node.name, stream));
        }
    }
    let of_topic = |images: &str| streams.iter().filter(|(.., stream)| stream.images == images).count();
    let shared: Vec<bool> = streams.iter().map(|(.., stream)| of_topic(&stream.images) > 1).collect();
    let named = streams.into_iter().zip(shared).map(|((camera, node, mut stream), is_shared)| {
        if is_shared {
            stream.name = format!("{}.{}", stream.name, dotted(node));
        }
        (camera, stream)
    });
    Ok(named.collect())
}

/// Follows the images on the topic that a node reads back to their camera, and returns its place.
fn camera_of(nodes: &[Ports], (reader, wanted): (&str, &str)) -> Result<usize, String> {
    let missing = || {
        format!(
            "{reader} would get no image: no camera of the launch file leads to the topic {wanted}, which it reads"
        )
    };
    let mut topic = wanted;
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
        if maker.period.is_some() {
            return Ok(member);
        }
        let place = maker.images_out.iter().position(|made| made == topic).expect("it publishes the topic");
        topic = match &maker.images_in[..] {
            [only] => only,
            several => several.get(place).ok_or_else(missing)?,
        };
    }
    Err(missing())
}
