//! [`ModelInfo`]: the figures of a model that `modulo model` shows, its description and the time of its inference.

use std::path::Path;

use modulo_runtime::Clock;
use ndarray::Array4;

use crate::DetectorError;
use crate::engine::{Engine, EngineOptions, OpenedEngine, SharedEngine, open};

/// A model that is loaded, with its description for people.
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
    session: SharedEngine,
    stride: usize,
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
    let OpenedEngine { engine: session, name, threads, layout, note, .. } = opened;
    Ok(ModelInfo {
        form,
        session,
        stride: layout.stride,
        engine: name,
        note,
        input: layout.input,
        output: layout.output,
        size: layout.size,
        classes: layout.names.all(),
        threads: threads.get(),
    })
}

/// Sizes (height, width) at which the speed is measured: those of the scenes and of KITTI, padded.
const SIZES: [(usize, usize); 2] = [(192, 640), (384, 1248)];
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

impl ModelInfo {
    /// Number of the inferences that are timed at each size.
    pub const RUNS: usize = 20;

    /// Times [`ModelInfo::RUNS`] inferences on a grey image at each of several sizes, enlarged to multiples of the stride. A model that
    /// fixes its size is timed at that size only.
    ///
    /// # Errors
    /// [`DetectorError::Engine`] when the model does not run.
    pub fn measure(&mut self, clock: &dyn Clock) -> Result<Vec<Speed>, DetectorError> {
        let (sizes, stride) =
            self.size.as_ref().map_or((&SIZES[..], self.stride), |fixed| (std::slice::from_ref(fixed), 1));
        let mut speeds = Vec::new();
        for size in sizes {
            let [height, width] = [size.0, size.1].map(|side| side.next_multiple_of(stride));
            let grey = Array4::from_elem((1, 3, height, width), 0.5);
            let mut durations = Vec::new();
            for _ in 0..WARM_UP + Self::RUNS {
                let start = clock.ticks_ns();
                self.session.run(grey.view())?;
                durations.push(clock.ticks_ns().saturating_sub(start));
            }
            let timed = &mut durations[WARM_UP..];
            timed.sort_unstable();
            speeds.push(Speed { height, width, median_ns: timed[Self::RUNS / 2] });
        }
        Ok(speeds)
    }
}
