//! `modulo eval report` and `modulo eval budget`: report and summary of the results of a grid.

use std::path::Path;

use anyhow::anyhow;
use modulo_eval::grid::GridError;
use modulo_eval::results::RESULTS;
use modulo_eval::{budget, report as page, store};

use super::usage;
use crate::{Ended, Failure};

/// Draws the charts and the report of the results in a folder.
pub fn report(folder: &Path) -> Result<Ended, Failure> {
    say!("{}", page::write(folder)?.display());
    Ok(Ended::Done)
}

/// Prints the Pareto front at each alpha, lens and noise. `*` marks the best choice within `ms`.
pub fn budget(folder: &Path, ms: f64) -> Result<Ended, Failure> {
    if !(ms > 0.0 && ms.is_finite()) {
        return Err(usage(anyhow!("--ms is {ms}, it must be more than 0")));
    }
    let results = store::load(folder)?;
    let results = results.ok_or_else(|| GridError::NoResults(folder.join(RESULTS)))?;
    for found in budget::within(&results, ms) {
        say!("alpha {}, {}:", found.alpha, found.conditions);
        for choice in &found.front {
            let mark = if found.best.as_ref() == Some(choice) { '*' } else { ' ' };
            say!("{mark} {:8.1} ms  AP50 {:5.1}  {}", choice.ms, 100.0 * choice.ap50, choice.name());
        }
        if found.best.is_none() {
            say!("  no choice is within {ms} ms");
        }
    }
    Ok(Ended::Done)
}
