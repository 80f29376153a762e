//! A transport within one process for tests of live nodes.

use std::sync::mpsc::{Receiver, Sender, channel};
use std::sync::{Arc, Mutex};
use std::time::Duration;

use modulo_middleware::transport::local::LocalTransport;
use modulo_middleware::transport::{
    Deliver, Guard, NodeId, ParameterPort, Publisher, Transport, TransportError,
};
use modulo_runtime::wire::keys::EntityKind;
use modulo_runtime::{Address, MessageKind, NodeName};

/// A local transport that hands the parameters of its nodes to the test.
pub struct Offered {
    local: LocalTransport,
    ports: Mutex<Sender<ParameterPort>>,
}

impl Offered {
    /// Returns a transport without a node, and what its nodes offer.
    pub fn new() -> (Arc<Self>, Receiver<ParameterPort>) {
        let (ports, port) = channel();
        (Arc::new(Self { local: LocalTransport::default(), ports: Mutex::new(ports) }), port)
    }
}

impl Transport for Offered {
    fn advertise(&self, node: &NodeName, address: &Address) -> Result<Box<dyn Publisher>, TransportError> {
        self.local.advertise(node, address)
    }
    fn subscribe(&self, node: &NodeName, address: &Address, take: Deliver) -> Result<Guard, TransportError> {
        self.local.subscribe(node, address, take)
    }
    fn announce(&self, node: &NodeName) -> Result<Guard, TransportError> {
        self.local.announce(node)
    }
    fn serve_parameters(&self, _: &NodeName, port: ParameterPort) -> Result<Guard, TransportError> {
        self.ports.lock().expect("not poisoned").send(port).expect("the test listens");
        Ok(Box::new(()))
    }
    fn nodes(&self) -> Vec<NodeId> {
        self.local.nodes()
    }
    fn id_of(&self, node: &NodeName) -> NodeId {
        self.local.id_of(node)
    }
    fn is_ready(&self, node: &str) -> bool {
        self.local.is_ready(node)
    }
    fn endpoints(&self, kind: EntityKind, topic: &str) -> Vec<NodeId> {
        self.local.endpoints(kind, topic)
    }
    fn users(&self, end: EntityKind, kind: MessageKind) -> Vec<(String, String)> {
        self.local.users(end, kind)
    }
    fn settling(&self) -> Duration {
        self.local.settling()
    }
}
