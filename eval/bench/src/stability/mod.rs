//! The stability suite: every method on the scenes on which methods fail, compared with the expected results.
//!
//! `radiance` draws, `catalogue` lists scenes and expectations, `measure` measures, `expect` judges, `page` and `report`
//! write the results. A run reads no file.

mod case;
mod catalogue;
mod expect;
mod measure;
mod page;
mod picture_folder;
mod radiance;
mod rejection;
mod report;

use std::collections::BTreeMap;
use std::path::Path;

use modulo_core::unwrap::{METHODS, QualityMetrics};

pub use case::Case;
pub use catalogue::cases;
pub use report::Outcome;

use crate::atomic_file::{make_folder, write, write_json};
use crate::{BenchError, Event};
use expect::{Verdict, judge_trust};
use measure::score;
use picture_folder::PictureFolder;
use report::{Report, SceneRow, Trial};

/// Runs all methods on all scenes and writes `index.html`, `results.json`, `pictures/` and `figures/` into `out`, which is
/// created if it is missing.
///
/// # Errors
/// [`BenchError`] if `out` cannot be written. A broken expectation is not an error: see [`Outcome`].
pub fn run(out: &Path, progress: impl FnMut(Event<'_>)) -> Result<Outcome, BenchError> {
    for folder in ["pictures", "figures"] {
        make_folder(&out.join(folder))?;
    }
    let report = examine_all(&PictureFolder::in_folder(out), progress)?;
    write_json(&out.join("results.json"), &report)?;
    write(&out.join("index.html"), page::html(&report).as_bytes())?;
    Ok(report.outcome)
}

/// Runs all methods on all scenes without writing a file.
///
/// # Errors
/// [`BenchError`] if a method refuses a scene.
pub fn measure(progress: impl FnMut(Event<'_>)) -> Result<Outcome, BenchError> {
    Ok(examine_all(&PictureFolder::none(), progress)?.outcome)
}

fn examine_all(folder: &PictureFolder, mut progress: impl FnMut(Event<'_>)) -> Result<Report, BenchError> {
    let cases = cases();
    let mut scenes = Vec::new();
    for (done, case) in cases.iter().enumerate() {
        progress(Event::Step { done, total: cases.len(), next: case.name() });
        scenes.push(examine(case, folder)?);
    }
    Ok(Report::new(scenes, rejection::all()))
}

/// Runs every method on `case`, and writes its pictures into `folder`.
fn examine(case: &Case, folder: &PictureFolder) -> Result<SceneRow, BenchError> {
    let exposure = case.expose()?;
    let y = exposure.modulo();
    let pictures = folder.open(case.name(), &exposure, &y)?;
    let mut trials = Vec::new();
    for &method in METHODS {
        let (score, x) = score(method, &y, &exposure)?;
        let expected = case.expected(method);
        let verdict = Verdict::both(expected.judge(&score), judge_trust(&score, case.is_observable()));
        let report = score.report;
        trials.push(Trial {
            method,
            expected: expected.words(),
            reason: expected.reason(),
            exact: score.exact,
            up_to_offset: score.up_to_offset,
            psnr_db: score.psnr,
            rung: report.method,
            trusted: report.trust.claim(),
            signal: report.quality.map(named),
            verdict,
            picture: pictures.as_ref().map(|pictures| pictures.add(method, &x)).transpose()?,
        });
    }
    Ok(SceneRow { scene: case.scene.clone(), shape: y.dim(), trials })
}

fn named(
    QualityMetrics { residues, steep, consensus, clamped }: QualityMetrics,
) -> BTreeMap<&'static str, f32> {
    [("residues", residues), ("steep", steep), ("consensus", consensus), ("clamped", clamped)].into()
}
