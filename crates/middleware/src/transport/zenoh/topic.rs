//! Publishers and subscriptions of ready-made CDR.

use std::borrow::Cow;
use std::sync::Arc;
use std::sync::atomic::{AtomicI64, Ordering};
use std::time::Duration;

use modulo_runtime::topic::{self, Durability, Profile};
use modulo_runtime::wire::attachment::Attachment;
use modulo_runtime::wire::keys::{self, Endpoint, EntityKind};
use modulo_runtime::{Clock, Message, NodeName};
use zenoh::Wait;
use zenoh::bytes::ZBytes;
use zenoh::liveliness::LivelinessToken;
use zenoh::qos::{CongestionControl, Reliability};
use zenoh::sample::Sample;
use zenoh_ext::{
    AdvancedPublisher, AdvancedPublisherBuilderExt, AdvancedSubscriberBuilderExt, CacheConfig, HistoryConfig,
    MissDetectionConfig, RecoveryConfig,
};

use super::sent::SentNumbers;
use super::{ZenohTransport, lock, stamp};
use crate::graph::discovery::gid;
use crate::transport::{Guard, Payload, Publisher, RawSample, TransportError};

/// Interval at which a publisher for late readers sends the number of its last sample.
const HEARTBEAT: Duration = Duration::from_secs(1);

/// A publisher of ready-made CDR. Dropping it takes it out of the graph.
pub struct RawPublisher {
    publisher: AdvancedPublisher<'static>,
    clock: Arc<dyn Clock>,
    gid: [u8; 16],
    sequence: AtomicI64,
    /// The number of the last message that was handed over; it is told to the readers.
    sent: Arc<AtomicI64>,
    numbers: Arc<SentNumbers>,
    _token: LivelinessToken,
}

impl ZenohTransport {
    /// Publishes ready-made CDR on `endpoint`.
    pub fn advertise_raw(
        &self,
        node: &NodeName,
        endpoint: &Endpoint,
    ) -> Result<RawPublisher, TransportError> {
        let profile = Profile::parse(&endpoint.qos);
        // A bag may name another form of hash than this domain uses.
        let endpoint = Endpoint { type_hash: self.hash(endpoint.type_hash.clone()), ..endpoint.clone() };
        let publisher = self
            .publisher(self.key(&endpoint), profile)
            .map_err(|why| TransportError::new(format!("publisher of {}", endpoint.topic), why))?;
        let token = self.token(node, EntityKind::Publisher, Some(endpoint));
        let (gid, sent) = (gid(&token.to_key()), Arc::default());
        self.numbers.add(gid, &sent);
        Ok(RawPublisher {
            publisher,
            clock: self.clock.clone(),
            gid,
            sequence: AtomicI64::new(1),
            sent,
            numbers: self.numbers.clone(),
            _token: self.declare(&token)?,
        })
    }

    /// Hands every sample of `endpoint` to `take`, on zenoh's own thread, until the guard is dropped.
    pub fn subscribe_raw(
        &self,
        node: &NodeName,
        endpoint: &Endpoint,
        take: impl Fn(RawSample) + Send + Sync + 'static,
    ) -> Result<Guard, TransportError> {
        let (take, profile, key) = (Arc::new(take), Profile::parse(&endpoint.qos), self.key(endpoint));
        let failed = |why| TransportError::new(format!("subscription of {}", endpoint.topic), why);
        let mut token = self.token(node, EntityKind::Subscription, Some(endpoint.clone()));
        let mut subscribers = Vec::with_capacity(2);
        // Samples from before this reader are on the key of the topic alone.
        if profile.durability == Durability::Volatile && keys::may_use_buffers(&endpoint.dds_type) {
            token.backends = keys::CPU_BUFFERS.to_owned();
            let (take, graph) = (take.clone(), self.graph.clone());
            let with_numbers = move |mut sample: RawSample| {
                if let Some(attachment) = &mut sample.attachment {
                    attachment.numbers += lock(&graph).readers_apart(&attachment.gid);
                }
                take(sample);
            };
            subscribers
                .push(self.subscriber(keys::buffers_key(&key), profile, with_numbers).map_err(failed)?);
        }
        subscribers.push(self.subscriber(key, profile, move |sample| take(sample)).map_err(failed)?);
        // The token comes last: a publisher that sees it may send at once.
        Ok(Box::new((subscribers, self.declare(&token)?)))
    }

