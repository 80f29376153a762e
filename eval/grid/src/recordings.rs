//! [`Recordings`]: what a run of a launch file is recorded to: a bag, and images with and without boxes.

use std::collections::BTreeMap;
use std::error::Error;
use std::path::{Path, PathBuf};

use modulo_bags::bag::{BagTopic, BagWriter};
use modulo_core::{Detection, Frame};
use modulo_draw::{Picture, RgbImage, distinct, sheet};
use modulo_images::save_png;
use modulo_runtime::lockstep::OnTopic;
use modulo_runtime::sensor::recovery::Recovery;
use modulo_runtime::{Qos, sensor_info};

use crate::messages::{found, image, recovery};
use crate::plan::{CameraPlan, DetectorStream};

/// Why a file could not be written.
type Fault = Box<dyn Error + Send + Sync>;

/// The folder of the images with the boxes of all streams.
pub const BOXES: &str = "boxes";

/// The recordings of an evaluation.
#[derive(Default)]
pub struct Recordings {
    /// The folder of the pictures.
    folder: PathBuf,
    /// The messages on the topics of the plan.
    bag: Option<BagWriter>,
    /// Whether the images that the detectors get are saved as `FOLDER/STREAM/NUMBER.png`, and those with the boxes of all streams in [`BOXES`].
    images: bool,
    /// The topics whose messages go into the bag.
    bagged: Vec<String>,
    /// The last picture of each stream, by the name of the stream.
    shown: BTreeMap<String, Shown>,
    /// The error of the first file that could not be written. Nothing is recorded after it.
    fault: Option<Fault>,
}

/// The last annotated image of a stream.
struct Shown {
    title: String,
    /// `None` where the frame has none.
    picture: Option<Picture>,
    classes: Vec<String>,
}

impl Recordings {
    /// Creates the recordings of an evaluation, with pictures in `folder`. The folders of the `images`, with the names of the streams, must be
    /// in it.
    pub fn new(folder: &Path, bag: Option<(BagWriter, Vec<String>)>, images: bool) -> Self {
        let (bag, bagged) = bag.unzip();
        let bagged = bagged.unwrap_or_default();
        Self { folder: folder.to_owned(), bag, bagged, images, ..Self::default() }
    }

    /// Whether nothing is recorded.
    pub fn is_empty(&self) -> bool {
        self.bag.is_none() && !self.images
    }

    /// Returns the topics whose messages are needed of `cameras`.
    pub fn topics(&self, cameras: &[CameraPlan]) -> Vec<String> {
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
    /// of all are drawn. An error is kept for [`Recordings::finish`]: the scores do not depend on recordings.
    pub(crate) fn add(
        &mut self,
        cameras: &[CameraPlan],
        (camera, number): (&CameraPlan, u64),
        out: &[OnTopic],
        ends_round: bool,
    ) {
        if self.fault.is_none() {
            self.fault = self.write(cameras, (camera, number), out, ends_round).err();
        }
    }

    fn write(
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
        let shown = camera.streams.iter().map(|stream| (stream.name.clone(), Shown::of(stream, out)));
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
    pub(crate) fn end(&mut self, camera: &CameraPlan) {
        for stream in &camera.streams {
            if let Some(shown) = self.shown.get_mut(&stream.name) {
                shown.title = format!("{}: ended", stream.name);
            }
        }
    }

    /// Returns the last annotated images of all streams as one, each below its title; `None` where no stream has one. A stream without an image
    /// has an empty place, so that all sheets have one size.
    fn sheet(&self, cameras: &[CameraPlan]) -> Option<RgbImage> {
        let picture = |DetectorStream { name, .. }: &DetectorStream| match self.shown.get(name) {
            Some(Shown { title, picture: Some(picture), .. }) => (title.clone(), Some(picture.clone())),
            _ => (format!("{name}: no image"), None),
        };
        let pictures: Vec<_> = cameras.iter().flat_map(|camera| &camera.streams).map(picture).collect();
        let classes = self.shown.values().flat_map(|shown| &shown.classes);
        sheet(&pictures, &distinct(classes.map(String::as_str)))
    }

    /// Completes the bag.
    ///
    /// # Errors
    /// The error of the first file that could not be written.
    pub fn finish(self) -> Result<(), Fault> {
        let bag = self.bag.map(BagWriter::finish).transpose().map(drop).map_err(Fault::from);
        self.fault.map_or(Ok(()), Err).and(bag)
    }
}

impl Shown {
    /// What the messages of a frame show of `stream`, with the method that has unwrapped its image and its trust in the title.
    fn of(stream: &DetectorStream, out: &[OnTopic]) -> Self {
        let note = stream.unwrapped.as_ref().and_then(|topics| method_of(out, &topics.recovery));
        let boxes: Vec<Detection> = found(out, &stream.detections).unwrap_or_default();
        Self {
            title: note.map_or_else(|| stream.name.clone(), |note| format!("{}: {note}", stream.name)),
            picture: stream.annotated.as_deref().and_then(|topic| picture(&image(out, topic)?.frame)),
            classes: boxes.into_iter().map(|found| found.class).collect(),
        }
    }
}

/// Returns the method that has unwrapped the image of this frame, and whether it trusts its result.
fn method_of(out: &[OnTopic], topic: &str) -> Option<String> {
    let Recovery { method_used, trusted } = recovery(out, topic)?;
    let trust = match trusted {
        Some(true) => ", trusted",
        Some(false) => ", not trusted",
        None => "",
    };
    Some(format!("{method_used}{trust}"))
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
