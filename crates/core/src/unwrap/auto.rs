//! Auto: tries candidates in order of cost, keeps the one with the best score, and says whether the result can be trusted.
//!
//! The candidates are `lines`, `gradient_tree` (unless the noise is strong), `smoothed_tree` (if there is noise), and [`growth`](super::growth) of
//! the last result; `spud` instead of growth for an image that cannot be predicted. The first one is the result whose second differences do not contradict it: at most
//! [`TrustLimits::jumps`] of them are above one peak. `lines` also needs a y without steep loops. If no candidate is accepted, the
//! one that bends least is the result ([`jumps::bends`]).
//!
//! Why second differences? If those of x and of another result for the same y, along rows and columns, are all below half a peak, then both
//! differ by whole peaks `a + b i + c j + d i j`, which the range makes constant. Around a wrong region they are off by one peak.
//!
//! An accepted result is trusted with evidence for the absolute offset ([`offset`]; without it, it is [`Trust::Relative`]), from 4 bits on, in a
//! single colour only without steep loops, and unless an edge may hide a multiple of the peak, see [`edges`](super::edges).
//!
//! A candidate whose work exceeds what is left of the [`budget`](super::budget) is not tried.
//!
//! Hot, dead and stuck samples are left out first, see [`defects`](super::defects).

use super::budget::{self, Budget};
use super::congruence::{FEW_OUTLIERS, OUTLIERS};
use super::defects::Defects;
use super::lines::Scanned;
use super::smoothed_tree::SmoothedTree;
use super::{
    GradientTree, Integers, Lines, Options, PASS_THROUGH, QualityMetrics, Range, Recovered, SMOOTHED_TREE,
    Scene, Spud, Trust, Unwrap, UnwrapError, jumps, offset,
};
use crate::frame::Frame;

/// The limits at which `auto` rejects the result of a method.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TrustLimits {
    /// In a single colour: the greatest [`QualityMetrics::steep`], a fraction of the loops.
    pub lines: f64,
    /// The greatest [`QualityMetrics::jumps`], second differences per sample.
    pub jumps: f64,
}

impl Default for TrustLimits {
    /// Returns 1e-5 and 2e-5.
    fn default() -> Self {
        Self { lines: 1e-5, jumps: 2e-5 }
    }
}

/// The fewest bits with which second differences show a wrong count: rounding to whole codes moves them by up to two codes,
/// which must be far below the peak.
pub(super) const FEWEST_BITS: u8 = 4;

/// With more noise than this, in peaks, a smoothed image is recovered better than the image itself. Read noise of 0.12 peaks is measured
/// as 0.10 to 0.12, sharp scenes at alpha 8 without noise as up to 0.07.
pub(super) const STRONG_NOISE: f32 = 0.09;

/// With at most this much noise, in peaks, smoothing gains too little for a second tree: the image grows from the result of the first one.
/// Sharp scenes without noise are measured as up to 0.07, most of them as less than this.
const LITTLE_NOISE: f32 = 0.036;

/// The largest share of clamped counts with which `lines` is accepted.
const FEW_CLAMPED: f32 = 3e-4;

/// The most second differences above one peak at a spike: a single sample whose count was clamped.
const JUMPS_OF_SPIKE: f32 = 4.0;

/// The bends of least squares count so many times: they make smooth what they do not find.
const HANDICAP: f64 = 1.02;

/// The method with the buffers of its candidates.
pub struct Auto {
    limits: TrustLimits,
    /// What is left of the work that is allowed on the image.
    budget: Budget,
    /// Whether trust needs evidence for the absolute offset.
    needs_offset: bool,
    /// The share of the pixels that may be below the least count, in a result without contradictions and in others.
    few_outliers: f64,
    outliers: f64,
    defects: Defects,
    lines: Lines,
    gradient_tree: GradientTree,
    smoothed_tree: SmoothedTree,
    spud: Spud,
    /// The result of a candidate.
    other: Recovered,
    /// Whether a tree has a result for this image.
    growable: bool,
}

/// The candidates after `lines`, in order of cost.
#[derive(Clone, Copy, PartialEq)]
enum Candidate {
    Tree,
    SmoothedTree,
    /// Growth from the last result, or `spud` for an image whose neighbours do not predict a pixel.
    Growth,
}

impl Auto {
    /// Makes the method with the limits and the threads of `options`.
    ///
    /// # Errors
    /// [`UnwrapError::Workers`] when the threads are not available, [`UnwrapError::Tau`] for an impossible threshold.
    pub fn new(options: &Options) -> Result<Self, UnwrapError> {
        Ok(Self {
            limits: options.trust,
            budget: Budget::default(),
            needs_offset: true,
            few_outliers: FEW_OUTLIERS,
            outliers: OUTLIERS,
            defects: Defects::default(),
            lines: Lines::default(),
            gradient_tree: GradientTree::new(options.threads)?,
            smoothed_tree: SmoothedTree::default(),
            spud: Spud::with_threads(options.tau, options.threshold_on, options.threads)?,
            other: Recovered::default(),
            growable: false,
        })
    }

