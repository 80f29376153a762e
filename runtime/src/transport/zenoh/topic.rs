//! Publishers and subscriptions of ready-made CDR.

use std::sync::Arc;
use std::sync::atomic::{AtomicI64, Ordering};

use zenoh::Wait;
use zenoh::liveliness::LivelinessToken;
use zenoh::pubsub::Publisher;
use zenoh::qos::{CongestionControl, Reliability};

use super::{ZenohTransport, stamp};
use crate::clock::Clock;
use crate::message::Message;
use crate::name::Place;
use crate::topic::Qos;
use crate::transport::keys::{self, Attachment, Endpoint, EntityKind};
use crate::transport::{Guard, Outlet, TransportError};

/// A publisher of ready-made CDR. Dropping it takes it out of the graph.
pub struct RawOutlet {
    publisher: Publisher<'static>,
    clock: Arc<dyn Clock>,
    gid: [u8; 16],
    sequence: AtomicI64,
    _token: LivelinessToken,
}

/// A sample as it came.
#[derive(Clone, Debug)]
pub struct RawSample {
    /// CDR with its encapsulation header.
    pub payload: Vec<u8>,
    /// What came with it; nodes of a ROS stack always send one.
    pub attachment: Option<Attachment>,
}

impl ZenohTransport {
    /// Publishes ready-made CDR on `endpoint`.
    ///
    /// # Errors
    /// [`TransportError`] with what zenoh says.
    pub fn advertise_raw(&self, node: &Place, endpoint: &Endpoint) -> Result<RawOutlet, TransportError> {
        let reliability = match keys::qos_of(&endpoint.qos) {
            Qos::Images | Qos::Clock => Reliability::BestEffort,
            Qos::Results | Qos::Latched | Qos::Events | Qos::Logs => Reliability::Reliable,
        };
        let publisher = self
            .session
            .declare_publisher(self.key(endpoint))
            .congestion_control(CongestionControl::Drop)
            .reliability(reliability)
            .wait()
            .map_err(|why| TransportError::new(format!("publisher of {}", endpoint.topic), why))?;
        let token = self.token(node, EntityKind::Publisher, Some(endpoint.clone()));
        Ok(RawOutlet {
            publisher,
            clock: self.clock.clone(),
            gid: token.gid(),
            sequence: AtomicI64::new(1),
            _token: self.declare(&token)?,
        })
    }

    /// Hands every sample of `endpoint` to `take`, on zenoh's own thread, until
    /// the guard is dropped.
    ///
    /// # Errors
    /// [`TransportError`] with what zenoh says.
    pub fn subscribe_raw(
        &self,
        node: &Place,
        endpoint: &Endpoint,
        take: impl Fn(RawSample) + Send + Sync + 'static,
    ) -> Result<Guard, TransportError> {
        let subscriber = self
            .session
            .declare_subscriber(self.key(endpoint))
            .callback(move |sample| {
                let attachment = sample.attachment().map(|a| a.to_bytes());
                take(RawSample {
                    payload: sample.payload().to_bytes().into_owned(),
                    attachment: attachment.as_deref().and_then(Attachment::parse),
                });
            })
            .wait()
            .map_err(|why| TransportError::new(format!("subscription of {}", endpoint.topic), why))?;
        let token = self.declare(&self.token(node, EntityKind::Subscription, Some(endpoint.clone())))?;
        Ok(Box::new((subscriber, token)))
    }
}

impl RawOutlet {
    /// Whether anybody reads this topic now.
    pub fn wanted(&self) -> bool {
        self.publisher.matching_status().wait().is_ok_and(|status| status.matching())
    }

    /// Sends CDR with its encapsulation header.
    ///
    /// # Errors
    /// [`TransportError`] when zenoh does not take it.
    pub fn put(&self, payload: Vec<u8>) -> Result<(), TransportError> {
        let attachment = Attachment {
            sequence: self.sequence.fetch_add(1, Ordering::Relaxed),
            stamp_ns: stamp(&*self.clock),
            gid: self.gid,
        };
        let put = self.publisher.put(payload).attachment(attachment.to_bytes().as_slice());
        put.wait().map_err(|why| TransportError::new(format!("put on {}", self.publisher.key_expr()), why))
    }
}

impl Outlet for RawOutlet {
    fn wanted(&self) -> bool {
        self.wanted()
    }

    fn put(&self, message: &Message) -> Result<(), TransportError> {
        let payload = message
            .encode()
            .map_err(|why| TransportError::new(format!("message for {}", self.publisher.key_expr()), why))?;
        self.put(payload)
    }
}
