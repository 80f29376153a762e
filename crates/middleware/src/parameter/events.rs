//! [`ParameterEvents`]: publishes the changes of the parameters of a node on `/parameter_events`.

use std::sync::Arc;

use modulo_msgs::rcl_interfaces::{Parameter, ParameterEvent};
use modulo_msgs::std_msgs::Time;
use modulo_runtime::parameter::to_ros;
use modulo_runtime::{Address, Message, MessageKind, NodeName, Parameters, Topic, Value};

use crate::driver::RunError;
use crate::transport::{Publisher, Transport};

/// The `/parameter_events` publisher of one node.
pub struct ParameterEvents {
    node: String,
    publisher: Box<dyn Publisher>,
}

impl ParameterEvents {
    /// Advertises `/parameter_events` for the node `node_name`.
    pub fn new(node_name: &NodeName, transport: &dyn Transport) -> Result<Self, RunError> {
        let address =
            Address::resolve(node_name, &Topic::new("/parameter_events", MessageKind::ParameterEvent))?;
        Ok(Self { node: node_name.fully_qualified(), publisher: transport.advertise(node_name, &address)? })
    }

    /// Publishes all parameters as new: the node has started.
    pub fn started(&self, now_ns: u64, set: &Parameters) {
        let all = set.descriptors().iter().map(|d| parameter(set, d.name)).collect();
        self.put(now_ns, |event| event.new_parameters = all);
    }

    /// Publishes the difference between `before` and `now`, if there is one.
    pub fn changed(&self, now_ns: u64, before: &Parameters, now: &Parameters) {
        let changed: Vec<_> = before.changed(now).map(|(name, _)| parameter(now, name)).collect();
        if !changed.is_empty() {
            self.put(now_ns, |event| event.changed_parameters = changed);
        }
    }

    fn put(&self, now_ns: u64, fill: impl FnOnce(&mut ParameterEvent)) {
        let stamp = Time::from_ns(now_ns);
        let mut event = ParameterEvent { stamp, node: self.node.clone(), ..ParameterEvent::default() };
        fill(&mut event);
        if let Err(why) = self.publisher.put(&Message::ParameterEvent(Arc::new(event))) {
            tracing::debug!("{why}");
        }
    }
}

fn parameter(set: &Parameters, name: &str) -> Parameter {
    Parameter { name: name.to_owned(), value: to_ros(set.get(name).map(Value::without_secrets).as_ref()) }
}

#[cfg(test)]
mod tests {
    use std::sync::mpsc::channel;

    use super::*;
    use crate::sample::Set;
    use crate::transport::Incoming;
    use crate::transport::local::LocalTransport;
    use modulo_runtime::ParameterSet as _;

    #[test]
    fn starts_and_changes_are_told_and_nothing_else() {
        let transport = LocalTransport::default();
        let node_name = NodeName { name: "detector".into(), namespace: "/front".into(), remaps: Vec::new() };
        let topic = Topic::new("/parameter_events", MessageKind::ParameterEvent);
        let address = Address::resolve(&node_name, &topic).expect("a name");
        let (sender, arrived) = channel();
        let deliver = Box::new(move |incoming| sender.send(incoming).expect("the test listens"));
        let _subscription = transport.subscribe(&node_name, &address, deliver).expect("a local topic");
        let events = ParameterEvents::new(&node_name, &transport).expect("a local topic");

        let before = Parameters::declare(Set::descriptors());
        let after = before.with(&[("angle".into(), Value::Double(2.0))], true).expect("possible");
        events.started(5_000_000_007, &before);
        events.changed(6, &before, &before);
        events.changed(7, &before, &after);

        let next = || match arrived.try_recv() {
            Ok(Incoming::Message(Message::ParameterEvent(event))) => Some(event),
            _ => None,
        };
        let started = next().expect("the start");
        assert_eq!((started.node.as_str(), started.stamp), ("/front/detector", Time { sec: 5, nanosec: 7 }));
        assert_eq!(started.new_parameters.len(), Set::descriptors().len());
        let changed = next().expect("the change");
        let [parameter] = &changed.changed_parameters[..] else { panic!("one change: {changed:?}") };
        assert_eq!((parameter.name.as_str(), parameter.value.double_value), ("angle", 2.0));
        assert!(next().is_none(), "a change to the same value is none");
    }
}
