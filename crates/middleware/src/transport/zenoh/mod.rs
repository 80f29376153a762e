//! The wire: the suite's nodes on a zenoh session, speaking the rmw_zenoh convention. The only folder that names zenoh.
//!
//! Sessions of one machine find each other without a router: the first one listens on a loopback port of the domain,
//! all others connect to it and learn of each other there. When it ends, the next new session takes its place. A router
//! on port 7447 is used when there is one.

mod listen;
mod sent;
mod service;
mod session;
mod topic;

use std::collections::{BTreeMap, BTreeSet};
use std::fmt;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use modulo_runtime::wire::keys::{self, Endpoint, EntityKind, Hashes, Token};
use modulo_runtime::{Address, Clock, NodeName};
use zenoh::liveliness::LivelinessToken;
use zenoh::pubsub::Subscriber;
use zenoh::sample::SampleKind;
use zenoh::shm::ShmClientStorage;
use zenoh::{Session, Wait};

pub use listen::TopicListener;
pub use service::{RawAnswer, RawService};
pub use session::meeting_port;
pub use topic::RawPublisher;

use sent::SentNumbers;

use super::{Deliver, Enable, Guard, Incoming, ParameterPort, Publisher, Transport, TransportError};

use crate::graph::Graph;
use crate::graph::discovery::{LostPublisher, Twins};
use crate::process::sockets;

/// A zenoh session in one ROS domain. Dropping it ends the session after everything sent has left, in some seconds at
/// most.
pub struct ZenohTransport {
    session: Session,
    /// Each connection holds it while shared memory is enabled.
    shared_memory: Arc<ShmClientStorage>,
    domain: u32,
    hashes: Hashes,
    clock: Arc<dyn Clock>,
    graph: Arc<Mutex<Arc<Graph>>>,
    numbers: Arc<SentNumbers>,
    next_id: AtomicU64,
    node_ids: Mutex<BTreeMap<String, u64>>,
    _watch: Subscriber<()>,
}

impl ZenohTransport {
    /// Opens a session in `domain`. `ZENOH_SESSION_CONFIG_URI` replaces the configuration, `ZENOH_CONFIG_OVERRIDE`
    /// ("key=json5;key=json5") changes single keys of it. `hashes` is the form that the other nodes of the domain use.
    pub fn open(domain: u32, hashes: Hashes, clock: Arc<dyn Clock>) -> Result<Self, TransportError> {
        let shared_memory = Arc::new(ShmClientStorage::builder().with_default_client_set().build());
        let session = session::open_session(domain, &shared_memory)?;
        let graph = Arc::<Mutex<Arc<Graph>>>::default();
        let watch = watch_graph(&session, domain, &graph)?;
        let numbers = Arc::new(SentNumbers::open(&session, domain)?);
        look_again(&graph, &numbers, session.zid().to_string())?;
        Ok(Self {
            session,
            shared_memory,
            domain,
            hashes,
            clock,
            graph,
            numbers,
            next_id: AtomicU64::new(0),
            node_ids: Mutex::default(),
            _watch: watch,
        })
    }

    /// Returns the nodes that take each other's place now where that concerns this session.
    pub fn twins(&self) -> Vec<Twins> {
        lock(&self.graph).twins_of(&self.session.zid().to_string())
    }

    /// Returns the graph as it is now.
    pub fn graph(&self) -> Arc<Graph> {
        lock(&self.graph).clone()
    }

    /// Returns the publishers that have gone without a word that they end: the link to them, or their process, is lost. Those of
    /// other programs give no such word and are left out.
    pub fn lost_publishers(&self) -> Vec<LostPublisher> {
        let graph = lock(&self.graph);
        let is_lost = |gid: &[u8; 16]| self.numbers.told(gid).is_some_and(|told| !told.ended);
        graph.gone().filter(|(gid, _)| is_lost(gid)).map(|(_, gone)| gone.clone()).collect()
    }

    /// Returns the ROS domain of the session.
    pub fn domain(&self) -> u32 {
        self.domain
    }

