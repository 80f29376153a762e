//! The wire: the suite's nodes on a zenoh session, speaking the rmw_zenoh
//! convention. The only file that names zenoh.
//!
//! Sessions of one machine find each other without a router: the first one
//! listens on a loopback port of the domain, all others connect to it and learn
//! of each other there. When it ends, the next new session takes its place. A
//! router on port 7447 is used when there is one.

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicI64, AtomicU64, Ordering};
use std::sync::mpsc::channel;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread;
use std::time::Duration;

use zenoh::liveliness::LivelinessToken;
use zenoh::pubsub::{Publisher, Subscriber};
use zenoh::qos::{CongestionControl, Reliability};
use zenoh::query::{ConsolidationMode, Query, QueryTarget};
use zenoh::sample::SampleKind;
use zenoh::{Config, Session, Wait};

use super::graph::Graph;
use super::keys::{self, Attachment, Endpoint, EntityKind, Token};
use super::{Address, Guard, Inlet, Outlet, ParameterPort, Parcel, Transport, TransportError};
use crate::clock::Clock;
use crate::inbox::Inbox;
use crate::message::Message;
use crate::name::Place;
use crate::parameter_service::Service;
use crate::topic::Qos;

/// First of the loopback ports on which sessions meet, one a domain.
const MEETING_PORT: u16 = 7450;

/// A zenoh session in one ROS domain.
pub struct ZenohTransport {
    session: Session,
    domain: u32,
    clock: Arc<dyn Clock>,
    graph: Arc<Mutex<Graph>>,
    next_id: AtomicU64,
    node_ids: Mutex<BTreeMap<String, u64>>,
    _watch: Subscriber<()>,
}

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

struct ZenohInlet {
    lost: Arc<AtomicU64>,
    _subscription: Guard,
}

impl ZenohTransport {
    /// Opens a session in `domain`. `ZENOH_SESSION_CONFIG_URI` replaces the
    /// configuration, `ZENOH_CONFIG_OVERRIDE` ("key=json5;key=json5") changes
    /// single keys of it.
    ///
    /// # Errors
    /// [`TransportError`] with what zenoh says.
    pub fn open(domain: u32, clock: Arc<dyn Clock>) -> Result<Self, TransportError> {
        let failed = |why: zenoh::Error| TransportError::new(format!("zenoh session, domain {domain}"), why);
        let session = open_session(domain)?;
        let graph = Arc::new(Mutex::new(Graph::default()));
        let watch = session
            .liveliness()
            .declare_subscriber(keys::token_selector(domain))
            .history(true)
            .callback({
                let graph = graph.clone();
                move |sample| {
                    let mut graph = lock(&graph);
                    match sample.kind() {
                        SampleKind::Put => graph.appear(sample.key_expr().as_str()),
                        SampleKind::Delete => graph.disappear(sample.key_expr().as_str()),
                    }
                }
            })
            .wait()
            .map_err(failed)?;
        Ok(Self {
            session,
            domain,
            clock,
            graph,
            next_id: AtomicU64::new(0),
            node_ids: Mutex::default(),
            _watch: watch,
        })
    }

    /// The graph as it is now.
    pub fn graph(&self) -> Graph {
        lock(&self.graph).clone()
    }

    /// Ends the session after everything sent has left.
    pub fn close(self) {
        if let Err(why) = self.session.close().wait() {
            tracing::warn!("zenoh session did not close: {why}");
        }
    }

    fn new_id(&self) -> u64 {
        self.next_id.fetch_add(1, Ordering::Relaxed)
    }

    fn token(&self, node: &Place, kind: EntityKind, endpoint: Option<Endpoint>) -> Token {
        let node_id = *lock(&self.node_ids).entry(node.fully_qualified()).or_insert_with(|| self.new_id());
        let entity_id = if kind == EntityKind::Node { node_id } else { self.new_id() };
        Token {
            domain: self.domain,
            session: self.session.zid().to_string(),
            node_id,
            entity_id,
            kind,
            namespace: node.namespace.clone(),
            node: node.name.clone(),
            endpoint,
        }
    }

