//! [`Streams`]: the newest images and boxes that one browser may be shown, and the choice of the next image.

use std::collections::{BTreeMap, VecDeque};
use std::sync::Arc;

use modulo_core::{Frame, Samples};
use modulo_msgs::cdr;
use modulo_msgs::std_msgs::Time;
use modulo_msgs::vision_msgs::Detection2DArray;
use modulo_runtime::StampedFrame;
use modulo_runtime::transport::Payload;

use crate::protocol::{DetectorView, PixelView};

/// Images of one topic that wait for their boxes: two seconds at 30 Hz.
const KEPT: usize = 60;
/// Their bytes.
pub const KEPT_BYTES: usize = 64 << 20;
/// DetectorResults of one detector that wait for their image.
const KEPT_BOXES: usize = 32;
/// Boxes are waited for at most this long, and only those of a detector that has answered within this time, ns.
const PATIENCE_NS: u64 = 1_000_000_000;

/// The images and boxes of one browser.
#[derive(Default)]
pub struct Streams {
    topics: BTreeMap<String, WatchedTopic>,
    results: BTreeMap<String, DetectorResults>,
}

/// One image topic.
#[derive(Default)]
struct WatchedTopic {
    /// The newest images that have not been sent, undecoded.
    waiting: VecDeque<(Time, Payload)>,
    /// When the first image since the last one that was sent came, in ticks of the clock.
    waiting_since_ns: u64,
    /// Whether the browser has yet to draw the last image.
    busy: bool,
    shown: Option<Arc<StampedFrame>>,
}

/// The boxes of one detector.
#[derive(Default)]
struct DetectorResults {
    by_stamp: VecDeque<(Time, Arc<Detection2DArray>)>,
    /// When the last ones came, in ticks of the clock.
    last_ns: u64,
}

/// An image that may be sent now, with the boxes that belong to it by the topic of their detector.
pub struct NextImage {
    /// Topic of the image.
    pub topic: String,
    /// CDR of the image.
    pub payload: Payload,
    /// Boxes of this very image.
    pub boxes: Vec<(String, Arc<Detection2DArray>)>,
}

impl Streams {
    /// Shows exactly `topics` from now on.
    pub fn watch(&mut self, topics: &[String]) {
        self.topics.retain(|topic, _| topics.contains(topic));
        for topic in topics {
            self.topics.entry(topic.clone()).or_default();
        }
    }

    /// Returns the topics that are shown.
    pub fn watched(&self) -> impl Iterator<Item = &String> {
        self.topics.keys()
    }

    /// Takes an image, as CDR that begins with its stamp. The oldest one that waits is dropped when there are too many.
    pub fn image(&mut self, topic: &str, payload: Payload, now_ns: u64) {
        let (Some(stream), Ok(stamp)) = (self.topics.get_mut(topic), cdr::from_slice(&payload)) else {
            return;
        };
        if stream.waiting.is_empty() {
            stream.waiting_since_ns = now_ns;
        }
        stream.waiting.push_back((stamp, payload));
        let bytes =
            |waiting: &VecDeque<(Time, Payload)>| waiting.iter().map(|(_, image)| image.len()).sum::<usize>();
        // The newest image stays even if it is a huge one.
        while stream.waiting.len() > 1 && (stream.waiting.len() > KEPT || bytes(&stream.waiting) > KEPT_BYTES)
        {
            stream.waiting.pop_front();
        }
    }

    /// Takes the boxes that a detector published on `topic`.
    pub fn boxes(&mut self, topic: &str, boxes: Arc<Detection2DArray>, now_ns: u64) {
        let results = self.results.entry(topic.to_owned()).or_default();
        results.last_ns = now_ns;
        results.by_stamp.push_back((boxes.header.stamp, boxes));
        if results.by_stamp.len() > KEPT_BOXES {
            results.by_stamp.pop_front();
        }
    }

    /// Notes that the browser has drawn the last image of `topic`.
    pub fn drawn(&mut self, topic: &str) {
        if let Some(stream) = self.topics.get_mut(topic) {
            stream.busy = false;
        }
    }

    /// Notes the image that was sent.
    pub fn sent(&mut self, topic: &str, image: Arc<StampedFrame>) {
        if let Some(stream) = self.topics.get_mut(topic) {
            stream.shown = Some(image);
        }
    }

    /// Returns an image that can be sent. An image that detectors read is held back until their boxes are there, so that boxes
    /// are drawn on the image that they belong to, but never longer than a second.
    pub fn next(&mut self, detectors: &[DetectorView], now_ns: u64) -> Option<NextImage> {
        let results = &self.results;
        let answers = |topic: &&str| {
            results.get(*topic).is_some_and(|results| now_ns.saturating_sub(results.last_ns) < PATIENCE_NS)
        };
        self.topics.iter_mut().filter(|(_, stream)| !stream.busy).find_map(|(topic, stream)| {
            let reading = detectors.iter().filter(|detector| detector.inputs.contains(topic));
            let reading: Vec<&str> = reading.map(|detector| &*detector.topic).filter(answers).collect();
            let answered =
                |stamp: Time| reading.iter().all(|detector| boxes_of(results, detector, stamp).is_some());
            let complete = stream.waiting.iter().rposition(|(stamp, _)| answered(*stamp));
            let overdue = now_ns.saturating_sub(stream.waiting_since_ns) >= PATIENCE_NS;
            let newest = complete.or_else(|| stream.waiting.len().checked_sub(1).filter(|_| overdue))?;
            let (stamp, payload) = stream.waiting.drain(..=newest).next_back()?;
            (stream.busy, stream.waiting_since_ns) = (true, now_ns);
            let boxes = reading.iter().filter_map(|&detector| {
                Some((detector.to_owned(), boxes_of(results, detector, stamp)?.clone()))
            });
            Some(NextImage { topic: topic.clone(), payload, boxes: boxes.collect() })
        })
    }

