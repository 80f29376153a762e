//! The transport between the nodes of one process: it hands on an `Arc` and serialises nothing. A message that a
//! subscriber does not take in time is replaced, as between processes.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use modulo_runtime::wire::keys::EntityKind;
use modulo_runtime::{Address, Message, MessageKind, NodeName, Qos};

use super::{Deliver, Guard, Incoming, NodeId, OnDrop, ParameterPort, Publisher, Transport, TransportError};

/// The graph of one process. Clones share it.
#[derive(Clone, Default)]
pub struct LocalTransport {
    /// By number, in the order in which they came.
    entities: Arc<Mutex<BTreeMap<u64, Entity>>>,
}

/// A node, a publisher or a subscription.
struct Entity {
    kind: EntityKind,
    /// Fully qualified name of its node.
    node: String,
    /// Topic and kind of the messages of an endpoint.
    topic: Option<(String, MessageKind)>,
    /// Takes the messages of a subscription.
    deliver: Option<Deliver>,
    /// The last message of a latched publisher, for late readers.
    last: Option<Message>,
}

impl Entity {
    fn is_on(&self, kind: EntityKind, topic: &str) -> bool {
        self.kind == kind && self.topic.as_ref().is_some_and(|(on, _)| on == topic)
    }

    /// Returns its node: one process is one session.
    fn node_id(&self) -> NodeId {
        NodeId { name: self.node.clone(), session: String::new() }
    }
}

struct LocalPublisher {
    transport: LocalTransport,
    id: u64,
    address: Address,
    _gone: Guard,
}

impl LocalTransport {
    fn entities(&self) -> MutexGuard<'_, BTreeMap<u64, Entity>> {
        self.entities.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Adds an entity of `node`, which is there until the guard is dropped.
    fn declare(
        &self,
        kind: EntityKind,
        node: &NodeName,
        address: Option<&Address>,
        deliver: Option<Deliver>,
    ) -> (u64, Guard) {
        let topic = address.map(|address| (address.topic.clone(), address.kind));
        let mut entities = self.entities();
        let id = entities.last_key_value().map_or(0, |(last, _)| last + 1);
        // Before the subscription is there: no message may come between these and the next one.
        let on_topic = |publisher: &&Entity| {
            address.is_some_and(|address| publisher.is_on(EntityKind::Publisher, &address.topic))
        };
        for last in entities.values().filter(on_topic).filter_map(|publisher| publisher.last.clone()) {
            deliver.iter().for_each(|deliver| deliver(Incoming::Message(last.clone())));
        }
        entities.insert(id, Entity { kind, node: node.fully_qualified(), topic, deliver, last: None });
        let transport = self.clone();
        (id, Box::new(OnDrop(move || drop(transport.entities().remove(&id)))))
    }
}

impl Publisher for LocalPublisher {
    fn wanted(&self) -> bool {
        let entities = self.transport.entities();
        entities.values().any(|entity| entity.is_on(EntityKind::Subscription, &self.address.topic))
    }

    fn put(&self, message: &Message) -> Result<(), TransportError> {
        // Held while messages are delivered, so that a subscription that has ended receives none.
        let mut entities = self.transport.entities();
        if self.address.qos == Qos::Latched
            && let Some(own) = entities.get_mut(&self.id)
        {
            own.last = Some(message.clone());
        }
        let topic = &self.address.topic;
        let readers = entities.values().filter(|entity| entity.is_on(EntityKind::Subscription, topic));
        readers
            .filter_map(|reader| reader.deliver.as_ref())
            .for_each(|deliver| deliver(Incoming::Message(message.clone())));
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

    fn nodes(&self) -> Vec<NodeId> {
        let entities = self.entities();
        entities.values().filter(|entity| entity.kind == EntityKind::Node).map(Entity::node_id).collect()
    }

    fn id_of(&self, node: &NodeName) -> NodeId {
        NodeId { name: node.fully_qualified(), session: String::new() }
    }

    fn endpoints(&self, kind: EntityKind, topic: &str) -> Vec<NodeId> {
        self.entities().values().filter(|entity| entity.is_on(kind, topic)).map(Entity::node_id).collect()
    }

    fn is_ready(&self, node: &str) -> bool {
        self.nodes().iter().any(|announced| announced.name == node)
    }

    fn users(&self, end: EntityKind, kind: MessageKind) -> Vec<(String, String)> {
        let entities = self.entities();
        let ends = entities.values().filter(|entity| entity.kind == end);
        let on_topics = ends.filter_map(|entity| Some((entity.topic.as_ref()?, &entity.node)));
        let of_kind = on_topics.filter(|((_, on), _)| *on == kind);
        of_kind.map(|((topic, _), node)| (topic.clone(), node.clone())).collect()
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
