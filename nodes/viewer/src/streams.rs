//! [`Streams`]: the newest images and boxes that one client may be shown, and the choice of the next images.

use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::sync::Arc;

use modulo_middleware::transport::Payload;
use modulo_msgs::cdr;
use modulo_msgs::diagnostic_msgs::DiagnosticArray;
use modulo_msgs::std_msgs::Time;
use modulo_msgs::vision_msgs::Detection2DArray;
use modulo_runtime::{StampedFrame, StreamScale};

use crate::cameras::namespace;
use crate::graph::{MessageOrigin, has_room, input_topic};
use crate::protocol::{DetectorView, GraphView, PixelView};
use crate::sent::SentImages;

/// Images of one topic that wait for their boxes: two seconds at 30 Hz.
const KEPT: usize = 60;
/// Their bytes.
const KEPT_BYTES: usize = 64 << 20;
/// Results of one detector that wait for their image.
const KEPT_BOXES: usize = 32;
/// A moment waits at most this long for its images, ns: a busy machine needs more than a second.
const PATIENCE_NS: u64 = 3_000_000_000;
/// A detector that has answered nothing for this long is not waited for.
const ANSWER_PATIENCE_NS: u64 = 10_000_000_000;
/// Nor is one that answers, but not these frames: on a busy machine several detectors seldom answer the same one.
const LONGEST_WAIT_NS: u64 = 60_000_000_000;

/// The images and boxes of one browser.
#[derive(Default)]
pub struct Streams {
    topics: BTreeMap<String, WatchedTopic>,
    results: BTreeMap<String, DetectorResults>,
    /// The topics of images and of boxes that a moment waits for: from a message on until a moment was sent without one.
    awaited: BTreeSet<String>,
    /// The stream that each detector answers, as its `~/state` names it.
    answered: BTreeMap<String, Arc<str>>,
}

#[derive(Default)]
struct WatchedTopic {
    /// The newest images that have not been sent.
    waiting: VecDeque<WaitingImage>,
    /// When the first image since the last ones that were sent came, in ticks of the clock.
    since_ns: u64,
    /// Whether the client has yet to draw the last image.
    busy: bool,
    sent: SentImages,
}

/// An image that has not been sent, undecoded.
struct WaitingImage {
    stamp: Time,
    /// When it came, in ticks of the clock.
    at_ns: u64,
    payload: Payload,
}

#[derive(Default)]
struct DetectorResults {
    node: String,
    newest: VecDeque<DetectorResult>,
}

struct DetectorResult {
    boxes: Arc<Detection2DArray>,
    /// When they came, in ticks of the clock.
    at_ns: u64,
    /// The stream that they were found in; unknown for a detector without `~/state`.
    stream: Option<Arc<str>>,
}

/// An image that may be sent now, with the boxes that belong to it.
pub struct NextImage {
    pub topic: String,
    pub stamp: Time,
    /// CDR of the image.
    pub payload: Payload,
    /// Boxes of this very image, by the topic of their detector.
    pub boxes: Vec<TopicBoxes>,
    /// Labels of its frame, by their topic.
    pub truth: Vec<TopicBoxes>,
}

type TopicBoxes = (String, Arc<Detection2DArray>);

