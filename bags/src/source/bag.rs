//! [`BagSource`]: the images of one topic of a bag, with the ground truth of the same stamp.

use std::collections::HashMap;
use std::io::Cursor;
use std::path::Path;
use std::sync::Arc;

use modulo_core::Frame;
use modulo_images::{ImageError, White, decode, sample_depth};
use modulo_msgs::cdr;
use modulo_msgs::diagnostic_msgs::DiagnosticArray;
use modulo_msgs::image::restore;
use modulo_msgs::sensor_msgs::{CameraInfo, CompressedImage, Image};
use modulo_msgs::std_msgs::Header;
use modulo_msgs::vision_msgs::Detection2DArray;
use modulo_runtime::sensor_info::{self, Descriptions, SensorHistory};
use modulo_runtime::topic::camera_info_topic;
use modulo_runtime::{MessageKind, StreamScale};
use serde::de::DeserializeOwned;

use super::pictures::{Picture, eight_bits};
use super::{GroundTruth, ReadFrames, Source, SourceError, SourceFrame, SourceOptions, from_detections};
use crate::GROUND_TRUTH_TOPIC;
use crate::bag::{BagError, BagReader, Messages, RawMessage, Selection, TopicCount};

/// The images of one topic of a bag, in log-time order.
pub struct BagSource {
    bag: BagReader,
    selection: Selection,
    messages: Messages,
    frames: u64,
    white: White,
    labels: HashMap<u64, Vec<GroundTruth>>,
    camera_info: Option<Arc<CameraInfo>>,
    /// One line for each part of the bag that cannot be read.
    pub losses: Vec<String>,
}

impl BagSource {
    /// Opens the bag at `path`. `options.topic` is needed when it has several image topics.
    ///
    /// # Errors
    /// [`SourceError`] when the bag cannot be read, or has not the topic.
    pub fn open(path: &Path, options: &SourceOptions) -> Result<Self, SourceError> {
        let white = White::new(options.coding.clone())?;
        let bag = BagReader::open(path)?;
        let topic = image_topic(&bag, options.topic.as_deref())?;
        let selection = Selection::of([topic.topic.name.clone()]);
        let messages = bag.messages(&selection);
        let white = match read_scale(&bag, &topic)? {
            Some(scale) => white.of_described(scale.most as f32),
            None => white,
        };
        // What is wrong with another topic alone does not concern the images.
        let losses = bag.warnings().iter().filter(|warning| warning.is_loss_of_any_topic());
        let mut losses: Vec<_> = losses.map(ToString::to_string).collect();
        let labels = read_labels(&bag, &mut losses)?;
        let camera_info = first(&bag, camera_info_topic(stream(&topic)), MessageKind::CameraInfo)?;
        let camera_info = camera_info.map(|(_, info)| Arc::new(info));
        Ok(Self { bag, selection, messages, frames: topic.messages, white, labels, camera_info, losses })
    }

    /// Returns the bag itself, for its warnings.
    pub fn bag(&self) -> &BagReader {
        &self.bag
    }

    /// Returns the next image as it was recorded, such as the codes of a modulo image; `None` at the end. After an error the
    /// next call goes on with the image behind the bad one.
    pub fn next_image(&mut self) -> Option<Result<RecordedImage, SourceError>> {
        let message = self.messages.next()?;
        Some(message.map_err(SourceError::from).and_then(|message| self.image(&message)))
    }

    /// Returns the next image as [`Pictures`](super::Pictures) have it, a mosaic in colours; `None` at the end.
    pub(super) fn next_picture(&mut self) -> Option<Result<Picture, SourceError>> {
        let message = self.messages.next()?;
        Some(message.map_err(SourceError::from).and_then(|message| {
            let RecordedImage { header, pixels, .. } = self.image(&message)?;
            let pixels = eight_bits(&pixels.demosaiced(), &mut self.white, origin(&message))?;
            Ok(Picture { name: header.stamp.as_ns().to_string().into(), pixels })
        }))
    }

    fn image(&self, message: &RawMessage) -> Result<RecordedImage, SourceError> {
        let (header, pixels) = read_message(message)?;
        let ground_truth = self.labels.get(&header.stamp.as_ns()).cloned();
        Ok(RecordedImage { header, pixels, ground_truth })
    }

