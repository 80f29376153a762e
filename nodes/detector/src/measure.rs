//! The figures of a model that `modulo model` shows: its description, and the time of its inference ([`measure`]).

use std::num::NonZeroUsize;
use std::path::Path;

use modulo_runtime::Clock;
use ndarray::Array4;

use crate::DetectorError;
use crate::engine::{Engine, EngineError, EngineOptions, OpenedEngine, open};
use crate::model::ModelLayout;

/// A description of a model for people.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ModelInfo {
    /// The engine that loaded it, `ort`, `openvino` or `rten`.
    pub engine: &'static str,
    /// Path of the library, or the reason for this engine.
    pub note: String,
    /// Name of the image input.
    pub input: String,
    /// Name of the output with the boxes.
    pub output: String,
    /// The form of the output.
    pub form: String,
    /// (height, width) of the input where the model fixes them.
    pub size: Option<(usize, usize)>,
    /// Class names by index; a gap is its number.
    pub classes: Vec<String>,
    /// Threads that one inference uses.
    pub threads: usize,
}

/// (height, width) of the image of a first run where the model fixes none.
pub const FIRST_RUN: (usize, usize) = (640, 640);

/// Loads `model`, runs it once and describes it.
///
/// # Errors
/// [`DetectorError::Engine`] as at the start of a detector.
pub fn describe(model: &Path, options: EngineOptions) -> Result<ModelInfo, DetectorError> {
    let mut opened = open(model, options)?;
    let form = opened.first_run(model, opened.layout.size.unwrap_or(FIRST_RUN))?.to_string();
    let OpenedEngine { name, threads, layout, note, .. } = opened;
    Ok(ModelInfo {
        form,
        engine: name,
        note,
        input: layout.input,
        output: layout.output,
        size: layout.size,
        classes: layout.names.all(),
        threads: threads.get(),
    })
}

/// Runs before the first timed one: buffers grow and caches fill in them.
const WARM_UP: usize = 3;

/// The time of an inference at one size.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Speed {
    /// Rows of the input.
    pub height: usize,
    /// Columns of the input.
    pub width: usize,
    /// Median duration, ns.
    pub median_ns: u64,
}

/// Times `runs` inferences of `model` on a grey image at each of `sizes` (height, width), enlarged to multiples of its stride. A model that
/// fixes its size is timed at that size only.
///
/// # Errors
/// [`DetectorError::Engine`] when the model does not load or not run.
pub fn measure(
    model: &Path,
    options: EngineOptions,
    sizes: &[(usize, usize)],
    runs: NonZeroUsize,
    clock: &dyn Clock,
) -> Result<Vec<Speed>, DetectorError> {
    let OpenedEngine { mut engine, layout: ModelLayout { size: fixed, stride, .. }, .. } =
        open(model, options)?;
    let (sizes, stride) = fixed.as_ref().map_or((sizes, stride), |fixed| (std::slice::from_ref(fixed), 1));
    let speed = |&(height, width): &(usize, usize)| {
        let [height, width] = [height, width].map(|side| side.next_multiple_of(stride));
        let median_ns = median_ns(&mut engine, (height, width), runs, clock)?;
        Ok(Speed { height, width, median_ns })
    };
    sizes.iter().map(speed).collect()
}

fn median_ns(
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
