//! [`Recordings`]: what a run of a launch file is recorded to: a bag, and images with and without boxes.

use std::collections::BTreeMap;
use std::error::Error;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};

use clap::Args;
use modulo_bags::bag::{BagTopic, BagWriter, Compression};
use modulo_core::{Detection, Frame};
use modulo_draw::{Picture, RgbImage, distinct, sheet};
use modulo_images::save_png;
use modulo_msgs::std_msgs::Time;
use modulo_runtime::clock::nanos;
use modulo_runtime::lockstep::{Lockstep, OnTopic};
use modulo_runtime::sensor::recovery::Recovery;
use modulo_runtime::{Clock, Qos, sensor_info};

use crate::GridError;
use crate::messages::{found, image, recovery};
use crate::plan::{CameraPlan, DetectorStream, PlannedNode, Variant, cameras};

/// Why a recording could not be made.
type Fault = Box<dyn Error + Send + Sync>;

/// The folder of the images with the boxes of all streams.
pub const BOXES: &str = "boxes";

/// The options of frames that no camera reads.
const LABELLED: [&str; 4] = ["kitti", "sequence", "yolo", "coco"];

/// Recordings for people to look at, from a second run of the nodes with the parameters of the launch file.
#[derive(Args, Clone, Debug)]
pub struct RecordOptions {
    /// New bag folder for the messages on --topics; with FILE
    #[arg(long, value_name = "FOLDER", requires_all = ["topics", "file"], conflicts_with_all = LABELLED)]
    pub bag: Option<PathBuf>,
    /// Topics for --bag
    #[arg(long, value_name = "TOPIC", num_args = 1.., requires = "bag")]
    pub topics: Vec<String>,
    /// Also write every image that a detector gets as PNG, and all streams with their boxes; with FILE
    #[arg(long, requires = "file", conflicts_with_all = LABELLED)]
    pub images: bool,
}

/// The recordings of an evaluation.
#[derive(Default)]
pub struct Recordings {
    /// The folder of the pictures.
    folder: PathBuf,
    bag: Option<BagWriter>,
    /// Whether the images that the detectors get are saved as `FOLDER/STREAM/NUMBER.png`, and those with the boxes of all streams in [`BOXES`].
    images: bool,
    /// The topics whose messages go into the bag.
    bagged: Vec<String>,
    /// The frames that each camera has sent, over all its sources, by its name.
    timelines: BTreeMap<String, Timeline>,
    /// The last picture of each stream, by the name of the stream.
    shown: BTreeMap<String, Shown>,
}

/// Moves the time stamps of several sources so that each frame is later than the one before it.
#[derive(Default)]
struct Timeline {
    frames: u64,
    /// Time stamp of the last frame, ns.
    last: Option<u64>,
    /// Time that is added to the stamps of the current source, ns.
    shift: u64,
}

/// The title of the last image of a stream, the image with its boxes where the frame has one, and their classes.
type Shown = (String, Option<Picture>, Vec<String>);

impl Recordings {
    /// Creates what `options` ask for, with pictures in `folder`; `None` where they ask for nothing.
    ///
    /// # Errors
    /// [`GridError::Request`] of a topic that no node publishes, of a bag that is there, and of several variants.
    pub fn create(
        options: &RecordOptions,
        variants: &[Variant],
        folder: &Path,
    ) -> Result<Option<Self>, GridError> {
        let RecordOptions { bag, topics, images } = options;
        cameras(&variants[0].nodes, topics)?;
        let bag = bag.as_ref().map(|folder| BagWriter::create(folder, Compression::Zstd)).transpose();
        let bag = bag.map_err(|why| GridError::Request(why.to_string()))?;
        if bag.is_none() && !images {
            return Ok(None);
        }
        if variants.len() > 1 {
            let why = "--bag and --images record one variant; give each argument one value";
            return Err(GridError::Request(why.to_owned()));
        }
        Ok(Some(Self {
            folder: folder.to_owned(),
            bag,
            bagged: topics.clone(),
            images: *images,
            ..Self::default()
        }))
    }

