//! Auto: the cheapest method that suffices for the frame, and whether its result can be trusted.
//!
//! The method `lines` runs first and inspects every 2 x 2 loop of y. Its metrics select the method:
//!
//! | metrics of y | method used | trusted |
//! |---|---|---|
//! | hardly a steep loop, each line agrees, all counts in range, hardly a jump | lines; pass_through if all k are 0 | yes |
//! | nearly all loops as steep as chance makes them | spud | no |
//! | strong noise | smoothed_tree | no |
//! | else | gradient_tree | if all counts are in range, and hardly a second difference of the result is above one peak (4 bits and more); in a single colour also if hardly a loop is steep |
//!
//! Hot, dead and stuck samples are left out first, see [`defects`](super::defects).
//!
//! Where `gradient_tree` is not trusted and there is noise, `smoothed_tree` runs as well, and the result with the smaller
//! second differences is kept ([`jumps::bends`]).
//!
//! In every case trust also needs evidence for the absolute offset, see [`offset`]; without it, the result is
//! [`Trust::Relative`].
//!
//! Trust is withheld at last where an edge may hide a multiple of the peak, see [`edges`](super::edges), and where the result leaves the
//! range. Without a known lens, some errors of a sharp one leave no trace in y and cannot be detected: [`edges`](super::edges) lists them.

use super::defects::Defects;
use super::smoothed_tree::SmoothedTree;
use super::{
    GradientTree, Integers, Lines, Options, PASS_THROUGH, QualityMetrics, Range, Recovered, Report, Spud,
    Tree, Trust, Unwrap, UnwrapError, jumps, offset,
};
use crate::frame::Frame;

/// The limits at which `auto` rejects the result of a method.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TrustLimits {
    /// For `lines`: the greatest [`QualityMetrics::steep`], a fraction of the loops.
    pub lines: f64,
    /// For `lines`: the least [`QualityMetrics::consensus`], a fraction of a line.
    pub consensus: f64,
    /// For `gradient_tree`: the greatest [`QualityMetrics::jumps`], second differences per sample.
    pub jumps: f64,
}

impl Default for TrustLimits {
    /// Returns 1e-5, 0.70 and 2e-5.
    fn default() -> Self {
        Self { lines: 1e-5, consensus: 0.70, jumps: 2e-5 }
    }
}

/// The fewest bits with which second differences show a wrong count: rounding to whole codes moves them by up to two codes,
/// which must be far below the peak.
pub(super) const FEWEST_BITS: u8 = 4;

/// With more than this share of steep loops, most of the image is noise, and only the average over many differences says anything.
/// Read noise with a sigma of 0.18 peaks gives 0.19 by itself, and codes of pure chance 0.25.
const DROWNED_STEEP: f32 = 0.18;

/// With more noise than this, in peaks, a smoothed image is recovered better than the image itself. Read noise of 0.12 peaks is measured
/// as 0.10 to 0.12, sharp scenes at alpha 8 without noise as up to 0.07.
pub(super) const STRONG_NOISE: f32 = 0.09;

/// With less noise than this, in peaks, smoothing changes hardly anything.
const SOME_NOISE: f32 = 0.02;

/// With more than this share of residues, a second method rarely helps, and the second differences of the results do not tell the better
/// one.
const MOST_RESIDUES: f32 = 0.04;

/// With more than this share of residues in strong noise, edges are as many as in sharp scenes at alpha 8, and no tree is right.
const DROWNED_RESIDUES: f32 = 0.12;

/// The largest share of clamped counts with which `lines` is used.
const FEW_CLAMPED: f32 = 3e-4;

/// The most second differences above one peak at a spike: a single sample whose count was clamped.
const JUMPS_OF_SPIKE: f32 = 4.0;

/// The method with the buffers of the methods that it selects.
pub struct Auto {
    limits: TrustLimits,
    /// Whether trust needs evidence for the absolute offset.
    needs_offset: bool,
    defects: Defects,
    lines: Lines,
    gradient_tree: GradientTree,
    spud: Spud,
    smoothed_tree: SmoothedTree,
    tree: Tree,
    /// The result of a second method.
    other: Recovered,
}

/// The decision that the metrics of `lines` lead to.
enum MethodChoice {
    PassThrough,
    Lines,
    Tree,
    Spud,
}

