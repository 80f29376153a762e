//! Recording from a running graph: every topic that appears is subscribed and
//! written as it comes, without decoding.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::time::Duration;

use modulo_runtime::transport::gaps::Gaps;
use modulo_runtime::transport::keys::{self, Endpoint, EntityKind};
use modulo_runtime::transport::zenoh::{RawSample, ZenohTransport};
use modulo_runtime::transport::{Guard, TransportError};
use modulo_runtime::{Clock, Place, Stop, Urgency};

use crate::bag::{BagError, BagTopic, TopicCount};
use crate::record::Recorder;

/// The name of the node in ROS 2, too.
const NODE: &str = "rosbag2_recorder";
/// How often the graph is looked at for new topics.
const GLANCE: Duration = Duration::from_millis(50);

/// Why a recording failed.
#[derive(Debug, thiserror::Error)]
pub enum CaptureError {
    /// The bag.
    #[error(transparent)]
    Bag(#[from] BagError),
    /// The wire.
    #[error(transparent)]
    Transport(#[from] TransportError),
}

/// What a recording holds.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Captured {
    /// Topics with their counts.
    pub topics: Vec<TopicCount>,
    /// Messages that were lost on the way here, by topic.
    pub lost: BTreeMap<String, u64>,
}

/// Records `topics` (`None`: all) of the graph of `transport` until `stop`.
/// What has arrived by then is written.
///
/// # Errors
/// [`CaptureError`] when a topic cannot be subscribed or the disk is full.
pub fn capture(
    transport: &ZenohTransport,
    clock: &dyn Clock,
    mut recorder: Recorder,
    topics: Option<&[String]>,
    stop: &Stop,
) -> Result<Captured, CaptureError> {
    let (samples, arrived) = channel();
    let place = Place { name: NODE.into(), namespace: "/".into(), remaps: Vec::new() };
    let _node = modulo_runtime::transport::Transport::announce(transport, &place)?;
    let mut wires = Wires { known: BTreeSet::new(), guards: Vec::new(), samples };
    let mut losses = Losses::default();
    while stop.urgency() == Urgency::None {
        wires.subscribe_new(transport, &place, &mut recorder, topics)?;
        write_arrived(&arrived, GLANCE, clock, &mut recorder, &mut losses)?;
        recorder.settle(clock.now_ns())?;
    }
    drop(wires);
    write_arrived(&arrived, Duration::ZERO, clock, &mut recorder, &mut losses)?;
    Ok(Captured { topics: recorder.finish()?, lost: losses.by_topic })
}

/// A sample and the topic it came on.
type Arrival = (BagTopic, RawSample);

struct Wires {
    known: BTreeSet<(String, String)>,
    guards: Vec<Guard>,
    samples: Sender<Arrival>,
}

impl Wires {
    fn subscribe_new(
        &mut self,
        transport: &ZenohTransport,
        place: &Place,
        recorder: &mut Recorder,
        topics: Option<&[String]>,
    ) -> Result<(), CaptureError> {
        let graph = transport.graph();
        let publishers = graph.tokens().filter(|t| t.kind == EntityKind::Publisher);
        for endpoint in publishers.filter_map(|t| t.endpoint.as_ref()) {
            let chosen = topics.is_none_or(|topics| topics.contains(&endpoint.topic));
            if !chosen || !self.known.insert((endpoint.topic.clone(), endpoint.type_hash.clone())) {
                continue;
            }
            let topic = bag_topic(endpoint);
            if topic.schema.is_empty() {
                tracing::warn!(
                    "{} is recorded without a definition: this suite has none of {}",
                    topic.name,
                    topic.type_name
                );
            }
            match recorder.announce(&topic) {
                // One publisher that is wrong must not end the recording of all others.
                Err(why @ BagError::TypeConflict { .. }) => {
                    tracing::warn!("{why}: not recorded");
                    continue;
                }
                announced => announced?,
            }
            let samples = self.samples.clone();
            self.guards.push(transport.subscribe_raw(place, endpoint, move |sample| {
                // Fails only when the recording has ended.
                let _ = samples.send((topic.clone(), sample));
            })?);
        }
        Ok(())
    }
}

fn bag_topic(endpoint: &Endpoint) -> BagTopic {
    let type_name = modulo_msgs::ros_name(&endpoint.dds_type);
    let mut topic = BagTopic::new(&endpoint.topic, &type_name, keys::qos_of(&endpoint.qos));
    if endpoint.type_hash != keys::NO_HASH {
        topic.type_hash.clone_from(&endpoint.type_hash);
    }
    topic
}

/// Samples that never came, by topic.
#[derive(Default)]
struct Losses {
    gaps: Gaps,
    by_topic: BTreeMap<String, u64>,
}

impl Losses {
    fn note(&mut self, topic: &str, sample: &RawSample) {
        let missing = sample.attachment.as_ref().map_or(0, |attachment| self.gaps.step(attachment));
        if missing > 0 {
            *self.by_topic.entry(topic.to_owned()).or_default() += missing;
        }
    }
}

/// Writes what has arrived, waiting at most `patience` for the first of it.
fn write_arrived(
    arrived: &Receiver<Arrival>,
    patience: Duration,
    clock: &dyn Clock,
    recorder: &mut Recorder,
    losses: &mut Losses,
) -> Result<(), BagError> {
    let mut patience = patience;
    loop {
        let (topic, sample) = match arrived.recv_timeout(patience) {
            Ok(arrival) => arrival,
            Err(RecvTimeoutError::Timeout | RecvTimeoutError::Disconnected) => return Ok(()),
        };
        patience = Duration::ZERO;
        losses.note(&topic.name, &sample);
        let now = clock.now_ns();
        let sent = sample.attachment.map_or(now, |a| u64::try_from(a.stamp_ns).unwrap_or(now));
        recorder.record(&topic, now, sent, &sample.payload)?;
    }
}