    fn declare(&self, token: &Token) -> Result<LivelinessToken, TransportError> {
        let key = token.to_key();
        self.session
            .liveliness()
            .declare_token(key.clone())
            .wait()
            .map_err(|why| TransportError::new(format!("token {key}"), why))
    }

    /// Publishes ready-made CDR on `endpoint`.
    ///
    /// # Errors
    /// [`TransportError`] with what zenoh says.
    pub fn advertise_raw(&self, node: &Place, endpoint: &Endpoint) -> Result<RawOutlet, TransportError> {
        let reliability = match keys::qos_of(&endpoint.qos) {
            Qos::Images => Reliability::BestEffort,
            Qos::Results | Qos::Latched => Reliability::Reliable,
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

    fn key(&self, endpoint: &Endpoint) -> String {
        keys::data_key(self.domain, &endpoint.topic, &endpoint.dds_type, &endpoint.type_hash)
    }
}

impl Transport for ZenohTransport {
    fn advertise(&self, node: &Place, address: &Address) -> Result<Box<dyn Outlet>, TransportError> {
        Ok(Box::new(self.advertise_raw(node, &topic_endpoint(address))?))
    }

    fn subscribe(
        &self,
        node: &Place,
        address: &Address,
        inbox: Arc<Inbox<Parcel>>,
        slot: usize,
    ) -> Result<Box<dyn Inlet>, TransportError> {
        let lost = Arc::new(AtomicU64::new(0));
        let gaps = Mutex::new(Gaps::default());
        let counter = lost.clone();
        let take = move |sample: RawSample| {
            if let Some(attachment) = &sample.attachment {
                counter.fetch_add(lock(&gaps).step(attachment), Ordering::Relaxed);
            }
            inbox.push(slot, Parcel::Bytes(sample.payload));
        };
        let subscription = self.subscribe_raw(node, &topic_endpoint(address), take)?;
        Ok(Box::new(ZenohInlet { lost, _subscription: subscription }))
    }

    fn announce(&self, node: &Place) -> Result<Guard, TransportError> {
        Ok(Box::new(self.declare(&self.token(node, EntityKind::Node, None))?))
    }

    /// Six queryables that feed one thread: a request may wait for the frame at
    /// hand, and zenoh's own threads must not wait with it.
    fn serve_parameters(&self, node: &Place, port: ParameterPort) -> Result<Guard, TransportError> {
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

    fn is_ready(&self, node: &str) -> bool {
        lock(&self.graph).has_node(node)
    }

    fn has_publisher(&self, topic: &str) -> bool {
        lock(&self.graph).endpoints(EntityKind::Publisher, topic).next().is_some()
    }

    /// A token's end travels in another queue than the data and may overtake it.
    fn settling(&self) -> Duration {
        Duration::from_millis(300)
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

impl Inlet for ZenohInlet {
    fn lost(&self) -> u64 {
        self.lost.load(Ordering::Relaxed)
    }
}

fn topic_endpoint(address: &Address) -> Endpoint {
    Endpoint {
        topic: address.topic.clone(),
        dds_type: modulo_msgs::dds_name(address.kind.type_name()),
        type_hash: address.kind.type_hash(),
        qos: keys::qos_string(address.qos).to_owned(),
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

fn stamp(clock: &dyn Clock) -> i64 {
    i64::try_from(clock.now_ns()).unwrap_or(i64::MAX)
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

/// Counts the holes in the sequence numbers of each publisher.
#[derive(Default)]
struct Gaps {
    last: BTreeMap<[u8; 16], i64>,
}

impl Gaps {
    /// How many samples are missing before this one. The first sample of a
    /// publisher starts its count: what it sent earlier was not for us.
    fn step(&mut self, attachment: &Attachment) -> u64 {
        let last = self.last.insert(attachment.gid, attachment.sequence);
        let missing = last.map_or(0, |last| attachment.sequence.saturating_sub(last).saturating_sub(1));
        u64::try_from(missing).unwrap_or(0)
    }
}

/// What a session is to the others of its machine.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Role {
    /// Listens on the meeting port.
    Host,
    /// Connects to it, again and again if it must.
    Guest,
}

fn open_session(domain: u32) -> Result<Session, TransportError> {
    let open = |role| {
        let opened = zenoh::open(configuration(domain, role)?).wait();
        opened.map_err(|why| TransportError::new(format!("zenoh session, domain {domain}"), why))
    };
    // Another session may take the port between the look and the opening; the
    // operating system lets one of them have it.
    let free = std::net::TcpListener::bind(("127.0.0.1", meeting_port(domain))).is_ok();
    if free && let Ok(session) = open(Role::Host) {
        return Ok(session);
    }
    open(Role::Guest)
}

/// The loopback port on which the sessions of `domain` meet.
pub fn meeting_port(domain: u32) -> u16 {
    u16::try_from(domain).unwrap_or(u16::MAX).saturating_add(MEETING_PORT)
}

fn configuration(domain: u32, role: Role) -> Result<Config, TransportError> {
    let mut config = match std::env::var("ZENOH_SESSION_CONFIG_URI") {
        Ok(path) => Config::from_file(&path)
            .map_err(|why| TransportError::new(format!("ZENOH_SESSION_CONFIG_URI = {path}"), why))?,
        Err(_) => {
            let mut config = Config::default();
            for (key, value) in defaults(domain, role) {
                insert(&mut config, key, &value)?;
            }
            config
        }
    };
    let overrides = std::env::var("ZENOH_CONFIG_OVERRIDE").unwrap_or_default();
    for pair in overrides.split(';').filter(|pair| !pair.trim().is_empty()) {
        let (key, value) = pair.split_once('=').ok_or_else(|| {
            TransportError::new("ZENOH_CONFIG_OVERRIDE", format!("'{pair}' is not key=json5"))
        })?;
        insert(&mut config, key.trim(), value.trim())?;
    }
    Ok(config)
}

fn insert(config: &mut Config, key: &str, value: &str) -> Result<(), TransportError> {
    config
        .insert_json5(key, value)
        .map_err(|why| TransportError::new(format!("zenoh configuration {key} = {value}"), why))
}

/// rmw_zenoh's session, plus the meeting port, plus queues that hold a whole
/// image: with zenoh's default of two batches a 1.4 MB image is dropped as soon
/// as its reader is a millisecond late.
fn defaults(domain: u32, role: Role) -> Vec<(&'static str, String)> {
    let meeting = format!("\"tcp/127.0.0.1:{}\"", meeting_port(domain));
    let (listen, connect) = match role {
        Role::Host => (format!(", {meeting}"), String::new()),
        Role::Guest => (String::new(), format!(", {meeting}")),
    };
    vec![
        ("mode", "\"peer\"".into()),
        ("connect/endpoints", format!("[\"tcp/127.0.0.1:7447\"{connect}]")),
        ("connect/timeout_ms", "-1".into()),
        ("connect/exit_on_failure", "false".into()),
        ("connect/retry", "{ period_init_ms: 100, period_max_ms: 1000, period_increase_factor: 2 }".into()),
        ("listen/endpoints", format!("[\"tcp/127.0.0.1:0\"{listen}]")),
        ("listen/exit_on_failure", "true".into()),
        ("listen/timeout_ms", "0".into()),
        // Nobody else has to be there.
        ("open/return_conditions/connect_scouted", "false".into()),
        ("scouting/multicast/enabled", "false".into()),
        ("scouting/gossip/enabled", "true".into()),
        ("timestamping/enabled", "true".into()),
        ("queries_default_timeout", "600000".into()),
        ("transport/link/tx/queue/size/data", "16".into()),
        ("transport/link/tx/queue/congestion_control/drop/wait_before_drop", "20000".into()),
        ("transport/link/tx/queue/congestion_control/drop/max_wait_before_drop_fragments", "200000".into()),
    ]
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
