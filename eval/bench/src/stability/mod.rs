//! The stability suite: every method on the scenes on which methods fail, compared with the expected results.
//!
//! `radiance` draws, `catalogue` lists scenes and expectations, `expect` judges, `page` and `report` write the results. A
//! run reads no file.

mod case;
mod catalogue;
mod expect;
mod page;
mod picture_folder;
mod radiance;
mod report;

use std::collections::BTreeMap;
use std::path::Path;

use modulo_core::metric::exact_share;
use modulo_core::unwrap::{METHODS, Options, QualityMetrics, Report, by_name};
use modulo_core::{Exposure, Frame, Recovered};
use ndarray::{Array3, Axis};

pub use case::Case;
pub use catalogue::cases;
pub use report::StabilityOutcome;

use crate::{BenchError, BenchEvent, make_folder, write, write_json};
use expect::{Judgement, judge_trust};
use picture_folder::ScenePictures;
use report::{SceneRow, StabilityReport, Trial};

/// Runs all methods on all scenes and writes `index.html`, `results.json`, `pictures/` and `figures/` into `out`, which is
/// created if it is missing.
///
/// # Errors
/// [`BenchError`] if `out` cannot be written. A broken expectation is not an error: see [`StabilityOutcome`].
pub fn run(out: &Path, progress: impl FnMut(BenchEvent<'_>)) -> Result<StabilityOutcome, BenchError> {
    for folder in ["pictures", "figures"] {
        make_folder(&out.join(folder))?;
    }
    let report = examine_all(Some(out), progress)?;
    write_json(&out.join("results.json"), &report)?;
    write(&out.join("index.html"), page::html(&report).as_bytes())?;
    Ok(report.outcome)
}

/// Runs all methods on all scenes without writing a file.
///
/// # Errors
/// [`BenchError`] if a method refuses a scene.
pub fn measure(progress: impl FnMut(BenchEvent<'_>)) -> Result<StabilityOutcome, BenchError> {
    Ok(examine_all(None, progress)?.outcome)
}

fn examine_all(
    folder: Option<&Path>,
    mut progress: impl FnMut(BenchEvent<'_>),
) -> Result<StabilityReport, BenchError> {
    let cases = cases();
    let mut scenes = Vec::new();
    for (done, case) in cases.iter().enumerate() {
        progress(BenchEvent::Step { done, total: cases.len(), next: case.name() });
        scenes.push(examine(case, folder)?);
    }
    Ok(StabilityReport::new(scenes, catalogue::rejections()))
}

/// Runs every method on `case`, and writes its pictures into `folder`, if there is one.
fn examine(case: &Case, folder: Option<&Path>) -> Result<SceneRow, BenchError> {
    let exposure = case.expose()?;
    // All methods get the same exposure, with the same noise.
    let y = exposure.modulo();
    let pictures = folder.map(|out| ScenePictures::new(out, case.name(), &exposure, &y)).transpose()?;
    let mut trials = Vec::new();
    for &method in METHODS {
        let (score, x) = score(method, &y, &exposure)?;
        let expected = case.expected(method);
        let verdict = Judgement::both(expected.judge(&score), judge_trust(&score, case.is_observable()));
        let report = score.report;
        trials.push(Trial {
            method,
            expected: expected.words(),
            reason: expected.reason(),
            exact: score.exact,
            up_to_offset: score.up_to_offset,
            psnr_db: score.psnr,
            method_used: report.method,
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

/// Accuracy of a result.
#[derive(Clone, Copy, Debug)]
pub struct MethodScore {
    /// Share of the samples with the true k, 0 to 1.
    pub exact: f64,
    /// The same share after the best offset for each channel.
    pub up_to_offset: f64,
    /// PSNR of x_hat against x in dB with the peak `alpha * 2^b`. `None` without any error.
    pub psnr: Option<f64>,
    /// The report of the method.
    pub report: Report,
}

/// Unwraps `y` by `method` on one thread and compares the result with `truth`. Also returns x_hat.
pub fn score(method: &str, y: &Frame, truth: &Exposure) -> Result<(MethodScore, Array3<f32>), BenchError> {
    let mut out = Recovered::default();
    by_name(method, &Options::default())?.unwrap(y, truth.range(), &mut out)?;
    let wraps = truth.wraps();
    let off = out.k.mapv(i16::from) - wraps.mapv(i16::from);
    let score = MethodScore {
        exact: exact_share(&out.k, &wraps)?,
        up_to_offset: up_to_offset(&off),
        psnr: psnr(&out.x, truth),
        report: out.report,
    };
    Ok((score, out.x))
}

/// Share of the samples that have the most frequent error of their channel.
fn up_to_offset(off: &Array3<i16>) -> f64 {
    let most_frequent = |channel| {
        // Wrap counts are bytes, so that their differences lie between -255 and 255: 511 values.
        let mut counts = [0usize; 511];
        off.index_axis(Axis(2), channel).iter().for_each(|off| counts[usize::from(off.abs_diff(-255))] += 1);
        counts.into_iter().max().expect("there are counts")
    };
    (0..off.dim().2).map(most_frequent).sum::<usize>() as f64 / off.len() as f64
}

fn psnr(x: &Array3<f32>, truth: &Exposure) -> Option<f64> {
    // The errors are multiples of the peak, which squared and added over an image exceed the precision of f32.
    let squares = x.iter().zip(truth.x()).map(|(a, b)| (f64::from(*a) - f64::from(*b)).powi(2));
    let mean = squares.sum::<f64>() / x.len() as f64;
    (mean > 0.0).then(|| 10.0 * (truth.range().limit().powi(2) / mean).log10())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_offset_is_forgiven_in_each_channel_alone() {
        let mut off = Array3::from_shape_fn((10, 10, 3), |(_, _, channel)| channel as i16 * 255 - 255);
        assert_eq!(up_to_offset(&off), 1.0);
        off[(0, 0, 1)] = 1;
        assert_eq!(up_to_offset(&off), 299.0 / 300.0);
    }
}
