//! One topic from one graph to the other, as the bytes that both carry: CDR with
//! its encapsulation header.

use std::sync::mpsc::sync_channel;
use std::thread;

use anyhow::Context as _;
use futures::StreamExt as _;
use futures::executor::block_on;
use modulo_runtime::bridge::{Direction, Route};
use modulo_runtime::transport::Guard;
use modulo_runtime::transport::payload::Payload;
use modulo_runtime::transport::zenoh::ZenohTransport;
use modulo_runtime::{Place, Qos};
use r2r::QosProfile;

/// Messages on their way to the DDS graph; when it is slower, the newest is dropped.
const QUEUE: usize = 8;

/// Forwards `route` while what is returned lives.
pub fn forward(
    route: &Route,
    place: &Place,
    transport: &ZenohTransport,
    node: &mut r2r::Node,
) -> anyhow::Result<Option<Guard>> {
    match route.direction {
        Direction::DdsToZenoh => inward(route, place, transport, node).map(|()| None),
        Direction::ZenohToDds => outward(route, place, transport, node).map(Some),
    }
}

fn inward(
    route: &Route,
    place: &Place,
    transport: &ZenohTransport,
    node: &mut r2r::Node,
) -> anyhow::Result<()> {
    let outlet = transport.advertise_raw(place, &route.endpoint())?;
    let messages = node
        .subscribe_raw(&route.topic, &route.ros_type, profile(route.qos))
        .with_context(|| format!("subscription of {}", route.topic))?;
    // Ends with the node, which closes the stream.
    thread::spawn(move || {
        block_on(messages.for_each(|bytes| {
            if let Err(why) = outlet.put(bytes) {
                tracing::warn!("{why}");
            }
            futures::future::ready(())
        }));
    });
    Ok(())
}

fn outward(
    route: &Route,
    place: &Place,
    transport: &ZenohTransport,
    node: &mut r2r::Node,
) -> anyhow::Result<Guard> {
    let publisher = node
        .create_publisher_untyped(&route.topic, &route.ros_type, profile(route.qos))
        .with_context(|| format!("publisher of {}", route.topic))?;
    let (queue, samples) = sync_channel::<Payload>(QUEUE);
    let topic = route.topic.clone();
    thread::spawn(move || {
        for bytes in samples {
            if let Err(why) = publisher.publish_raw(&bytes) {
                tracing::warn!("{topic}: {why}");
            }
        }
    });
    let topic = route.topic.clone();
    let guard = transport.subscribe_raw(place, &route.endpoint(), move |sample| {
        if queue.try_send(sample.payload).is_err() {
            tracing::warn!("{topic}: the DDS graph is too slow, a message was dropped");
        }
    })?;
    Ok(guard)
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
