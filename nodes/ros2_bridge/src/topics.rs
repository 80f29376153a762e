//! Forwards one topic from one graph to the other, as the bytes that both carry: CDR with its encapsulation header.

use std::sync::Arc;
use std::thread;

use anyhow::Context as _;
use futures::StreamExt as _;
use futures::executor::block_on;
use modulo_middleware::graph::discovery::gid as gid_of;
use modulo_middleware::transport::queue::{Keep, Lane, Limit, Queue};
use modulo_middleware::transport::zenoh::ZenohTransport;
use modulo_middleware::transport::{Guard, Payload, RawSample};
use modulo_runtime::wire::keys::{EntityKind, Token};
use modulo_runtime::{NodeName, Qos, SystemClock};
use r2r::QosProfile;
use r2r::qos::ReliabilityPolicy;

use crate::plan::{Route, RouteDirection};

/// The number of results that wait for the other side.
const RESULTS_WAITING: usize = 64;
/// The number of images that wait for the other side, a third of a second at 30 Hz. A newer image replaces the oldest one.
const IMAGES_WAITING: usize = 10;

/// A topic that is forwarded until this is dropped.
pub struct Forwarding {
    _source: Option<Guard>,
    waiting: ForwardQueue,
}

#[derive(Clone)]
struct ForwardQueue {
    queue: Arc<Queue<RawSample>>,
    lane: Lane,
}

/// Forwards `route` on `node` for as long as the result lives. Of the messages of the suite only those pass whose publisher, a
/// fully qualified name, `belongs` to `node`: several nodes may publish one topic, and each of them has a node on DDS.
pub fn forward(
    route: &Route,
    bridge: &NodeName,
    transport: &Arc<ZenohTransport>,
    node: &mut r2r::Node,
    belongs: impl Fn(&str) -> bool + Send + Sync + 'static,
) -> anyhow::Result<Forwarding> {
    let waiting = ForwardQueue::new(route.qos);
    let source = match route.direction {
        RouteDirection::DdsToZenoh => {
            from_dds(route, bridge, transport, node, &waiting)?;
            None
        }
        RouteDirection::ZenohToDds => {
            // A reliable publisher serves readers of both kinds.
            let profile = profile(route.qos, ReliabilityPolicy::Reliable);
            let publisher = node
                .create_publisher_untyped(&route.topic, &route.ros_type, profile)
                .with_context(|| format!("publisher of {} on DDS", route.topic))?;
            waiting.send_with(&route.topic, move |bytes| Ok(publisher.publish_raw(bytes)?));
            let (queue, lane) = (waiting.queue.clone(), waiting.lane);
            let (suite, topic) = (transport.clone(), route.topic.clone());
            let take = move |sample: RawSample| {
                if publisher_of(&sample, &topic, &suite).is_none_or(|publisher| belongs(&publisher)) {
                    drop(queue.push(lane, sample));
                }
            };
            Some(transport.subscribe_raw(bridge, &route.endpoint(), take)?)
        }
    };
    Ok(Forwarding { _source: source, waiting })
}

/// Forwards `route` from DDS through `waiting` until `node` ends.
fn from_dds(
    route: &Route,
    bridge: &NodeName,
    transport: &ZenohTransport,
    node: &mut r2r::Node,
    waiting: &ForwardQueue,
) -> anyhow::Result<()> {
    let publisher = transport.advertise_raw(bridge, &route.endpoint())?;
    let messages = node
        .subscribe_raw(&route.topic, &route.ros_type, profile(route.qos, reliability(route, node)?))
        .with_context(|| format!("subscription of {} on DDS", route.topic))?;
    waiting.send_with(&route.topic, move |bytes| Ok(publisher.put(bytes.to_vec())?));
    // Ends with the node, which closes the stream. It only moves messages, so that the short stream of r2r, which would lose
    // the newest message, is never full.
    let waiting = waiting.clone();
    thread::spawn(move || {
        block_on(messages.for_each(|bytes| {
            waiting.push(bytes);
            futures::future::ready(())
        }))
    });
    Ok(())
}

impl Drop for Forwarding {
    fn drop(&mut self) {
        self.waiting.queue.end();
    }
}

impl ForwardQueue {
    fn new(qos: Qos) -> Self {
        let limit = Limit { messages: 0, bytes: 0 };
        let queue = Arc::new(Queue::new(Arc::new(SystemClock::default()), limit));
        let lane = queue.open(Keep::Last(if qos == Qos::Images { IMAGES_WAITING } else { RESULTS_WAITING }));
        Self { queue, lane }
    }

    fn push(&self, bytes: Vec<u8>) {
        drop(self.queue.push(self.lane, RawSample { payload: Payload::new(bytes), attachment: None }));
    }

    /// Sends the waiting messages on a thread of their own until the queue ends, then reports what was lost.
    fn send_with(&self, topic: &str, send: impl Fn(&[u8]) -> anyhow::Result<()> + Send + 'static) {
        let (Self { queue, lane }, topic) = (self.clone(), topic.to_owned());
        thread::spawn(move || {
            while let Some(sample) = queue.take(None) {
                if let Err(why) = send(&sample.item.payload) {
                    tracing::warn!("{topic}: {why:#}");
                }
            }
            let counts = queue.close(lane);
            let (received, replaced, lost) =
                (counts.received, counts.replaced, counts.lost() + counts.unread);
            tracing::info!("{topic}: {received} messages, {replaced} replaced by a newer one, {lost} lost");
        });
    }
}

/// The node that published `sample`; `None` for a publisher without a number, or one that is gone already.
fn publisher_of(sample: &RawSample, topic: &str, transport: &ZenohTransport) -> Option<String> {
    let gid = sample.attachment.as_ref()?.gid;
    let graph = transport.graph();
    graph
        .endpoints(EntityKind::Publisher, topic)
        .find(|token| gid_of(&token.to_key()) == gid)
        .map(Token::node_name)
}

/// The reliability of a subscription that all present publishers serve.
fn reliability(route: &Route, node: &r2r::Node) -> anyhow::Result<ReliabilityPolicy> {
    let publishers = node.get_publishers_info_by_topic(&route.topic, false)?;
    let reliable =
        publishers.iter().all(|publisher| publisher.qos_profile.reliability == ReliabilityPolicy::Reliable);
    Ok(if reliable { ReliabilityPolicy::Reliable } else { ReliabilityPolicy::BestEffort })
}

fn profile(qos: Qos, reliability: ReliabilityPolicy) -> QosProfile {
    let profile = match qos {
        // Each image is many datagrams, and some are sent again; as many wait in DDS as in the queue before it.
        Qos::Images => QosProfile::sensor_data().keep_last(IMAGES_WAITING),
        Qos::Results => QosProfile::default(),
        Qos::Latched => QosProfile::default().keep_last(1).transient_local(),
        Qos::Clock => QosProfile::sensor_data().keep_last(1),
        Qos::Events => QosProfile::parameter_events(),
        Qos::Logs => QosProfile::default().keep_last(1000).transient_local(),
    };
    QosProfile { reliability, ..profile }
}
