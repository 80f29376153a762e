//! The transport between the nodes of one process: it hands on an `Arc` and serialises nothing. A message that a
//! subscriber does not take in time is replaced, as between processes.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use modulo_runtime::wire::keys::EntityKind;
use modulo_runtime::{Address, Message, MessageKind, NodeName};

use super::{Deliver, Guard, Incoming, NodeId, OnDrop, ParameterPort, Publisher, Transport, TransportError};

/// The graph of one process. Clones share it.
#[derive(Clone, Default)]
pub struct LocalTransport {
    graph: Arc<Mutex<LocalGraph>>,
}

#[derive(Default)]
struct LocalGraph {
    /// Topic, kind of its messages and node of each publisher.
    publishers: Vec<(String, MessageKind, String)>,
    subscribers: BTreeMap<String, Vec<Subscriber>>,
    nodes: Vec<String>,
    next_id: u64,
}

struct Subscriber {
    id: u64,
    kind: MessageKind,
    node: String,
    deliver: Deliver,
}

struct LocalPublisher {
    transport: LocalTransport,
    topic: String,
    _gone: Guard,
}

impl LocalTransport {
    fn graph(&self) -> MutexGuard<'_, LocalGraph> {
        self.graph.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Returns the node of this name: one process is one session.
fn local(name: &str) -> NodeId {
    NodeId { name: name.to_owned(), session: String::new() }
}

impl Publisher for LocalPublisher {
    fn wanted(&self) -> bool {
        self.transport.graph().subscribers.get(&self.topic).is_some_and(|s| !s.is_empty())
    }

    fn put(&self, message: &Message) -> Result<(), TransportError> {
        // Held while messages are delivered, so that a subscription that has ended receives none.
        let graph = self.transport.graph();
        for subscriber in graph.subscribers.get(&self.topic).into_iter().flatten() {
            (subscriber.deliver)(Incoming::Message(message.clone()));
        }
        Ok(())
    }
}

impl Transport for LocalTransport {
    fn advertise(&self, node: &NodeName, address: &Address) -> Result<Box<dyn Publisher>, TransportError> {
        let topic = address.topic.clone();
        let entry = (topic.clone(), address.kind, node.fully_qualified());
        self.graph().publishers.push(entry.clone());
        let transport = self.clone();
        let gone = OnDrop(move || {
            let publishers = &mut transport.graph().publishers;
            if let Some(index) = publishers.iter().position(|publisher| *publisher == entry) {
                // Only one entry: a node may publish a topic twice, and the other publisher is still there.
                publishers.swap_remove(index);
            }
        });
        Ok(Box::new(LocalPublisher { transport: self.clone(), topic, _gone: Box::new(gone) }))
    }

    fn subscribe(
        &self,
        node: &NodeName,
        address: &Address,
        deliver: Deliver,
    ) -> Result<Guard, TransportError> {
        let mut graph = self.graph();
        // A node may subscribe to one topic twice, so its name does not identify a subscription.
        let id = graph.next_id;
        graph.next_id += 1;
        let subscriber = Subscriber { id, kind: address.kind, node: node.fully_qualified(), deliver };
        graph.subscribers.entry(address.topic.clone()).or_default().push(subscriber);
        let (transport, topic) = (self.clone(), address.topic.clone());
        Ok(Box::new(OnDrop(move || {
            if let Some(list) = transport.graph().subscribers.get_mut(&topic) {
                list.retain(|s| s.id != id);
            }
        })))
    }

    fn announce(&self, node: &NodeName) -> Result<Guard, TransportError> {
        let name = node.fully_qualified();
        self.graph().nodes.push(name.clone());
        let transport = self.clone();
        Ok(Box::new(OnDrop(move || transport.graph().nodes.retain(|n| *n != name))))
    }

    /// Keeps `port` and offers it to no caller: a local node cannot be reached from outside of its process.
    fn serve_parameters(&self, _node: &NodeName, port: ParameterPort) -> Result<Guard, TransportError> {
        Ok(Box::new(port))
    }

    fn nodes(&self) -> Vec<NodeId> {
        self.graph().nodes.iter().map(|name| local(name)).collect()
    }

    fn id_of(&self, node: &NodeName) -> NodeId {
        local(&node.fully_qualified())
    }

    fn endpoints(&self, kind: EntityKind, topic: &str) -> Vec<NodeId> {
        let graph = self.graph();
        match kind {
            EntityKind::Publisher => {
                graph.publishers.iter().filter(|(on, ..)| on == topic).map(|(.., node)| local(node)).collect()
            }
            EntityKind::Subscription => {
                graph.subscribers.get(topic).into_iter().flatten().map(|s| local(&s.node)).collect()
            }
            EntityKind::Node | EntityKind::Server | EntityKind::Client => Vec::new(),
        }
    }

    fn is_ready(&self, node: &str) -> bool {
        self.graph().nodes.iter().any(|n| n == node)
    }

    fn users(&self, end: EntityKind, kind: MessageKind) -> Vec<(String, String)> {
        let graph = self.graph();
        let publishers = graph.publishers.iter().map(|(topic, on, node)| (topic, *on, node));
        let subscribers = graph
            .subscribers
            .iter()
            .flat_map(|(topic, all)| all.iter().map(move |s| (topic, s.kind, &s.node)));
        let ends: Box<dyn Iterator<Item = _>> = match end {
            EntityKind::Publisher => Box::new(publishers),
            EntityKind::Subscription => Box::new(subscribers),
            EntityKind::Node | EntityKind::Server | EntityKind::Client => Box::new(std::iter::empty()),
        };
        ends.filter(|(_, on, _)| *on == kind).map(|(topic, _, node)| (topic.clone(), node.clone())).collect()
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
    use modulo_runtime::Qos;

    #[test]
    fn declarations_end_with_their_guards() {
        let transport = LocalTransport::default();
        let node = NodeName::new("n", "/", &[]).expect("valid");
        let address =
            Address { topic: "/t".into(), kind: MessageKind::Detections, qos: Qos::Results, profile: None };
        let publisher = transport.advertise(&node, &address).expect("local");
        assert!(!publisher.wanted() && transport.publishers("/t") == ["/n"] && !transport.is_ready("/n"));

        let (sender, arrived) = channel();
        let deliver = Box::new(move |incoming| sender.send(incoming).expect("the test listens"));
        let subscription = transport.subscribe(&node, &address, deliver).expect("local");
        let ready = transport.announce(&node).expect("local");
        assert!(publisher.wanted() && transport.is_ready("/n") && transport.subscribers("/t") == ["/n"]);

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
}
