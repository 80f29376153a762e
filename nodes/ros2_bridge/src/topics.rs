//! Forwards one topic from one graph to the other, as the bytes that both carry: CDR with its encapsulation header.

use std::sync::Arc;
use std::thread;

use anyhow::Context as _;
use futures::StreamExt as _;
use futures::executor::block_on;
use modulo_runtime::bridge::{Route, RouteDirection};
use modulo_runtime::queue::{Keep, Limit, Next, Queue};
use modulo_runtime::transport::zenoh::ZenohTransport;
use modulo_runtime::transport::{Guard, RawSample};
use modulo_runtime::{NodeName, Qos, SystemClock};
use r2r::QosProfile;

/// Results on their way to the DDS graph. Of images, only the newest one waits.
const RESULTS_WAITING: usize = 64;

/// Forwards `route` for as long as the returned guard lives.
pub fn forward(
    route: &Route,
    node_name: &NodeName,
    transport: &ZenohTransport,
    node: &mut r2r::Node,
) -> anyhow::Result<Option<Guard>> {
    match route.direction {
        RouteDirection::DdsToZenoh => inward(route, node_name, transport, node).map(|()| None),
        RouteDirection::ZenohToDds => outward(route, node_name, transport, node).map(Some),
    }
}

fn inward(
    route: &Route,
    node_name: &NodeName,
    transport: &ZenohTransport,
    node: &mut r2r::Node,
) -> anyhow::Result<()> {
    let publisher = transport.advertise_raw(node_name, &route.endpoint())?;
    let messages = node
        .subscribe_raw(&route.topic, &route.ros_type, profile(route.qos))
        .with_context(|| format!("subscription of {}", route.topic))?;
    // Ends with the node, which closes the stream.
    thread::spawn(move || {
        block_on(messages.for_each(|bytes| {
            if let Err(why) = publisher.put(bytes) {
                tracing::warn!("{why}");
            }
            futures::future::ready(())
        }));
    });
    Ok(())
}

fn outward(
    route: &Route,
    node_name: &NodeName,
    transport: &ZenohTransport,
    node: &mut r2r::Node,
) -> anyhow::Result<Guard> {
    let publisher = node
        .create_publisher_untyped(&route.topic, &route.ros_type, profile(route.qos))
        .with_context(|| format!("publisher of {}", route.topic))?;
    let limit = Limit { messages: 0, bytes: 0 };
    let queue = Arc::new(Queue::<RawSample>::new(Arc::new(SystemClock::default()), limit));
    let keep = if route.qos == Qos::Images { Keep::Latest } else { Keep::Last(RESULTS_WAITING) };
    let lane = queue.open(keep);
    let (samples, topic) = (queue.clone(), route.topic.clone());
    thread::spawn(move || {
        while let Next::Item(sample) = samples.take(None) {
            if let Err(why) = publisher.publish_raw(&sample.item.payload) {
                tracing::warn!("{topic}: {why}");
            }
        }
        let lost = samples.close(lane).lost();
        if lost > 0 {
            tracing::warn!("{topic}: {lost} messages were lost, the DDS graph was too slow");
        }
    });
    let end = EndQueue(queue.clone());
    let guard = transport
        .subscribe_raw(node_name, &route.endpoint(), move |sample| drop(queue.push(lane, sample)))?;
    Ok(Box::new((guard, end)))
}

/// Ends the thread that publishes the samples from zenoh.
struct EndQueue(Arc<Queue<RawSample>>);

impl Drop for EndQueue {
    fn drop(&mut self) {
        self.0.end();
    }
}

fn profile(qos: Qos) -> QosProfile {
    match qos {
        Qos::Images => QosProfile::sensor_data(),
        Qos::Results => QosProfile::default(),
        Qos::Latched => QosProfile::default().keep_last(1).transient_local(),
        Qos::Clock => QosProfile::sensor_data().keep_last(1),
        Qos::Events => QosProfile::parameter_events(),
        Qos::Logs => QosProfile::default().keep_last(1000).transient_local(),
    }
}