    /// Returns the samples of the shown images at column `u` and row `v`.
    pub fn pixel(&self, u: usize, v: usize) -> Vec<PixelView> {
        let shown = self.topics.iter().filter_map(|(topic, stream)| Some((topic, stream.shown.as_ref()?)));
        let inside = shown.filter(|(_, image)| v < image.frame.height() && u < image.frame.width());
        let view = |(topic, image): (&String, &Arc<StampedFrame>)| PixelView {
            topic: topic.clone(),
            stamp: (image.header.stamp.sec, image.header.stamp.nanosec),
            samples: samples_at(&image.frame, v, u),
        };
        inside.map(view).collect()
    }
}

fn boxes_of<'a>(
    results: &'a BTreeMap<String, DetectorResults>,
    detector: &str,
    stamp: Time,
) -> Option<&'a Arc<Detection2DArray>> {
    let found = results.get(detector)?.by_stamp.iter().rev().find(|(at, _)| *at == stamp);
    found.map(|(_, boxes)| boxes)
}

/// Returns the samples of the pixel in row `v` and column `u`, which must be inside of `frame`.
fn samples_at(frame: &Frame, v: usize, u: usize) -> Vec<f32> {
    let channels = 0..frame.channels();
    match frame.samples() {
        Samples::U8(codes) => channels.map(|c| f32::from(codes[[v, u, c]])).collect(),
        Samples::U16(codes) => channels.map(|c| f32::from(codes[[v, u, c]])).collect(),
        Samples::F32(values) => channels.map(|c| values[[v, u, c]]).collect(),
    }
}

#[cfg(test)]
mod tests {
    use modulo_msgs::image::encode_frame;
    use modulo_msgs::std_msgs::Header;
    use ndarray::Array3;

    use super::*;

    fn header(ns: u64) -> Header {
        Header { stamp: Time::from_ns(ns), frame_id: String::new() }
    }

    fn image(ns: u64) -> Payload {
        let frame = Frame::from_u8(Array3::from_elem((2, 3, 1), ns as u8)).expect("a frame");
        Payload::new(encode_frame(&header(ns), &frame).expect("short"))
    }

    fn boxes(ns: u64) -> Arc<Detection2DArray> {
        Arc::new(Detection2DArray { header: header(ns), detections: Vec::new() })
    }

    fn detector() -> Vec<DetectorView> {
        let inputs = vec!["/recovered".to_owned()];
        vec![DetectorView { node: "/detector".into(), topic: "/boxes".into(), inputs }]
    }

    fn stamp(next: Option<NextImage>) -> Option<(u64, usize)> {
        let next = next?;
        let stamp: Time = cdr::from_slice(&next.payload).expect("an image");
        Some((stamp.as_ns(), next.boxes.len()))
    }

    #[test]
    fn boxes_are_sent_with_the_image_that_they_belong_to() {
        let mut streams = Streams::default();
        streams.watch(&["/recovered".into()]);
        streams.boxes("/boxes", boxes(1), 0);
        for ns in [1, 2, 3] {
            streams.image("/recovered", image(ns), 0);
        }
        // Images 2 and 3 have no boxes yet.
        assert_eq!(stamp(streams.next(&detector(), 0)), Some((1, 1)));
        assert_eq!(stamp(streams.next(&detector(), 0)), None, "the browser has not drawn image 1");
        streams.drawn("/recovered");
        assert_eq!(stamp(streams.next(&detector(), 0)), None, "the boxes of image 2 are not there");
        streams.boxes("/boxes", boxes(3), 10);
        assert_eq!(stamp(streams.next(&detector(), 20)), Some((3, 1)), "the newest one");
        streams.drawn("/recovered");
        streams.image("/recovered", image(4), 20);
        streams.boxes("/boxes", boxes(5), 30);
        assert_eq!(stamp(streams.next(&detector(), 19 + PATIENCE_NS)), None);
        assert_eq!(
            stamp(streams.next(&detector(), 20 + PATIENCE_NS)),
            Some((4, 0)),
            "the detector left it out"
        );
        streams.drawn("/recovered");
        streams.image("/recovered", image(6), 5 * PATIENCE_NS);
        assert_eq!(stamp(streams.next(&detector(), 5 * PATIENCE_NS)), Some((6, 0)), "the detector is silent");
    }

    #[test]
    fn few_images_wait() {
        let mut streams = Streams::default();
        streams.image("/other", image(1), 0);
        assert!(streams.next(&[], 0).is_none(), "a topic that is not watched");
        streams.watch(&["/modulo".into()]);
        for ns in 0..2 * KEPT as u64 {
            streams.image("/modulo", image(ns), 0);
        }
        assert_eq!(streams.topics["/modulo"].waiting.len(), KEPT);
        assert_eq!(stamp(streams.next(&[], 0)), Some((2 * KEPT as u64 - 1, 0)));
        assert!(streams.topics["/modulo"].waiting.is_empty(), "older images are never shown later");
        streams.image("/modulo", Payload::new(vec![0, 1]), 0);
        assert!(streams.topics["/modulo"].waiting.is_empty(), "a cut message");
    }
}
