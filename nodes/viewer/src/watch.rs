//! [`Watch`]: the newest messages of the topics that one client is shown, and its next image as a JPEG file.

use std::collections::BTreeSet;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use modulo_core::Samples;
use modulo_images::FileFormat;
use modulo_runtime::{Message, MessageKind, StampedFrame};
use tokio::sync::Notify;
use tokio::task::spawn_blocking;

use crate::feed::{Feed, Heard, MessageOrigin, Session, Statuses, state_topic};
use crate::protocol::{BoxView, GraphView, ImageHeader};
use crate::streams::{NextImage, Streams};

/// Interval at which the graph and the statuses are looked at.
pub(crate) const LOOK: Duration = Duration::from_millis(500);

/// The messages that wait for one client; the callbacks of the transport fill it.
pub(crate) struct Watch {
    session: Arc<Session>,
    inbox: Mutex<Inbox>,
    /// Told of each message.
    pub news: Notify,
}

/// The messages that have arrived for one client.
#[derive(Default)]
pub(crate) struct Inbox {
    pub streams: Streams,
    pub statuses: Statuses,
    pub statuses_changed: bool,
}

/// An image that can be sent now.
pub(crate) struct JpegImage {
    pub image: Arc<StampedFrame>,
    pub header: ImageHeader,
    pub jpeg: Vec<u8>,
}

impl Watch {
    pub fn new(session: Arc<Session>) -> Arc<Self> {
        Arc::new(Self { session, inbox: Mutex::default(), news: Notify::new() })
    }

    pub fn inbox(&self) -> MutexGuard<'_, Inbox> {
        self.inbox.lock().unwrap_or_else(PoisonError::into_inner)
    }

    pub fn feed(self: &Arc<Self>) -> Feed {
        let watch = Arc::downgrade(self);
        Feed::new(self.session.clone(), move |origin, heard| {
            let Some(watch) = watch.upgrade() else { return };
            watch.inbox().hear(origin, heard, watch.session.clock.ticks_ns());
            watch.news.notify_one();
        })
    }

    /// Looks at the graph, and subscribes `feed` to what the client is shown. Returns the feed, the graph and what failed.
    pub async fn look(&self, mut feed: Feed) -> (Feed, GraphView, Vec<String>) {
        let watched: BTreeSet<String> = self.inbox().streams.watched().cloned().collect();
        let wanted = move |graph: &GraphView| {
            let reads = |input| watched.contains(input);
            let detectors = graph.detectors.iter().filter(|detector| detector.inputs.iter().any(reads));
            let topics = detectors.flat_map(|detector| [detector.topic.clone(), state_topic(&detector.node)]);
            let statuses = ["/diagnostics", "/sensor_info"].map(str::to_owned);
            topics.chain(statuses).chain(watched.iter().cloned()).collect()
        };
        let looked = spawn_blocking(move || {
            let (graph, errors) = feed.look(wanted);
            (feed, graph, errors)
        });
        looked.await.expect("a look at the graph does not panic")
    }

    /// Returns the next image that is due, or why it cannot be shown.
    pub async fn next(&self, graph: &GraphView) -> Option<Result<JpegImage, String>> {
        let now = self.session.clock.ticks_ns();
        let next = self.inbox().streams.next(graph, now)?;
        let topic = next.topic.clone();
        let encoded = spawn_blocking(move || encode(&next)).await.expect("encoding does not panic");
        Some(encoded.map_err(|why| {
            self.inbox().streams.drawn(&topic);
            format!("{topic}: {why}")
        }))
    }
}

impl Inbox {
    fn hear(&mut self, origin: &MessageOrigin, heard: Heard, now_ns: u64) {
        match heard {
            Heard::Image(payload) => self.streams.image(&origin.topic, payload, now_ns),
            Heard::Boxes(boxes) => self.streams.boxes(origin, boxes, now_ns),
            Heard::Statuses(array) if origin.topic == state_topic(&origin.node) => {
                self.streams.state(&origin.node, &array);
            }
            Heard::Statuses(array) => {
                self.statuses.note(&array);
                self.statuses_changed = true;
            }
        }
    }
}

fn encode(next: &NextImage) -> Result<JpegImage, String> {
    let Message::Image(image) =
        Message::decode(MessageKind::Image, &next.payload).map_err(|why| why.to_string())?
    else {
        return Err("is no image".to_owned());
    };
    let (shown, white) = eight_bits(&image.frame);
    let jpeg = modulo_images::encode(&shown, FileFormat::Jpeg).map_err(|why| why.to_string())?;
    let boxes = next.boxes.iter().map(|(detector, boxes)| (detector.clone(), BoxView::of(boxes)));
    let header = ImageHeader {
        topic: next.topic.clone(),
        stamp: (image.header.stamp.sec, image.header.stamp.nanosec),
        width: image.frame.width(),
        height: image.frame.height(),
        white,
        boxes: boxes.collect(),
    };
    Ok(JpegImage { image, header, jpeg })
}

/// Returns the image with 8 bits, and the value that became white if it had more. Values in between keep their ratio.
fn eight_bits(frame: &modulo_core::Frame) -> (modulo_core::Frame, Option<f32>) {
    if let Samples::U8(_) = frame.samples() {
        return (frame.clone(), None);
    }
    let values = frame.to_f32();
    let white = values.iter().copied().fold(1.0, f32::max);
    let scaled = values.mapv(|value| (255.0 * value / white).round() as u8);
    (modulo_core::Frame::from_u8(scaled).expect("the shape is that of a frame"), Some(white))
}
