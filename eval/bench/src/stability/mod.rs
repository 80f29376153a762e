//! The stability suite: every method on the scenes on which methods fail, and
//! what is expected of it there.
//!
//! `canvas` draws, `catalogue` lists scenes and expectations, `measure` measures, `expect` judges, `page` and
//! `results.json` tell. No file is read: a run depends on the program alone.

mod album;
mod canvas;
mod case;
mod catalogue;
mod expect;
mod measure;
mod page;
mod refusal;
mod report;

use std::collections::BTreeMap;
use std::path::Path;

use modulo_core::unwrap::{METHODS, Signal};

pub use case::{Case, Family};
pub use catalogue::cases;
pub use expect::{Evidence, Expect, RECOVERED};
pub use report::{Outcome, RefusalRow, Report, SceneRow, Trial, Verdict};

use crate::store::{make_folder, write, write_json};
use crate::{Event, StudyError};
use album::Album;
use expect::judge_trust;
use measure::score;

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
        scenes.push(examine(case, album)?);
    }
    Ok(Report::new(scenes, refusal::all()))
}

/// Runs every method on `case`; pictures go into `album`.
///
/// # Errors
/// [`StudyError`] when a method refuses the scene, or a picture cannot be written.
fn examine(case: &Case, album: &Album) -> Result<SceneRow, StudyError> {
    let exposure = case.expose()?;
    let y = exposure.modulo();
    let sheet = album.open(&case.name, &exposure, &y)?;
    let mut trials = Vec::new();
    for &method in METHODS {
        let (score, x) = score(method, &y, &exposure)?;
        let expected = case.expected(method);
        let verdict = Verdict::both(expected.judge(&score), judge_trust(&score, case.evidence));
        let report = score.report;
        trials.push(Trial {
            method,
            expected: expected.words(),
            reason: expected.reason(),
            exact: score.exact,
            up_to_offset: score.up_to_offset,
            psnr_db: score.psnr,
            rung: report.rung,
            trusted: report.trust.claim(),
            signal: report.signal.map(named),
            verdict,
            picture: sheet.as_ref().map(|sheet| sheet.add(method, &x)).transpose()?,
        });
    }
    Ok(SceneRow {
        name: case.name.clone(),
        family: case.family,
        what: case.what.clone(),
        why: case.why,
        twin: if let Evidence::Absent(twin) = case.evidence { Some(twin) } else { None },
        bits: case.sensor().bits,
        alpha: case.sensor().alpha,
        shape: y.dim(),
        trials,
    })
}

fn named(Signal { residues, steep, consensus, clamped }: Signal) -> BTreeMap<&'static str, f32> {
    [("residues", residues), ("steep", steep), ("consensus", consensus), ("clamped", clamped)].into()
}
