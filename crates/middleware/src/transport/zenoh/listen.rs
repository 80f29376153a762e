//! A look at the graph from outside, and [`TopicListener`]: a subscription to a topic of any type.

use std::sync::Arc;
use std::thread::sleep;
use std::time::Duration;

use modulo_msgs::interface::ros2msg_of;
use modulo_msgs::type_description_interfaces::{GetTypeDescriptionRequest, GetTypeDescriptionResponse};
use modulo_msgs::{cdr, ros_name, type_hash_of_schema};
use modulo_runtime::name::{NOT_OVER_ZENOH, is_hidden, near_or_all};
use modulo_runtime::wire::keys::{Endpoint, EntityKind};
use modulo_runtime::{NodeName, Stop, Urgency};

use super::ZenohTransport;
use crate::graph::Graph;
use crate::graph::type_description::NAME_AND_TYPE;
use crate::transport::queue::{Arrived, Keep, Lane, Limit, Queue};
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
    pub fn settled_graph(&self) -> Arc<Graph> {
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
    pub fn graph_with(&self, topic: &str) -> Result<Arc<Graph>, TransportError> {
        let mut waited = Duration::ZERO;
        while !self.graph().topics().contains_key(topic) {
            if waited >= PATIENCE {
                let topics = self.graph().topics();
                let known: Vec<&str> =
                    topics.keys().map(String::as_str).filter(|known| !is_hidden(known)).collect();
                let why = match near_or_all(topic, &known, "; there is") {
                    known if known.is_empty() => format!("there is no topic at all; {NOT_OVER_ZENOH}"),
                    known => format!("no node publishes or reads it{known}"),
                };
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
        Ok(TopicListener { endpoint, samples, lane, stop, _guards: (subscription, node) })
    }

    /// Returns the definition of the type of `endpoint` with all that it uses, as bags carry it. The nodes that publish the
    /// topic are asked for it, by the service that nodes of ROS 2 offer.
    ///
    /// # Errors
    /// [`TransportError`] when none of them has a definition with the hash of `endpoint`.
    pub fn definition_of(&self, endpoint: &Endpoint) -> Result<String, TransportError> {
        let mut why = format!("no publisher of {} has the service ~/{SERVICE}", endpoint.topic);
        let mut waited = Duration::ZERO;
        // The token of the service may come a little later than that of the publisher.
        while waited < CALM {
            let graph = self.graph();
            let services = graph.endpoints(EntityKind::Publisher, &endpoint.topic);
            let services = services.map(|publisher| format!("{}/{SERVICE}", publisher.node_name()));
            for service in services.filter(|name| graph.endpoints(EntityKind::Server, name).next().is_some())
            {
                match self.ask_for_definition(&service, endpoint) {
                    Ok(text) => return Ok(text),
                    Err(reason) => (why, waited) = (reason, CALM),
                }
            }
            sleep(GLANCE);
            waited += GLANCE;
        }
        Err(TransportError::new(format!("definition of {}", ros_name(&endpoint.dds_type)), why))
    }

    fn ask_for_definition(&self, service: &str, endpoint: &Endpoint) -> Result<String, String> {
        let (type_name, type_hash) = (ros_name(&endpoint.dds_type), endpoint.type_hash.clone());
        let request = GetTypeDescriptionRequest { type_name, type_hash, include_type_sources: true };
        let bytes = cdr::to_vec(&request).map_err(|why| why.to_string())?;
        let answer = self.call(service, NAME_AND_TYPE.1, bytes, ANSWER).map_err(|why| why.to_string())?;
        let answer: GetTypeDescriptionResponse = cdr::from_slice(&answer).map_err(|why| why.to_string())?;
        if !answer.successful {
            return Err(format!("{service}: {}", answer.failure_reason));
        }
        let GetTypeDescriptionRequest { type_name, type_hash, .. } = request;
        let text = ros2msg_of(&type_name, &answer.type_sources);
        let text = text.ok_or_else(|| format!("{service} has no .msg text of {type_name}"))?;
        // A definition that does not fit would show wrong values.
        match type_hash_of_schema(&type_name, &text) {
            Ok(hash) if hash == type_hash => Ok(text),
            Ok(hash) => Err(format!("{service} has the definition {hash}, the topic {type_hash}")),
            Err(why) => Err(format!("{service}: {why}")),
        }
    }
}

/// Name of the service below the node.
const SERVICE: &str = NAME_AND_TYPE.0;
/// Time limit for its answer.
const ANSWER: Duration = Duration::from_secs(2);

/// A subscription to a topic of any type; its samples wait in a bounded queue.
pub struct TopicListener {
    /// The endpoint that is read.
    pub endpoint: Endpoint,
    samples: Arc<Queue<RawSample>>,
    lane: Lane,
    stop: Stop,
    _guards: (Guard, Guard),
}

impl TopicListener {
    /// Returns the next sample within `patience`, or without a time limit for `None`.
    pub fn next(&self, patience: Option<Duration>) -> Option<Arrived<RawSample>> {
        self.samples.take(patience)
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
