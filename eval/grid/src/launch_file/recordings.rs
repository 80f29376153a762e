//! [`Recordings`]: what an evaluation writes while it runs: a bag, images, and a video of the boxes.

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
use ndarray::Array3;

use super::file_name;
use super::plan::{CameraPlan, DetectorStream, EvaluationPlan};
use crate::messages::{found, image, recovery};
use crate::video::AnnotatedVideo;

/// Why a file could not be written.
type Fault = Box<dyn Error + Send + Sync>;

/// Name of the picture of the frame in which the numbers of the boxes of the streams differ most: every stream with its boxes, in the order of the
/// detectors, with a legend of the classes.
pub const GRID: &str = "grid.png";

/// The recordings of an evaluation.
#[derive(Default)]
pub struct Recordings {
    /// The folder of the pictures.
    folder: PathBuf,
    /// The messages on the topics of the plan.
    bag: Option<BagWriter>,
    /// The annotated images of all streams.
    video: Option<AnnotatedVideo>,
    /// Whether the images that the detectors get are saved as `FOLDER/STREAM/NUMBER.png`.
    images: bool,
    /// The frame in [`GRID`], and how much the numbers of the boxes of its streams differ.
    pictured: Option<(u64, usize)>,
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
    pub fn new(folder: &Path, bag: Option<BagWriter>, video: Option<AnnotatedVideo>, images: bool) -> Self {
        Self { folder: folder.to_owned(), bag, video, images, ..Self::default() }
    }

    /// Returns the topics whose messages are needed for `plan`.
    pub fn topics(&self, plan: &EvaluationPlan) -> Vec<String> {
        let mut topics = plan.bagged.clone();
        for camera in &plan.cameras {
            topics.extend(camera.truth.clone());
            for stream in &camera.streams {
                topics.push(stream.detections.clone());
                topics.extend(self.images.then(|| stream.images.clone()));
                topics.extend(stream.annotated.clone());
                topics.extend(stream.labels.clone());
                topics.extend(stream.recovery.clone());
            }
        }
        topics
    }

    /// Adds frame `number` of `camera`. With the last camera of a round, in which each one has sent a frame, the annotated images
    /// of all are drawn. An error is kept for [`Recordings::finish`]: the scores do not depend on recordings.
    pub(super) fn add(
        &mut self,
        plan: &EvaluationPlan,
        (camera, number): (&CameraPlan, u64),
        out: &[OnTopic],
        ends_round: bool,
    ) {
        if self.fault.is_none() {
            self.fault = self.write(plan, (camera, number), out, ends_round).err();
        }
    }

    fn write(
        &mut self,
        plan: &EvaluationPlan,
        (camera, number): (&CameraPlan, u64),
        out: &[OnTopic],
        ends_round: bool,
    ) -> Result<(), Fault> {
        if let Some(bag) = &mut self.bag {
            record(bag, out, &plan.bagged)?;
        }
        for stream in camera.streams.iter().filter(|_| self.images) {
            if let Some(frame) = image(out, &stream.images) {
                save_png(&self.folder.join(&stream.name).join(file_name(number)), &frame.frame)?;
            }
        }
        let shown = camera.streams.iter().map(|stream| (stream.name.clone(), Shown::of(stream, out)));
        self.shown.extend(shown);
        if !ends_round {
            return Ok(());
        }
        let spread = self.spread();
        let is_largest = self.pictured.is_none_or(|(_, largest)| spread > largest);
        if !is_largest && self.video.is_none() {
            return Ok(());
        }
        let Some(sheet) = self.sheet(plan) else { return Ok(()) };
        if is_largest {
            save_sheet(&self.folder, &sheet)?;
            self.pictured = Some((number, spread));
        }
        match (&mut self.video, out.first()) {
            (Some(video), Some((_, message))) => Ok(video.add(sheet, message.stamp().as_ns())?),
            _ => Ok(()),
        }
    }

    /// Returns how much the numbers of the boxes of the streams differ in the frames that are shown.
    fn spread(&self) -> usize {
        let boxes = || self.shown.values().map(|shown| shown.classes.len());
        boxes().max().unwrap_or_default() - boxes().min().unwrap_or_default()
    }

