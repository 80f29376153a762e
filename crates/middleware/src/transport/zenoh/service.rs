//! Services: calls of others', answers of the services that every ROS 2 node has.

use std::error::Error;
use std::sync::Arc;
use std::thread;
use std::time::Duration;

use modulo_msgs::cdr;
use modulo_msgs::std_srvs::{SetBoolRequest, SetBoolResponse};
use modulo_runtime::name::did_you_mean;
use modulo_runtime::wire::attachment::Attachment;
use modulo_runtime::wire::keys::{self, Endpoint, EntityKind};
use modulo_runtime::{Clock, NodeName, RareWarnings};
use zenoh::Wait;
use zenoh::qos::Priority;
use zenoh::query::{ConsolidationMode, Query, QueryTarget};

use super::{ZenohTransport, stamp};
use crate::graph::type_description;
use crate::parameter::service::Service;
use crate::transport::queue::{Keep, Limit, Queue, Queued};
use crate::transport::{Enable, Guard, OnDrop, ParameterPort, TransportError};

impl ZenohTransport {
    /// Calls a service and waits for its answer.
    ///
    /// # Errors
    /// [`TransportError`] when no server answers within `patience`.
    pub fn call(
        &self,
        service: &str,
        ros_type: &str,
        request: Vec<u8>,
        patience: Duration,
    ) -> Result<Vec<u8>, TransportError> {
        let endpoint = self.service_endpoint(service.to_owned(), ros_type)?;
        let failed = |why: &dyn std::fmt::Display| TransportError::new(format!("call of {service}"), why);
        let attachment = Attachment { sequence: 1, stamp_ns: stamp(&*self.clock), gid: [0; 16], numbers: 1 };
        let replies = self
            .session
            .get(self.key(&endpoint))
            .payload(request)
            .attachment(attachment.to_bytes().as_slice())
            // Service servers declare themselves complete; without consolidation, the first answer comes at once.
            .target(QueryTarget::AllComplete)
            .consolidation(ConsolidationMode::None)
            // The call and its answer, which takes its priority, do not wait behind images.
            .priority(Priority::InteractiveHigh)
            .timeout(patience)
            .wait()
            .map_err(|why| failed(&why))?;
        // The channel closes at the timeout, or at once when no server has the key.
        let reply = replies.recv().map_err(|_| failed(&self.why_nobody_answers(&endpoint)))?;
        match reply.result() {
            Ok(sample) => Ok(sample.payload().to_bytes().into_owned()),
            Err(error) => Err(failed(&String::from_utf8_lossy(&error.payload().to_bytes()))),
        }
    }

    /// Returns why there is no answer: a server with another hash is another key to zenoh.
    fn why_nobody_answers(&self, asked: &Endpoint) -> String {
        let graph = self.graph();
        let servers = graph.endpoints(EntityKind::Server, &asked.topic);
        let other = servers.filter_map(|t| t.endpoint.as_ref()).find(|e| e.type_hash != asked.type_hash);
        match other {
            Some(other) if other.type_hash == keys::NO_HASH => {
                "the node is one without type hashes, as in ROS 2 Humble: set MODULO_TYPE_HASH=none".to_owned()
            }
            Some(other) => {
                format!("the node has {}, this command {}", other.type_hash, asked.type_hash)
            }
            None if graph.endpoints(EntityKind::Server, &asked.topic).next().is_some() => {
                "it serves this, but did not answer: it may be busy or hang (see its log), or a router on the way may deny the \
                 request (access_control in the configuration of the router, docs/how-to/two-machines.md)"
                    .to_owned()
            }
            None => {
                let (known, node) = (graph.nodes(), asked.topic.rsplit_once('/').map_or("", |(node, _)| node));
                let near = did_you_mean(node, known.iter().map(String::as_str));
                format!("no such node is in the graph{near}; is it running? modulo node list shows those that are")
            }
        }
    }

    /// Serves `handlers` by one thread for all of them: a request may wait for the frame at hand, and zenoh's own
    /// threads must not wait with it. When the queue is full, the caller is answered with an error at once.
    pub fn serve_raw(&self, node: &NodeName, handlers: Vec<RawService>) -> Result<Guard, TransportError> {
        let queue = Arc::new(Queue::new(self.clock.clone(), Limit { messages: CALLS, bytes: usize::MAX }));
        let lane = queue.open(Keep::All);
        let mut guards: Vec<Guard> = Vec::new();
        for (index, handler) in handlers.iter().enumerate() {
            let topic = format!("{}/{}", node.fully_qualified(), handler.name);
            let endpoint =
                Endpoint { qos: handler.qos.to_owned(), ..self.service_endpoint(topic, handler.ros_type)? };
            let queue = queue.clone();
            let queryable = self
                .session
                .declare_queryable(self.key(&endpoint))
                .complete(true)
                .callback(move |query| {
                    if let Some((_, query)) = queue.push(lane, (index, query)) {
                        refuse(&query, "the node is busy with other calls, or is ending; call again");
                    }
                })
                .wait()
                .map_err(|why| TransportError::new(format!("service {}", endpoint.topic), why))?;
            let token = self.declare(&self.token(node, EntityKind::Server, Some(endpoint)))?;
            guards.push(Box::new((queryable, token)));
        }
        let (clock, calls) = (self.clock.clone(), queue.clone());
        thread::Builder::new()
            .name("services".into())
            .spawn(move || answer_all(&calls, &handlers, &*clock))
            .map_err(|why| TransportError::new("thread of the services", why))?;
        Ok(Box::new((guards, OnDrop(move || queue.end()))))
    }

