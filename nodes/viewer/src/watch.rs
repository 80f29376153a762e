//! [`Watch`]: the newest messages of the topics that one client is shown, its next images as JPEG files, and what has changed.

use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use modulo_images::FileFormat;
use modulo_middleware::transport::{Guard, RawSample, TransportError};
use modulo_msgs::diagnostic_msgs::DiagnosticArray;
use modulo_msgs::ros_name;
use modulo_msgs::std_msgs::Time;
use modulo_msgs::vision_msgs::Detection2DArray;
use modulo_runtime::sensor::recovery::Recovery;
use modulo_runtime::sensor_info::{self, Descriptions};
use modulo_runtime::topic::RECOVERY_TOPIC;
use modulo_runtime::wire::keys::{Endpoint, EntityKind};
use modulo_runtime::{Message, MessageKind, SensorModel, StampedFrame, StreamKind, StreamScale};
use tokio::sync::Notify;
use tokio::task::{JoinHandle, spawn_blocking};

use crate::cameras::{FirstStreams, namespace};
use crate::expose::Captured;
use crate::graph::{MessageOrigin, Session, Statuses, author, state_topic};
use crate::protocol::{BoxView, Event, ExposeRequest, GraphView, ImageHeader, MomentHeader, Notice, Step};
use crate::shown::ShownImage;
use crate::streams::{NextImage, Streams};

/// Interval at which the graph and the statuses are looked at.
pub(crate) const LOOK: Duration = Duration::from_millis(500);
/// Notices that wait for a client: those of 2 s of 8 cameras at 30 Hz, each with two nodes behind it.
const NOTICES: usize = 1440;

/// The reader of the images.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Audience {
    /// A page, which chooses the exposure itself, and is told what becomes of each frame.
    Page,
    /// Foxglove, which shows images as they are.
    Foxglove,
}

/// The subscriptions of one client, by topic. They belong to its task: the last callback that fills its [`Watch`] must not end itself.
pub(crate) type Subscriptions = Arc<Mutex<BTreeMap<String, Guard>>>;

/// The messages that wait for one client; the callbacks of the transport fill it.
pub(crate) struct Watch {
    session: Arc<Session>,
    audience: Audience,
    inbox: Mutex<Inbox>,
    /// Told of each message.
    pub news: Notify,
}

#[derive(Default)]
pub(crate) struct Inbox {
    pub streams: Streams,
    /// Whether the images of one stamp are shown at the same time, or the newest one of each topic.
    pub together: bool,
    pub statuses: Statuses,
    notices: VecDeque<Notice>,
    lost_notices: usize,
    first: FirstStreams,
    sensors: Descriptions,
}

pub(crate) struct JpegImage {
    pub image: Arc<StampedFrame>,
    pub scale: Option<StreamScale>,
    pub header: ImageHeader,
    pub jpeg: Vec<u8>,
}

/// The images that can be sent now, and why others of them cannot be shown.
pub(crate) struct Moment {
    pub at_ms: f64,
    together: bool,
    camera: String,
    pub images: Vec<JpegImage>,
    pub errors: Vec<String>,
}

impl Moment {
    /// Returns the binary message for the page.
    pub fn message(&self) -> Vec<u8> {
        let images = self.images.iter().map(|image| image.header.clone()).collect();
        let (together, camera) = (self.together, self.camera.clone());
        let header = MomentHeader { at_ms: self.at_ms, together, camera, images };
        let header = serde_json::to_vec(&header).expect("strings and finite numbers are JSON");
        let length = u32::try_from(header.len()).expect("a header is short");
        let mut message = [&length.to_le_bytes()[..], &header].concat();
        self.images.iter().for_each(|image| message.extend_from_slice(&image.jpeg));
        message
    }
}

impl Watch {
    pub fn new(session: Arc<Session>, audience: Audience) -> Arc<Self> {
        let inbox = Inbox { together: audience == Audience::Page, ..Inbox::default() };
        let inbox = Mutex::new(inbox);
        Arc::new(Self { session, audience, inbox, news: Notify::new() })
    }

