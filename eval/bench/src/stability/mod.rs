//! The stability suite: every method on the scenes on which methods fail, compared with the expected results.
//!
//! `case` has the scenes with their expectations, `radiance` draws them, `expect` judges, `page` and `report` write the results. A run
//! reads no file.
//!
//! All pictures of a run have the same gamma, which makes dark scenes visible: radiance is `255 sqrt(x / (alpha 2^b))`, codes
//! are `255 y / 2^b`. No figure is computed from pictures.

mod case;
mod expect;
mod page;
mod radiance;
mod report;

use std::collections::BTreeMap;
use std::path::Path;

use modulo_core::unwrap::{QualityMetrics, Report};
use modulo_core::{Exposure, Frame, FrameError, Recovered, SensorError, Unwrap};
use modulo_images::save_png;
use ndarray::{Array3, Axis, concatenate, s};
use report::{SceneRow, StabilityReport, Trial};

use crate::{BenchError, BenchEvent, write, write_json};
pub use case::{Case, cases};
pub use report::StabilityOutcome;

/// Runs all methods on all scenes and writes `index.html`, `results.json`, `pictures/` and `figures/` into `out`.
///
/// # Errors
/// [`BenchError`] if `out` cannot be written. A broken expectation is not an error: see [`StabilityOutcome`].
pub fn run(out: &Path, mut progress: impl FnMut(BenchEvent<'_>)) -> Result<StabilityOutcome, BenchError> {
    for folder in ["pictures", "figures"].map(|name| out.join(name)) {
        std::fs::create_dir_all(&folder).map_err(|why| BenchError::Io(folder, why))?;
    }
    let cases = cases();
    let mut scenes = Vec::new();
    for (done, case) in cases.iter().copied().enumerate() {
        progress(BenchEvent::Step { done, total: cases.len(), next: &case.name });
        scenes.push(examine(case, out)?);
    }
    let report = StabilityReport::new(scenes);
    write_json(&out.join("results.json"), &report)?;
    write(&out.join("index.html"), page::html(&report).as_bytes())?;
    Ok(report.outcome)
}

/// Runs every method on `case`, and writes its pictures into `folder`.
fn examine(case: &'static Case, folder: &Path) -> Result<SceneRow, BenchError> {
    let exposure = case.expose()?;
    // All methods get the same exposure, with the same noise.
    let y = exposure.modulo();
    let pictures = ScenePictures::new(folder, &case.name, &exposure, &y)?;
    let mut trials = Vec::new();
    // Pictures of a mosaic have colours; its modulo image is shown as it is.
    for mut method in case.methods() {
        let (score, x) = score(method.as_mut(), &y, &exposure)?;
        let method = method.name();
        let expected = case.expected(method);
        let verdict = expected.judge(&score, case.is_observable());
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
            picture: pictures.add(method, &in_colour(x, &exposure))?,
        });
    }
    Ok(SceneRow { scene: case, shape: y.dim(), trials })
}

/// Demosaics the radiance of a colour mosaic; any other one stays as it is.
fn in_colour(x: Array3<f32>, exposure: &Exposure) -> Array3<f32> {
    exposure.mosaic().map(|mosaic| mosaic.demosaic(x.view())).unwrap_or(x)
}

