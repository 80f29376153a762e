//! Services: calls of others', answers of our parameter services.

use std::sync::mpsc::channel;
use std::thread;
use std::time::Duration;

use zenoh::Wait;
use zenoh::query::{ConsolidationMode, Query, QueryTarget};

use super::{ZenohTransport, stamp};
use crate::clock::Clock;
use crate::name::Place;
use crate::parameter_service::Service;
use crate::transport::keys::{self, Attachment, Endpoint, EntityKind};
use crate::transport::{Guard, ParameterPort, TransportError};

impl ZenohTransport {
    /// Calls a service and waits for its answer.
    ///
    /// # Errors
    /// [`TransportError`] when nobody answers within `patience`.
    pub fn call(
        &self,
        service: &str,
        ros_type: &str,
        request: Vec<u8>,
        patience: Duration,
    ) -> Result<Vec<u8>, TransportError> {
        let endpoint = service_endpoint(service.to_owned(), ros_type);
        let failed = |why: &dyn std::fmt::Display| TransportError::new(format!("call of {service}"), why);
        let attachment = Attachment { sequence: 1, stamp_ns: stamp(&*self.clock), gid: [0; 16] };
        let replies = self
            .session
            .get(self.key(&endpoint))
            .payload(request)
            .attachment(attachment.to_bytes().as_slice())
            .target(QueryTarget::AllComplete)
            .consolidation(ConsolidationMode::None)
            .timeout(patience)
            .wait()
            .map_err(|why| failed(&why))?;
        let reply = replies.recv().map_err(|_| failed(&"nobody answered; is the node there?"))?;
        match reply.result() {
            Ok(sample) => Ok(sample.payload().to_bytes().into_owned()),
            Err(_) => Err(failed(&"the node answered with an error")),
        }
    }

    /// Six queryables that feed one thread: a request may wait for the frame at
    /// hand, and zenoh's own threads must not wait with it.
    pub(super) fn serve_six(&self, node: &Place, port: ParameterPort) -> Result<Guard, TransportError> {
        let (queue, queries) = channel::<(Service, Query)>();
        let mut guards: Vec<Guard> = Vec::new();
        for service in Service::ALL {
            let (name, ros_type) = service.name_and_type();
            let endpoint = service_endpoint(format!("{}/{name}", node.fully_qualified()), ros_type);
            let queue = queue.clone();
            let queryable = self
                .session
                .declare_queryable(self.key(&endpoint))
                .complete(true)
                .callback(move |query| {
                    // Fails only while the node is ending; the caller's timeout tells.
                    let _ = queue.send((service, query));
                })
                .wait()
                .map_err(|why| TransportError::new(format!("service {}", endpoint.topic), why))?;
            let token = self.declare(&self.token(node, EntityKind::Server, Some(endpoint)))?;
            guards.push(Box::new((queryable, token)));
        }
        let clock = self.clock.clone();
        thread::Builder::new()
            .name("parameters".into())
            .spawn(move || {
                for (service, query) in queries {
                    if let Err(why) = reply(service, &query, &port, &*clock) {
                        tracing::warn!("parameter service: {why}");
                    }
                }
            })
            .map_err(|why| TransportError::new("thread of the parameter services", why))?;
        Ok(Box::new(guards))
    }
}

fn service_endpoint(name: String, ros_type: &str) -> Endpoint {
    Endpoint {
        topic: name,
        dds_type: modulo_msgs::dds_name(ros_type),
        type_hash: modulo_msgs::type_hash(ros_type).unwrap_or_default(),
        qos: keys::SERVICE_QOS.to_owned(),
    }
}

/// Answers one service call; a call without payload or attachment is none.
fn reply(service: Service, query: &Query, port: &ParameterPort, clock: &dyn Clock) -> Result<(), String> {
    let attachment = query.attachment().map(|a| a.to_bytes());
    let caller = attachment.as_deref().and_then(Attachment::parse).ok_or("a request without attachment")?;
    let request = query.payload().ok_or("a request without payload")?.to_bytes();
    let answer = service.answer(&request, port).map_err(|why| why.to_string())?;
    let attachment = Attachment { stamp_ns: stamp(clock), ..caller }.to_bytes();
    let reply = query.reply(query.key_expr().clone(), answer).attachment(attachment.as_slice());
    reply.wait().map_err(|why| why.to_string())
}
