//! [`Sessions`]: loaded models that several detectors of a process share, each of which is loaded once.

use std::path::PathBuf;

use crate::DetectorError;
use crate::engine::{self, EngineOptions, OpenedEngine};
use crate::head::Head;
use crate::input_size::InputSize;
use crate::model::ModelLayout;

/// What tells sessions apart: the model, how it runs, and the size of its input as the parameter has it.
type Key = (PathBuf, EngineOptions, String);

/// Models that are loaded and have run once. Detectors of equal models that are made with the same sessions share one, and use it by turns.
#[derive(Default)]
pub struct Sessions {
    open: Vec<(Key, OpenedEngine, Head)>,
    /// Number of inputs whose output each session remembers: an input that equals one of them is not run again.
    remembered: usize,
}

impl Sessions {
    /// Creates sessions that remember the output of this number of last inputs.
    pub fn remembering(remembered: usize) -> Self {
        Self { open: Vec::new(), remembered }
    }

    /// Returns a session of `model`, which is loaded, and run at the size that `settled` gives, unless it is open already.
    pub(crate) fn open(
        &mut self,
        model: PathBuf,
        options: EngineOptions,
        (size, (height, width)): (&str, (usize, usize)),
        settled: impl FnOnce(&ModelLayout) -> Result<InputSize, DetectorError>,
    ) -> Result<(OpenedEngine, Head), DetectorError> {
        let key = (model, options, size.to_owned());
        if let Some((_, opened, head)) = self.open.iter().find(|(other, ..)| *other == key) {
            return Ok((opened.clone(), *head));
        }
        let mut opened = engine::open(&key.0, key.1)?;
        let head = opened.first_run(&key.0, settled(&opened.layout)?.tensor(height, width))?;
        opened.engine.remember(self.remembered);
        self.open.push((key, opened.clone(), head));
        Ok((opened, head))
    }
}
