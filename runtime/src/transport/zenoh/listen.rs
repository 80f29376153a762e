//! A look at the graph from outside, and [`TopicListener`]: a subscription to a topic of any type.

use std::sync::Arc;
use std::thread::sleep;
use std::time::Duration;

use modulo_msgs::ros_name;

use super::ZenohTransport;
use crate::graph::{Graph, NodeName};
use crate::process::stop::{Stop, Urgency};
use crate::transport::keys::EntityKind;
use crate::transport::queue::{Arrived, Keep, Lane, Limit, Next, Queue};
use crate::transport::{Guard, RawSample, Transport as _, TransportError};

/// The graph is complete when it has not changed for this long.
const CALM: Duration = Duration::from_millis(300);
/// Time limit for a topic to appear, and for the graph to become complete.
const PATIENCE: Duration = Duration::from_secs(5);
const GLANCE: Duration = Duration::from_millis(20);
/// Samples that wait for the reader.
const WAITING: Limit = Limit { messages: 4096, bytes: 64 << 20 };

impl ZenohTransport {
    /// Returns the graph once it has not changed for 300 ms, or after 5 s.
    pub fn settled_graph(&self) -> Graph {
        let (mut graph, mut unchanged, mut waited) = (self.graph(), Duration::ZERO, Duration::ZERO);
        while unchanged < CALM && waited < PATIENCE {
            sleep(GLANCE);
            waited += GLANCE;
            let now = self.graph();
            // Tokens come one by one, so a pause is taken to mean that the graph is complete.
            unchanged = if now.tokens().eq(graph.tokens()) { unchanged + GLANCE } else { Duration::ZERO };
            graph = now;
        }
        graph
    }

    /// Returns the settled graph as soon as `topic` (an absolute name) has an endpoint.
    ///
    /// # Errors
    /// [`TransportError`] with the names of all topics when there is no endpoint within 5 s.
    pub fn graph_with(&self, topic: &str) -> Result<Graph, TransportError> {
        let mut waited = Duration::ZERO;
        while !self.graph().topics().contains_key(topic) {
            if waited >= PATIENCE {
                let known: Vec<String> = self.graph().topics().into_keys().collect();
                let known = if known.is_empty() { "no topic at all".to_owned() } else { known.join(", ") };
                let why = format!("no node publishes or reads it; there is {known}");
                return Err(TransportError::new(format!("topic {topic}"), why));
            }
            sleep(GLANCE);
            waited += GLANCE;
        }
        Ok(self.settled_graph())
    }

    /// Subscribes to `topic` (an absolute name) as its first publisher offers it, until `stop` is asked for an end.
    ///
    /// # Errors
    /// [`TransportError`] when the topic does not appear, or cannot be subscribed.
    pub fn listen(&self, topic: &str, stop: Stop) -> Result<TopicListener, TransportError> {
        let graph = self.graph_with(topic)?;
        let publisher = graph.endpoints(EntityKind::Publisher, topic).next();
        // Readers name the type as well, so a topic can be listened to before its publisher comes.
        let any = publisher.or_else(|| graph.endpoints(EntityKind::Subscription, topic).next());
        let endpoint = any.and_then(|token| token.endpoint.clone());
        let gone = || TransportError::new(format!("topic {topic}"), "all of its endpoints are gone");
        let endpoint = endpoint.ok_or_else(gone)?;
        let node_name = NodeName { name: "modulo_topic".into(), namespace: "/".into(), remaps: Vec::new() };
        // The command appears in the graph as a node, as the tools of ROS 2 do.
        let node = self.announce(&node_name)?;
        let samples = Arc::new(Queue::new(self.clock.clone(), WAITING));
        stop.wakes(&samples);
        let (queue, lane) = (samples.clone(), samples.open(Keep::All));
        let take = move |sample| drop(queue.push(lane, sample));
        let subscription = self.subscribe_raw(&node_name, &endpoint, take)?;
        let type_name = ros_name(&endpoint.dds_type);
        Ok(TopicListener { type_name, samples, lane, stop, _guards: (subscription, node) })
    }
}

/// A subscription to a topic of any type; its samples wait in a bounded queue.
pub struct TopicListener {
    type_name: String,
    samples: Arc<Queue<RawSample>>,
    lane: Lane,
    stop: Stop,
    _guards: (Guard, Guard),
}

impl TopicListener {
    /// Returns the ROS name of the type of the topic.
    pub fn type_name(&self) -> &str {
        &self.type_name
    }

    /// Returns the next sample within `patience`, or without a time limit for `None`.
    pub fn next(&self, patience: Option<Duration>) -> Option<Arrived<RawSample>> {
        match self.samples.take(patience) {
            Next::Item(arrived) => Some(arrived),
            Next::Idle | Next::Ended => None,
        }
    }

    /// Returns the number of samples that were sent, but not read.
    pub fn lost(&self) -> u64 {
        self.samples.counts(self.lane).lost()
    }

    /// Returns whether no end has been requested.
    pub fn goes_on(&self) -> bool {
        self.stop.urgency() == Urgency::None
    }
}
