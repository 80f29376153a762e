//! Recording from a running graph: every topic that appears is subscribed and written as it comes, without decoding.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;
use std::sync::mpsc::{Receiver, TryRecvError, channel};
use std::thread;
use std::time::Duration;

use modulo_bags::bag::{BagError, BagTopic, BagWriter, TopicCount};
use modulo_middleware::graph::discovery::LostPublisher;
use modulo_middleware::transport::queue::{Arrived, Keep, Lane, Limit, Queue};
use modulo_middleware::transport::zenoh::ZenohTransport;
use modulo_middleware::transport::{Guard, RawSample, Transport, TransportError};
use modulo_runtime::name::is_hidden;
use modulo_runtime::stop::Wake as _;
use modulo_runtime::topic::{Durability, Profile};
use modulo_runtime::wire::keys::{self, Endpoint, EntityKind};
use modulo_runtime::{Clock, NodeName, Stop, Urgency};

use crate::LiveError;

/// The name of the node in ROS 2, too.
const NODE: &str = "rosbag2_recorder";
/// Interval at which the graph is searched for new topics.
const GLANCE_NS: u64 = 50_000_000;
/// A compressed variant is recorded when the image itself has not been found this long after it: the tokens of a node that is new
/// come in any order.
const ALONE_NS: u64 = 250_000_000;
/// Samples that wait for the disk. As rosbag2's cache of 100 MiB, and bounded in number for topics of tiny messages.
const WAITING: Limit = Limit { messages: 1 << 20, bytes: 100 << 20 };
/// Most bytes of samples that wait for the definitions of their topics. Without room, a topic is recorded without definition.
const HELD: usize = 64 << 20;
/// After a stop, samples that wait are written for this long; the rest is lost and counted.
const LAST_WRITES_NS: u64 = 250_000_000;

/// The content of a recording.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Captured {
    /// Topics with their counts.
    pub topics: Vec<TopicCount>,
    /// Messages that were sent but are not in the bag, by topic: lost on the way here, or because of a slow disk.
    pub lost: BTreeMap<String, u64>,
    /// Topics with the node whose link was lost: how many of its messages are missing is not known.
    pub cut: BTreeMap<String, String>,
}

/// Records `topics` (`None`: all) of the graph of `transport` until `stop`. Samples wait for the disk in bounded
/// memory; those for which there is no room are dropped and counted.
///
/// # Errors
/// [`LiveError`] when a topic cannot be subscribed or the disk is full.
pub fn capture(
    transport: &Arc<ZenohTransport>,
    clock: &Arc<dyn Clock>,
    recorder: BagWriter,
    topics: Option<&[String]>,
    stop: &Stop,
) -> Result<Captured, LiveError> {
    let queue = Arc::new(Queue::new(clock.clone(), WAITING));
    // The recorder sleeps in the queue, and a stop must not wait for the end of that sleep.
    stop.wakes(&queue);
    let mut capture = CaptureLoop {
        transport,
        node_name: NodeName { name: NODE.into(), namespace: "/".into(), remaps: Vec::new() },
        recorder,
        queue,
        glimpsed: BTreeMap::new(),
        known: BTreeSet::new(),
        lanes: BTreeMap::new(),
        asked: BTreeMap::new(),
        held: 0,
        guards: BTreeMap::new(),
        numbered: BTreeSet::new(),
        cut: BTreeMap::new(),
    };
    // Nodes that wait for a recorder find it by this name.
    let _node = transport.announce(&capture.node_name)?;
    while stop.urgency() == Urgency::None {
        capture.subscribe_new(topics, clock.ticks_ns())?;
        capture.look_for_links();
        // New topics are looked for at intervals, as tokens may appear at any time.
        let look = clock.ticks_ns() + GLANCE_NS;
        // However fast samples come, the graph and the stop are looked at in between.
        while stop.urgency() == Urgency::None && clock.ticks_ns() < look {
            capture.write_next(Duration::from_nanos(look.saturating_sub(clock.ticks_ns())))?;
            capture.take_answers()?;
        }
        capture.recorder.settle(clock.now_ns())?;
    }
    capture.finish(&**clock)
}

struct CaptureLoop<'a> {
    transport: &'a Arc<ZenohTransport>,
    node_name: NodeName,
    recorder: BagWriter,
    queue: Arc<Queue<RawSample>>,
    /// Compressed variants that a look at the graph has found, with the time of the first look.
    glimpsed: BTreeMap<String, u64>,
    /// Topic and type hash of each subscription, and of those that are refused.
    known: BTreeSet<(String, String)>,
    lanes: BTreeMap<Lane, BagTopic>,
    /// Topics that are subscribed, but wait for their definition: a bag has it in front of the first message.
    asked: BTreeMap<Lane, AskedTopic>,
    /// Bytes of their samples.
    held: usize,
    guards: BTreeMap<Lane, Guard>,
    /// Lanes whose publishers tell the numbers of their last messages.
    numbered: BTreeSet<Lane>,
    /// Topics with the node whose link was lost, and whether it is away now.
    cut: BTreeMap<String, (String, bool)>,
}

