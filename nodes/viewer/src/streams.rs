//! [`Streams`]: the newest images and boxes that one browser may be shown, and the choice of the next image.

use std::collections::{BTreeMap, VecDeque};
use std::sync::Arc;

use modulo_core::{Frame, Samples};
use modulo_middleware::transport::Payload;
use modulo_msgs::cdr;
use modulo_msgs::diagnostic_msgs::DiagnosticArray;
use modulo_msgs::std_msgs::Time;
use modulo_msgs::vision_msgs::Detection2DArray;
use modulo_runtime::StampedFrame;

use crate::feed::{MessageOrigin, input_topic};
use crate::protocol::{DetectorView, GraphView, PixelView};

/// Images of one topic that wait for their boxes: two seconds at 30 Hz.
const KEPT: usize = 60;
/// Their bytes.
pub const KEPT_BYTES: usize = 64 << 20;
/// Results of one detector that wait for their image.
const KEPT_BOXES: usize = 32;
/// Boxes are waited for at most this long, and only those of a detector that has answered within this time, ns.
const PATIENCE_NS: u64 = 1_000_000_000;

/// The images and boxes of one browser.
#[derive(Default)]
pub struct Streams {
    topics: BTreeMap<String, WatchedTopic>,
    results: BTreeMap<String, DetectorResults>,
    /// The stream that each detector answers, as its `~/state` names it.
    answered: BTreeMap<String, Arc<str>>,
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
    node: String,
    newest: VecDeque<DetectorResult>,
    /// When the last one came, in ticks of the clock.
    last_ns: u64,
}

/// The boxes of one image.
struct DetectorResult {
    boxes: Arc<Detection2DArray>,
    /// The stream that they were found in; unknown for a detector without `~/state`.
    stream: Option<Arc<str>>,
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

    /// Takes the boxes that a detector published.
    pub(crate) fn boxes(&mut self, origin: &MessageOrigin, boxes: Arc<Detection2DArray>, now_ns: u64) {
        let results = self.results.entry(origin.topic.clone()).or_default();
        results.last_ns = now_ns;
        results.node.clone_from(&origin.node);
        let stream = self.answered.get(&origin.node).cloned();
        results.newest.push_back(DetectorResult { boxes, stream });
        if results.newest.len() > KEPT_BOXES {
            results.newest.pop_front();
        }
    }

