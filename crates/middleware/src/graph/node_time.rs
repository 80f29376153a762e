//! [`NodeTime`]: the clock of a node. It shows the time of the machine, or that of `/clock` while `use_sim_time` is on;
//! as in ROS 2, it shows 0 until the first message has come.
//!
//! Stamps follow it. Periods, waits and durations never do: they are the machine's.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use modulo_runtime::{Address, Clock, Message, MessageKind, NodeName, Parameters, Topic};

use crate::driver::{CommonParameters, RunError};
use crate::transport::{Guard, Incoming, Transport};

/// The clock of one node.
pub struct NodeTime<'a> {
    machine: &'a dyn Clock,
    /// The latest time that was on `/clock`, ns.
    simulated_ns: Arc<AtomicU64>,
    /// The subscription of `/clock`.
    simulation: Option<Guard>,
}

/// A change of the clock of a node: the next subscription of `/clock`, if it changes.
pub struct ClockChange(Option<Option<Guard>>);

impl<'a> NodeTime<'a> {
    /// Returns a clock with the time of `machine`.
    pub fn new(machine: &'a dyn Clock) -> Self {
        Self { machine, simulated_ns: Arc::default(), simulation: None }
    }

    /// Returns the time of the machine, ns since the epoch, whatever `/clock` shows.
    pub fn machine_ns(&self) -> u64 {
        self.machine.now_ns()
    }

    /// Subscribes to `/clock` if `parameters` ask for its time and it is not subscribed yet.
    pub fn open(
        &self,
        parameters: &Parameters,
        node_name: &NodeName,
        transport: &dyn Transport,
    ) -> Result<ClockChange, RunError> {
        Ok(ClockChange(match (CommonParameters::from(parameters).use_sim_time, &self.simulation) {
            (true, None) => Some(Some(self.simulate(node_name, transport)?)),
            // Dropping the guard ends the subscription.
            (false, Some(_)) => Some(None),
            (true, Some(_)) | (false, None) => None,
        }))
    }

    /// Goes over to the time of `change`.
    pub fn follow(&mut self, ClockChange(change): ClockChange) {
        if let Some(simulation) = change {
            self.simulation = simulation;
        }
    }

    /// Subscribes to `/clock`; each message sets the time.
    fn simulate(&self, node_name: &NodeName, transport: &dyn Transport) -> Result<Guard, RunError> {
        let address = Address::resolve(node_name, &Topic::new("/clock", MessageKind::Clock))?;
        let simulated_ns = self.simulated_ns.clone();
        let deliver = move |incoming: Incoming| match incoming.open(MessageKind::Clock) {
            Ok(Message::Clock(clock)) => simulated_ns.store(clock.clock.as_ns(), Ordering::Relaxed),
            Ok(other) => tracing::warn!("/clock: carries {:?}", other.kind()),
            Err(why) => tracing::warn!("/clock: {why}"),
        };
        Ok(transport.subscribe(node_name, &address, Box::new(deliver))?)
    }
}

impl Clock for NodeTime<'_> {
    fn now_ns(&self) -> u64 {
        match self.simulation {
            Some(_) => self.simulated_ns.load(Ordering::Relaxed),
            None => self.machine.now_ns(),
        }
    }

    fn ticks_ns(&self) -> u64 {
        self.machine.ticks_ns()
    }
}

#[cfg(test)]
mod tests {
    use modulo_msgs::rosgraph_msgs;
    use modulo_msgs::std_msgs::Time;

    use super::*;
    use crate::transport::local::LocalTransport;
    use modulo_runtime::{ManualClock, ParameterSet as _, Value};

    #[test]
    fn the_time_on_clock_holds_while_it_is_asked_for() {
        let transport = LocalTransport::default();
        let node_name = NodeName { name: "camera".into(), namespace: "/".into(), remaps: Vec::new() };
        let Topic { name, kind, qos, .. } = Topic::new("/clock", MessageKind::Clock);
        let simulator = transport
            .advertise(&node_name, &Address { topic: name, kind, qos, profile: None })
            .expect("local");
        let tell = |ns| {
            let clock = Arc::new(rosgraph_msgs::Clock { clock: Time::from_ns(ns) });
            simulator.put(&Message::Clock(clock)).expect("local");
        };
        let asked = |on| {
            let set = Parameters::declare(CommonParameters::descriptors());
            set.with(&[("use_sim_time".into(), Value::Bool(on))], true).expect("live")
        };
        let machine = ManualClock::at(77);
        let mut time = NodeTime::new(&machine);
        let follow = |on, time: &mut NodeTime<'_>| {
            let change = time.open(&asked(on), &node_name, &transport).expect("local");
            time.follow(change);
        };
        follow(false, &mut time);
        tell(3);
        assert_eq!(time.now_ns(), 77);
        follow(true, &mut time);
        assert_eq!(time.now_ns(), 0, "before the first message");
        tell(5);
        tell(6_000_000_007);
        assert_eq!((time.now_ns(), time.now_ns()), (6_000_000_007, 6_000_000_007));
        tell(4);
        assert_eq!((time.now_ns(), time.ticks_ns()), (4, 77), "a simulation may start anew");
        follow(false, &mut time);
        assert_eq!(time.now_ns(), 77);
    }
}
