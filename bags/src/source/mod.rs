//! [`Source`]: frames of a scene, one after the other, from whatever holds them.
//!
//! A source only reads. It never waits, never repeats a frame by itself and never guesses a stamp that the data does
//! not have.

mod bag;
mod classes;
mod coco;
mod data_set;
mod folder;
mod json;
mod kitti;
mod labels;
mod light;
mod npz;
mod order;
mod pictures;
mod scene;
mod spikes;
mod video;
mod yolo;

use std::path::Path;
use std::sync::Arc;

use modulo_core::{BBox, Detection};
use modulo_images::{Coding, ImageError};
use modulo_msgs::sensor_msgs::CameraInfo;
use modulo_msgs::std_msgs::Header;
use modulo_msgs::vision_msgs::{Detection2D, Detection2DArray};
use modulo_runtime::embedded::locate;
use modulo_runtime::secret::without_secrets;
use modulo_video::{LiveAddress, VideoAddress, VideoError};
use ndarray::Array3;

pub use bag::{BagSource, RecordedImage};
pub use classes::NAME_FILES;
pub use folder::images_of;
pub use kitti::FrameList;
pub use labels::Skipped;
pub use pictures::{Picture, Pictures, of_radiance};

use crate::FileError;
use crate::bag::BagError;
use light::Light;