    /// Returns the form of type hashes in this domain.
    pub fn hashes(&self) -> Hashes {
        self.hashes
    }

    fn new_id(&self) -> u64 {
        self.next_id.fetch_add(1, Ordering::Relaxed)
    }

    fn token(&self, node: &NodeName, kind: EntityKind, endpoint: Option<Endpoint>) -> Token {
        // All endpoints of a node carry its number, whichever of them is declared first.
        let node_id = *lock(&self.node_ids).entry(node.fully_qualified()).or_insert_with(|| self.new_id());
        // As in rmw_zenoh, a node and its endpoints are numbered by one counter.
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
            backends: String::new(),
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

    /// Returns the form of `hash` on this wire.
    fn hash(&self, hash: String) -> String {
        match self.hashes {
            Hashes::Rihs01 => hash,
            Hashes::None => keys::NO_HASH.to_owned(),
        }
    }

    fn topic_endpoint(&self, address: &Address) -> Endpoint {
        Endpoint {
            topic: address.topic.clone(),
            dds_type: modulo_msgs::dds_name(address.kind.type_name()),
            type_hash: self.hash(address.kind.type_hash()),
            qos: address
                .profile
                .map_or_else(|| keys::qos_string(address.qos).to_owned(), |own| own.to_string()),
        }
    }

    fn key(&self, endpoint: &Endpoint) -> String {
        keys::data_key(self.domain, &endpoint.topic, &endpoint.dds_type, &endpoint.type_hash)
    }
}

impl Drop for ZenohTransport {
    fn drop(&mut self) {
        session::close(&self.session);
        // Where a peer closes at the same moment, a task of zenoh outlives the closing, and may be the last to hold the pool of
        // shared memory. To free it while the process ends panics, and aborts the process where two images are in it.
        session::wait_for_connections(&self.shared_memory);
    }
}

impl Transport for ZenohTransport {
    fn advertise(&self, node: &NodeName, address: &Address) -> Result<Box<dyn Publisher>, TransportError> {
        Ok(Box::new(self.advertise_raw(node, &self.topic_endpoint(address))?))
    }

    fn subscribe(
        &self,
        node: &NodeName,
        address: &Address,
        deliver: Deliver,
    ) -> Result<Guard, TransportError> {
        self.subscribe_raw(node, &self.topic_endpoint(address), move |sample| {
            deliver(Incoming::Sample(sample))
        })
    }

    fn announce(&self, node: &NodeName) -> Result<Guard, TransportError> {
        Ok(Box::new(self.declare(&self.token(node, EntityKind::Node, None))?))
    }

    fn serve_parameters(&self, node: &NodeName, port: ParameterPort) -> Result<Guard, TransportError> {
        // Those that may wait for a model have a thread of their own.
        let (setting, reading) =
            service::handlers(port).into_iter().partition(|service| service.name.starts_with("set_"));
        Ok(Box::new((self.serve_raw(node, setting)?, self.serve_raw(node, reading)?)))
    }

    fn serve_enable(&self, node: &NodeName, enable: Enable) -> Result<Guard, TransportError> {
        self.serve_raw(node, vec![service::enable_service(enable)])
    }

    fn graph(&self) -> Arc<Graph> {
        self.graph()
    }

    fn session(&self) -> String {
        self.session.zid().to_string()
    }

    fn last_sent(&self, publisher: &[u8; 16]) -> Option<i64> {
        self.numbers.told(publisher).map(|told| told.last)
    }

    fn lost_publisher(&self, topic: &str) -> Option<LostPublisher> {
        self.lost_publishers().into_iter().find(|lost| lost.topic == topic)
    }