struct AskedTopic {
    topic: BagTopic,
    /// Samples that have come before the definition.
    samples: Vec<Arrived<RawSample>>,
    answer: Receiver<Result<String, TransportError>>,
}

impl CaptureLoop<'_> {
    fn subscribe_new(&mut self, topics: Option<&[String]>, now_ns: u64) -> Result<(), LiveError> {
        let graph = self.transport.graph();
        let publishers = graph.tokens().filter(|t| t.kind == EntityKind::Publisher);
        for endpoint in publishers.filter_map(|t| t.endpoint.as_ref()) {
            // As with `ros2 bag record --all`, hidden topics are only recorded by name. So are compressed variants of
            // images that are recorded anyway: they would be made for the recorder alone.
            // When a node ends, the token of its images may go first.
            let (glimpsed, known) = (&mut self.glimpsed, &self.known);
            let mut repeats = |raw: &str| {
                let since = *glimpsed.entry(endpoint.topic.clone()).or_insert(now_ns);
                now_ns < since + ALONE_NS
                    || known.iter().any(|(topic, _)| topic == raw)
                    || graph.endpoints(EntityKind::Publisher, raw).next().is_some()
            };
            let raw = endpoint.topic.strip_suffix("/compressed");
            let usual = || !is_hidden(&endpoint.topic) && !raw.is_some_and(&mut repeats);
            let chosen = topics.map_or_else(usual, |topics| topics.contains(&endpoint.topic));
            if !chosen || !self.known.insert((endpoint.topic.clone(), endpoint.type_hash.clone())) {
                continue;
            }
            // A lane for each subscription, so that losses are known by topic.
            let (queue, lane) = (self.queue.clone(), self.queue.open(Keep::All));
            let take = move |sample| drop(queue.push(lane, sample));
            // Late readers get the last message of other topics on another way than its numbers.
            if Profile::parse(&endpoint.qos).durability == Durability::Volatile {
                self.numbered.insert(lane);
            }
            self.guards.insert(lane, self.transport.subscribe_raw(&self.node_name, endpoint, take)?);
            let topic = bag_topic(endpoint);
            if topic.schema.is_empty() {
                let answer = self.ask(endpoint)?;
                self.asked.insert(lane, AskedTopic { topic, samples: Vec::new(), answer });
            } else {
                self.begin(lane, topic)?;
            }
        }
        Ok(())
    }

    /// Warns once of each link that is lost: what its node sends now is not recorded.
    fn look_for_links(&mut self) {
        for topic in self.lanes.values().map(|topic| &topic.name) {
            let was_away = self.cut.get(topic).is_some_and(|(_, is_away)| *is_away);
            match self.transport.lost_publisher(topic) {
                Some(LostPublisher { node, .. }) if !was_away => {
                    tracing::warn!(
                        "the link to {node} was lost: what it sends on {topic} now is not recorded"
                    );
                    self.cut.insert(topic.clone(), (node, true));
                }
                None if was_away => {
                    tracing::info!("messages come again on {topic}");
                    self.cut.entry(topic.clone()).and_modify(|(_, is_away)| *is_away = false);
                }
                _ => {}
            }
        }
    }

    /// Asks for the definition of the type of `endpoint` on a thread of its own: the publishers may take seconds to answer.
    fn ask(&self, endpoint: &Endpoint) -> Result<Receiver<Result<String, TransportError>>, TransportError> {
        let (transport, endpoint, queue) = (self.transport.clone(), endpoint.clone(), self.queue.clone());
        let (give, answer) = channel();
        let asking = move || {
            // Fails only when the recording has ended.
            let _ = give.send(transport.definition_of(&endpoint));
            queue.wake();
        };
        let thread = thread::Builder::new().name("definition".into()).spawn(asking);
        thread.map_err(|why| TransportError::new("thread that asks for a definition", why))?;
        Ok(answer)
    }

    /// Records `topic` from now on, unless the bag has the topic with another type.
    fn begin(&mut self, lane: Lane, topic: BagTopic) -> Result<(), BagError> {
        match self.recorder.topic(&topic) {
            // One publisher that is wrong must not end the recording of all others.
            Err(why @ BagError::TypeConflict(..)) => {
                tracing::warn!("{why}: not recorded");
                self.guards.remove(&lane);
                self.queue.close(lane);
            }
            added => {
                added?;
                self.lanes.insert(lane, topic);
            }
        }
        Ok(())
    }

    /// Records the topics whose definitions have come, or will not come.
    fn take_answers(&mut self) -> Result<(), BagError> {
        let lanes: Vec<Lane> = self.asked.keys().copied().collect();
        for lane in lanes {
            match self.asked[&lane].answer.try_recv() {
                Ok(answer) => self.begin_asked(lane, answer.map_err(|why| why.to_string()))?,
                Err(TryRecvError::Empty) => {}
                Err(TryRecvError::Disconnected) => {
                    self.begin_asked(lane, Err("nobody answers".to_owned()))?
                }
            }
        }
        Ok(())
    }

    /// Records a topic with its definition or without one, and what has come of it so far.
    fn begin_asked(&mut self, lane: Lane, definition: Result<String, String>) -> Result<(), BagError> {
        let Some(AskedTopic { mut topic, samples, .. }) = self.asked.remove(&lane) else { return Ok(()) };
        match definition {
            Ok(text) => (topic.schema, topic.schema_encoding) = (text.into_bytes(), "ros2msg".to_owned()),
            Err(why) => tracing::warn!("{} is recorded without a definition: {why}", topic.name),
        }
        self.held -= samples.iter().map(held_bytes).sum::<usize>();
        self.begin(lane, topic)?;
        samples.iter().try_for_each(|sample| self.write(sample))
    }

    /// Writes the sample that arrived first; waits at most `patience` for one. Returns whether there was one.
    fn write_next(&mut self, patience: Duration) -> Result<bool, BagError> {
        let Some(sample) = self.queue.take(Some(patience)) else { return Ok(false) };
        let lane = sample.lane;
        let Some(asked) = self.asked.get_mut(&lane) else { return self.write(&sample).map(|()| true) };
        self.held += held_bytes(&sample);
        asked.samples.push(sample);
        if self.held > HELD {
            self.begin_asked(lane, Err("its messages do not fit into the memory until it comes".to_owned()))?;
        }
        Ok(true)
    }

    fn write(&mut self, Arrived { lane, stamp_ns, item }: &Arrived<RawSample>) -> Result<(), BagError> {
        // A topic that cannot be recorded has no entry.
        let Some(topic) = self.lanes.get(lane) else { return Ok(()) };
        // The source time, which rosbag2 stores as the time of publication; other publishers may send none.
        let sent = item.attachment.map_or(*stamp_ns, |a| u64::try_from(a.stamp_ns).unwrap_or(*stamp_ns));
        self.recorder.record(topic, *stamp_ns, sent, &item.payload)
    }

    /// Ends the subscriptions, writes waiting samples within a time limit, and completes the bag.
    fn finish(mut self, clock: &dyn Clock) -> Result<Captured, LiveError> {
        self.look_for_links();
        let transport = self.transport;
        for lane in &self.numbered {
            self.queue.heard(*lane, |publisher| transport.last_sent(publisher));
        }
        // New samples end first, or the loop below could go on until its limit.
        self.guards.clear();
        let end = clock.ticks_ns() + LAST_WRITES_NS;
        self.take_answers()?;
        while let Some(lane) = self.asked.keys().next().copied() {
            self.begin_asked(lane, Err("the recording ends before it has come".to_owned()))?;
        }
        while clock.ticks_ns() < end && self.write_next(Duration::ZERO)? {}
        let mut lost = BTreeMap::new();
        for (lane, topic) in &self.lanes {
            let counts = self.queue.close(*lane);
            if let Some(warning) = counts.warning(&topic.name) {
                tracing::warn!("{warning}");
            }
            // Topics without losses are left out, so that the report is empty for a complete recording.
            if counts.lost() + counts.unread > 0 {
                *lost.entry(topic.name.clone()).or_default() += counts.lost() + counts.unread;
            }
        }
        let cut = self.cut.into_iter().map(|(topic, (node, _))| (topic, node)).collect();
        Ok(Captured { topics: self.recorder.finish()?, lost, cut })
    }
}

fn held_bytes(sample: &Arrived<RawSample>) -> usize {
    size_of::<Arrived<RawSample>>() + sample.item.payload.len()
}

fn bag_topic(endpoint: &Endpoint) -> BagTopic {
    let type_name = modulo_msgs::ros_name(&endpoint.dds_type);
    let mut topic = BagTopic::new(&endpoint.topic, &type_name, keys::qos_of(&endpoint.qos));
    if endpoint.type_hash != keys::NO_HASH {
        topic.type_hash.clone_from(&endpoint.type_hash);
    }
    topic
}