impl Streams {
    /// Shows exactly `topics` from now on.
    pub fn watch(&mut self, topics: &[String]) {
        self.topics.retain(|topic, _| topics.contains(topic));
        self.awaited.retain(|topic| topics.contains(topic) || self.results.contains_key(topic));
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
            stream.since_ns = now_ns;
        }
        self.awaited.insert(topic.to_owned());
        stream.waiting.push_back(WaitingImage { stamp, at_ns: now_ns, payload });
        drop_oldest(&mut stream.waiting, KEPT_BYTES, |image| image.payload.len());
    }

    pub(crate) fn boxes(&mut self, origin: &MessageOrigin, boxes: Arc<Detection2DArray>, now_ns: u64) {
        if !has_room(&self.results, &origin.topic) {
            return;
        }
        let results = self.results.entry(origin.topic.clone()).or_default();
        self.awaited.insert(origin.topic.clone());
        results.node.clone_from(&origin.node);
        let stream = self.answered.get(&origin.node).cloned();
        results.newest.push_back(DetectorResult { boxes, at_ns: now_ns, stream });
        if results.newest.len() > KEPT_BOXES {
            results.newest.pop_front();
        }
    }

    /// Takes the `~/state` of a detector, which has the stamp of the first image that it holds for.
    pub(crate) fn state(&mut self, node: &str, state: &DiagnosticArray) {
        let Some(stream) = state.value("stream").filter(|_| has_room(&self.answered, node)) else { return };
        let stream: Arc<str> = stream.into();
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

    /// Notes the image that was sent, and what its samples mean.
    pub fn sent(&mut self, topic: &str, image: Arc<StampedFrame>, scale: Option<StreamScale>) {
        if let Some(stream) = self.topics.get_mut(topic) {
            stream.sent.push(image, scale);
        }
    }

    /// Returns the images that can be sent now: `together` those of one camera and one stamp, for which all topics of the camera wait,
    /// else the newest one of a topic. An image that detectors answer is held back until their boxes are there, so that boxes are drawn on the image that they were found in.
    ///
    /// No image is waited for longer than three seconds, and what was not there then is not waited for again before it has come: a
    /// replay that is paused for long, and then plays a single message, loses neither a topic nor the boxes. Where detectors have
    /// answered different frames for three seconds, as on a busy machine, each topic has the newest image that was answered. Boxes are
    /// waited for at most a minute, and at most ten seconds after the last boxes of their detector.
    pub fn next(&mut self, graph: &GraphView, together: bool, now_ns: u64) -> Vec<NextImage> {
        let mut groups: BTreeMap<&str, Vec<&String>> = BTreeMap::new();
        for topic in self.topics.keys() {
            let group = if together { graph.camera(topic) } else { topic };
            groups.entry(group).or_default().push(topic);
        }
        // A group whose images were sent is busy until they are drawn, so that each one has its turn.
        let moment = groups.into_values().find_map(|topics| {
            let stamps = self.next_stamps(graph, &topics, now_ns)?;
            Some(topics.into_iter().cloned().zip(stamps).collect::<Vec<_>>())
        });
        let next = moment.into_iter().flatten();
        next.filter_map(|(topic, stamp)| self.take(graph, topic, stamp, now_ns)).collect()
    }

    /// Returns the stamp of the image of each of `topics` that is sent next: the newest one of which all is there that is waited for, or
    /// after three seconds that of the newest image of each topic that has its boxes.
    fn next_stamps(&self, graph: &GraphView, topics: &[&String], now_ns: u64) -> Option<Vec<Option<Time>>> {
        let streams = || topics.iter().map(|&topic| (topic, &self.topics[topic]));
        if streams().any(|(_, stream)| stream.busy) {
            return None;
        }
        let waited_ns = streams().map(|(_, stream)| stream.waited_ns(now_ns)).max().unwrap_or(0);
        let is_answered = |topic: &String, image: &WaitingImage| {
            self.missing(graph, topic, image).all(|boxes| self.is_silent(boxes, waited_ns, now_ns))
        };
        let is_whole = |stamp: &Time| {
            streams().all(|(topic, stream)| match stream.place(*stamp) {
                Some(place) => is_answered(topic, &stream.waiting[place]),
                None => !self.awaited.contains(topic),
            })
        };
        let awaited = streams().find(|(topic, _)| self.awaited.contains(*topic));
        let newest_first = awaited.into_iter().flat_map(|(_, stream)| stream.waiting.iter().rev());
        if let Some(stamp) = newest_first.map(|image| image.stamp).find(is_whole) {
            return Some(vec![Some(stamp); topics.len()]);
        }
        let newest_answered = |(topic, stream): (&String, &WatchedTopic)| {
            let newest = stream.waiting.iter().rev().find(|image| is_answered(topic, image));
            // A topic without images holds up nothing, one without boxes does.
            (stream.waiting.is_empty() || newest.is_some()).then(|| newest.map(|image| image.stamp))
        };
        (waited_ns >= PATIENCE_NS).then(|| streams().map(newest_answered).collect())?
    }

    /// Takes the image of `stamp` on `topic` to send it. What is not there is no longer waited for.
    fn take(
        &mut self,
        graph: &GraphView,
        topic: String,
        stamp: Option<Time>,
        now_ns: u64,
    ) -> Option<NextImage> {
        let stream = self.topics.get_mut(&topic)?;
        stream.since_ns = now_ns;
        let Some(place) = stamp.and_then(|stamp| stream.place(stamp)) else {
            self.awaited.remove(&topic);
            return None;
        };
        stream.busy = true;
        // Older ones are never shown later.
        let image = stream.waiting.drain(..=place).next_back()?;
        let missing: Vec<String> = self.missing(graph, &topic, &image).cloned().collect();
        self.awaited.retain(|awaited| !missing.contains(awaited));
        let found = |d: &DetectorView| Some((d.topic.clone(), self.boxes_of(graph, d, &topic, &image)?));
        // The labels of a frame are in the namespace of its camera.
        let labels = graph.truths.iter().filter(|truth| namespace(truth) == graph.camera(&topic));
        let label = |truth: &String| {
            Some((truth.clone(), self.results.get(truth)?.of_image(&image).next()?.boxes.clone()))
        };
        let boxes = graph.detectors.iter().filter_map(found).collect();
        let truth = labels.filter_map(label).collect();
        Some(NextImage { topic, stamp: image.stamp, payload: image.payload, boxes, truth })
    }

    /// Returns the topics of the detectors that are waited for, answer the images of `topic` and have not answered `image`.
    fn missing<'a>(
        &'a self,
        graph: &'a GraphView,
        topic: &'a String,
        image: &'a WaitingImage,
    ) -> impl Iterator<Item = &'a String> {
        let is_missing = move |detector: &&DetectorView| {
            let stream = self.answered.get(&detector.node).map(|stream| &**stream);
            self.awaited.contains(&detector.topic)
                && shows(graph, detector, stream, topic)
                && self.boxes_of(graph, detector, topic, image).is_none()
        };
        graph.detectors.iter().filter(is_missing).map(|detector| &detector.topic)
    }

    /// Returns whether the detector that publishes `boxes` is no longer waited for, by images that have waited for `waited_ns`.
    fn is_silent(&self, boxes: &str, waited_ns: u64, now_ns: u64) -> bool {
        let newest = self.results.get(boxes).and_then(|results| results.newest.back());
        let silent_ns = newest.map_or(waited_ns, |result| now_ns.saturating_sub(result.at_ns));
        waited_ns.min(silent_ns) >= ANSWER_PATIENCE_NS || waited_ns >= LONGEST_WAIT_NS
    }

    fn boxes_of(
        &self,
        graph: &GraphView,
        detector: &DetectorView,
        topic: &String,
        image: &WaitingImage,
    ) -> Option<Arc<Detection2DArray>> {
        let mut of_image = self.results.get(&detector.topic)?.of_image(image);
        let found = of_image.find(|result| shows(graph, detector, result.stream.as_deref(), topic));
        found.map(|result| result.boxes.clone())
    }

    /// Returns the image of `topic` and `stamp` that was sent, if it is still kept.
    pub fn sent_image(&self, topic: &str, stamp: Time) -> Option<Arc<StampedFrame>> {
        self.topics.get(topic)?.sent.image(stamp).map(|(image, _)| image.clone())
    }

    /// Returns the samples of `images`, named by topic and stamp, at column `u` and row `v`. Those that are no longer kept are left out.
    pub fn pixel(&self, u: usize, v: usize, images: Vec<(String, (i32, u32))>) -> Vec<PixelView> {
        let view = |(topic, (sec, nanosec)): (String, _)| {
            let (samples, radiance) = self.topics.get(&topic)?.sent.pixel(Time { sec, nanosec }, u, v)?;
            Some(PixelView { topic, radiance, samples })
        };
        images.into_iter().filter_map(view).collect()
    }
}