    pub fn inbox(&self) -> MutexGuard<'_, Inbox> {
        self.inbox.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Looks at the graph, and subscribes to exactly what the client is shown. Returns the graph and what failed.
    pub async fn look(self: &Arc<Self>, subscribed: &Subscriptions) -> (GraphView, Vec<String>) {
        let (watch, subscribed) = (self.clone(), subscribed.clone());
        done(spawn_blocking(move || watch.follow_graph(&subscribed))).await
    }

    fn follow_graph(self: &Arc<Self>, subscribed: &Subscriptions) -> (GraphView, Vec<String>) {
        let graph = self.session.transport.graph();
        let mut view = GraphView::of(&self.session, &graph);
        let wanted = self.wanted(&view);
        let mut guards = subscribed.lock().unwrap_or_else(PoisonError::into_inner);
        guards.retain(|topic, _| wanted.contains(topic));
        let mut errors = Vec::new();
        for topic in wanted {
            let publisher = graph.endpoints(EntityKind::Publisher, &topic).next();
            let publisher = publisher.and_then(|token| Some((token.node_name(), token.endpoint.as_ref()?)));
            // A topic without a publisher has no type yet; it is looked at again.
            let (Some((node, endpoint)), false) = (publisher, guards.contains_key(&topic)) else { continue };
            match self.subscribe(author(node, &topic, &view.statuses), endpoint) {
                Ok(guard) => drop(guards.insert(topic, guard)),
                Err(why) => errors.push(why.to_string()),
            }
        }
        view.first = self.inbox().first.of(&view);
        (view, errors)
    }

    /// Returns the topics that the client is shown, and those that say what belongs to them.
    fn wanted(&self, graph: &GraphView) -> BTreeSet<String> {
        let watched: BTreeSet<String> = self.inbox().streams.watched().cloned().collect();
        let all = self.audience == Audience::Page;
        let reads = |input| watched.contains(input);
        let detectors = graph.detectors.iter().filter(|d| all || d.inputs.iter().any(reads));
        let topics = detectors.flat_map(|detector| [detector.topic.clone(), state_topic(&detector.node)]);
        let labels = graph.truths.iter().filter(|_| all).cloned();
        let is_needed = |topic: &&String| all || sensor_info::is_topic(topic);
        let statuses = graph.statuses.iter().filter(is_needed).cloned();
        topics.chain(labels).chain(statuses).chain(watched.iter().cloned()).collect()
    }

    /// Subscribes to what `node` has made. A message is heard in a thread of the transport, which must not wait.
    fn subscribe(self: &Arc<Self>, node: String, endpoint: &Endpoint) -> Result<Guard, TransportError> {
        // The subscription belongs to the watch, and does not keep it.
        let (watch, kind) =
            (Arc::downgrade(self), MessageKind::from_type_name(&ros_name(&endpoint.dds_type)));
        let origin = MessageOrigin { node, topic: endpoint.topic.clone() };
        let hear = move |sample: RawSample| {
            let (Some(watch), Some(kind)) = (watch.upgrade(), kind) else { return };
            let now_ns = watch.session.clock.ticks_ns();
            if kind == MessageKind::Image {
                watch.inbox().streams.image(&origin.topic, sample.payload, now_ns);
            } else {
                // One that cannot be read is left out: its reader in the suite counts it.
                match Message::decode(kind, &sample.payload) {
                    Ok(Message::Detections(boxes)) => watch.inbox().hear_boxes(&origin, boxes, &watch),
                    Ok(Message::Diagnostics(array)) => watch.inbox().hear_statuses(&origin, &array, &watch),
                    _ => return,
                }
            }
            watch.news.notify_one();
        };
        self.session.transport.subscribe_raw(&self.session.node_name, endpoint, hear)
    }

    /// Returns what is new for the page: the graph if it is no longer `known`, the statuses and the notices.
    pub fn events(&self, known: &mut GraphView, seen: GraphView) -> Vec<Event> {
        let mut events = Vec::new();
        if *known != seen {
            let warnings = seen.warnings.iter().filter(|warning| !known.warnings.contains(warning));
            events.extend(warnings.cloned().map(Event::Error));
            known.clone_from(&seen);
            events.push(Event::Graph(seen));
        }
        let fresh = self.inbox().statuses.take_fresh();
        if !fresh.is_empty() {
            events.push(Event::Status(fresh));
        }
        events.extend(self.notices());
        events
    }

