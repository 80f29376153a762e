//! [`measure`]: the time of an inference, without image processing.

use std::num::NonZeroUsize;
use std::path::Path;

use modulo_runtime::Clock;
use ndarray::Array4;

use super::{ModelLayout, cores};
use crate::DetectorError;
use crate::engine::{self, Engine, EngineChoice, EngineError, OpenedEngine};

/// Runs before the first timed one: buffers grow and caches fill in them.
const WARM_UP: usize = 3;

/// The duration of one inference at one size.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Speed {
    /// Rows of the input.
    pub height: usize,
    /// Columns of the input.
    pub width: usize,
    /// Median duration, ns.
    pub median_ns: u64,
}

/// Times `runs` inferences of `model` on a grey image at each of `sizes` (height, width; multiples of 32). A model that
/// fixes its size is timed at that size only. `threads` = 0 stands for all cores.
///
/// # Errors
/// [`DetectorError::Engine`] when the model does not load or not run.
pub fn measure(
    model: &Path,
    engine: EngineChoice,
    threads: usize,
    sizes: &[(usize, usize)],
    runs: NonZeroUsize,
    clock: &dyn Clock,
) -> Result<Vec<Speed>, DetectorError> {
    let OpenedEngine { mut engine, layout: ModelLayout { size: fixed, .. }, .. } =
        engine::open(model, engine, cores(threads))?;
    let sizes = fixed.as_ref().map_or(sizes, std::slice::from_ref);
    let speed = |&(height, width): &(usize, usize)| {
        let median_ns = median(engine.as_mut(), (height, width), runs, clock)?;
        Ok(Speed { height, width, median_ns })
    };
    sizes.iter().map(speed).collect()
}

fn median(
    engine: &mut dyn Engine,
    (height, width): (usize, usize),
    runs: NonZeroUsize,
    clock: &dyn Clock,
) -> Result<u64, EngineError> {
    let grey = Array4::from_elem((1, 3, height, width), 0.5);
    for _ in 0..WARM_UP {
        engine.run(grey.view())?;
    }
    let mut durations = Vec::with_capacity(runs.get());
    for _ in 0..runs.get() {
        let start = clock.ticks_ns();
        engine.run(grey.view())?;
        durations.push(clock.ticks_ns().saturating_sub(start));
    }
    durations.sort_unstable();
    Ok(durations[durations.len() / 2])
}