/// Drops the oldest of the images that are kept when there are too many. The newest one stays even if it is a huge one.
pub(crate) fn drop_oldest<T>(images: &mut VecDeque<T>, most: usize, size: impl Fn(&T) -> usize) {
    let mut bytes: usize = images.iter().map(&size).sum();
    while images.len() > 1 && (images.len() > KEPT || bytes > most) {
        bytes -= images.pop_front().map_or(0, |image| size(&image));
    }
}

impl DetectorResults {
    /// Returns the results with the stamp of `image`, the newest one first. A replay in a loop repeats its stamps: what was there long
    /// before the image is about an earlier one.
    fn of_image(&self, image: &WaitingImage) -> impl Iterator<Item = &DetectorResult> {
        let (stamp, earliest_ns) = (image.stamp, image.at_ns.saturating_sub(PATIENCE_NS));
        self.newest
            .iter()
            .rev()
            .filter(move |result| result.boxes.header.stamp == stamp && result.at_ns >= earliest_ns)
    }
}

impl WatchedTopic {
    /// Returns the place of the image of `stamp` among those that wait.
    fn place(&self, stamp: Time) -> Option<usize> {
        self.waiting.iter().rposition(|image| image.stamp == stamp)
    }

    /// Returns how long images have waited.
    fn waited_ns(&self, now_ns: u64) -> u64 {
        if self.waiting.is_empty() { 0 } else { now_ns.saturating_sub(self.since_ns) }
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
            several.contains(topic)
                && detector.topic.starts_with(&format!("{}{}/", detector.node, namespace(topic)))
        }
    }
}