    /// Takes the `~/state` of a detector, which has the stamp of the first image that it holds for.
    pub(crate) fn state(&mut self, node: &str, state: &DiagnosticArray) {
        let mut values = state.status.iter().flat_map(|status| &status.values);
        let Some(stream) = values.find(|value| value.key == "stream") else { return };
        let stream: Arc<str> = stream.value.as_str().into();
        self.answered.insert(node.to_owned(), stream.clone());
        for results in self.results.values_mut().filter(|results| results.node == node) {
            // The results that it holds for may have overtaken it.
            let first = |result: &DetectorResult| result.boxes.header.stamp == state.header.stamp;
            let first = results.newest.iter().position(first).unwrap_or(results.newest.len());
            for (index, result) in results.newest.iter_mut().enumerate() {
                if index >= first || result.stream.is_none() {
                    result.stream = Some(stream.clone());
                }
            }
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

    /// Returns an image that can be sent. An image that detectors answer is held back until their boxes are there, so that boxes
    /// are drawn on the image that they were found in, but never longer than a second.
    pub fn next(&mut self, graph: &GraphView, now_ns: u64) -> Option<NextImage> {
        let (results, answered) = (&self.results, &self.answered);
        let is_alive = |detector: &&DetectorView| {
            let results = results.get(&detector.topic);
            results.is_some_and(|results| now_ns.saturating_sub(results.last_ns) < PATIENCE_NS)
        };
        self.topics.iter_mut().filter(|(_, stream)| !stream.busy).find_map(|(topic, stream)| {
            let boxes_at = |detector: &DetectorView, stamp| {
                let mut newest = results.get(&detector.topic)?.newest.iter().rev();
                let of_image = |result: &&DetectorResult| {
                    result.boxes.header.stamp == stamp
                        && shows(graph, detector, result.stream.as_deref(), topic)
                };
                newest.find(of_image).map(|result| result.boxes.clone())
            };
            let answers = |detector: &&DetectorView| {
                shows(graph, detector, answered.get(&detector.node).map(|stream| &**stream), topic)
            };
            let answering: Vec<_> = graph.detectors.iter().filter(answers).filter(is_alive).collect();
            let is_complete = |stamp| answering.iter().all(|detector| boxes_at(detector, stamp).is_some());
            let complete = stream.waiting.iter().rposition(|(stamp, _)| is_complete(*stamp));
            let overdue = now_ns.saturating_sub(stream.waiting_since_ns) >= PATIENCE_NS;
            let newest = complete.or_else(|| stream.waiting.len().checked_sub(1).filter(|_| overdue))?;
            let (stamp, payload) = stream.waiting.drain(..=newest).next_back()?;
            (stream.busy, stream.waiting_since_ns) = (true, now_ns);
            let boxes = graph.detectors.iter();
            let boxes =
                boxes.filter_map(|detector| Some((detector.topic.clone(), boxes_at(detector, stamp)?)));
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

/// Returns whether `detector` finds its boxes in the image `topic` when it answers `streams`, names with commas between them. The
/// name does not identify a remapped input; then, and without a name, every image that the node reads is accepted.
fn shows(graph: &GraphView, detector: &DetectorView, streams: Option<&str>, topic: &String) -> bool {
    let named = streams.iter().flat_map(|streams| streams.split(", "));
    let named = named.map(|stream| input_topic(&detector.node, stream));
    let named: Vec<String> = named.filter(|named| graph.images.contains(named)).collect();
    match &*named {
        [] => detector.inputs.contains(topic),
        [one] => one == topic,
        // The boxes of the camera /front are on ~/front/detections.
        several => {
            let camera = topic.rsplit_once('/').map_or("", |(camera, _)| camera);
            several.contains(topic) && detector.topic.starts_with(&format!("{}{camera}/", detector.node))
        }
    }
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
    use modulo_msgs::diagnostic_msgs::{DiagnosticStatus, KeyValue};
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

    fn origin() -> MessageOrigin {
        MessageOrigin { node: "/detector".into(), topic: "/boxes".into() }
    }

    /// A detector that reads `inputs`.
    fn detector(inputs: &[&str]) -> GraphView {
        let inputs = inputs.iter().map(|&input| input.to_owned()).collect();
        let MessageOrigin { node, topic } = origin();
        GraphView {
            images: ["/modulo", "/recovered"].map(str::to_owned).into(),
            detectors: vec![DetectorView { node, topic, inputs, offers: Vec::new() }],
            ..GraphView::default()
        }
    }

    fn state(ns: u64, stream: &str) -> DiagnosticArray {
        let values = vec![KeyValue { key: "stream".into(), value: stream.into() }];
        let status = DiagnosticStatus {
            level: DiagnosticStatus::OK,
            name: "detector: state".into(),
            message: String::new(),
            hardware_id: String::new(),
            values,
        };
        DiagnosticArray { header: header(ns), status: vec![status] }
    }

    fn stamp(next: Option<NextImage>) -> Option<(u64, usize)> {
        let next = next?;
        let stamp: Time = cdr::from_slice(&next.payload).expect("an image");
        Some((stamp.as_ns(), next.boxes.len()))
    }

    #[test]
    fn boxes_are_sent_with_the_image_that_they_belong_to() {
        let (mut streams, graph) = (Streams::default(), detector(&["/recovered"]));
        streams.watch(&["/recovered".into()]);
        streams.boxes(&origin(), boxes(1), 0);
        for ns in [1, 2, 3] {
            streams.image("/recovered", image(ns), 0);
        }
        // Images 2 and 3 have no boxes yet.
        assert_eq!(stamp(streams.next(&graph, 0)), Some((1, 1)));
        assert_eq!(stamp(streams.next(&graph, 0)), None, "the browser has not drawn image 1");
        streams.drawn("/recovered");
        assert_eq!(stamp(streams.next(&graph, 0)), None, "the boxes of image 2 are not there");
        streams.boxes(&origin(), boxes(3), 10);
        assert_eq!(stamp(streams.next(&graph, 20)), Some((3, 1)), "the newest one");
        streams.drawn("/recovered");
        streams.image("/recovered", image(4), 20);
        streams.boxes(&origin(), boxes(5), 30);
        assert_eq!(stamp(streams.next(&graph, 19 + PATIENCE_NS)), None);
        assert_eq!(stamp(streams.next(&graph, 20 + PATIENCE_NS)), Some((4, 0)), "the detector left it out");
        streams.drawn("/recovered");
        streams.image("/recovered", image(6), 5 * PATIENCE_NS);
        assert_eq!(stamp(streams.next(&graph, 5 * PATIENCE_NS)), Some((6, 0)), "the detector is silent");
    }

    /// Both streams show the same frames, and the detector reads both while it changes from one to the other one.
    #[test]
    fn boxes_are_sent_only_with_images_of_the_stream_that_they_were_found_in() {
        for is_late in [false, true] {
            let (mut streams, graph) = (Streams::default(), detector(&["/modulo", "/recovered"]));
            streams.state("/detector", &state(0, "recovered"));
            streams.watch(&["/modulo".into(), "/recovered".into()]);
            streams.boxes(&origin(), boxes(1), 0);
            if !is_late {
                streams.state("/detector", &state(2, "modulo"));
            }
            streams.boxes(&origin(), boxes(2), 0);
            if is_late {
                streams.state("/detector", &state(2, "modulo"));
            }
            for (ns, topic, count) in
                [(1, "/recovered", 1), (1, "/modulo", 0), (2, "/recovered", 0), (2, "/modulo", 1)]
            {
                streams.image(topic, image(ns), 0);
                // An image that nobody answers is sent at the latest after a second.
                let next = streams.next(&graph, 0).or_else(|| streams.next(&graph, PATIENCE_NS));
                assert_eq!(stamp(next), Some((ns, count)), "{topic}, state is late: {is_late}");
                streams.drawn(topic);
            }
        }
    }

    #[test]
    fn the_boxes_of_a_detector_with_a_remapped_input_are_sent() {
        let (mut streams, mut graph) = (Streams::default(), detector(&["/camera/image"]));
        graph.images = vec!["/camera/image".into()];
        streams.watch(&graph.images);
        streams.state("/detector", &state(0, "recovered"));
        streams.boxes(&origin(), boxes(1), 0);
        streams.image("/camera/image", image(1), 0);
        assert_eq!(stamp(streams.next(&graph, 0)), Some((1, 1)));
    }

    #[test]
    fn a_detector_of_two_cameras_has_a_topic_of_boxes_for_each() {
        let (mut streams, mut graph) = (Streams::default(), GraphView::default());
        graph.images = ["/front/recovered", "/rear/recovered"].map(str::to_owned).into();
        graph.detectors = ["/detector/front/detections", "/detector/rear/detections"]
            .map(|topic| DetectorView {
                node: "/detector".into(),
                topic: topic.into(),
                inputs: graph.images.clone(),
                offers: Vec::new(),
            })
            .into();
        streams.watch(&graph.images);
        streams.state("/detector", &state(0, "/front/recovered, /rear/recovered"));
        let front = MessageOrigin { node: "/detector".into(), topic: "/detector/front/detections".into() };
        streams.boxes(&front, boxes(1), 0);
        streams.image("/rear/recovered", image(1), 0);
        assert_eq!(
            stamp(streams.next(&graph, 0)),
            Some((1, 0)),
            "the detector has answered no image of /rear"
        );
        streams.image("/front/recovered", image(1), 0);
        assert_eq!(stamp(streams.next(&graph, 0)), Some((1, 1)));
    }

    #[test]
    fn few_images_wait() {
        let mut streams = Streams::default();
        streams.image("/other", image(1), 0);
        assert!(streams.next(&GraphView::default(), 0).is_none(), "a topic that is not watched");
        streams.watch(&["/modulo".into()]);
        for ns in 0..2 * KEPT as u64 {
            streams.image("/modulo", image(ns), 0);
        }
        assert_eq!(streams.topics["/modulo"].waiting.len(), KEPT);
        assert_eq!(stamp(streams.next(&GraphView::default(), 0)), Some((2 * KEPT as u64 - 1, 0)));
        assert!(streams.topics["/modulo"].waiting.is_empty(), "older images are never shown later");
        streams.image("/modulo", Payload::new(vec![0, 1]), 0);
        assert!(streams.topics["/modulo"].waiting.is_empty(), "a cut message");
    }
}
