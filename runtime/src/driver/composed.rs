//! The composed driver: several live nodes in one process, a thread each, on
//! the local transport. Frames are shared, never serialised.

use std::sync::Arc;
use std::thread;

use super::RunError;
use super::live::{self, NodeSetup};
use crate::clock::Clock;
use crate::graph::NodeName;
use crate::graph::node_time::is_simulated;
use crate::node::Node;
use crate::parameter::{ParameterError, Parameters};
use crate::process::stop::{Stop, Urgency};
use crate::report::NodeReport;
use crate::transport::local::LocalTransport;

/// What the end of a node means for the others.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum OnExit {
    /// They run on.
    Continue,
    /// They finish what is on its way, and end.
    Shutdown,
}

/// One node of a composed process.
pub struct Member {
    /// The step.
    pub node: Box<dyn Node>,
    /// Its parameters.
    pub parameters: Parameters,
    /// Its name and remaps.
    pub node_name: NodeName,
    /// What its end means for the others.
    pub on_exit: OnExit,
}

/// Asks the other members to end, also when this one panics.
struct AskOnDrop {
    stop: Stop,
    urgency: Urgency,
}

impl Drop for AskOnDrop {
    fn drop(&mut self) {
        self.stop.ask(self.urgency);
    }
}

/// Runs all members until they are done; returns what each did, in their order.
/// A member that fails ends the others too.
///
/// # Errors
/// The first member's [`RunError`].
pub fn run(members: Vec<Member>, clock: &Arc<dyn Clock>, stop: &Stop) -> Result<Vec<NodeReport>, RunError> {
    if members.iter().any(|member| is_simulated(&member.parameters)) {
        let why = "nobody in this one process tells the time on /clock; start the nodes as processes";
        return Err(ParameterError::new("use_sim_time", true, why).into());
    }
    let transport = LocalTransport::default();
    thread::scope(|scope| {
        let threads: Vec<_> = members
            .into_iter()
            .map(|member| {
                let (transport, stop) = (&transport, stop.clone());
                scope.spawn(move || {
                    let Member { node, parameters, node_name, on_exit } = member;
                    let setup = NodeSetup { node, parameters, node_name, saved: None, report_file: None };
                    let mut end = AskOnDrop { stop: stop.clone(), urgency: Urgency::Now };
                    let result = live::run(setup, transport, clock, stop);
                    end.urgency = match (&result, on_exit) {
                        (Err(_), _) => Urgency::Now,
                        (Ok(_), OnExit::Shutdown) => Urgency::Drain,
                        (Ok(_), OnExit::Continue) => Urgency::None,
                    };
                    result
                })
            })
            .collect();
        threads
            .into_iter()
            .map(|thread| thread.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic)))
            .collect()
    })
}