impl Auto {
    /// Makes the method with the limits and the threads of `options`.
    ///
    /// # Errors
    /// [`UnwrapError::Workers`] when the threads are not available, [`UnwrapError::Tau`] for an impossible threshold.
    pub fn new(options: &Options) -> Result<Self, UnwrapError> {
        Ok(Self {
            limits: options.trust,
            needs_offset: true,
            defects: Defects::default(),
            lines: Lines::default(),
            gradient_tree: GradientTree::new(options.threads)?,
            spud: Spud::with_threads(options.tau, options.threshold_on, options.threads)?,
            smoothed_tree: SmoothedTree::default(),
            tree: Tree::default(),
            other: Recovered::default(),
        })
    }

    /// Makes the method for differences between colours, whose absolute offset the caller finds.
    ///
    /// # Errors
    /// The errors of [`Auto::new`].
    pub(super) fn of_differences(options: &Options) -> Result<Self, UnwrapError> {
        Ok(Self { needs_offset: false, ..Self::new(options)? })
    }

    fn judge(&self, quality: QualityMetrics, lines: &Recovered, range: Range) -> MethodChoice {
        let QualityMetrics { steep, consensus, clamped, jumps, .. } = quality;
        if steep > DROWNED_STEEP {
            return MethodChoice::Spud;
        }
        // Compared in double precision, in which the limits are given.
        let (steep, consensus) = (f64::from(steep), f64::from(consensus));
        // A clamped count contradicts the range, however smooth y looks. Only single samples may do so: a defect in a dark part may be
        // seen as a little below 0, and is then a spike by itself.
        let excused =
            || if clamped > 0.0 { JUMPS_OF_SPIKE * jumps::spikes(&lines.x, range).min(clamped) } else { 0.0 };
        if steep <= self.limits.lines
            && consensus >= self.limits.consensus
            && clamped <= FEW_CLAMPED
            && (f64::from(jumps) <= self.limits.jumps || f64::from(jumps - excused()) <= self.limits.jumps)
        {
            let wrapped = lines.k.iter().any(|&k| k > 0);
            return if wrapped { MethodChoice::Lines } else { MethodChoice::PassThrough };
        }
        MethodChoice::Tree
    }

    /// Unwraps by the tree that the noise of y asks for; returns the trust in the result, and writes its jumps into `quality`.
    fn grow(
        &mut self,
        y: &Frame,
        range: Range,
        quality: &mut QualityMetrics,
        out: &mut Recovered,
    ) -> Result<Trust, UnwrapError> {
        let noise = self.smoothed_tree.read(y, range)?;
        // Rounding to few bits looks like noise, and is none.
        let noise = if range.bits() < FEWEST_BITS { 0.0 } else { noise };
        if noise > STRONG_NOISE {
            self.grow_in_noise(y, range, quality.residues, out)?;
            quality.jumps = jumps::share(&out.x, range);
            return Ok(Trust::Untrusted);
        }
        self.gradient_tree.unwrap(y, range.of_few_outliers(), out)?;
        quality.jumps = jumps::share(&out.x, range);
        // A result that contradicts itself is not trusted, whatever y looks like.
        let agrees = f64::from(quality.jumps) <= self.limits.jumps;
        let is_steep = f64::from(quality.steep) > self.limits.lines;
        // In a single colour, nothing contradicts a wrong region behind a hard edge. Differences between colours have few edges.
        let may_hide = is_steep && y.channels() == 1 && self.needs_offset;
        let is_sound = |report: &Report| {
            range.bits() >= FEWEST_BITS && agrees && !may_hide && report.trust != Trust::Untrusted
        };
        let mut trust =
            if is_sound(&out.report) { self.trust_in_offset(out, range) } else { Trust::Untrusted };
        // Where the offset is sought here, wrong regions must not raise the whole image. Where the result contradicts itself, or where y has
        // hard edges, behind which a region may be wrong without a trace, more samples may be out of range.
        if self.needs_offset && trust != Trust::Trusted && (!agrees || (is_steep && range.black() == 0)) {
            self.gradient_tree.place(y, range, out)?;
            quality.jumps = jumps::share(&out.x, range);
            trust = if is_sound(&out.report) { trust } else { Trust::Untrusted };
        }
        if trust == Trust::Untrusted && noise > SOME_NOISE && quality.residues <= MOST_RESIDUES {
            self.smoothed_tree.unwrap(&mut self.gradient_tree, y.dim(), range, &mut self.other);
            if jumps::bends(&self.other.x, range) < jumps::bends(&out.x, range) {
                std::mem::swap(out, &mut self.other);
                quality.jumps = jumps::share(&out.x, range);
            }
        }
        Ok(trust)
    }