#[cfg(test)]
mod tests {
    use modulo_core::Frame;
    use modulo_msgs::diagnostic_msgs::{DiagnosticStatus, KeyValue};
    use modulo_msgs::image::encode_frame;
    use modulo_msgs::std_msgs::Header;
    use ndarray::Array3;

    use super::*;

    const SECOND_NS: u64 = 1_000_000_000;

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

    /// The next image of a client that shows the newest image of each topic.
    fn one(streams: &mut Streams, graph: &GraphView, now_ns: u64) -> Option<NextImage> {
        streams.next(graph, false, now_ns).pop()
    }

    /// Topics, stamps and numbers of boxes of the next moment.
    fn moment(streams: &mut Streams, graph: &GraphView, now_ns: u64) -> Vec<(String, u64, usize)> {
        let next = streams.next(graph, true, now_ns).into_iter();
        let view = |image: NextImage| {
            let topic = image.topic.clone();
            let (ns, boxes) = stamp(Some(image)).expect("there is one");
            (topic, ns, boxes)
        };
        next.map(view).collect()
    }

    #[test]
    fn images_of_one_moment_have_one_stamp_and_wait_for_the_slowest() {
        let (mut streams, graph) = (Streams::default(), detector(&["/recovered"]));
        let both = ["/modulo".to_owned(), "/recovered".to_owned()];
        streams.watch(&both);
        streams.boxes(&origin(), boxes(3), 0);
        streams.boxes(&origin(), boxes(9), 0);
        for ns in 1..=5 {
            streams.image("/modulo", image(ns), 0);
        }
        let alone = [(both[0].clone(), 5, 0)];
        assert_eq!(moment(&mut streams, &graph, 10), alone, "nothing has come on the other topic yet");
        streams.drawn("/modulo");
        for ns in 6..=8 {
            streams.image("/modulo", image(ns), 20);
        }
        streams.image("/recovered", image(6), 20);
        assert_eq!(moment(&mut streams, &graph, 20), [], "the boxes of image 6 are not there");
        streams.boxes(&origin(), boxes(6), 20);
        let both_of = |ns, found| [(both[0].clone(), ns, 0), (both[1].clone(), ns, found)];
        assert_eq!(moment(&mut streams, &graph, 20), both_of(6, 1), "7 and 8 of the faster topic wait");
        streams.image("/recovered", image(8), 30);
        streams.boxes(&origin(), boxes(8), 30);
        streams.drawn("/modulo");
        assert_eq!(moment(&mut streams, &graph, 30), [], "the client has not drawn the other one");
        streams.drawn("/recovered");
        assert_eq!(moment(&mut streams, &graph, 30), both_of(8, 1));
        both.iter().for_each(|topic| streams.drawn(topic));
        streams.image("/modulo", image(9), 40);
        assert_eq!(moment(&mut streams, &graph, 39 + PATIENCE_NS), []);
        let late = [(both[0].clone(), 9, 0)];
        assert_eq!(moment(&mut streams, &graph, 40 + PATIENCE_NS), late, "a silent one is not waited for");
        streams.drawn("/modulo");
        streams.image("/modulo", image(10), 50 + PATIENCE_NS);
        assert_eq!(moment(&mut streams, &graph, 50 + PATIENCE_NS).len(), 1, "nor is it later");
    }

    /// The first message after a long pause belongs to the moment of those that follow from it.
    #[test]
    fn a_paused_replay_plays_whole_moments() {
        let (mut streams, graph) = (Streams::default(), detector(&["/recovered"]));
        let both = ["/modulo".to_owned(), "/recovered".to_owned()];
        streams.watch(&both);
        for round in 0..3 {
            let pressed_ns = round * 180 * SECOND_NS;
            let moment_at =
                |streams: &mut Streams, ms: u64| moment(streams, &graph, pressed_ns + ms * 1_000_000);
            streams.image("/modulo", image(round), pressed_ns);
            if round > 0 {
                assert_eq!(moment_at(&mut streams, 50), [], "the recovered image is not there");
            }
            streams.image("/recovered", image(round), pressed_ns + 100_000_000);
            if round > 0 {
                assert_eq!(moment_at(&mut streams, 150), [], "the boxes are not there");
            }
            streams.boxes(&origin(), boxes(round), pressed_ns + 200_000_000);
            let whole = [(both[0].clone(), round, 0), (both[1].clone(), round, 1)];
            assert_eq!(moment_at(&mut streams, 250), whole);
            both.iter().for_each(|topic| streams.drawn(topic));
        }
    }

