//! The composed driver: several live nodes in one process, a thread each, on the local transport.

use std::cell::Cell;
use std::sync::Arc;
use std::thread;

use modulo_runtime::{Clock, NodeReport, ParameterError, Stop, Urgency};

use super::live::{self, NodeSetup};
use super::{CommonParameters, RunError};
use crate::transport::OnDrop;
use crate::transport::local::LocalTransport;

/// One node of a composed process.
pub struct Member {
    /// The node.
    pub setup: NodeSetup,
    /// Whether the other nodes finish the messages that are on their way, and end, when this node has ended.
    pub ends_all: bool,
}

/// Runs all members until they are done, and returns their reports in order. A member that fails also ends the others.
///
/// # Errors
/// The first member's [`RunError`].
pub fn run(members: Vec<Member>, clock: &Arc<dyn Clock>, stop: &Stop) -> Result<Vec<NodeReport>, RunError> {
    let is_simulated = |member: &Member| CommonParameters::from(&member.setup.parameters).use_sim_time;
    if members.iter().any(is_simulated) {
        let why = "no node of a composed process publishes /clock; start the nodes as processes";
        return Err(ParameterError::new("use_sim_time", true, why).into());
    }
    let transport = LocalTransport::default();
    thread::scope(|scope| {
        // All threads are started before the first one is joined.
        let threads: Vec<_> = members
            .into_iter()
            .map(|member| {
                let (transport, stop) = (&transport, stop.clone());
                scope.spawn(move || {
                    let Member { setup, ends_all } = member;
                    // A panic leaves the urgency as it is here, so that the other members end as well.
                    let urgency = Cell::new(Urgency::Now);
                    let _end = OnDrop(|| stop.ask(urgency.get()));
                    let report = live::run(setup, transport, clock, stop.clone())?;
                    urgency.set(if ends_all { Urgency::Drain } else { Urgency::None });
                    Ok(report)
                })
            })
            .collect();
        threads
            .into_iter()
            // A panic in a member is an error of the program and not a result of the run.
            .map(|thread| thread.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic)))
            .collect()
    })
}