    /// Returns 300 ms: the end of a token travels in another queue than the data and may overtake it.
    fn settling(&self) -> Duration {
        Duration::from_millis(300)
    }
}

fn stamp(clock: &dyn Clock) -> i64 {
    i64::try_from(clock.now_ns()).unwrap_or(i64::MAX)
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Keeps `graph` as it is in `domain` until the subscriber is dropped, and warns once about each endpoint that does not
/// fit an endpoint of this session, since zenoh gives no warning.
fn watch_graph(
    session: &Session,
    domain: u32,
    graph: &Arc<Mutex<Arc<Graph>>>,
) -> Result<Subscriber<()>, TransportError> {
    let (graph, own) = (graph.clone(), session.zid().to_string());
    let warned = Mutex::new(BTreeSet::new());
    session
        .liveliness()
        .declare_subscriber(keys::token_selector(domain))
        // Tokens from before this session count as well.
        .history(true)
        .callback(move |sample| {
            let key = sample.key_expr().as_str();
            match sample.kind() {
                SampleKind::Put => {
                    for conflict in appear(&graph, key, &own) {
                        // A token comes again after each reconnection, but its conflict is reported once.
                        warn_once(&mut lock(&warned), &conflict, &conflict);
                    }
                }
                SampleKind::Delete => Arc::make_mut(&mut lock(&graph)).disappear(key),
            }
        })
        .wait()
        .map_err(|why| TransportError::new(format!("watch of domain {domain}"), why))
}

/// Most warnings of one kind: peers may invent names without end.
const WARNINGS: usize = 256;

/// Gives `warning`, unless `what` was warned of before.
fn warn_once<T: Ord + Clone>(warned: &mut BTreeSet<T>, what: &T, warning: &dyn fmt::Display) {
    if warned.len() < WARNINGS && warned.insert(what.clone()) {
        tracing::warn!("{warning}");
        if warned.len() == WARNINGS {
            tracing::warn!("these were {WARNINGS} warnings of this kind, and no more of them are given");
        }
    }
}

/// Time between two looks at the graph and the sockets.
const LOOK: Duration = Duration::from_millis(500);

/// Until the graph is dropped, keeps links from waiting when they are closed, tells the `numbers` of this session, and warns once of
/// the nodes of `graph` that take each other's place, if that concerns the session `own`. They count when two looks find them: the
/// token of a node that was killed may outlive it for a moment.
fn look_again(
    graph: &Arc<Mutex<Arc<Graph>>>,
    numbers: &Arc<SentNumbers>,
    own: String,
) -> Result<(), TransportError> {
    let (graph, numbers) = (Arc::downgrade(graph), Arc::downgrade(numbers));
    let look = move || {
        let (mut seen, mut warned) = (Vec::new(), BTreeSet::new());
        loop {
            std::thread::sleep(LOOK);
            let (Some(graph), Some(numbers)) = (graph.upgrade(), numbers.upgrade()) else { return };
            numbers.tell();
            Arc::make_mut(&mut lock(&graph)).pass(LOOK);
            // A link is closed after it has been silent for much longer than this.
            sockets::close_without_waiting();
            let now = lock(&graph).twins_of(&own);
            for twins in now.iter().filter(|twins| seen.contains(*twins)) {
                warn_once(&mut warned, &twins.nodes, twins);
            }
            seen = now;
        }
    };
    let thread = std::thread::Builder::new().name("look".into()).spawn(look);
    thread.map(drop).map_err(|why| TransportError::new("thread that looks at the graph", why))
}

/// Adds a token to the graph. Returns its conflicts with the endpoints of session `own` in words.
fn appear(graph: &Mutex<Arc<Graph>>, key: &str, own: &str) -> Vec<String> {
    let mut graph = lock(graph);
    Arc::make_mut(&mut graph).appear(key);
    // Other programs may use keys of this form for something else.
    let Some(token) = Token::parse(key) else { return Vec::new() };
    let conflicts = graph.conflicts_with(&token);
    let ours = conflicts.filter(|(other, _)| token.session == own || other.session == own);
    ours.map(|(_, conflict)| conflict).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_without_end_are_not_remembered_without_end() {
        let mut warned = BTreeSet::new();
        for number in 0..2 * WARNINGS {
            warn_once(&mut warned, &number, &"a peer does not fit");
        }
        assert_eq!(warned.len(), WARNINGS);
    }
}