    /// Returns the trust in a result whose counts agree with each other.
    fn trust_in_offset(&self, out: &Recovered, range: Range) -> Trust {
        if self.needs_offset { offset::trust(out, range) } else { Trust::Trusted }
    }

    /// Unwraps y in strong noise by the method that wins at its share of residues.
    fn grow_in_noise(
        &mut self,
        y: &Frame,
        range: Range,
        residues: f32,
        out: &mut Recovered,
    ) -> Result<(), UnwrapError> {
        if residues > DROWNED_RESIDUES {
            return self.spud.unwrap(y, range, out);
        }
        self.smoothed_tree.unwrap(&mut self.gradient_tree, y.dim(), range, out);
        if residues <= MOST_RESIDUES {
            self.tree.unwrap(y, range, &mut self.other)?;
            if jumps::bends(&self.other.x, range) < jumps::bends(&out.x, range) {
                std::mem::swap(out, &mut self.other);
            }
        }
        Ok(())
    }
}

impl Unwrap for Auto {
    fn name(&self) -> &'static str {
        "auto"
    }

    fn unwrap(&mut self, y: &Frame, range: Range, out: &mut Recovered) -> Result<(), UnwrapError> {
        // A defect that matters makes loops steep: an image without steep loops is not searched.
        let Some(rows) = self.lines.scan_to_steep(y, range)? else {
            return self.unwrap_scanned(y, 0.0, range, out);
        };
        // The colours between which a difference was taken have no defects any more.
        if !self.needs_offset {
            self.lines.scan_from(rows, y, range)?;
            return self.unwrap_scanned(y, 0.0, range, out);
        }
        let codes = Integers::of(y)?;
        let mut defects = std::mem::take(&mut self.defects);
        let done = match defects.remove(y, codes, range) {
            None => {
                self.lines.scan_from(rows, y, range).and_then(|()| self.unwrap_scanned(y, 0.0, range, out))
            }
            Some((sound, share)) => {
                let scanned = self.lines.scan_from(0, sound, range);
                let done = scanned.and_then(|()| self.unwrap_scanned(sound, share, range, out));
                done.map(|()| defects.restore(codes, range, out))
            }
        };
        self.defects = defects;
        done
    }
}

impl Auto {
    /// Unwraps the image that `lines` has scanned, of whose samples a share of `defects` was replaced.
    fn unwrap_scanned(
        &mut self,
        y: &Frame,
        defects: f32,
        range: Range,
        out: &mut Recovered,
    ) -> Result<(), UnwrapError> {
        self.finish_lines(y, defects, range.of_few_outliers(), out)?;
        // A second method overwrites the report, but the metrics of y remain those of `lines`.
        let quality = out.report.quality.expect("lines always gives its quality");
        let mut quality = QualityMetrics { defects, ..quality };
        let trust = match self.judge(quality, out, range) {
            MethodChoice::PassThrough => {
                out.report.method = PASS_THROUGH;
                self.trust_in_offset(out, range)
            }
            MethodChoice::Lines => self.trust_in_offset(out, range),
            MethodChoice::Spud => {
                self.spud.unwrap(y, range, out)?;
                quality.jumps = jumps::share(&out.x, range);
                Trust::Untrusted
            }
            MethodChoice::Tree => self.grow(y, range, &mut quality, out)?,
        };
        out.report.quality = Some(quality);
        out.report.trust = trust;
        Ok(())
    }

    /// Writes the result of `lines` for the image that it has scanned. Where counts leave the range, alpha may be a little
    /// larger than it was given.
    fn finish_lines(
        &mut self,
        y: &Frame,
        defects: f32,
        range: Range,
        out: &mut Recovered,
    ) -> Result<(), UnwrapError> {
        let is_clamped = |out: &Recovered| {
            out.report
                .quality
                .is_some_and(|quality| quality.clamped > if defects > 0.0 { FEW_CLAMPED } else { 0.0 })
        };
        self.lines.finish(y, range, out)?;
        if is_clamped(out) && range.widened().max_wraps() > range.max_wraps() {
            self.lines.unwrap(y, range.widened(), out)?;
            // The counts beyond the range are right only if they explain the whole image.
            if is_clamped(out) {
                self.lines.unwrap(y, range, out)?;
            }
        }
        Ok(())
    }
}