    /// Learns the white level from a message that is skipped. Unreadable messages do not affect it, as in `frame`.
    fn learn(&mut self, message: &RawMessage) {
        if [8, 16, 32].into_iter().all(|depth| self.white.is_settled(depth)) {
            return;
        }
        if message.topic.type_name == MessageKind::CompressedImage.type_name() {
            let image = cdr::from_slice::<CompressedImage>(&message.data).ok();
            let depth = image.and_then(|image| sample_depth(Cursor::new(&image.data)));
            if depth.is_none_or(|depth| self.white.is_settled(depth)) {
                return;
            }
        }
        if let Ok((_, pixels)) = read_message(message) {
            self.white.learn(&pixels, origin(message));
        }
    }

    fn frame(&mut self, message: &RawMessage) -> Result<SourceFrame, SourceError> {
        let RecordedImage { header, pixels, ground_truth } = self.image(message)?;
        let (stamp, frame_id) = (header.stamp.as_ns(), header.frame_id);
        let radiance = self.white.radiance(&pixels, origin(message))?;
        let frame = SourceFrame::new(stamp.to_string(), radiance);
        Ok(SourceFrame { stamp_ns: Some(stamp), frame_id, ground_truth, ..frame })
    }
}

/// An image of a bag as it was recorded.
#[derive(Clone, Debug, PartialEq)]
pub struct RecordedImage {
    /// The stamp and the coordinate frame of the message.
    pub header: Header,
    /// The pixels of the message, a colour mosaic where its encoding names one.
    pub pixels: Frame,
    /// The labelled objects; `None` for an image without labels.
    pub ground_truth: Option<Vec<GroundTruth>>,
}

impl ReadFrames for BagSource {
    fn next(&mut self) -> Option<Result<SourceFrame, SourceError>> {
        let message = self.messages.next()?;
        Some(message.map_err(SourceError::from).and_then(|message| self.frame(&message)))
    }

    /// Decodes only the images that decide how the later ones are read.
    fn pass(&mut self, frames: u64) {
        for _ in 0..frames {
            match self.messages.next() {
                None => return,
                Some(Ok(message)) => self.learn(&message),
                Some(Err(_)) => {}
            }
        }
    }

    fn rewind(&mut self) {
        self.messages = self.bag.messages(&self.selection);
    }
}

impl From<BagSource> for Source {
    fn from(bag: BagSource) -> Self {
        let (len, camera_info) = (usize::try_from(bag.frames).ok(), bag.camera_info.clone());
        Self { len, camera_info, losses: bag.losses.clone(), ..Self::over(bag) }
    }
}

fn kind(topic: &TopicCount) -> Option<MessageKind> {
    MessageKind::from_type_name(&topic.topic.type_name)
}

/// Returns the topic that was asked for, or the only one.
fn image_topic(bag: &BagReader, wanted: Option<&str>) -> Result<TopicCount, SourceError> {
    let is_image =
        |t: &TopicCount| matches!(kind(t), Some(MessageKind::Image | MessageKind::CompressedImage));
    let images: Vec<TopicCount> = bag.topics().into_iter().filter(is_image).collect();
    let fitting: Vec<_> = images.iter().filter(|t| wanted.is_none_or(|name| t.topic.name == name)).collect();
    // A bag with several image topics and no choice is refused: the first one could be any.
    if let [only] = fitting[..] {
        return Ok(only.clone());
    }
    let names: Vec<_> = images.iter().map(|t| t.topic.name.as_str()).collect();
    let found = match wanted {
        Some(name) => format!("no image topic '{name}'"),
        None => format!("{} image topics", images.len()),
    };
    let mut topics = match names.first() {
        None => "none".to_owned(),
        Some(first) => format!(
            "{}; choose one by 'source_topic:={first}' behind a launch file, or by -p 'source_topic:={first}' of a camera",
            names.join(", ")
        ),
    };
    // The topic may be in the part that is missing.
    bag.warnings().iter().filter(|w| w.is_loss_of_any_topic()).for_each(|w| topics += &format!("; {w}"));
    Err(SourceError::of(bag.path(), &format!("{found}; image topics here: {topics}")))
}