    /// Returns what nodes have told of frames since the last call.
    pub fn notices(&self) -> Vec<Event> {
        let mut inbox = self.inbox();
        let lost = std::mem::take(&mut inbox.lost_notices);
        let lost = (lost > 0).then(|| Event::Error(format!("{lost} notices of frames found no room")));
        let notices: Vec<Notice> = inbox.notices.drain(..).collect();
        let notices = (!notices.is_empty()).then_some(Event::Notices(notices));
        notices.into_iter().chain(lost).collect()
    }

    /// Returns what is known of the frame that the page wants to expose anew.
    pub fn captured(&self, asked: &ExposeRequest) -> Result<Captured, String> {
        let (inbox, (sec, nanosec)) = (self.inbox(), asked.stamp);
        let stamp = Time { sec, nanosec };
        let (kind, _) = inbox.sensors.of(&asked.topic);
        let kind = kind.filter(|kind| [StreamKind::Recovered, StreamKind::Metered].contains(kind));
        let kind = kind.ok_or_else(|| format!("{} is no recovered image", asked.topic))?;
        let (_, sensors) = inbox.sensors.of(&asked.modulo);
        let sensor = sensors.and_then(|sensors| sensors.nearest(stamp)).cloned();
        let sensor = sensor.ok_or_else(|| format!("no sensor has described {}", asked.modulo))?;
        let modulo = inbox.streams.sent_image(&asked.modulo, stamp);
        let modulo = modulo.ok_or("the viewer no longer keeps the counts of this frame")?;
        let state = asked.detector.as_ref().and_then(|node| inbox.statuses.values(&state_topic(node)));
        Ok(Captured { modulo, sensor, kind, detector: state })
    }

    /// Returns the next images that are due; `None` if there are none.
    pub async fn next(&self, graph: &GraphView) -> Option<Moment> {
        let now = self.session.clock.ticks_ns();
        let (next, together) = {
            let mut inbox = self.inbox();
            let together = inbox.together;
            let next = inbox.streams.next(graph, together, now);
            let with_sensor = |image: NextImage| {
                let (kind, sensors) = inbox.sensors.of(&image.topic);
                ((kind, sensors.and_then(|sensors| sensors.nearest(image.stamp)).cloned()), image)
            };
            (next.into_iter().map(with_sensor).collect::<Vec<_>>(), together)
        };
        let camera = graph.camera(&next.first()?.1.topic).to_owned();
        let audience = self.audience;
        let encode_all = move || -> Vec<_> {
            next.iter().map(|(of, image)| (image.topic.clone(), encode(image, of, audience))).collect()
        };
        let encoded = done(spawn_blocking(encode_all)).await;
        let (mut images, mut errors) = (Vec::new(), Vec::new());
        for (topic, encoded) in encoded {
            match encoded {
                Ok(image) => images.push(image),
                Err(why) => {
                    self.inbox().streams.drawn(&topic);
                    errors.push(format!("{topic}: {why}"));
                }
            }
        }
        let at_ms = self.session.clock.now_ns() as f64 / 1e6;
        Some(Moment { at_ms, together, camera, images, errors })
    }
}

/// Waits for `work`. The end of the viewer, which cancels it, also ends the task that waits here.
pub(crate) async fn done<T>(work: JoinHandle<T>) -> T {
    match work.await {
        Ok(result) => result,
        Err(why) if why.is_cancelled() => std::future::pending().await,
        Err(why) => std::panic::resume_unwind(why.into_panic()),
    }
}

impl Inbox {
    fn hear_boxes(&mut self, origin: &MessageOrigin, boxes: Arc<Detection2DArray>, watch: &Watch) {
        self.note(watch, origin, boxes.header.stamp, Step::Detected { classes: classes(&boxes) });
        self.streams.boxes(origin, boxes, watch.session.clock.ticks_ns());
    }

