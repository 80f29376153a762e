//! A transport within one process for tests of live nodes.

use std::sync::mpsc::{Receiver, Sender, channel};
use std::sync::{Arc, Mutex};
use std::time::Duration;

use modulo_middleware::graph::Graph;
use modulo_middleware::transport::local::LocalTransport;
use modulo_middleware::transport::{Deliver, Guard, ParameterPort, Publisher, Transport, TransportError};
use modulo_runtime::{Address, NodeName};

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
    fn graph(&self) -> Arc<Graph> {
        self.local.graph()
    }
    fn session(&self) -> String {
        self.local.session()
    }
    fn settling(&self) -> Duration {
        self.local.settling()
    }
}