/// Reads all labels of the bag by stamp; they are small beside the images. Those that cannot be read are `losses`.
fn read_labels(
    bag: &BagReader,
    losses: &mut Vec<String>,
) -> Result<HashMap<u64, Vec<GroundTruth>>, SourceError> {
    let is_truth =
        |t: &TopicCount| t.topic.name == GROUND_TRUTH_TOPIC && kind(t) == Some(MessageKind::Detections);
    let mut labels = HashMap::new();
    if !bag.topics().iter().any(is_truth) {
        return Ok(labels);
    }
    for message in bag.messages(&Selection::of([GROUND_TRUTH_TOPIC])) {
        let message = match message {
            Ok(message) => message,
            Err(why @ BagError::LeftOut(_)) => {
                losses.push(why.to_string());
                continue;
            }
            Err(why) => return Err(why.into()),
        };
        let array: Detection2DArray = cdr::from_slice(&message.data).map_err(|e| bad(&message, e))?;
        let (stamp, objects) = (array.header.stamp.as_ns(), from_detections(&array));
        // The same labels twice do no harm; different ones for one image have no right answer.
        if *labels.entry(stamp).or_insert_with(|| objects.clone()) != objects {
            let why =
                format!("other labels have its stamp of {stamp} ns too; record each source into its own bag");
            return Err(bad(&message, why));
        }
    }
    Ok(labels)
}

/// Returns what the samples of the images mean, if the first description that names their topic, or is beside them, tells it: a sensor of 6 bits has no
/// code above 63.
fn read_scale(bag: &BagReader, images: &TopicCount) -> Result<Option<StreamScale>, SourceError> {
    let (stream, mut descriptions) = (stream(images), Descriptions::default());
    let beside: Vec<String> = sensor_info::topics_for(stream).into_iter().map(|topic| topic.name).collect();
    for TopicCount { topic, .. } in bag.topics().iter().filter(|t| sensor_info::is_topic(&t.topic.name)) {
        let is_beside = beside.contains(&topic.name);
        let described = match first::<DiagnosticArray>(bag, topic.name.clone(), MessageKind::Diagnostics) {
            Err(_) if !is_beside => continue,
            read => read?,
        };
        // Those of other cameras do not matter.
        if let Some((message, info)) = described
            && (is_beside || info.value(stream).is_some())
        {
            descriptions.note(&topic.name, &info).map_err(|e| bad(&message, e))?;
        }
    }
    let (kind, sensors) = descriptions.of(stream);
    // Of floats, as no encoding limits them. Pictures have no other full scale than that of their encoding.
    Ok(StreamScale::of(kind, 32, sensors.and_then(SensorHistory::latest), 0))
}

/// Reads the first message of a topic that seldom changes: a bag is not read as a whole for it.
fn first<T: DeserializeOwned>(
    bag: &BagReader,
    topic: String,
    wanted: MessageKind,
) -> Result<Option<(RawMessage, T)>, SourceError> {
    let is_wanted = |t: &TopicCount| t.topic.name == topic && kind(t) == Some(wanted);
    if !bag.topics().iter().any(is_wanted) {
        return Ok(None);
    }
    // One that is left out is followed by another.
    let mut messages =
        bag.messages(&Selection::of([topic])).filter(|m| !matches!(m, Err(BagError::LeftOut(_))));
    let Some(message) = messages.next().transpose()? else { return Ok(None) };
    let content = cdr::from_slice(&message.data).map_err(|e| bad(&message, e))?;
    Ok(Some((message, content)))
}

/// Returns the name of the stream of the images: the files of NAME are on NAME/compressed.
fn stream(images: &TopicCount) -> &str {
    let name = &*images.topic.name;
    let is_file = kind(images) == Some(MessageKind::CompressedImage);
    name.rsplit_once('/').filter(|_| is_file).map_or(name, |(raw, _)| raw)
}

fn read_message(message: &RawMessage) -> Result<(Header, Frame), SourceError> {
    if message.topic.type_name == MessageKind::CompressedImage.type_name() {
        let image: CompressedImage = cdr::from_slice(&message.data).map_err(|e| bad(message, e))?;
        let picture = decode(&image.data, &origin(message))?;
        return Ok((image.header, restore(picture, &image.format).map_err(|e| bad(message, e))?));
    }
    let image: Image = cdr::from_slice(&message.data).map_err(|e| bad(message, e))?;
    let header = image.header.clone();
    Ok((header, image.into_frame().map_err(|e| bad(message, e))?))
}

fn bad(message: &RawMessage, why: impl std::fmt::Display) -> SourceError {
    ImageError::Undecodable(origin(message), why.to_string()).into()
}

fn origin(message: &RawMessage) -> String {
    format!("{} at {}", message.topic.name, message.log_time)
}
