//! Auto: as much model as the frame needs, and a word on whether to trust it.
//!
//! The first rung, `lines`, looks at every 2 x 2 loop of y on its way; what it saw decides
//! what follows:
//!
//! | seen in y | rung | trusted |
//! |---|---|---|
//! | hardly a steep loop, each line agrees, all counts in range | lines; pass_through if all k are 0 | yes |
//! | few steep loops | gradient_tree | if all counts are in range |
//! | more | gradient_tree | no |
//!
//! Trust is given on y alone. What leaves no trace in y cannot be seen here: a region with
//! a sharp contour of exactly whole peaks, and a whole channel brighter than the peak.

use super::{
    GradientTree, Lines, Options, PASS_THROUGH, QualityMetrics, Range, Recovered, Trust, Unwrap, UnwrapError,
};
use crate::frame::Frame;

/// How much may speak against a rung before `auto` leaves it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TrustLimits {
    /// `lines`: greatest [`QualityMetrics::steep`], a fraction of the loops.
    pub lines: f64,
    /// `lines`: least [`QualityMetrics::consensus`], a fraction of a line.
    pub consensus: f64,
    /// `gradient_tree`: greatest [`QualityMetrics::steep`], a fraction of the loops.
    pub gradient_tree: f64,
}

impl Default for TrustLimits {
    /// 1e-5, 0.70 and 2e-5.
    fn default() -> Self {
        Self { lines: 1e-5, consensus: 0.70, gradient_tree: 2e-5 }
    }
}

/// The ladder with its rungs' buffers.
pub struct Auto {
    limits: TrustLimits,
    lines: Lines,
    gradient_tree: GradientTree,
}

/// What the quality of `lines` asks for.
enum Verdict {
    PassThrough,
    Lines,
    FallBack { trusted: bool },
}

impl Auto {
    /// With the limits and the threads of `options`.
    ///
    /// # Errors
    /// [`UnwrapError::Workers`] when the threads cannot be had.
    pub fn new(options: &Options) -> Result<Self, UnwrapError> {
        let gradient_tree = GradientTree::new(options.threads)?;
        Ok(Self { limits: options.trust, lines: Lines::default(), gradient_tree })
    }

    fn judge(&self, lines: &Recovered) -> Verdict {
        let QualityMetrics { steep, consensus, clamped, .. } =
            lines.report.quality.expect("lines always gives its quality");
        let (steep, consensus) = (f64::from(steep), f64::from(consensus));
        if steep <= self.limits.lines && consensus >= self.limits.consensus && clamped == 0.0 {
            let wrapped = lines.k.iter().any(|&k| k > 0);
            return if wrapped { Verdict::Lines } else { Verdict::PassThrough };
        }
        Verdict::FallBack { trusted: steep <= self.limits.gradient_tree }
    }
}

impl Unwrap for Auto {
    fn name(&self) -> &'static str {
        "auto"
    }

    fn unwrap(&mut self, y: &Frame, range: Range, out: &mut Recovered) -> Result<(), UnwrapError> {
        self.lines.unwrap(y, range, out)?;
        let quality = out.report.quality;
        match self.judge(out) {
            Verdict::PassThrough => out.report.method = PASS_THROUGH,
            Verdict::Lines => {}
            Verdict::FallBack { trusted } => {
                self.gradient_tree.unwrap(y, range, out)?;
                out.report.quality = quality;
                // A result that contradicts itself is not trusted, whatever y looks like.
                if !trusted || out.report.trust == Trust::Contradicted {
                    out.report.trust = Trust::Contradicted;
                    return Ok(());
                }
            }
        }
        out.report.trust = Trust::Trusted;
        Ok(())
    }
}
