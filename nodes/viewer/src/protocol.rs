//! The messages between the page and the viewer: JSON texts both ways, and images as binary messages of a JSON [`MomentHeader`]
//! behind its length (`u32`, little endian), followed by a JPEG file for each image.

use std::collections::BTreeMap;

use modulo_core::Detection;
use modulo_middleware::parameter::client::{ClientError, ParameterClient};
use modulo_msgs::diagnostic_msgs::DiagnosticStatus;
use modulo_msgs::rcl_interfaces::{ParameterDescriptor, ParameterValue};
use modulo_msgs::vision_msgs::Detection2DArray;
use modulo_runtime::parameter::text::{bare, type_name};
use serde::{Deserialize, Serialize};

/// A message from the page.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum PageRequest {
    /// Show exactly these image topics.
    Watch(Vec<String>),
    /// The last images of these topics have been drawn: the next ones may come.
    Drawn(Vec<String>),
    /// Show the images of one stamp together (true), or the newest one of each topic.
    Together(bool),
    /// Send the samples of these images, by topic and stamp, at column `u` and row `v`, both from 0.
    Pixel { u: usize, v: usize, images: Vec<(String, (i32, u32))> },
    /// Expose a frame anew.
    Expose(ExposeRequest),
    /// Send all parameters of the node with this fully qualified name.
    Parameters(String),
    /// Set a parameter to a value in the notation of YAML.
    Set { node: String, name: String, value: String },
    /// Call a service of the player of a bag.
    Player(PlayerCall),
}

/// A frame that the page has, and the exposure that it is to have.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct ExposeRequest {
    /// The topic of the image that is shown, of a recovered stream.
    pub topic: String,
    /// The topic of the modulo image that has its counts.
    pub modulo: String,
    /// The stamp of both.
    pub stamp: (i32, u32),
    /// How much brighter it is to be than its own exposure.
    pub stops: f64,
    /// The fully qualified name of the detector of its boxes, if there is one.
    pub detector: Option<String>,
}

/// A call of a service of `/rosbag2_player`.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum PlayerCall {
    /// Only report the state.
    State,
    /// Pause, or go on.
    Toggle,
    /// Play the next message while paused.
    Next,
    /// Change the speed; 2 is twice as fast as the recording.
    Rate(f64),
    /// Go on at this time of the bag, in seconds since the epoch; while paused, play so many messages there.
    Seek(f64, u64),
}

/// A message to the page.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Event {
    /// The graph, at the start and when it has changed.
    Graph(GraphView),
    /// The newest status of each name on which one has come since the last message.
    Status(Vec<DiagnosticStatus>),
    /// The news that nodes have told of frames since the last message.
    Notices(Vec<Notice>),
    /// The parameters of a node in the order of their names.
    Parameters { node: String, parameters: Vec<ParameterView> },
    /// The result of [`PageRequest::Set`], with the reason of a refusal.
    Set { node: String, name: String, error: Option<String> },
    /// The state of the player of a bag.
    Player { paused: bool, rate: f64 },
    /// The samples of each of the images that is kept and has the pixel at column `u` and row `v`.
    Pixel { u: usize, v: usize, samples: Vec<PixelView> },
    /// A frame that was exposed anew, or why it cannot be.
    Exposed { of: ExposeRequest, result: Result<ExposedView, String> },
    /// A request that could not be carried out.
    Error(String),
}

/// The part of the graph that the page shows.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct GraphView {
    pub domain: u32,
    /// Image topics that have a publisher, in the order in which they are listed.
    pub images: Vec<String>,
    /// The image topics that are shown as long as the user has chosen none.
    pub first: Vec<String>,
    /// The node that publishes each image topic.
    pub makers: BTreeMap<String, String>,
    /// The camera of each image topic, by the name of its namespace.
    #[serde(skip)]
    pub cameras: BTreeMap<String, String>,
    pub detectors: Vec<DetectorView>,
    /// Topics of labels: boxes of a node that reads no image.
    pub truths: Vec<String>,
    /// All nodes with parameters.
    pub nodes: Vec<String>,
    /// What mixes, as where a suite runs twice in the domain, and which nodes are cut off.
    #[serde(skip)]
    pub warnings: Vec<String>,
    /// The ways that images and boxes take.
    pub links: Vec<LinkView>,
    #[serde(skip)]
    pub statuses: Vec<String>,
    /// Whether a bag is being replayed.
    pub player: bool,
}

/// A topic of boxes and the images that its publisher reads.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct DetectorView {
    pub node: String,
    pub topic: String,
    /// The image topics that it reads now; two while its input changes.
    pub inputs: Vec<String>,
    /// The values of its parameter `input` for which there is an image topic now, and `auto`.
    pub offers: Vec<String>,
}

/// A topic from one node to another one.
#[derive(Clone, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Serialize)]
pub struct LinkView {
    pub from: String,
    pub to: String,
    pub topic: String,
    /// The quality of service of the publisher, such as `best effort, keep 5`.
    pub qos: String,
}

/// The news that a node has told of one frame.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Notice {
    /// When it arrived here, ms since the epoch.
    pub at_ms: f64,
    /// Stamp of the frame, seconds and nanoseconds.
    pub stamp: (i32, u32),
    pub node: String,
    pub step: Step,
}

