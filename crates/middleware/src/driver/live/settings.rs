//! [`Settings`]: the parameters of a live node, where they are read, and where a change is kept and published.

use std::sync::{Arc, Mutex, PoisonError};

use modulo_runtime::{Node, Parameters};

use crate::parameter::events::ParameterEvents;
use crate::process::node_files::SavedState;

pub(super) struct Settings {
    /// Shared with the service that reads them.
    now: Arc<Mutex<Parameters>>,
    saved: Option<SavedState>,
    events: ParameterEvents,
    pub changes: u64,
}

impl Settings {
    /// Begins with `parameters`; those that are `saved` outlast a crash.
    pub fn new(parameters: Parameters, saved: Option<SavedState>, events: ParameterEvents) -> Self {
        Self { now: Arc::new(Mutex::new(parameters)), saved, events, changes: 0 }
    }

    pub fn read(&self) -> Parameters {
        self.reader()()
    }

    /// Returns a function that returns the parameters as they are when it is called.
    pub fn reader(&self) -> impl Fn() -> Parameters + Send + Sync + use<> {
        let now = self.now.clone();
        move || now.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    pub fn started(&self, now_ns: u64) {
        self.events.started(now_ns, &self.read());
    }

    /// Stores, saves and publishes `next`, which `node` has taken in place of `before`.
    pub fn change(&mut self, before: &Parameters, next: &Parameters, node: &dyn Node, now_ns: u64) {
        self.changes += 1;
        // Stored before the event is sent: a listener that asks back reads the new value.
        *self.now.lock().unwrap_or_else(PoisonError::into_inner) = next.clone();
        if let Some(saved) = &self.saved {
            saved.keep(next);
        }
        // Another source begins with its first frame, also after a crash.
        self.keep_position(node);
        self.events.changed(now_ns, before, next);
    }

    /// Returns the position that an earlier life of the node has kept.
    pub fn position(&self) -> Option<u64> {
        self.saved.as_ref().and_then(SavedState::position)
    }

    /// Keeps the position of `node`, if it is a source that has one.
    pub fn keep_position(&self, node: &dyn Node) {
        if let (Some(saved), Some(position)) = (&self.saved, node.position()) {
            saved.keep_position(position);
        }
    }
}