    /// Two cameras have no stamp in common.
    #[test]
    fn each_camera_has_moments_of_its_own() {
        let (mut streams, graph) = (Streams::default(), GraphView::default());
        let topics = ["/front/modulo", "/front/recovered", "/rear/recovered"].map(str::to_owned);
        streams.watch(&topics);
        let mut shown = Vec::new();
        for round in 0..3 {
            let (front, rear, now_ns) = (10 * round + 1, 10 * round + 2, round * PATIENCE_NS / 10);
            streams.image(&topics[0], image(front), now_ns);
            streams.image(&topics[2], image(rear), now_ns);
            // The first image of a topic says that there are more of them.
            shown.extend(moment(&mut streams, &graph, now_ns).into_iter().filter(|_| round > 0));
            streams.image(&topics[1], image(front), now_ns);
            for _ in 0..2 {
                shown.extend(moment(&mut streams, &graph, now_ns).into_iter().filter(|_| round > 0));
            }
            topics.iter().for_each(|topic| streams.drawn(topic));
        }
        let round = |rear: usize, ns| {
            [(topics[rear].clone(), ns + 1, 0), (topics[0].clone(), ns, 0), (topics[1].clone(), ns, 0)]
        };
        assert_eq!(shown, [round(2, 11), round(2, 21)].concat());
    }

    #[test]
    fn a_replay_in_a_loop_has_no_boxes_of_its_last_round() {
        let (mut streams, graph) = (Streams::default(), detector(&["/recovered"]));
        streams.watch(&["/recovered".into()]);
        streams.boxes(&origin(), boxes(1), 0);
        let round = 2 * PATIENCE_NS;
        streams.image("/recovered", image(1), round);
        streams.boxes(&origin(), boxes(9), round);
        assert_eq!(stamp(one(&mut streams, &graph, round)), None, "the boxes of this round are not there");
        streams.boxes(&origin(), boxes(1), round + 1);
        assert_eq!(stamp(one(&mut streams, &graph, round + 1)), Some((1, 1)));
    }

    #[test]
    fn labels_are_those_of_the_frame() {
        let (mut streams, mut graph) = (Streams::default(), detector(&["/recovered"]));
        graph.truths = ["/ground_truth", "/front/ground_truth"].map(str::to_owned).into();
        streams.watch(&["/modulo".into()]);
        for (node, topic) in [("/camera", "/ground_truth"), ("/front/camera", "/front/ground_truth")] {
            streams.boxes(&MessageOrigin { node: node.into(), topic: topic.into() }, boxes(7), 0);
        }
        streams.image("/modulo", image(7), 0);
        let next = one(&mut streams, &graph, 0).expect("an image");
        let topics: Vec<&str> = next.truth.iter().map(|(topic, _)| topic.as_str()).collect();
        assert_eq!(topics, ["/ground_truth"]);
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
        assert_eq!(stamp(one(&mut streams, &graph, 0)), Some((1, 1)));
        assert_eq!(stamp(one(&mut streams, &graph, 0)), None, "the browser has not drawn image 1");
        streams.drawn("/recovered");
        assert_eq!(stamp(one(&mut streams, &graph, 0)), None, "the boxes of image 2 are not there");
        streams.boxes(&origin(), boxes(3), 10);
        assert_eq!(stamp(one(&mut streams, &graph, 20)), Some((3, 1)), "the newest one");
        streams.drawn("/recovered");
        streams.image("/recovered", image(4), 20);
        streams.boxes(&origin(), boxes(5), 30);
        assert_eq!(stamp(one(&mut streams, &graph, 29 + ANSWER_PATIENCE_NS)), None);
        let now_ns = 30 + ANSWER_PATIENCE_NS;
        assert_eq!(stamp(one(&mut streams, &graph, now_ns)), Some((4, 0)), "nothing was answered for long");
        streams.drawn("/recovered");
        let later = 2 * ANSWER_PATIENCE_NS;
        streams.image("/recovered", image(6), later);
        assert_eq!(stamp(one(&mut streams, &graph, later)), Some((6, 0)), "the detector is silent");
    }

