//! [`Account`]: where the wall time of a run goes.

use std::collections::BTreeMap;

use modulo_runtime::Clock;

use crate::results::RunTime;

/// Durations by stage, ns.
pub type Spent = BTreeMap<&'static str, u64>;

/// The stages of a run that are no stages of a frame: reading all frames once, loading models, waiting for the thread that
/// reads the frames, comparing a recovered image with the true one, scoring, writing results, and measuring times.
pub const INSPECT: &str = "inspect";
pub const LOAD: &str = "load";
pub const WAIT: &str = "wait";
pub const COMPARE: &str = "compare";
pub const SCORE: &str = "score";
pub const STORE: &str = "store";
pub const TIMES: &str = "times";

/// The wall time of a run so far, by stage.
pub struct Account<'a> {
    timer: &'a dyn Clock,
    start: u64,
    workers: usize,
    stages_ns: BTreeMap<&'static str, f64>,
}

impl<'a> Account<'a> {
    /// Begins the account of a run with `workers` workers.
    pub fn new(timer: &'a dyn Clock, workers: usize) -> Self {
        Self { timer, start: timer.ticks_ns(), workers, stages_ns: BTreeMap::new() }
    }

    /// Does `work`, for which all workers wait, as a stage.
    pub fn stage<T>(&mut self, stage: &'static str, work: impl FnOnce() -> T) -> T {
        let start = self.timer.ticks_ns();
        let done = work();
        *self.stages_ns.entry(stage).or_default() += self.timer.ticks_ns().saturating_sub(start) as f64;
        done
    }

    /// Adds the durations of one worker.
    pub fn add(&mut self, spent: &Spent) {
        for (stage, ns) in spent {
            *self.stages_ns.entry(stage).or_default() += *ns as f64 / self.workers as f64;
        }
    }

    /// The wall time since the start. Time outside of all stages is the stage `other`.
    pub fn finish(&self) -> RunTime {
        let wall = self.timer.ticks_ns().saturating_sub(self.start) as f64;
        let other = wall - self.stages_ns.values().sum::<f64>();
        let stages = self.stages_ns.iter().map(|(stage, ns)| (*stage, *ns)).chain([("other", other)]);
        let stages_s = stages.map(|(stage, ns)| (stage.to_owned(), ns / 1e9)).collect();
        RunTime { wall_s: wall / 1e9, workers: self.workers, stages_s }
    }
}
