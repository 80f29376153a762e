//! The transport between the nodes of one process: it hands on an `Arc` and serialises nothing. A message that a
//! subscriber does not take in time is replaced, as between processes.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use modulo_runtime::wire::keys::{Endpoint, EntityKind, NO_HASH, Token};
use modulo_runtime::{Address, Message, NodeName, Qos};

use super::{Deliver, Guard, Incoming, OnDrop, ParameterPort, Publisher, Transport, TransportError};
use crate::graph::Graph;

/// The graph of one process. Clones share it.
#[derive(Clone, Default)]
pub struct LocalTransport {
    entities: Arc<Mutex<Entities>>,
}

/// All nodes and endpoints that were declared. Topics are kept by the number of the endpoint.
#[derive(Default)]
struct Entities {
    graph: Arc<Graph>,
    declared: u64,
    /// The topics of subscriptions, and the functions that take their messages.
    readers: BTreeMap<u64, (String, Deliver)>,
    /// The last message of a latched publisher, for late readers.
    last: BTreeMap<u64, (String, Message)>,
}

struct LocalPublisher {
    transport: LocalTransport,
    id: u64,
    address: Address,
    _gone: Guard,
}

impl LocalTransport {
    fn entities(&self) -> MutexGuard<'_, Entities> {
        self.entities.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn token(&self, kind: EntityKind, node: &NodeName, id: u64, address: Option<&Address>) -> Token {
        let endpoint = address.map(|address| Endpoint {
            topic: address.topic.clone(),
            dds_type: modulo_msgs::dds_name(address.kind.type_name()),
            type_hash: NO_HASH.to_owned(),
            qos: String::new(),
        });
        let (session, backends) = (self.session(), String::new());
        let (namespace, node) = (node.namespace.clone(), node.name.clone());
        Token { domain: 0, session, node_id: id, entity_id: id, kind, namespace, node, endpoint, backends }
    }

    /// Adds an entity of `node`, which is there until the guard is dropped.
    fn declare(
        &self,
        kind: EntityKind,
        node: &NodeName,
        address: Option<&Address>,
        deliver: Option<Deliver>,
    ) -> (u64, Guard) {
        let mut entities = self.entities();
        let id = entities.declared;
        entities.declared += 1;
        let key = self.token(kind, node, id, address).to_key();
        Arc::make_mut(&mut entities.graph).appear(&key);
        if let (Some(Address { topic, .. }), Some(deliver)) = (address, deliver) {
            // Before the subscription is there: no message may come between these and the next one.
            let last = entities.last.values().filter(|(on, _)| on == topic);
            last.for_each(|(_, last)| deliver(Incoming::Message(last.clone())));
            entities.readers.insert(id, (topic.clone(), deliver));
        }
        let transport = self.clone();
        let end = move || {
            let mut entities = transport.entities();
            Arc::make_mut(&mut entities.graph).disappear(&key);
            entities.last.remove(&id);
            entities.readers.remove(&id);
        };
        (id, Box::new(OnDrop(end)))
    }
}

impl Publisher for LocalPublisher {
    fn wanted(&self) -> bool {
        self.transport.entities().readers.values().any(|(topic, _)| *topic == self.address.topic)
    }

    fn put(&self, message: &Message) -> Result<(), TransportError> {
        // Held while messages are delivered, so that a subscription that has ended receives none.
        let mut entities = self.transport.entities();
        let Address { topic, qos, .. } = &self.address;
        if *qos == Qos::Latched {
            entities.last.insert(self.id, (topic.clone(), message.clone()));
        }
        let readers = entities.readers.values().filter(|(on, _)| on == topic);
        readers.for_each(|(_, deliver)| deliver(Incoming::Message(message.clone())));
        Ok(())
    }
}

impl Transport for LocalTransport {
    fn advertise(&self, node: &NodeName, address: &Address) -> Result<Box<dyn Publisher>, TransportError> {
        let (id, _gone) = self.declare(EntityKind::Publisher, node, Some(address), None);
        Ok(Box::new(LocalPublisher { transport: self.clone(), id, address: address.clone(), _gone }))
    }

    fn subscribe(
        &self,
        node: &NodeName,
        address: &Address,
        deliver: Deliver,
    ) -> Result<Guard, TransportError> {
        Ok(self.declare(EntityKind::Subscription, node, Some(address), Some(deliver)).1)
    }

    fn announce(&self, node: &NodeName) -> Result<Guard, TransportError> {
        Ok(self.declare(EntityKind::Node, node, None, None).1)
    }

    /// Keeps `port` and offers it to no caller: a local node cannot be reached from outside of its process.
    fn serve_parameters(&self, _node: &NodeName, port: ParameterPort) -> Result<Guard, TransportError> {
        Ok(Box::new(port))
    }

    fn graph(&self) -> Arc<Graph> {
        self.entities().graph.clone()
    }

    /// Returns the one session of a process.
    fn session(&self) -> String {
        "local".to_owned()
    }

    fn settling(&self) -> Duration {
        Duration::ZERO
    }
}

#[cfg(test)]
mod tests {
    use std::sync::mpsc::channel;

    use modulo_msgs::vision_msgs::Detection2DArray;

    use super::*;
    use modulo_runtime::MessageKind;

    #[test]
    fn declarations_end_with_their_guards() {
        let transport = LocalTransport::default();
        let node = NodeName::new("n", "/", &[]).expect("valid");
        let address =
            Address { topic: "/t".into(), kind: MessageKind::Detections, qos: Qos::Results, profile: None };
        let publisher = transport.advertise(&node, &address).expect("local");
        let subscribers = || transport.endpoints(EntityKind::Subscription, "/t").len();
        assert!(!publisher.wanted() && transport.publishers("/t") == ["/n"] && !transport.is_ready("/n"));

        let (sender, arrived) = channel();
        let deliver = Box::new(move |incoming| sender.send(incoming).expect("the test listens"));
        let subscription = transport.subscribe(&node, &address, deliver).expect("local");
        let ready = transport.announce(&node).expect("local");
        assert!(publisher.wanted() && transport.is_ready("/n") && subscribers() == 1);

        let array = Arc::new(Detection2DArray::default());
        publisher.put(&Message::Detections(array.clone())).expect("local");
        let Ok(Incoming::Message(Message::Detections(got))) = arrived.try_recv() else {
            panic!("the message must have arrived")
        };
        assert!(Arc::ptr_eq(&got, &array), "shared, not copied");

        drop((subscription, ready));
        assert!(!publisher.wanted() && !transport.is_ready("/n"));
        drop(publisher);
        assert!(transport.publishers("/t").is_empty());
    }

    #[test]
    fn a_late_reader_gets_the_last_message_of_a_latched_topic() {
        let transport = LocalTransport::default();
        let node = NodeName::new("n", "/", &[]).expect("valid");
        for (qos, expected) in [(Qos::Latched, 1), (Qos::Results, 0)] {
            let address = Address { topic: "/t".into(), kind: MessageKind::Detections, qos, profile: None };
            let publisher = transport.advertise(&node, &address).expect("local");
            for _ in 0..2 {
                publisher.put(&Message::Detections(Arc::default())).expect("local");
            }
            let (sender, arrived) = channel();
            let deliver = Box::new(move |incoming| sender.send(incoming).expect("the test listens"));
            let _subscription = transport.subscribe(&node, &address, deliver).expect("local");
            assert_eq!(arrived.try_iter().count(), expected, "{qos:?}");
        }
    }
}