    fn service_endpoint(&self, name: String, ros_type: &str) -> Result<Endpoint, TransportError> {
        let unknown =
            || TransportError::new(format!("service {name}"), format!("type {ros_type} is unknown"));
        let type_hash = modulo_msgs::type_hash(ros_type).ok_or_else(unknown)?;
        Ok(Endpoint {
            topic: name,
            dds_type: modulo_msgs::dds_name(ros_type),
            type_hash: self.hash(type_hash),
            qos: keys::SERVICE_QOS.to_owned(),
        })
    }
}

/// Answers `calls` until they end.
fn answer_all(calls: &Queue<(usize, Query)>, handlers: &[RawService], clock: &dyn Clock) {
    let mut refusals = RareWarnings::default();
    while let Some(arrived) = calls.take(None) {
        let (service, query) = arrived.item;
        let handler = &handlers[service];
        // The caller gets the error, too: without any reply it would wait for its timeout.
        if let Err(why) = reply(handler, &query, clock) {
            if let Some(warning) = refusals.note(handler.name, &why, clock.ticks_ns()) {
                tracing::warn!("service {}: {warning}", handler.name);
            }
            refuse(&query, &why);
        }
    }
    for (name, warning) in refusals.rest() {
        tracing::warn!("service {name}: {warning}");
    }
}

/// Calls that wait for a node at most; each caller waits for its answer.
const CALLS: usize = 64;

/// A call of the service with this index.
impl Queued for (usize, Query) {}

fn refuse(query: &Query, why: &str) {
    if let Err(failed) = query.reply_err(why).wait() {
        tracing::debug!("a caller is gone: {failed}");
    }
}

/// One service of a node. Requests and responses are CDR with its encapsulation header.
pub struct RawService {
    /// Name below the node's.
    pub name: &'static str,
    /// ROS name of the type, such as `std_srvs/srv/Trigger`.
    pub ros_type: &'static str,
    /// QoS string for the token.
    pub qos: &'static str,
    /// Computes the response to a request; an error is logged and sent to the caller.
    pub answer: RawAnswer,
}

/// Computes the bytes of the response from the bytes of the request.
pub type RawAnswer = Box<dyn Fn(&[u8]) -> Result<Vec<u8>, Box<dyn Error>> + Send>;

impl RawService {
    /// Returns the service with this name and type that `answer` serves.
    pub fn new<E: Into<Box<dyn Error>>>(
        (name, ros_type): (&'static str, &'static str),
        qos: &'static str,
        answer: impl Fn(&[u8]) -> Result<Vec<u8>, E> + Send + 'static,
    ) -> Self {
        Self { name, ros_type, qos, answer: Box::new(move |request| answer(request).map_err(Into::into)) }
    }
}

/// Returns the services that every ROS 2 node has.
pub(super) fn handlers(port: ParameterPort) -> Vec<RawService> {
    let port = Arc::new(port);
    let parameters = Service::ALL.iter().map(|service| {
        let port = port.clone();
        RawService::new(service.name_and_type(), keys::PARAMETER_QOS, move |request| {
            service.answer(request, &port)
        })
    });
    let described =
        RawService::new(type_description::NAME_AND_TYPE, keys::SERVICE_QOS, type_description::answer);
    parameters.chain([described]).collect()
}

pub(super) fn enable_service(enable: Enable) -> RawService {
    RawService::new(("enable", "std_srvs/srv/SetBool"), keys::SERVICE_QOS, move |request| {
        let SetBoolRequest { data } = cdr::from_slice(request)?;
        let done = enable(data);
        let success = done.is_ok();
        let message = done.err().unwrap_or_else(|| if data { "enabled" } else { "disabled" }.to_owned());
        cdr::to_vec(&SetBoolResponse { success, message })
    })
}

/// Answers one service call. A call without payload or attachment is an error.
fn reply(handler: &RawService, query: &Query, clock: &dyn Clock) -> Result<(), String> {
    // A router that denies a service does so by the key: a pattern is another key to it, and would get through.
    if query.key_expr().as_str().contains('*') {
        return Err(format!(
            "a request for the pattern {}; ask for the key of one service",
            query.key_expr()
        ));
    }
    let attachment = query.attachment().map(|a| a.to_bytes());
    let caller = attachment.as_deref().and_then(Attachment::parse).ok_or("a request without attachment")?;
    let request = query.payload().ok_or("a request without payload")?.to_bytes();
    let answer = (handler.answer)(&request).map_err(|why| why.to_string())?;
    // The answer repeats the number and the id of the caller, by which rmw_zenoh finds its request.
    let attachment = Attachment { stamp_ns: stamp(clock), ..caller }.to_bytes();
    let reply = query.reply(query.key_expr().clone(), answer).attachment(attachment.as_slice());
    reply.wait().map_err(|why| why.to_string())
}