/// A step of a frame through the suite.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Step {
    /// The camera has described it, which it does right before it sends the images.
    Sensed,
    /// It was unwrapped, and the result is `trusted` or not where the method makes a claim; `message` has the reason.
    Unwrapped { camera: String, trusted: Option<bool>, message: String },
    /// Objects were looked for. `classes` has the number of boxes of each class.
    Detected { classes: BTreeMap<String, usize> },
}

/// A parameter with what a control for it needs.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ParameterView {
    pub name: String,
    /// Name of its type, such as `double`.
    pub r#type: &'static str,
    pub value: String,
    pub description: String,
    /// The default, if the description ends with it, as that of this suite does: `(default 0.25)`.
    pub default: Option<String>,
    /// Whether it can never be set.
    pub read_only: bool,
    /// Smallest and largest value of a number.
    pub range: Option<(f64, f64)>,
    /// The possible values of a string; empty when there are others.
    pub words: Vec<String>,
}

impl ParameterView {
    /// Asks a node for all its parameters, in the order of their names.
    pub fn read_all(client: &ParameterClient<'_>) -> Result<Vec<Self>, ClientError> {
        let names = client.names()?;
        let (values, descriptors) = (client.values(&names)?, client.descriptors(&names)?);
        let views = descriptors.iter().zip(&values).map(|(descriptor, value)| Self::new(descriptor, value));
        let mut parameters: Vec<_> = views.collect();
        parameters.sort_by(|a, b| a.name.cmp(&b.name));
        Ok(parameters)
    }

    pub fn new(descriptor: &ParameterDescriptor, value: &ParameterValue) -> Self {
        let doubles = descriptor.floating_point_range.first().map(|range| (range.from_value, range.to_value));
        let integers =
            descriptor.integer_range.first().map(|range| (range.from_value as f64, range.to_value as f64));
        let words = descriptor.additional_constraints.strip_prefix("one of ");
        let described = descriptor.description.strip_suffix(')');
        let (description, default) = described.and_then(|text| text.rsplit_once(" (default ")).unzip();
        Self {
            name: descriptor.name.clone(),
            r#type: type_name(descriptor.r#type),
            value: bare(value),
            description: description.unwrap_or(&descriptor.description).to_owned(),
            default: default.map(str::to_owned),
            read_only: descriptor.read_only,
            range: doubles.or(integers),
            words: words.map_or_else(Vec::new, |words| words.split(", ").map(str::to_owned).collect()),
        }
    }
}

/// The samples of one image at a pixel.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PixelView {
    pub topic: String,
    /// One sample for each channel, in codes.
    pub samples: Vec<f32>,
    /// The radiance that they stand for, in peaks of the sensor; empty where nobody says.
    pub radiance: Vec<f64>,
}

/// A picture with another exposure, as its own image is encoded.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ExposedView {
    /// A JPEG file in base64.
    pub jpeg: String,
    /// The boxes in this picture; `None` where no detector can look at it.
    pub boxes: Option<Vec<BoxView>>,
    /// Why the model of the detector cannot be used.
    pub why: String,
}

/// The header of a binary message, in front of the JPEG files of its images.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct MomentHeader {
    /// When the message was made, ms since the epoch.
    pub at_ms: f64,
    /// Whether these are all images of a moment of one camera, of one stamp, or single ones of topics that are shown as they come.
    pub together: bool,
    /// The camera of the images, by the name of its namespace.
    pub camera: String,
    /// The images, in the order of their files.
    pub images: Vec<ImageHeader>,
}

/// The facts that the page knows of an image.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ImageHeader {
    pub topic: String,
    /// The word of its [`StreamKind`](modulo_runtime::StreamKind), if it has one.
    pub stream: Option<&'static str>,
    /// Stamp of the image, seconds and nanoseconds.
    pub stamp: (i32, u32),
    /// Width and height in pixels.
    pub width: usize,
    pub height: usize,
    /// Length of its JPEG file in bytes.
    pub bytes: usize,
    /// The radiance of the code 255, in peaks of the sensor, of a file with sRGB's codes of radiance; `None` for any other image.
    pub peaks: Option<f64>,
    /// The share of the samples in each half stop of radiance from 8 stops below the peak on; empty for any other image.
    pub stops: Vec<f32>,
    /// The boxes of this very image, by the topic of the detector.
    pub boxes: Vec<(String, Vec<BoxView>)>,
    /// The labels of its frame.
    pub truth: Vec<BoxView>,
}

/// A box in pixels of the image.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct BoxView {
    /// Left, top, right and bottom edge.
    pub edges: [f32; 4],
    pub class: String,
    /// Score in 0 to 1.
    pub score: f32,
}

impl BoxView {
    /// Returns the boxes of `array`; those that are rotated or not finite are left out.
    pub fn of(array: &Detection2DArray) -> Vec<Self> {
        array.detections.iter().filter_map(|detection| detection.to_detection()).map(Self::from).collect()
    }
}

impl From<Detection> for BoxView {
    fn from(Detection { bbox, class, score }: Detection) -> Self {
        Self { edges: [bbox.x1, bbox.y1, bbox.x2, bbox.y2], class, score }
    }
}