    /// Runs the cameras of `nodes` to their ends, and records what they send. After each frame it calls `tell`, which may stop the run.
    ///
    /// # Errors
    /// Why a node fails or a file cannot be written; the frames before stay.
    pub fn record(
        &mut self,
        nodes: &[PlannedNode],
        timer: &dyn Clock,
        tell: &dyn Fn(&Lockstep<'_>) -> ControlFlow<()>,
    ) -> Result<(), Fault> {
        let cameras = cameras(nodes, &[])?;
        let mut chain = Lockstep::new(timer, self.topics(&cameras));
        for node in nodes {
            chain.add(node.make()?, &node.name)?;
        }
        let mut running: Vec<&CameraPlan> = cameras.iter().collect();
        // The time of the chain goes on over all sources, as in one long run. The camera whose frame is due first comes first.
        let due = |timelines: &BTreeMap<String, Timeline>, camera: &CameraPlan| {
            let frames = timelines.get(&camera.name).map_or(0, |timeline| timeline.frames);
            frames.saturating_mul(nanos(camera.interval))
        };
        while let Some(next) = (0..running.len()).min_by_key(|&index| due(&self.timelines, running[index])) {
            let camera = running[next];
            let before = chain.position(camera.member);
            let Some(mut out) = chain.tick(camera.member, due(&self.timelines, camera))? else {
                self.end(running.remove(next));
                continue;
            };
            // A loss that the source tells, such as the cut end of a bag, is no frame and has no number.
            if out.is_empty() && before.is_some() && chain.position(camera.member) == before {
                continue;
            }
            let timeline = self.timelines.entry(camera.name.clone()).or_default();
            let number = timeline.frames;
            timeline.place(&mut out, nanos(camera.interval));
            self.add(&cameras, (camera, number), &out, next + 1 == running.len())?;
            if tell(&chain).is_break() {
                break;
            }
        }
        Ok(())
    }

    /// Returns the topics whose messages are needed of `cameras`.
    fn topics(&self, cameras: &[CameraPlan]) -> Vec<String> {
        let mut topics = self.bagged.clone();
        for stream in cameras.iter().flat_map(|camera| &camera.streams) {
            topics.push(stream.detections.clone());
            // What shows the bag draws boxes on the stream that they were found in.
            topics.extend(self.bagged.contains(&stream.detections).then(|| stream.state.clone()));
            // Boxes are drawn for those who read the picture.
            if self.images {
                topics.push(stream.images.clone());
                topics.extend(stream.annotated.clone());
                topics.extend(stream.unwrapped.as_ref().map(|unwrapped| unwrapped.recovery.clone()));
            }
        }
        topics
    }

    /// Adds frame `number` of `camera`. With the last camera of a round, in which each one has sent a frame, the annotated images
    /// of all are drawn.
    fn add(
        &mut self,
        cameras: &[CameraPlan],
        (camera, number): (&CameraPlan, u64),
        out: &[OnTopic],
        ends_round: bool,
    ) -> Result<(), Fault> {
        if let Some(bag) = &mut self.bag {
            let is_state = |topic: &String| camera.streams.iter().any(|stream| stream.state == *topic);
            record(bag, out.iter().filter(|(topic, _)| self.bagged.contains(topic) || is_state(topic)))?;
        }
        if !self.images {
            return Ok(());
        }
        for stream in &camera.streams {
            if let Some(frame) = image(out, &stream.images) {
                save_png(&self.file(&stream.name, number)?, &frame.frame)?;
            }
        }
        let shown = camera.streams.iter().map(|stream| (stream.name.clone(), shown(stream, out)));
        self.shown.extend(shown);
        if let Some(sheet) = ends_round.then(|| self.sheet(cameras)).flatten() {
            sheet.save(self.file(BOXES, number)?)?;
        }
        Ok(())
    }

    /// The file of a frame in the folder `name`, which is made.
    fn file(&self, name: &str, number: u64) -> Result<PathBuf, Fault> {
        let folder = self.folder.join(name);
        std::fs::create_dir_all(&folder)?;
        Ok(folder.join(format!("{number:06}.png")))
    }

    /// Notes that `camera` has sent its last frame.
    fn end(&mut self, camera: &CameraPlan) {
        for stream in &camera.streams {
            if let Some((title, ..)) = self.shown.get_mut(&stream.name) {
                *title = format!("{}: ended", stream.name);
            }
        }
    }

    /// Returns the last annotated images of all streams as one, each below its title; `None` where no stream has one. A stream without an image
    /// has an empty place, so that all sheets have one size.
    fn sheet(&self, cameras: &[CameraPlan]) -> Option<RgbImage> {
        let picture = |DetectorStream { name, .. }: &DetectorStream| match self.shown.get(name) {
            Some((title, Some(picture), _)) => (title.clone(), Some(picture.clone())),
            _ => (format!("{name}: no image"), None),
        };
        let pictures: Vec<_> = cameras.iter().flat_map(|camera| &camera.streams).map(picture).collect();
        let classes = self.shown.values().flat_map(|(_, _, classes)| classes);
        sheet(&pictures, &distinct(classes.map(String::as_str)))
    }

    /// Completes the bag.
    ///
    /// # Errors
    /// Why it could not be written.
    pub fn finish(self) -> Result<(), Fault> {
        Ok(self.bag.map(BagWriter::finish).transpose().map(drop)?)
    }
}

impl Timeline {
    /// Counts a frame, and moves the stamps of its messages to `interval` ns after the frame before, if they are not later than that
    /// frame. Sources were recorded independently, and a repeated source starts again at its first stamp, but labels and
    /// images are matched by their stamps: no two frames may share a stamp. All later frames of the source are moved by
    /// the same time, so that the intervals within a source do not change.
    fn place(&mut self, out: &mut [OnTopic], interval: u64) {
        self.frames += 1;
        let Some((_, first)) = out.first() else { return };
        // All messages of a frame carry the stamp of its image.
        let stamp = first.stamp().as_ns();
        if let Some(last) = self.last.filter(|last| stamp.saturating_add(self.shift) <= *last) {
            self.shift = last.saturating_add(interval) - stamp;
        }
        self.last = Some(stamp.saturating_add(self.shift));
        if self.shift > 0 {
            for (_, message) in out {
                message.set_stamp(Time::from_ns(message.stamp().as_ns().saturating_add(self.shift)));
            }
        }
    }
}

/// Returns the title, the picture and the classes that the messages of a frame have for `stream`. The title names the method that has
/// unwrapped the image, and its trust.
fn shown(stream: &DetectorStream, out: &[OnTopic]) -> Shown {
    let said = stream.unwrapped.as_ref().and_then(|topics| recovery(out, &topics.recovery));
    let title = match said {
        None => stream.name.clone(),
        Some(Recovery { method_used, trusted }) => {
            let trust = trusted.map_or("", |trusted| if trusted { ", trusted" } else { ", not trusted" });
            format!("{}: {method_used}{trust}", stream.name)
        }
    };
    let picture = stream.annotated.as_deref().and_then(|topic| picture(&image(out, topic)?.frame));
    let boxes: Vec<Detection> = found(out, &stream.detections).unwrap_or_default();
    (title, picture, boxes.into_iter().map(|found| found.class).collect())
}

/// A frame as it is. `None` unless it is 8-bit RGB.
pub(crate) fn picture(frame: &Frame) -> Option<Picture> {
    let pixels = frame.as_u8()?;
    let (height, width, _) = pixels.dim();
    let [width, height] = [width, height].map(|side| u32::try_from(side).ok());
    Picture::new(width?, height?, pixels.iter().copied().collect(), Vec::new()).ok()
}

/// Writes `messages`. Log time and publish time are the stamp of the message.
fn record<'a>(recorder: &mut BagWriter, messages: impl Iterator<Item = &'a OnTopic>) -> Result<(), Fault> {
    for (topic, message) in messages {
        let bytes = message.encode()?;
        // The stamp, and not the wall clock: the same run must give the same bytes.
        let stamp = message.stamp().as_ns();
        let kind = message.kind();
        let is_latched = sensor_info::is_topic(topic) || topic.ends_with("/state");
        let qos = if is_latched { Qos::Latched } else { Qos::usual(kind) };
        let bag_topic = BagTopic::new(topic, kind.type_name(), qos);
        recorder.record(&bag_topic, stamp, stamp, &bytes)?;
    }
    Ok(())
}
