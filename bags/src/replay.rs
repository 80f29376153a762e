//! Replaying a bag into a running graph: each payload is sent as it was
//! recorded, on its topic, when it is due.

use std::collections::BTreeMap;
use std::thread;
use std::time::Duration;

use modulo_runtime::transport::keys::{self, Endpoint};
use modulo_runtime::transport::zenoh::{RawOutlet, ZenohTransport};
use modulo_runtime::transport::{Transport, TransportError};
use modulo_runtime::{Clock, Place, Stop, Urgency};

use crate::bag::{BagError, BagTopic, qos};
use crate::play::Player;

/// The longest sleep between two looks at the stop flag.
const GLANCE: Duration = Duration::from_millis(20);

/// Why a replay failed.
#[derive(Debug, thiserror::Error)]
pub enum ReplayError {
    /// The bag.
    #[error(transparent)]
    Bag(#[from] BagError),
    /// The wire.
    #[error(transparent)]
    Transport(#[from] TransportError),
    /// Somebody who should listen is not there.
    #[error("waited {seconds} s for {missing}, which is not there; start it, or leave --wait-for out")]
    Waited {
        /// How long.
        seconds: u64,
        /// Names of the nodes.
        missing: String,
    },
}

/// Waits until all of `nodes` (fully qualified) are ready.
///
/// # Errors
/// [`ReplayError::Waited`] when one is not there within `patience`.
pub fn wait_for(
    transport: &dyn Transport,
    clock: &dyn Clock,
    nodes: &[String],
    patience: Duration,
    stop: &Stop,
) -> Result<(), ReplayError> {
    let start = clock.ticks_ns();
    let limit = u64::try_from(patience.as_nanos()).unwrap_or(u64::MAX);
    loop {
        let missing: Vec<&str> =
            nodes.iter().filter(|n| !transport.is_ready(n)).map(String::as_str).collect();
        if missing.is_empty() || stop.urgency() != Urgency::None {
            return Ok(());
        }
        if clock.ticks_ns().saturating_sub(start) > limit {
            return Err(ReplayError::Waited { seconds: patience.as_secs(), missing: missing.join(", ") });
        }
        thread::sleep(GLANCE);
    }
}

/// Sends every message of `player` when it is due, its topics renamed by
/// `remaps`; returns how many were sent, by topic.
///
/// # Errors
/// [`ReplayError`] when the bag cannot be read on or the wire does not take it.
pub fn replay(
    transport: &ZenohTransport,
    clock: &dyn Clock,
    player: &mut Player,
    remaps: &[(String, String)],
    stop: &Stop,
) -> Result<BTreeMap<String, u64>, ReplayError> {
    let place = Place { name: "player".into(), namespace: "/".into(), remaps: remaps.to_vec() };
    let mut outlets = BTreeMap::new();
    for count in player.bag().topics() {
        let endpoint = endpoint(&count.topic, &place)?;
        let outlet = transport.advertise_raw(&place, &endpoint)?;
        outlets.insert(count.topic.name.clone(), (endpoint.topic, outlet));
    }
    let _node = transport.announce(&place)?;
    wait_until_heard(&outlets, clock, stop);
    let sent = send_all(&outlets, clock, player, stop);
    // What was put last must have left before the publishers go.
    thread::sleep(transport.settling());
    sent
}

/// Discovery takes a moment: the first message should not go out before those
/// who are already there have found us. Nobody has to be there.
fn wait_until_heard(outlets: &BTreeMap<String, (String, RawOutlet)>, clock: &dyn Clock, stop: &Stop) {
    let start = clock.ticks_ns();
    let heard = || outlets.values().any(|(_, outlet)| outlet.wanted());
    while !heard() && clock.ticks_ns() - start < 500_000_000 && stop.urgency() == Urgency::None {
        thread::sleep(GLANCE);
    }
}

fn send_all(
    outlets: &BTreeMap<String, (String, RawOutlet)>,
    clock: &dyn Clock,
    player: &mut Player,
    stop: &Stop,
) -> Result<BTreeMap<String, u64>, ReplayError> {
    let mut sent = BTreeMap::new();
    let start = clock.ticks_ns();
    while let Some(due) = player.next_due() {
        let due = due?;
        let at = start.saturating_add(u64::try_from(due.after.as_nanos()).unwrap_or(u64::MAX));
        while clock.ticks_ns() < at {
            if stop.urgency() != Urgency::None {
                return Ok(sent);
            }
            thread::sleep(GLANCE.min(Duration::from_nanos(at.saturating_sub(clock.ticks_ns()))));
        }
        if let Some((name, outlet)) = outlets.get(&due.message.topic.name) {
            outlet.put(due.message.data)?;
            *sent.entry(name.clone()).or_default() += 1;
        }
    }
    Ok(sent)
}

fn endpoint(topic: &BagTopic, place: &Place) -> Result<Endpoint, TransportError> {
    let named = |why: modulo_runtime::name::NameError| TransportError::new("topic of the bag", why);
    let computed = || {
        let text = String::from_utf8_lossy(&topic.schema);
        modulo_msgs::type_hash_of_schema(&topic.type_name, &text).unwrap_or_default()
    };
    Ok(Endpoint {
        topic: place.resolve(&topic.name).map_err(named)?,
        dds_type: modulo_msgs::dds_name(&topic.type_name),
        type_hash: if topic.type_hash.starts_with("RIHS") { topic.type_hash.clone() } else { computed() },
        qos: keys::qos_string(qos::parse(&topic.qos)).to_owned(),
    })
}