    /// Declares a publisher as rmw_zenoh does: it never waits for a reader, and may keep samples for late readers.
    fn publisher(&self, key: String, profile: Profile) -> zenoh::Result<AdvancedPublisher<'static>> {
        let reliable = profile.reliability == topic::Reliability::Reliable;
        let publisher = self
            .session
            .declare_publisher(key)
            .congestion_control(CongestionControl::Drop)
            .reliability(if reliable { Reliability::Reliable } else { Reliability::BestEffort })
            .advanced();
        match profile.durability {
            Durability::Volatile => publisher.wait(),
            Durability::TransientLocal => {
                // The publisher keeps what its depth promises; a reader asks for it when it finds the publisher.
                let kept = CacheConfig::default().max_samples(profile.depth);
                let publisher = publisher.cache(kept).publisher_detection();
                // By best effort, a missed sample is not asked for again, so its number need not be sent.
                if !reliable {
                    return publisher.wait();
                }
                // The sporadic one waits for a reader that stands still, and zenoh closes the link of such a reader.
                let misses = MissDetectionConfig::default().heartbeat(HEARTBEAT);
                publisher.sample_miss_detection(misses).wait()
            }
        }
    }

    /// Declares a subscriber as rmw_zenoh does: one for earlier samples gets those of present publishers, and of
    /// publishers that it finds later.
    fn subscriber(
        &self,
        key: String,
        profile: Profile,
        take: impl Fn(RawSample) + Send + Sync + 'static,
    ) -> zenoh::Result<Guard> {
        let take = move |sample: Sample| {
            // Samples without an attachment come from programs outside of ROS and are still passed on.
            let attachment = sample.attachment().map(|a| a.to_bytes());
            take(RawSample {
                payload: payload(sample.payload()),
                attachment: attachment.as_deref().and_then(Attachment::parse),
            });
        };
        let subscriber = self.session.declare_subscriber(key).callback(take);
        if profile.durability == Durability::Volatile {
            return Ok(Box::new(subscriber.wait()?));
        }
        // Publishers that appear later are asked for their last samples, too.
        let history = HistoryConfig::default().detect_late_publishers().max_samples(profile.depth);
        let subscriber = subscriber.history(history).subscriber_detection();
        Ok(match profile.reliability {
            topic::Reliability::BestEffort => Box::new(subscriber.wait()?),
            topic::Reliability::Reliable => {
                Box::new(subscriber.recovery(RecoveryConfig::default().heartbeat()).wait()?)
            }
        })
    }
}

/// A smaller payload is copied: it would keep a whole receive buffer from being used again.
const LARGE: usize = 65_536;

/// A payload that arrived in one piece and is left where it is.
struct InPlace(ZBytes);

impl AsRef<[u8]> for InPlace {
    fn as_ref(&self) -> &[u8] {
        self.0.slices().next().unwrap_or_default()
    }
}

fn payload(bytes: &ZBytes) -> Payload {
    match bytes.to_bytes() {
        Cow::Borrowed(slice) if slice.len() >= LARGE => Payload::new(InPlace(bytes.clone())),
        copied => Payload::new(copied.into_owned()),
    }
}

impl RawPublisher {
    /// Returns its global id and the number of messages that have left it.
    pub fn sent(&self) -> ([u8; 16], u64) {
        (self.gid, self.sent.load(Ordering::Acquire).unsigned_abs())
    }

    /// Sends CDR with its encapsulation header.
    pub fn put(&self, payload: Vec<u8>) -> Result<(), TransportError> {
        let sequence = self.sequence.fetch_add(1, Ordering::Relaxed);
        let attachment = Attachment { sequence, stamp_ns: stamp(&*self.clock), gid: self.gid, numbers: 1 };
        let put = self.publisher.put(payload).attachment(attachment.to_bytes().as_slice()).wait();
        // Afterwards, so that the number is not told before the message is in the queue.
        self.sent.fetch_max(sequence, Ordering::Release);
        put.map_err(|why| TransportError::new(format!("put on {}", self.publisher.key_expr()), why))
    }
}

impl Drop for RawPublisher {
    fn drop(&mut self) {
        self.numbers.end(self.gid, self.sent.load(Ordering::Acquire));
    }
}

impl Publisher for RawPublisher {
    fn wanted(&self) -> bool {
        self.publisher.matching_status().wait().is_ok_and(|status| status.matching())
    }

    fn sent(&self) -> Option<([u8; 16], u64)> {
        Some(Self::sent(self))
    }

    fn put(&self, message: &Message) -> Result<(), TransportError> {
        let payload = message
            .encode()
            .map_err(|why| TransportError::new(format!("message for {}", self.publisher.key_expr()), why))?;
        self.put(payload)
    }
}

#[cfg(test)]
mod tests {
    use std::sync::mpsc;

    use modulo_runtime::SystemClock;
    use modulo_runtime::wire::keys::Hashes;

    use super::super::session::free_domain;
    use super::*;

    /// zenoh closes the link of a reader that takes no message which must not be dropped for 5 s.
    #[test]
    fn no_message_of_a_publisher_waits_for_a_reader() {
        let domain = free_domain();
        let open = || {
            ZenohTransport::open(domain, Hashes::Rihs01, Arc::new(SystemClock::default())).expect("a session")
        };
        let (sender, reader) = (open(), open());
        let node = NodeName::new("camera", "/", &[]).expect("a name");
        let endpoint = Endpoint {
            topic: "/sensor_info".into(),
            dds_type: "std_msgs::msg::dds_::String_".into(),
            type_hash: keys::NO_HASH.into(),
            qos: ":1:,1:,:,:,,".into(),
        };
        let (told, heard) = mpsc::channel();
        let take = move |sample: Sample| {
            let is_heartbeat = sample.key_expr().as_str().contains("/@adv/");
            // The test may have ended.
            let _ = told.send((is_heartbeat, sample.congestion_control()));
        };
        // The heartbeat has a key of its own, which `**` does not match.
        let subscriptions = ["/**", "/@adv/**"].map(|rest| {
            let key = format!("{}{rest}", sender.key(&endpoint));
            reader.session.declare_subscriber(key).callback(take.clone()).wait().expect("a subscriber")
        });
        let publisher = sender.advertise_raw(&node, &endpoint).expect("a publisher");
        let mut missing = [true, true];
        while missing != [false, false] {
            publisher.put(vec![0; 8]).expect("an open session");
            let Ok((is_heartbeat, control)) = heard.recv_timeout(Duration::from_secs(60)) else {
                panic!("{missing:?}")
            };
            assert_eq!(control, CongestionControl::Drop, "heartbeat: {is_heartbeat}");
            missing[usize::from(is_heartbeat)] = false;
        }
        drop(subscriptions);
    }
}
