//! [`import_kitti`]: a KITTI folder to a bag with images and ground truth; [`import_video`]: a video to a bag with its images.
//!
//! KITTI's object set has no times, so frame `i` is stamped `i` / 10 s after a fixed epoch, for sequences as well. No
//! pixel and no label is changed. Frames that cannot be decoded are left out with their labels, and counted.

use std::path::{Path, PathBuf};

use modulo_core::{Frame, Samples};
use modulo_images::read_image;
use modulo_msgs::cdr::{self, CdrError};
use modulo_msgs::image::encode_frame;
use modulo_msgs::std_msgs::{Header, Time};
use modulo_runtime::{MessageKind, Qos};
use modulo_video::{Pixels, VideoFile};

use crate::bag::{BagError, BagTopic, BagWriter, Compression, TopicId};
use crate::source::{FRAME_ID, KittiFolder, SourceError, to_detections};
use crate::{GROUND_TRUTH_TOPIC, IMAGE_TOPIC};

/// Stamp of the first frame: 2011-09-26T00:00:00Z, the day of the recordings.
const EPOCH_NS: u64 = 1_316_995_200_000_000_000;
const TIMELESS: &str = "its frames have no times; put them into another container, such as by: ffmpeg -i VIDEO -c copy \
                        VIDEO.mp4";
/// KITTI's camera runs at 10 Hz.
const PERIOD_NS: u64 = 100_000_000;

/// Counts of an import.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ImportReport {
    /// Number of images.
    pub frames: usize,
    /// Images with a label file; the others have no ground truth message.
    pub labelled: usize,
    /// Labelled objects, areas to leave out included.
    pub objects: usize,
    /// Frames that are missing, damaged or cannot be decoded, and are left out.
    pub missing: usize,
}

/// Error: a data set could not be imported. No bag is left behind.
#[derive(Debug, thiserror::Error)]
pub enum ImportError {
    /// An image or a label.
    #[error(transparent)]
    Source(#[from] SourceError),
    /// The bag cannot be written.
    #[error(transparent)]
    Bag(#[from] BagError),
    /// A message that is too large.
    #[error(transparent)]
    Cdr(#[from] CdrError),
    /// A float image, which has no codes to put into an image message, or a video whose container has no times.
    #[error("{file}: {1}", file = .0.display())]
    Unfit(PathBuf, &'static str),
}

/// Writes the KITTI folder `folder` (with `image_2` or `image_02`) as the new bag `out`: `/camera/image_raw` and
/// `/ground_truth`, 10 Hz.
///
/// # Errors
/// [`ImportError`] of the first label or write that fails, and of a float image. Images that are damaged are counted.
pub fn import_kitti(folder: &Path, out: &Path) -> Result<ImportReport, ImportError> {
    let folder = KittiFolder::open(folder)?;
    let mut import = Import::new(BagWriter::create(out, Compression::None)?, true)?;
    // Stamps follow from the number of the frame, so that two imports of a folder are equal byte by byte.
    let mut frames = (EPOCH_NS..).step_by(PERIOD_NS as usize).zip(folder.images());
    let written = frames.try_for_each(|(stamp, image)| import.frame(&folder, image, stamp));
    import.finish(out, written)
}

/// Writes the video `video` as the new bag `out`: `/camera/image_raw`, each frame at its time of presentation since the first one. Codes
/// of more than 8 bits are spread over 16.
///
/// # Errors
/// [`ImportError`] of a video that cannot be read, and of a write that fails. Single frames that are missing are counted.
pub fn import_video(video: &Path, out: &Path) -> Result<ImportReport, ImportError> {
    let mut frames = VideoFile::open(video).map_err(SourceError::from)?;
    frames.warnings().iter().for_each(|warning| tracing::warn!("{warning}"));
    let mut import = Import::new(BagWriter::create(out, Compression::None)?, false)?;
    let written = std::iter::from_fn(|| frames.next_frame()).try_for_each(|frame| {
        let Ok(frame) = frame.inspect_err(|why| tracing::warn!("left out: {why}")) else {
            import.report.missing += 1;
            return Ok(());
        };
        let stamp = frame.time_ns.ok_or_else(|| ImportError::Unfit(video.to_owned(), TIMELESS))?;
        let header = Header { stamp: Time::from_ns(stamp), frame_id: FRAME_ID.to_owned() };
        import.image(&header, &spread(frame.pixels))
    });
    import.finish(out, written)
}

/// Spreads codes over the samples that hold them, so that their full scale is that of the samples.
fn spread(Pixels { frame, bits }: Pixels) -> Frame {
    let Samples::U16(codes) = frame.samples() else { return frame };
    let most = (1_u32 << bits) - 1;
    Frame::from_u16(codes.mapv(|code| (u32::from(code) * 65_535 / most) as u16))
        .expect("as many samples as before")
}

struct Import {
    bag: BagWriter,
    images: TopicId,
    labels: Option<TopicId>,
    report: ImportReport,
}

impl Import {
    fn new(mut bag: BagWriter, is_labelled: bool) -> Result<Self, BagError> {
        let images = bag.topic(&BagTopic::new(IMAGE_TOPIC, MessageKind::Image.type_name(), Qos::Images))?;
        let labels = BagTopic::new(GROUND_TRUTH_TOPIC, MessageKind::Detections.type_name(), Qos::Results);
        let labels = is_labelled.then(|| bag.topic(&labels)).transpose()?;
        Ok(Self { bag, images, labels, report: ImportReport::default() })
    }

    fn image(&mut self, header: &Header, frame: &Frame) -> Result<(), ImportError> {
        let stamp = header.stamp.as_ns();
        self.bag.write(self.images, stamp, stamp, &encode_frame(header, frame)?)?;
        self.report.frames += 1;
        Ok(())
    }

    /// Completes the bag `out` that was `written`, or removes it: half a data set must not look like a whole one.
    fn finish(self, out: &Path, written: Result<(), ImportError>) -> Result<ImportReport, ImportError> {
        let report = self.report;
        let finished = written.and_then(|()| Ok(self.bag.finish()?));
        if finished.is_err() {
            let _ = std::fs::remove_dir_all(out);
        }
        finished.map(|_| report)
    }

    fn frame(&mut self, folder: &KittiFolder, image: &Path, stamp: u64) -> Result<(), ImportError> {
        let header = Header { stamp: Time::from_ns(stamp), frame_id: FRAME_ID.to_owned() };
        let frame = match codes(image) {
            Err(ImportError::Source(why)) => {
                tracing::warn!("left out: {why}");
                self.report.missing += 1;
                return Ok(());
            }
            frame => frame?,
        };
        self.image(&header, &frame)?;
        if let (Some(labels), Some(topic)) = (folder.labels_of(image)?, self.labels) {
            let message = cdr::to_vec(&to_detections(&labels, &header))?;
            self.bag.write(topic, stamp, stamp, &message)?;
            self.report.labelled += 1;
            self.report.objects += labels.len();
        }
        Ok(())
    }
}

fn codes(image: &Path) -> Result<Frame, ImportError> {
    let frame = read_image(image).map_err(SourceError::from)?;
    match frame.samples() {
        Samples::U8(_) | Samples::U16(_) => Ok(frame),
        Samples::F32(_) => {
            Err(ImportError::Unfit(image.to_owned(), "is a float image, 8 or 16 bit codes are needed"))
        }
    }
}
