//! Messages between nodes of one process: an `Arc` is handed on, nothing is
//! serialised. What a subscriber does not take in time is replaced, as between
//! processes.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use super::{Address, Guard, Inlet, Outlet, ParameterPort, Parcel, Transport, TransportError};
use crate::inbox::Inbox;
use crate::message::Message;
use crate::name::Place;

/// The graph of one process. Clones share it.
#[derive(Clone, Default)]
pub struct LocalTransport {
    graph: Arc<Mutex<LocalGraph>>,
}

#[derive(Default)]
struct LocalGraph {
    publishers: BTreeMap<String, usize>,
    subscribers: BTreeMap<String, Vec<Subscriber>>,
    nodes: Vec<String>,
    next_id: u64,
}

struct Subscriber {
    id: u64,
    inbox: Arc<Inbox<Parcel>>,
    slot: usize,
}

/// Runs its closure when dropped: takes a declaration out of the graph.
struct Undeclare<F: FnMut() + Send + Sync>(F);

impl<F: FnMut() + Send + Sync> Drop for Undeclare<F> {
    fn drop(&mut self) {
        (self.0)();
    }
}

struct LocalOutlet {
    transport: LocalTransport,
    topic: String,
    _gone: Guard,
}

struct LocalInlet {
    _gone: Guard,
}

impl LocalTransport {
    fn graph(&self) -> MutexGuard<'_, LocalGraph> {
        self.graph.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Outlet for LocalOutlet {
    fn wanted(&self) -> bool {
        self.transport.graph().subscribers.get(&self.topic).is_some_and(|s| !s.is_empty())
    }

    fn put(&self, message: &Message) -> Result<(), TransportError> {
        let graph = self.transport.graph();
        for subscriber in graph.subscribers.get(&self.topic).into_iter().flatten() {
            subscriber.inbox.push(subscriber.slot, Parcel::Message(message.clone()));
        }
        Ok(())
    }
}

impl Inlet for LocalInlet {
    fn lost(&self) -> u64 {
        0
    }
}

impl Transport for LocalTransport {
    fn advertise(&self, _node: &Place, address: &Address) -> Result<Box<dyn Outlet>, TransportError> {
        let topic = address.topic.clone();
        *self.graph().publishers.entry(topic.clone()).or_default() += 1;
        let gone = Undeclare({
            let (transport, topic) = (self.clone(), topic.clone());
            move || {
                if let Some(count) = transport.graph().publishers.get_mut(&topic) {
                    *count = count.saturating_sub(1);
                }
            }
        });
        Ok(Box::new(LocalOutlet { transport: self.clone(), topic, _gone: Box::new(gone) }))
    }

    fn subscribe(
        &self,
        _node: &Place,
        address: &Address,
        inbox: Arc<Inbox<Parcel>>,
        slot: usize,
    ) -> Result<Box<dyn Inlet>, TransportError> {
        let mut graph = self.graph();
        let id = graph.next_id;
        graph.next_id += 1;
        let subscriber = Subscriber { id, inbox, slot };
        graph.subscribers.entry(address.topic.clone()).or_default().push(subscriber);
        let (transport, topic) = (self.clone(), address.topic.clone());
        let gone = Undeclare(move || {
            if let Some(list) = transport.graph().subscribers.get_mut(&topic) {
                list.retain(|s| s.id != id);
            }
        });
        Ok(Box::new(LocalInlet { _gone: Box::new(gone) }))
    }

    fn announce(&self, node: &Place) -> Result<Guard, TransportError> {
        let name = node.fully_qualified();
        self.graph().nodes.push(name.clone());
        let transport = self.clone();
        Ok(Box::new(Undeclare(move || transport.graph().nodes.retain(|n| *n != name))))
    }

    /// Nobody outside the process can reach a local node.
    fn serve_parameters(&self, _node: &Place, port: ParameterPort) -> Result<Guard, TransportError> {
        Ok(Box::new(port.requests))
    }

    fn is_ready(&self, node: &str) -> bool {
        self.graph().nodes.iter().any(|n| n == node)
    }

    fn has_publisher(&self, topic: &str) -> bool {
        self.graph().publishers.get(topic).is_some_and(|&count| count > 0)
    }

    fn settling(&self) -> Duration {
        Duration::ZERO
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::inbox::{Keep, Taken};
    use crate::message::MessageKind;
    use crate::topic::Qos;
    use modulo_msgs::vision_msgs::Detection2DArray;

    #[test]
    fn declarations_end_with_their_guards() {
        let transport = LocalTransport::default();
        let node = Place::new("n", "/", &[]).expect("valid");
        let address = Address { topic: "/t".into(), kind: MessageKind::Detections, qos: Qos::Results };
        let outlet = transport.advertise(&node, &address).expect("local");
        assert!(!outlet.wanted() && transport.has_publisher("/t") && !transport.is_ready("/n"));

        let inbox = Arc::new(Inbox::new(&[Keep::Latest]));
        let inlet = transport.subscribe(&node, &address, inbox.clone(), 0).expect("local");
        let ready = transport.announce(&node).expect("local");
        assert!(outlet.wanted() && transport.is_ready("/n"));

        let array = Arc::new(Detection2DArray::default());
        outlet.put(&Message::Detections(array.clone())).expect("local");
        let Taken::Item(0, Parcel::Message(Message::Detections(got))) = inbox.take(Duration::ZERO) else {
            panic!("the message must have arrived")
        };
        assert!(Arc::ptr_eq(&got, &array), "shared, not copied");

        drop((inlet, ready));
        assert!(!outlet.wanted() && !transport.is_ready("/n"));
        drop(outlet);
        assert!(!transport.has_publisher("/t"));
    }
}