    /// Makes the method for differences between colours, whose absolute offset the caller finds.
    ///
    /// # Errors
    /// The errors of [`Auto::new`].
    pub(super) fn of_differences(options: &Options) -> Result<Self, UnwrapError> {
        // Differences have either sign, so that the least one is no outlier.
        Ok(Self { needs_offset: false, few_outliers: 0.0, outliers: 0.0, ..Self::new(options)? })
    }

    /// Unwraps the image that `lines` has scanned, with the metrics that it has given.
    fn unwrap_scanned(
        &mut self,
        y: &Frame,
        mut quality: QualityMetrics,
        range: Range,
        out: &mut Recovered,
    ) -> Result<(), UnwrapError> {
        self.budget.spend(budget::LINES * samples(y) as f64);
        let is_steep = f64::from(quality.steep) > self.limits.lines;
        let mut is_accepted = false;
        // Behind a hard edge, lines take the offset of the wrong side.
        if !is_steep {
            self.finish_lines(y, range, &mut quality, out)?;
            is_accepted = self.accepts(jumps_of_lines(y, out, &quality, range));
        }
        if !is_accepted {
            is_accepted = self.try_others(y, range, &mut quality, out)?;
        } else if out.k.iter().all(|&k| k == 0) {
            out.report.method = PASS_THROUGH;
        }
        // In a single colour, nothing contradicts a wrong region behind a hard edge. Differences between colours have few edges.
        let may_hide = is_steep && y.channels() == 1 && self.needs_offset;
        let mut trust = match is_accepted {
            false => Trust::Untrusted,
            true if may_hide || range.bits() < FEWEST_BITS => Trust::Unobservable,
            true if self.needs_offset => offset::trust(y, out, range),
            true => Trust::Trusted,
        };
        // A region behind a hard edge, whose counts leave no trace in y, must not raise the whole image.
        if is_accepted && is_steep && trust != Trust::Trusted && self.needs_offset && range.black() == 0 {
            self.place(y, range, out)?;
            trust = if out.report.trust == Trust::Untrusted { Trust::Untrusted } else { trust };
        }
        (out.report.quality, out.report.trust) = (Some(quality), trust);
        out.report.is_over_budget = self.budget.is_exceeded();
        Ok(())
    }

    /// Writes the last result of a tree anew, at an offset at which more samples may be out of range.
    fn place(&mut self, y: &Frame, range: Range, out: &mut Recovered) -> Result<(), UnwrapError> {
        if out.report.method == self.gradient_tree.name() {
            self.gradient_tree.place(Integers::of(y, range)?, range, self.outliers, out);
        } else if out.report.method == SMOOTHED_TREE {
            self.smoothed_tree.place(&mut self.gradient_tree, range, self.outliers, out);
        }
        Ok(())
    }

    /// Returns whether a result with so many jumps does not contradict itself.
    fn accepts(&self, jumps: f32) -> bool {
        f64::from(jumps) <= self.limits.jumps
    }

    /// Writes the result of the first candidate after `lines` that is accepted, else the one that bends least, and its jumps. Without the work
    /// for any of them, the result is that of `lines`. Returns whether one is accepted.
    fn try_others(
        &mut self,
        y: &Frame,
        range: Range,
        quality: &mut QualityMetrics,
        out: &mut Recovered,
    ) -> Result<bool, UnwrapError> {
        let mut least = f64::MAX;
        let noise = self.smoothed_tree.read(y, range)?;
        self.growable = false;
        // A tree on codes with strong noise is slow and wrong.
        let candidates = [
            (Candidate::Tree, noise <= STRONG_NOISE),
            (Candidate::SmoothedTree, noise > LITTLE_NOISE),
            (Candidate::Growth, true),
        ];
        for (candidate, _) in candidates.into_iter().filter(|(_, is_useful)| *is_useful) {
            let Some(jumps) = self.try_one(candidate, y, range)? else { continue };
            if self.accepts(jumps) {
                std::mem::swap(out, &mut self.other);
                quality.jumps = jumps;
                return Ok(true);
            }
            let handicap = if self.other.report.method == self.spud.name() { HANDICAP } else { 1.0 };
            let bends = handicap * jumps::bends(&self.other.x, range);
            if bends < least {
                (least, quality.jumps) = (bends, jumps);
                std::mem::swap(out, &mut self.other);
            }
        }
        if least == f64::MAX {
            let defects = quality.defects;
            *quality = self.lines.scan_from(0, y, range, f64::INFINITY)?;
            quality.defects = defects;
            self.finish_lines(y, range, quality, out)?;
        }
        Ok(false)
    }