fn named(
    QualityMetrics { residues, steep, clamped, jumps, defects }: QualityMetrics,
) -> BTreeMap<&'static str, f32> {
    [("residues", residues), ("steep", steep), ("clamped", clamped), ("jumps", jumps), ("defects", defects)]
        .into()
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
pub fn score(
    method: &mut dyn Unwrap,
    y: &Frame,
    truth: &Exposure,
) -> Result<(MethodScore, Array3<f32>), BenchError> {
    let mut out = Recovered::default();
    method.unwrap(y, &truth.range().into(), &mut out)?;
    let off = out.k.mapv(i16::from) - truth.wraps().mapv(i16::from);
    let score = MethodScore {
        exact: truth.exact_share(&out.k).expect("a method keeps the shape of its image"),
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

/// For each method the scene that shows its peculiarity in the documentation.
const FIGURES: &[(&str, &str)] = &[
    ("auto", "step_200"),
    ("spud", "sun_blur"),
    ("least_squares", "sun_motion"),
    ("itoh", "colour_shift"),
    ("lines", "night_sharp"),
    ("tree", "alpha_8"),
    ("gradient_tree", "pole_1px"),
];

/// Rows of a scene that a figure of the documentation shows.
const ROWS: std::ops::Range<usize> = 32..160;

/// Width of the white gap between pictures side by side, px.
const GAP: usize = 4;

/// The pictures of one scene.
pub struct ScenePictures<'a> {
    out: &'a Path,
    scene: &'a str,
    limit: f64,
    truth: Array3<u8>,
    modulo: Array3<u8>,
}

impl<'a> ScenePictures<'a> {
    /// Writes the truth and the modulo image of `scene` into `out`, which has the subfolders `pictures` and `figures`.
    pub fn new(out: &'a Path, scene: &'a str, exposure: &Exposure, y: &Frame) -> Result<Self, BenchError> {
        let limit = exposure.range().limit();
        // The sensor delivers whole codes. A perfect result is therefore floor(x), and equals this picture byte for
        // byte.
        let truth = radiance(&in_colour(exposure.x().mapv(f32::floor), exposure), limit);
        let modulo = codes(y, exposure.range().peak());
        let pictures = Self { out, scene, limit, truth, modulo };
        pictures.save(&pictures.path("truth"), &[&pictures.truth])?;
        pictures.save(&pictures.path("modulo"), &[&pictures.modulo])?;
        Ok(pictures)
    }

    /// Writes the result of `method`, unless it equals the truth. Returns the path of its picture within the folder.
    pub fn add(&self, method: &str, x: &Array3<f32>) -> Result<String, BenchError> {
        let result = radiance(x, self.limit);
        if FIGURES.contains(&(method, self.scene)) {
            let parts = [&self.truth, &self.modulo, &result]
                .map(|picture| picture.slice(s![ROWS, .., ..]).to_owned());
            self.save(&format!("figures/{method}.png"), &parts.each_ref())?;
        }
        // Most methods are exact on most scenes. Their pictures would be copies of the truth: the page links that one.
        if result == self.truth {
            return Ok(self.path("truth"));
        }
        self.save(&self.path(method), &[&result])?;
        Ok(self.path(method))
    }

    fn path(&self, label: &str) -> String {
        format!("pictures/{}-{label}.png", self.scene)
    }

    fn save(&self, path: &str, pictures: &[&Array3<u8>]) -> Result<(), BenchError> {
        let frame = strip(pictures).map_err(|error: FrameError| SensorError::from(error))?;
        Ok(save_png(&self.out.join(path), &frame)?)
    }
}

/// Radiance `x` (code units) of a sensor with range `limit`, as 8-bit pixels.
fn radiance(x: &Array3<f32>, limit: f64) -> Array3<u8> {
    let limit = limit as f32;
    x.mapv(|x| (255.0 * (x / limit).max(0.0).sqrt() + 0.5) as u8)
}

/// Codes of a sensor with peak `peak`, as 8-bit pixels.
fn codes(y: &Frame, peak: f32) -> Array3<u8> {
    y.to_f32().mapv(|y| (255.0 * y / peak + 0.5) as u8)
}

/// Joins pictures of equal height and channels side by side.
fn strip(pictures: &[&Array3<u8>]) -> Result<Frame, FrameError> {
    let (height, _, channels) = pictures[0].dim();
    let gap = Array3::from_elem((height, GAP, channels), 255);
    let parts: Vec<_> = pictures.iter().flat_map(|picture| [gap.view(), picture.view()]).skip(1).collect();
    Frame::from_u8(concatenate(Axis(1), &parts).expect("all pictures show rows of the same scene"))
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
