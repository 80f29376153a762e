//! The stability suite: every method on the scenes on which methods fail, and
//! what is expected of it there.
//!
//! `canvas` draws, `catalogue` lists scenes and expectations, `measure` measures, `expect` judges, `page` and
//! `results.json` tell. No file is read: a run depends on the program alone.

mod case;
mod catalogue;
mod expect;
mod measure;
mod page;
mod pictures;
mod radiance;
mod rejection;
mod report;

use std::collections::BTreeMap;
use std::path::Path;

use modulo_core::unwrap::{METHODS, Signal};

pub use case::{Case, Family};
pub use catalogue::cases;
pub use expect::{Evidence, Expect, RECOVERED};
pub use report::{Outcome, RejectionRow, Report, SceneRow, Trial, Verdict};

use crate::files::{make_folder, write, write_json};
use crate::{BenchError, Event};
use expect::judge_trust;
use measure::score;
use pictures::PictureFolder;

/// Runs all methods on all scenes and writes `index.html`, `results.json`, `pictures/` and `figures/` into `out`,
/// which is made if need be.
///
/// # Errors
/// [`BenchError`] when `out` cannot be written. A broken expectation is no error: see [`Outcome`].
pub fn run(out: &Path, progress: impl FnMut(Event<'_>)) -> Result<Outcome, BenchError> {
    for folder in ["pictures", "figures"] {
        make_folder(&out.join(folder))?;
    }
    let report = examine_all(&mut PictureFolder::in_folder(out), progress)?;
    write_json(&out.join("results.json"), &report)?;
    write(&out.join("index.html"), page::html(&report).as_bytes())?;
    Ok(report.outcome)
}

/// The same measurements without a file or a picture.
///
/// # Errors
/// [`BenchError`] when a method refuses a scene.
pub fn measure(progress: impl FnMut(Event<'_>)) -> Result<Report, BenchError> {
    examine_all(&mut PictureFolder::none(), progress)
}

fn examine_all(
    folder: &mut PictureFolder,
    mut progress: impl FnMut(Event<'_>),
) -> Result<Report, BenchError> {
    let cases = cases();
    let mut scenes = Vec::new();
    for (done, case) in cases.iter().enumerate() {
        progress(Event::Step { done, total: cases.len(), next: &case.name });
        scenes.push(examine(case, folder)?);
    }
    Ok(Report::new(scenes, rejection::all()))
}

/// Runs every method on `case`; pictures go into `folder`.
///
/// # Errors
/// [`BenchError`] when a method refuses the scene, or a picture cannot be written.
fn examine(case: &Case, folder: &PictureFolder) -> Result<SceneRow, BenchError> {
    let exposure = case.expose()?;
    let y = exposure.modulo();
    let pictures = folder.open(&case.name, &exposure, &y)?;
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
            picture: pictures.as_ref().map(|pictures| pictures.add(method, &x)).transpose()?,
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