    /// Two detectors that skip frames on a busy machine seldom answer the same one: frames without boxes are not shown for that.
    #[test]
    fn a_detector_that_answers_other_frames_is_waited_for_a_minute() {
        let (mut streams, graph) = (Streams::default(), detector(&["/recovered"]));
        streams.watch(&["/recovered".into()]);
        streams.boxes(&origin(), boxes(0), 0);
        for second in 1..=60 {
            streams.image("/recovered", image(2 * second), second * SECOND_NS);
            streams.boxes(&origin(), boxes(2 * second + 1), second * SECOND_NS);
            assert_eq!(stamp(one(&mut streams, &graph, second * SECOND_NS)), None, "after {second} s");
        }
        let now_ns = SECOND_NS + LONGEST_WAIT_NS;
        streams.boxes(&origin(), boxes(9), now_ns);
        assert_eq!(stamp(one(&mut streams, &graph, now_ns)), Some((120, 0)), "the newest one");
    }

    /// Where the detectors of two streams answer different frames, no frame is shown without the image of one of them for that.
    #[test]
    fn a_moment_without_boxes_is_no_reason_to_show_fewer_images() {
        let (mut streams, graph) = (Streams::default(), detector(&["/recovered"]));
        let both = ["/modulo".to_owned(), "/recovered".to_owned()];
        streams.watch(&both);
        streams.boxes(&origin(), boxes(0), 0);
        for (ns, topics) in [(1, &both[..]), (2, &both[..1])] {
            topics.iter().for_each(|topic| streams.image(topic, image(ns), 0));
        }
        streams.boxes(&origin(), boxes(9), PATIENCE_NS);
        assert_eq!(moment(&mut streams, &graph, 2 * PATIENCE_NS), [], "frame 1 waits for its boxes");
        streams.boxes(&origin(), boxes(1), 2 * PATIENCE_NS);
        assert_eq!(moment(&mut streams, &graph, 2 * PATIENCE_NS).len(), 2);
    }

    #[test]
    fn streams_whose_detectors_answer_other_frames_go_on() {
        let (mut streams, mut graph) = (Streams::default(), detector(&["/recovered"]));
        let other = MessageOrigin { node: "/other".into(), topic: "/other_boxes".into() };
        let (node, topic) = (other.node.clone(), other.topic.clone());
        graph.detectors.push(DetectorView {
            node,
            topic,
            inputs: vec!["/modulo".into()],
            offers: Vec::new(),
        });
        streams.watch(&["/modulo".into(), "/recovered".into()]);
        for (ns, detector) in [(1, &other), (2, &origin())] {
            ["/modulo", "/recovered"].iter().for_each(|topic| streams.image(topic, image(ns), 0));
            streams.boxes(detector, boxes(ns), 0);
        }
        assert_eq!(moment(&mut streams, &graph, PATIENCE_NS - 1), []);
        let mixed = [("/modulo".into(), 1, 1), ("/recovered".into(), 2, 1)];
        assert_eq!(moment(&mut streams, &graph, PATIENCE_NS), mixed);
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
                // An image that nobody answers is sent at the latest after ten seconds.
                let next =
                    one(&mut streams, &graph, 0).or_else(|| one(&mut streams, &graph, ANSWER_PATIENCE_NS));
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
        assert_eq!(stamp(one(&mut streams, &graph, 0)), Some((1, 1)));
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
            stamp(one(&mut streams, &graph, 0)),
            Some((1, 0)),
            "the detector has answered no image of /rear"
        );
        streams.image("/front/recovered", image(1), 0);
        assert_eq!(stamp(one(&mut streams, &graph, 0)), Some((1, 1)));
    }

    #[test]
    fn few_images_wait() {
        let mut streams = Streams::default();
        streams.image("/other", image(1), 0);
        assert!(one(&mut streams, &GraphView::default(), 0).is_none(), "a topic that is not watched");
        streams.watch(&["/modulo".into()]);
        for ns in 0..2 * KEPT as u64 {
            streams.image("/modulo", image(ns), 0);
        }
        assert_eq!(streams.topics["/modulo"].waiting.len(), KEPT);
        assert_eq!(stamp(one(&mut streams, &GraphView::default(), 0)), Some((2 * KEPT as u64 - 1, 0)));
        assert!(streams.topics["/modulo"].waiting.is_empty(), "older images are never shown later");
        streams.image("/modulo", Payload::new(vec![0, 1]), 0);
        assert!(streams.topics["/modulo"].waiting.is_empty(), "a cut message");
    }
}
