//! The stability suite: every method on the scenes on which methods fail, and
//! what is expected of it there.
//!
//! `canvas` draws, `catalogue` lists scenes and expectations, `examine` measures and judges, `page` and
//! `results.json` tell. No file is read: a run depends on the program alone.

mod album;
mod canvas;
mod case;
mod catalogue;
mod examine;
mod expect;
mod measure;
mod page;
mod picture;
mod refusal;
mod report;

use std::path::Path;

pub use case::{Case, Family};
pub use catalogue::cases;
pub use expect::{Evidence, Expect, RECOVERED};
pub use report::{Outcome, RefusalRow, Report, SceneRow, SignalRow, Trial, Verdict};

use crate::store::{make_folder, write, write_json};
use crate::{Event, StudyError};
use album::Album;

/// Runs all methods on all scenes and writes `index.html`, `results.json`, `pictures/` and `figures/` into `out`,
/// which is made if need be.
///
/// # Errors
/// [`StudyError`] when `out` cannot be written. A broken expectation is no error: see [`Outcome`].
pub fn run(out: &Path, progress: impl FnMut(Event<'_>)) -> Result<Outcome, StudyError> {
    for folder in ["pictures", "figures"] {
        make_folder(&out.join(folder))?;
    }
    let report = examine_all(&mut Album::in_folder(out), progress)?;
    write_json(&out.join("results.json"), &report)?;
    write(&out.join("index.html"), page::html(&report).as_bytes())?;
    Ok(report.outcome)
}

/// The same measurements without a file or a picture.
///
/// # Errors
/// [`StudyError`] when a method refuses a scene.
pub fn measure(progress: impl FnMut(Event<'_>)) -> Result<Report, StudyError> {
    examine_all(&mut Album::none(), progress)
}

fn examine_all(album: &mut Album, mut progress: impl FnMut(Event<'_>)) -> Result<Report, StudyError> {
    let cases = cases();
    let mut scenes = Vec::new();
    for (done, case) in cases.iter().enumerate() {
        progress(Event::Step { done, total: cases.len(), next: &case.name });
        scenes.push(examine::examine(case, album)?);
    }
    Ok(Report::new(scenes, refusal::all()))
}