    fn hear_statuses(&mut self, origin: &MessageOrigin, array: &DiagnosticArray, watch: &Watch) {
        if origin.topic == state_topic(&origin.node) {
            self.streams.state(&origin.node, array);
            return array.status.iter().for_each(|status| self.statuses.note(&origin.topic, status));
        }
        let is_sensor = sensor_info::is_topic(&origin.topic);
        if is_sensor {
            // A description that cannot be read is counted by its readers in the suite.
            let _ = self.sensors.note(&origin.topic, array);
            self.note(watch, origin, array.header.stamp, Step::Sensed);
        } else if origin.topic.rsplit('/').next() == Some(RECOVERY_TOPIC) {
            let trusted = Recovery::of(array).trusted;
            let message = array.status.first().map(|status| status.message.clone()).unwrap_or_default();
            let step = Step::Unwrapped { camera: namespace(&origin.topic).to_owned(), trusted, message };
            self.note(watch, origin, array.header.stamp, step);
        }
        // The page takes the sensor of the camera whose stream it shows.
        let topic = is_sensor.then_some(&*origin.topic);
        array.status.iter().for_each(|status| self.statuses.note(topic.unwrap_or(&status.name), status));
    }

    /// Keeps a notice for a page; the oldest one is left out when too many wait.
    fn note(&mut self, watch: &Watch, origin: &MessageOrigin, stamp: Time, step: Step) {
        if watch.audience != Audience::Page {
            return;
        }
        if self.notices.len() == NOTICES {
            self.notices.pop_front();
            self.lost_notices += 1;
        }
        let at_ms = watch.session.clock.now_ns() as f64 / 1e6;
        let (stamp, node) = ((stamp.sec, stamp.nanosec), origin.node.clone());
        self.notices.push_back(Notice { at_ms, stamp, node, step });
    }
}

fn classes(boxes: &Detection2DArray) -> BTreeMap<String, usize> {
    let mut classes = BTreeMap::new();
    for found in BoxView::of(boxes) {
        *classes.entry(found.class).or_default() += 1;
    }
    classes
}

fn encode(
    next: &NextImage,
    (kind, sensor): &(Option<StreamKind>, Option<SensorModel>),
    audience: Audience,
) -> Result<JpegImage, String> {
    let Message::Image(image) =
        Message::decode(MessageKind::Image, &next.payload).map_err(|why| why.to_string())?
    else {
        return Err("is no image".to_owned());
    };
    let scale = StreamScale::of(*kind, image.frame.depth(), sensor.as_ref(), 0);
    let shown = ShownImage::of(&image.frame, scale, audience);
    let jpeg = modulo_images::encode(&shown.frame, FileFormat::Jpeg).map_err(|why| why.to_string())?;
    let boxes = next.boxes.iter().map(|(detector, boxes)| (detector.clone(), BoxView::of(boxes)));
    let header = ImageHeader {
        topic: next.topic.clone(),
        stream: kind.map(StreamKind::word),
        stamp: (image.header.stamp.sec, image.header.stamp.nanosec),
        width: image.frame.width(),
        height: image.frame.height(),
        bytes: jpeg.len(),
        peaks: shown.peaks,
        stops: shown.stops,
        boxes: boxes.collect(),
        truth: next.truth.iter().flat_map(|(_, labels)| BoxView::of(labels)).collect(),
    };
    Ok(JpegImage { image, scale, header, jpeg })
}

#[cfg(test)]
mod tests {
    use tokio::runtime::Builder;

    use super::*;

    #[test]
    fn work_that_the_end_of_the_viewer_cancels_never_returns() {
        let ending = Builder::new_multi_thread().build().expect("a runtime");
        let other = Builder::new_current_thread().enable_time().build().expect("a runtime");
        let handle = ending.handle().clone();
        assert_eq!(other.block_on(done(handle.spawn_blocking(|| 7))), 7);
        ending.shutdown_background();
        let cancelled = handle.spawn_blocking(|| 8);
        let waited = async { tokio::time::timeout(Duration::from_millis(20), done(cancelled)).await };
        assert!(other.block_on(waited).is_err(), "it must not return");
    }
}