    /// Notes that `camera` has sent its last frame.
    pub(super) fn end(&mut self, camera: &CameraPlan) {
        for stream in &camera.streams {
            if let Some(shown) = self.shown.get_mut(&stream.name) {
                shown.title = format!("{}: ended", stream.name);
            }
        }
    }

    /// Returns the last annotated images of all streams as one, each below its title; `None` where no stream has one. A stream without an image
    /// has an empty place, so that all sheets have one size.
    fn sheet(&self, plan: &EvaluationPlan) -> Option<RgbImage> {
        let picture = |DetectorStream { name, .. }: &DetectorStream| match self.shown.get(name) {
            Some(Shown { title, picture: Some(picture), .. }) => (title.clone(), Some(picture.clone())),
            _ => (format!("{name}: no image"), None),
        };
        let pictures: Vec<_> = plan.streams().map(picture).collect();
        let classes = self.shown.values().flat_map(|shown| &shown.classes);
        sheet(&pictures, &distinct(classes.map(String::as_str)))
    }

    /// Returns the number of the frame in [`GRID`]; `None` where no detector draws its boxes.
    pub fn pictured(&self) -> Option<u64> {
        self.pictured.map(|(number, _)| number)
    }

    /// Completes the bag and the video.
    ///
    /// # Errors
    /// The error of the first file that could not be written.
    pub fn finish(self) -> Result<(), Fault> {
        let bag = self.bag.map(BagWriter::finish).transpose().map(drop).map_err(Fault::from);
        let video = self.video.map(AnnotatedVideo::finish).transpose().map(drop).map_err(Fault::from);
        self.fault.map_or(Ok(()), Err).and(bag).and(video)
    }
}

impl Shown {
    /// What the messages of a frame show of `stream`, with the method that has unwrapped its image and its trust in the title.
    fn of(stream: &DetectorStream, out: &[OnTopic]) -> Self {
        let note = stream.recovery.as_deref().and_then(|topic| method_of(out, topic));
        let boxes: Vec<Detection> = found(out, &stream.detections).unwrap_or_default();
        Self {
            title: note.map_or_else(|| stream.name.clone(), |note| format!("{}: {note}", stream.name)),
            picture: stream.annotated.as_deref().and_then(|topic| picture(&image(out, topic)?.frame)),
            classes: boxes.into_iter().map(|found| found.class).collect(),
        }
    }
}

/// Writes the annotated images into `folder`.
fn save_sheet(folder: &Path, sheet: &RgbImage) -> Result<(), Fault> {
    let size = (sheet.height() as usize, sheet.width() as usize, 3);
    let pixels = Array3::from_shape_vec(size, sheet.as_raw().clone()).expect("three samples a pixel");
    let frame = Frame::from_u8(pixels).expect("a sheet has three channels");
    Ok(save_png(&folder.join(GRID), &frame)?)
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

/// An annotated frame. `None` unless it is 8-bit RGB.
fn picture(frame: &Frame) -> Option<Picture> {
    let pixels = frame.as_u8()?;
    let (height, width, _) = pixels.dim();
    let [width, height] = [width, height].map(|side| u32::try_from(side).ok());
    Picture::new(width?, height?, pixels.iter().copied().collect(), Vec::new()).ok()
}

/// Writes the messages on `topics`. Log time and publish time are the stamp of the message.
fn record(recorder: &mut BagWriter, out: &[OnTopic], topics: &[String]) -> Result<(), Fault> {
    for (topic, message) in out.iter().filter(|(topic, _)| topics.contains(topic)) {
        let bytes = message.encode()?;
        // The stamp, and not the wall clock: the same run must give the same bytes.
        let stamp = message.stamp().as_ns();
        let kind = message.kind();
        let qos = if sensor_info::is_topic(topic) { Qos::Latched } else { Qos::usual(kind) };
        let bag_topic = BagTopic::new(topic, kind.type_name(), qos);
        recorder.record(&bag_topic, stamp, stamp, &bytes)?;
    }
    Ok(())
}
