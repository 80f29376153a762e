//! All methods on one case: draw, expose, unwrap, judge.

use modulo_core::unwrap::METHODS;

use super::album::Album;
use super::case::Case;
use super::expect::{Evidence, judge_trust};
use super::measure::score;
use super::report::{SceneRow, SignalRow, Trial, Verdict};
use crate::StudyError;

/// Runs every method on `case`; pictures go into `album`.
///
/// # Errors
/// [`StudyError`] when a method refuses the scene, or a picture cannot be written.
pub fn examine(case: &Case, album: &Album) -> Result<SceneRow, StudyError> {
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
            signal: report.signal.map(SignalRow::from),
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