/// Error: a frame could not be read. The message names the file, the fault and the possible values.
#[derive(Debug, thiserror::Error)]
pub enum SourceError {
    /// A camera or a stream, where frames of a recording are needed.
    #[error(
        "{0}: is live, and only the node modulo_camera reads live sources; record its images with modulo launch and modulo bag \
         record, and give the bag"
    )]
    Live(LiveAddress),
    /// A video that cannot be read.
    #[error(transparent)]
    Video(#[from] VideoError),
    /// An address that is no scene.
    #[error(transparent)]
    Scene(#[from] modulo_scene::SpecError),
    /// The system does not read a file.
    #[error(transparent)]
    Io(#[from] FileError),
    /// An image that cannot be had.
    #[error(transparent)]
    Image(#[from] ImageError),
    /// A source that is missing, is none of those that are read, or has labels that cannot be read. The text names it, the fault and
    /// the possible values.
    #[error("{0}")]
    Unreadable(String),
    /// A bag that cannot be read.
    #[error(transparent)]
    Bag(#[from] BagError),
}

impl SourceError {
    fn of(path: &Path, why: &str) -> Self {
        Self::Unreadable(format!("{}: {why}", path.display()))
    }

    /// Returns the error of a file or folder of a data set that does not exist; `needed` says what is needed.
    fn absent(path: &Path, needed: &str) -> Self {
        Self::of(path, &format!("no such file or folder; {needed}"))
    }

    /// Returns the error of a file with labels, in its line number `line`, from 1.
    fn label(path: &Path, line: usize, why: &str) -> Self {
        Self::Unreadable(format!("{}:{line}: {why}", path.display()))
    }
}

/// The sources of frames that [`open`] reads.
const POSSIBLE: &str = "scene://PRESET, an image, a folder of images, a KITTI folder, a video, a bag, a spike recording (.npz), and for a camera also rtsp://, http://, \
                        https://, /dev/videoN and topic:NAME, such as topic:/camera/image_raw";
/// The schemes that [`open`] reads.
const SCHEMES: &str = "scene, rtsp, rtsps, http and https are the schemes that are read; bring images of another origin in by a node \
                       of ROS 2, and give the camera source topic:NAME, such as topic:/image_raw";

/// One recorded frame.
#[derive(Clone, Debug, PartialEq)]
pub struct SourceFrame {
    /// Radiance, `H x W x C` with `C` = 1 (grey, or a raw mosaic) or 3, as a fraction of full scale in `[0, 1)`, as
    /// [`White::radiance`](modulo_images::White::radiance) has it.
    pub radiance: Array3<f32>,
    /// Name of the frame: the name of the file without extension, or the stamp in a bag.
    pub name: String,
    /// Time of exposure, ns since the epoch, where the data has one.
    pub stamp_ns: Option<u64>,
    /// Coordinate frame; `camera_optical` when the data has none.
    pub frame_id: String,
    /// The labelled objects; `None` for a frame without labels, an empty list for a labelled frame without objects.
    pub ground_truth: Option<Vec<GroundTruth>>,
    /// Full scale in resets, where the pixels of a real sensor have reset themselves n times and `radiance` is (n + 1/2) / full scale; `None`
    /// for all other frames.
    pub full_resets: Option<f32>,
}

impl SourceFrame {
    fn new(name: String, radiance: Array3<f32>) -> Self {
        Self {
            radiance,
            name,
            stamp_ns: None,
            frame_id: FRAME_ID.to_owned(),
            ground_truth: None,
            full_resets: None,
        }
    }
}

/// The reader of the frames behind a [`Source`], in their recorded order.
pub trait ReadFrames: Send {
    /// Returns the next frame; `None` when it is over. After an error the next call goes on with the frame behind the
    /// bad one.
    fn next(&mut self) -> Option<Result<SourceFrame, SourceError>>;

    /// Resumes after the next `frames` frames, without reading them where that is possible.
    fn pass(&mut self, frames: u64) {
        for _ in 0..frames {
            if self.next().is_none() {
                return;
            }
        }
    }

    /// Goes back to the first frame.
    fn rewind(&mut self);
}

/// Frames in their recorded order, good ones and errors; after an error, the next one is that behind the bad one.
pub struct Source {
    frames: Box<dyn ReadFrames>,
    light: Option<Light>,
    /// The number of the next frame.
    number: u64,
    /// How many frames there are from the start, if that is known.
    pub len: Option<usize>,
    /// The camera info that was recorded with the images, whose calibration holds for all of them; `None` without one.
    pub camera_info: Option<Arc<CameraInfo>>,
    /// One line for each kind of label or image that is left out, and for what its frames may be wrong in.
    pub warnings: Vec<String>,
    /// One line for each part of the recording that cannot be read, such as the end of a bag that was cut: frames may be
    /// missing without an error in their place.
    pub losses: Vec<String>,
}

impl Source {
    /// Creates a source of `frames`, about which nothing else is known.
    pub fn over(frames: impl ReadFrames + 'static) -> Self {
        let (warnings, losses) = (Vec::new(), Vec::new());
        let frames = Box::new(frames);
        Self { frames, light: None, number: 0, len: None, camera_info: None, warnings, losses }
    }

    /// Resumes after the next `frames` frames, without reading them where that is possible.
    pub fn pass(&mut self, frames: u64) {
        self.frames.pass(frames);
        self.number = self.number.saturating_add(frames);
    }

    /// Goes back to the first frame.
    pub fn rewind(&mut self) {
        self.frames.rewind();
        self.number = 0;
    }
}

impl Iterator for Source {
    type Item = Result<SourceFrame, SourceError>;

    fn next(&mut self) -> Option<Self::Item> {
        let mut next = self.frames.next()?;
        if let (Ok(frame), Some(light)) = (&mut next, self.light) {
            let factor = light.factor(self.number) as f32;
            frame.radiance.mapv_inplace(|radiance| factor * radiance);
        }
        self.number = self.number.saturating_add(1);
        Some(next)
    }
}

/// Options for reading a source.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SourceOptions {
    /// How the samples stand for radiance.
    pub coding: Coding,
    /// The image topic of a bag; `None` when the bag has just one.
    pub topic: Option<String>,
}

/// Coordinate frame of images without one.
pub const FRAME_ID: &str = "camera_optical";

/// Opens what `spec` names: a scene (`scene://PRESET?seed=N`), a bag (a `.mcap` or `.db3` file, or a
/// folder with `metadata.yaml` or such files), a KITTI folder (with `image_2` or `image_02`), a folder of images,
/// one image, a video ([`VideoAddress`]), or a spike recording (`PATH.npz?window=N`), each under changing light with `?light=NAME` behind it.
///
/// # Errors
/// [`SourceError`] when the path is missing, holds no frame, or cannot be read.
///
/// ```
/// use modulo_bags::source::{SourceOptions, open};
///
/// let mut source = open("scene://tunnel?seed=3&frames=2&width=64&height=32", &SourceOptions::default())?;
/// let frame = source.next().expect("the scene has two frames")?;
/// assert_eq!(frame.radiance.dim(), (32, 64, 3));
/// assert!(frame.ground_truth.is_some());
/// # Ok::<(), modulo_bags::source::SourceError>(())
/// ```
pub fn open(spec: &str, options: &SourceOptions) -> Result<Source, SourceError> {
    let (spec, light) = light::split(spec)?;
    Ok(Source { light, ..open_unlit(&spec, options)? })
}

fn open_unlit(spec: &str, options: &SourceOptions) -> Result<Source, SourceError> {
    if spec.is_empty() {
        return Err(SourceError::Unreadable(format!("no source is given; possible are {POSSIBLE}")));
    }
    let path = &locate(Path::new(spec)).map_err(|why| FileError::new(Path::new(spec), why))?;
    let is_bag = || !spec.contains("://") && crate::bag::is_bag(path);
    if let Some(topic) = options.topic.clone().filter(|_| !is_bag()) {
        let why = "is no bag and has no topics; leave source_topic empty";
        let spec = without_secrets(spec);
        return Err(SourceError::Unreadable(format!("source_topic '{topic}': {spec} {why}")));
    }
    if let Some((path, window)) = spikes::split(spec) {
        let path = locate(path).map_err(|why| FileError::new(path, why))?;
        return spikes::open(&path, window, options);
    }
    if is_rendered(spec) {
        return scene::open(spec);
    }
    match VideoAddress::of(spec)? {
        Some(VideoAddress::File(path)) => return video::open(&path, options),
        Some(VideoAddress::Live(address)) => return Err(SourceError::Live(address)),
        None if spec.contains("://") => {
            return Err(SourceError::Unreadable(format!("{}: {SCHEMES}", without_secrets(spec))));
        }
        None => {}
    }
    if !path.exists() {
        return Err(SourceError::of(path, &format!("no such path; possible are {POSSIBLE}")));
    }
    // Bags come first, because the folder of a bag may hold images and anything else.
    if crate::bag::is_bag(path) {
        return BagSource::open(path, options).map(Source::from);
    }
    if kitti::is_at(path) {
        return Source::kitti(path, None, options);
    }
    folder::open(path, options)
}

/// Returns whether `spec` names a scene without a number of frames, which never ends.
pub fn is_endless(spec: &str) -> bool {
    let Ok((spec, _)) = light::split(spec) else { return false };
    is_rendered(&spec) && spec.parse::<modulo_scene::SceneSpec>().is_ok_and(|scene| scene.frames == 0)
}

/// Returns whether `spec` names a scene, whose frames are rendered by the suite.
pub fn is_rendered(spec: &str) -> bool {
    spec.starts_with("scene://")
}

/// [`GroundTruth::occluded`] of a crowd: an area in which the objects of the class are not labelled individually.
pub const CROWD: i32 = 4;

/// One labelled object. Evaluation needs to know which objects are hard to see and which areas to leave out.
/// `Detection2D` has no fields for that, so a message carries them in its `id`.
#[derive(Clone, Debug, PartialEq)]
pub struct GroundTruth {
    /// Box in pixels of the original image.
    pub bbox: BBox,
    /// The class as the data set calls it, but that of KITTI in lower case; `dontcare` is an area to leave out.
    pub class: String,
    /// Fraction of the object outside the image, 0 to 1; -1 when it is unknown.
    pub truncated: f32,
    /// 0 fully visible, 1 partly occluded, 2 largely occluded, 3 unknown, [`CROWD`]; -1 when it is unknown.
    pub occluded: i32,
}

impl GroundTruth {
    fn to_detection(&self, header: &Header) -> Detection2D {
        let detection = Detection { bbox: self.bbox, score: 1.0, class: self.class.clone() };
        let id = format!("occluded={} truncated={:.2}", self.occluded, self.truncated);
        Detection2D { id, ..Detection2D::from_detection(&detection, header) }
    }

    fn from_detection(message: &Detection2D) -> Option<Self> {
        let Detection { bbox, class, .. } = message.to_detection()?;
        let field = |key: &str| {
            let fields = message.id.split_whitespace().filter_map(|field| field.split_once('='));
            fields.into_iter().find(|(name, _)| *name == key).map(|(_, value)| value)
        };
        let truncated = field("truncated").and_then(|v| v.parse().ok()).filter(|v: &f32| v.is_finite());
        let occluded = field("occluded").and_then(|v| v.parse().ok());
        Some(Self { bbox, class, truncated: truncated.unwrap_or(-1.0), occluded: occluded.unwrap_or(-1) })
    }
}

/// Returns the labels of one image as a message with that image's header; class and box as in a detection of score 1,
/// the rest in `id` as `occluded=1 truncated=0.00`.
pub fn to_detections(labels: &[GroundTruth], header: &Header) -> Detection2DArray {
    let detections = labels.iter().map(|label| label.to_detection(header)).collect();
    Detection2DArray { header: header.clone(), detections }
}

/// Returns the labels in a message. An `id` without occlusion or truncation leaves these at -1; a detection without
/// class or with a rotated box is no label.
pub fn from_detections(message: &Detection2DArray) -> Vec<GroundTruth> {
    message.detections.iter().filter_map(GroundTruth::from_detection).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn label() -> impl Strategy<Value = GroundTruth> {
        // KITTI writes two decimals.
        let number = |range: std::ops::Range<i32>| range.prop_map(|n| n as f32 / 100.0);
        let edges = (number(0..200_000), number(0..60_000), number(0..90_000), number(0..90_000));
        (edges, "[a-z_]{1,12}", number(-100..101), -1..4).prop_map(
            |((x, y, w, h), class, truncated, occluded)| {
                let bbox = BBox { x1: x, y1: y, x2: x + w, y2: y + h };
                GroundTruth { bbox, class, truncated, occluded }
            },
        )
    }

    proptest! {
        #[test]
        fn labels_return(labels in proptest::collection::vec(label(), 0..4)) {
            let header = Header::default();
            prop_assert_eq!(from_detections(&to_detections(&labels, &header)), labels);
        }
    }

    #[test]
    fn a_source_that_is_no_recording_says_what_to_write() {
        for (spec, remedy) in [
            ("/camera/image_raw", "topic:/camera/image_raw"),
            ("/dev/video0", "modulo_camera"),
            ("rtsp://10.0.0.3/stream", "modulo_camera"),
            ("udp://10.0.0.3:5000", "topic:NAME"),
            ("video:file:///etc/passwd", "schemes"),
        ] {
            let why = open(spec, &SourceOptions::default()).err().expect("no recording").to_string();
            assert!(why.contains(spec) && why.contains(remedy), "{why}");
        }
    }

    #[test]
    fn a_source_that_is_refused_keeps_its_password() {
        for spec in [
            "rtsp://admin:s3cret@10.0.0.3/live",
            "srt+http://admin:s3cret@10.0.0.3/live",
            "http://10.0.0.3/?p=s3cret",
        ] {
            let why = open(spec, &SourceOptions::default()).err().expect("no recording").to_string();
            assert!(!why.contains("s3cret") && why.contains("10.0.0.3"), "{why}");
        }
    }

    #[test]
    fn an_untold_occlusion_is_minus_one() {
        let label = GroundTruth { bbox: BBox::default(), class: "car".into(), truncated: 0.5, occluded: 2 };
        let mut message = to_detections(&[label], &Header::default());
        assert_eq!(message.detections[0].id, "occluded=2 truncated=0.50");
        message.detections[0].id = "truncated=NaN".into();
        let labels = from_detections(&message);
        assert_eq!((labels[0].truncated, labels[0].occluded), (-1.0, -1));
    }
}
