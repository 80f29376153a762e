//! [`Sessions`]: loaded models that several detectors of a process share, each of which is loaded once.

use std::path::PathBuf;
use std::sync::{Arc, Mutex, PoisonError};

use crate::DetectorError;
use crate::engine::{self, EngineOptions, OpenedEngine};
use crate::head::Head;
use crate::model::ModelLayout;

/// What tells sessions apart: the model, how it runs, and the size of its input as the parameter has it.
type Key = (PathBuf, EngineOptions, String);

/// Models that are loaded and have run. Detectors of equal models that are made with the same sessions, or clones of them on other threads,
/// share one, and use it by turns.
#[derive(Clone, Default)]
pub struct Sessions {
    open: Arc<Mutex<Vec<(Key, OpenedEngine, Head)>>>,
    /// Number of inputs whose output each session remembers: an input that equals one of them is not run again.
    remembered: usize,
}

impl Sessions {
    /// Creates sessions that remember the output of this number of last inputs.
    pub fn remembering(remembered: usize) -> Self {
        Self { remembered, ..Self::default() }
    }

    /// Returns a session of `model`, which is loaded, and run at the sizes that `settled` gives, unless it is open already.
    pub(crate) fn open(
        &self,
        model: PathBuf,
        options: EngineOptions,
        size: &str,
        settled: impl FnOnce(&ModelLayout) -> Result<Vec<(usize, usize)>, DetectorError>,
    ) -> Result<(OpenedEngine, Head), DetectorError> {
        let key = (model, options, size.to_owned());
        // Held while a model is loaded: others wait for it, and do not load it as well.
        let mut open = self.open.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((_, opened, head)) = open.iter().find(|(other, ..)| *other == key) {
            return Ok((opened.clone(), *head));
        }
        let mut opened = engine::open(&key.0, key.1)?;
        let sizes = settled(&opened.layout)?;
        let (first, others) = sizes.split_first().expect("a model runs at one size at least");
        let head = opened.first_run(&key.0, *first)?;
        others.iter().try_for_each(|size| opened.warm_up(*size).map(drop))?;
        opened.engine.remembered = self.remembered;
        open.push((key, opened.clone(), head));
        Ok((opened, head))
    }
}