    /// Unwraps by one candidate; returns whether its work was left.
    fn unwrap_by(&mut self, candidate: Candidate, y: &Frame, range: Range) -> Result<bool, UnwrapError> {
        let Self { gradient_tree, smoothed_tree, spud, budget, other, few_outliers: few, .. } = self;
        let is_done = match candidate {
            Candidate::Tree => {
                let is_left = budget.take(smoothed_tree.work_of_tree(y.dim()));
                if is_left {
                    gradient_tree.unwrap_within(y, range, *few, other)?;
                }
                is_left
            }
            Candidate::SmoothedTree => {
                smoothed_tree.unwrap(gradient_tree, y.dim(), (range, *few), budget, other)
            }
            Candidate::Growth => {
                // Without a tree there is nothing to grow from.
                let grown =
                    if self.growable { smoothed_tree.grow(range, *few, budget, other) } else { Some(false) };
                let needs_spud = grown == Some(false) && budget.take(budget::SPUD * samples(y) as f64);
                if needs_spud {
                    spud.unwrap(y, &range.into(), other)?;
                }
                needs_spud || grown == Some(true)
            }
        };
        self.growable |= is_done;
        Ok(is_done)
    }

    /// Unwraps by one candidate; returns the jumps of its result, or `None` if its work was not left.
    fn try_one(&mut self, candidate: Candidate, y: &Frame, range: Range) -> Result<Option<f32>, UnwrapError> {
        if !self.unwrap_by(candidate, y, range)? {
            return Ok(None);
        }
        let jumps = jumps::share_above(&self.other.x, range.peak());
        if f64::from(jumps) <= self.limits.jumps || candidate == Candidate::Growth {
            return Ok(Some(jumps));
        }
        // Wrong regions must not shift the whole image either.
        let mut other = std::mem::take(&mut self.other);
        self.place(y, range, &mut other)?;
        if candidate == Candidate::Tree {
            self.smoothed_tree.take(&other);
        }
        self.other = other;
        Ok(Some(jumps::share_above(&self.other.x, range.peak())))
    }

    /// Writes the result of `lines` for the image that it has scanned, and its metrics. Where counts leave the range, alpha may be a little
    /// larger than it was given.
    fn finish_lines(
        &mut self,
        y: &Frame,
        range: Range,
        quality: &mut QualityMetrics,
        out: &mut Recovered,
    ) -> Result<(), UnwrapError> {
        let is_clamped = |out: &Recovered| out.report.quality.is_some_and(|quality| quality.clamped > 0.0);
        self.lines.finish(y, range, self.few_outliers, out)?;
        if is_clamped(out) && range.widened().max_wraps() > range.max_wraps() {
            let range = range.widened();
            self.lines.scan_from(0, y, range, f64::INFINITY)?;
            self.lines.finish(y, range, self.few_outliers, &mut self.other)?;
            // The counts beyond the range are right only if they explain the whole image.
            if !is_clamped(&self.other) {
                std::mem::swap(out, &mut self.other);
            }
        }
        let of_lines = out.report.quality.expect("lines always gives its quality");
        *quality = QualityMetrics { defects: quality.defects, ..of_lines };
        Ok(())
    }
}

/// Returns the number of the samples of `y`.
fn samples(y: &Frame) -> usize {
    y.height() * y.width() * y.channels()
}

/// Returns the jumps of the result of `lines` that speak against it. A clamped count contradicts the range; only few single samples may do so: a
/// defect in a dark part may seem to be below 0.
fn jumps_of_lines(y: &Frame, out: &mut Recovered, quality: &QualityMetrics, range: Range) -> f32 {
    match quality.clamped {
        0.0 => quality.jumps,
        clamped if clamped > FEW_CLAMPED => f32::INFINITY,
        clamped => {
            out.fill(y, range);
            quality.jumps - JUMPS_OF_SPIKE * jumps::spikes(&out.x, range).min(clamped)
        }
    }
}

impl Unwrap for Auto {
    fn name(&self) -> &'static str {
        "auto"
    }

    fn unwrap(&mut self, y: &Frame, scene: &Scene, out: &mut Recovered) -> Result<(), UnwrapError> {
        let range = scene.range;
        self.budget = Budget::of_ms(scene.work);
        self.lines.leaves_out_radiance = !scene.radiance;
        // A defect that matters makes loops steep: an image without steep loops is not searched.
        let rows = match self.lines.scan(0, y, range, None)? {
            Scanned::Whole(quality) => return self.unwrap_scanned(y, quality, range, out),
            Scanned::ToSteep(rows) => rows,
        };
        let most = self.limits.lines;
        // The colours between which a difference was taken have no defects any more.
        if !self.needs_offset {
            let quality = self.lines.scan_from(rows, y, range, most)?;
            return self.unwrap_scanned(y, quality, range, out);
        }
        let codes = Integers::of(y, range)?;
        let mut defects = std::mem::take(&mut self.defects);
        let done = match defects.remove(y, codes, range) {
            None => {
                let quality = self.lines.scan_from(rows, y, range, most);
                quality.and_then(|quality| self.unwrap_scanned(y, quality, range, out))
            }
            Some((sound, share)) => {
                let quality = self.lines.scan_from(0, sound, range, most);
                let quality = quality.map(|quality| QualityMetrics { defects: share, ..quality });
                let done = quality.and_then(|quality| self.unwrap_scanned(sound, quality, range, out));
                done.map(|()| defects.restore(codes, range, out))
            }
        };
        self.defects = defects;
        done
    }
}
