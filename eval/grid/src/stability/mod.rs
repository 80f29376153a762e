//! The stability suite: every method on the scenes on which methods fail, compared with the expected results.
//!
//! `case` has the scenes with their expectations, `radiance` draws them, `expect` judges. A run reads no file.

mod case;
mod expect;
mod radiance;

use std::path::Path;

use modulo_core::{Frame, SensorError};
use modulo_images::save_png;
use serde::Serialize;

use crate::GridError;
use crate::images::runner::{self, ALL, Capture, Picture, Row, RunOptions, Simulated};
use crate::progress::GridEvent;
use crate::score::LEAST_TRUSTED_SHARE;
use crate::store::save;
pub use case::{Case, cases};
pub use expect::Judgement;

/// Folder of the pictures beside the results.
const PICTURES: &str = "pictures";

/// The result of a method on a scene.
#[derive(Clone, Debug, Serialize)]
pub struct Trial {
    /// The figures.
    #[serde(flatten)]
    pub row: Row,
    /// The expectation in words.
    pub expected: String,
    /// Whether it holds.
    pub verdict: Judgement,
}

impl Trial {
    /// Compares a result with what is expected of it.
    fn of(row: Row) -> Self {
        let case = cases().into_iter().find(|case| case.name == row.file).expect("a row is of a case");
        let expected = case.expected(&row.method);
        let mut trial = Self { expected: expected.words(), row, verdict: Judgement::Held };
        trial.verdict = expected.judge(trial.result(), trial.is_trusted(), case.is_observable());
        trial
    }

    /// `scene, method: what` for a broken expectation, and for a documented failure that no longer occurs.
    pub fn what(&self) -> String {
        let Self { row: Row { file, method, .. }, expected, verdict } = self;
        match verdict {
            Judgement::Broken(how) => format!("{file}, {method}: {how}"),
            _ => format!("{file}, {method}: expected was \"{expected}\""),
        }
    }

    /// The accuracy.
    pub fn result(&self) -> &Simulated {
        self.row.simulated.as_ref().expect("the images of all scenes are simulated")
    }

    /// Whether the method trusts the result.
    pub fn is_trusted(&self) -> bool {
        self.row.trusted == Some(true)
    }

    /// Whether at least 99.9 % of the samples have the true wrap count; no offset is forgiven.
    pub fn is_recovered(&self) -> bool {
        self.result().exact_k >= LEAST_TRUSTED_SHARE
    }
}

/// Runs all methods on all scenes, and writes [`RESULTS`](crate::results::RESULTS), the trials of each scene and method, and the pictures
/// into the folder `out`.
///
/// # Errors
/// [`GridError`] if `out` cannot be written, or a scene cannot be exposed. A broken expectation is not an error.
pub fn run(out: &Path, tell: &dyn Fn(GridEvent<'_>)) -> Result<Vec<Trial>, GridError> {
    let pictures = out.join(PICTURES);
    std::fs::create_dir_all(&pictures).map_err(|why| GridError::io(&pictures, why))?;
    let options = RunOptions { method: vec![ALL.to_owned()], threads: 1, repeats: 1, exr: false, out: None };
    let by = (&options, out, runner::methods(&options, false)?);
    let cases = cases();
    let scenes = cases.iter().map(|&case| {
        let (file, name) = (case.name.clone(), format!("{PICTURES}/{}", case.name));
        std::iter::once(Picture { file, name, content: Ok(case) })
    });
    let capture = |name: &str, case: &&Case, (): &()| capture(out, name, case);
    let run = runner::run(by, (scenes, cases.len()), &[()], capture, tell)?;
    if let [why, ..] = &run.skipped[..] {
        return Err(GridError::Results(why.clone()));
    }
    let trials: Vec<Trial> = run.rows.into_iter().map(Trial::of).collect();
    save(out, &trials)?;
    Ok(trials)
}

/// Exposes the sensor of a case, and writes the true and the modulo image into the folder `out`. The methods are told the range alone.
fn capture(out: &Path, name: &str, case: &Case) -> Result<Capture, GridError> {
    let exposure = case.expose()?;
    let (y, scene, name) = (exposure.modulo(), exposure.range().into(), name.to_owned());
    save_png(&out.join(format!("{name}_truth.png")), &exposure.ideal().demosaiced())?;
    // Codes of all bits as pixels of 8 bits.
    let shown = y.to_f32().mapv(|code| (255.0 * code / exposure.range().peak() + 0.5) as u8);
    save_png(&out.join(format!("{name}_modulo.png")), &Frame::from_u8(shown).map_err(SensorError::from)?)?;
    let (sensor, truth) = (case.sensor.clone(), Some((exposure, None, case::SEED)));
    Ok(Capture { y, sensor, scene, name, counts: false, full_scale: 1.0, truth })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_result_that_is_worse_than_expected_is_named() {
        let trials = [("step_120", 0.9), ("step_140", 1.0), ("step_200", 0.9)].map(|(file, exact_k)| {
            Trial::of(Row {
                file: file.to_owned(),
                sensor: Default::default(),
                method: "lines".to_owned(),
                method_used: "lines".to_owned(),
                trusted: None,
                reason: None,
                most_k: 3,
                ms: 1.0,
                simulated: Some(Simulated { exact_k, ..Simulated::default() }),
            })
        });
        let [broken, better, held] = &trials;
        assert!(matches!(broken.verdict, Judgement::Broken(_)));
        assert_eq!(broken.what(), "step_120, lines: 90.00 % exact, 100.00 % expected");
        assert_eq!((&better.verdict, &held.verdict), (&Judgement::Better, &Judgement::Held));
        assert!(better.what().starts_with("step_140, lines: expected was \"fails"), "{}", better.what());
    }
}
