//! [`Judged`]: a method, and whether its results are to be trusted, whatever method found them.
//!
//! A method says whether its counts agree with each other. The judge then takes the trust from a result whose errors
//! could be undetectable ([`edges`](super::edges)), and looks for evidence of the absolute offset
//! ([`offset`](super::offset)).
//!
//! `auto` proves counts first ([`proof`](super::proof)). If that is possible for all of them, no method is needed. Else
//! its result is judged as it is, and then takes the counts that are proved: that makes it no worse, whatever it is.

use super::budget::{self, Budget};
use super::edges::{self, Arrangement};
use super::offset::OffsetFinder;
use super::proof::{Proof, Proved};
use super::{
    Integers, OffsetEvidence, PROOF, QualityMetrics, Recovered, Report, Scene, Trust, Unwrap, UnwrapError,
};
use crate::frame::Frame;
use crate::optics::Psf;

/// A method with its judge.
pub(super) struct Judged {
    method: Box<dyn Unwrap>,
    /// Proves counts before the method is asked.
    proof: Option<Proof>,
    /// Finds the offset of the results of a sensor with one gain; pixels of low gain show that of two gains.
    offset: Option<OffsetFinder>,
}

impl Judged {
    /// Returns `method` for a sensor with one gain. `proves`: counts are proved before it is asked. `successive`: the
    /// images are successive frames of one camera.
    pub fn of_one_gain(method: Box<dyn Unwrap>, proves: bool, successive: bool) -> Self {
        let proof = proves.then(Proof::default);
        Self { method, proof, offset: Some(OffsetFinder::new(successive)) }
    }

    /// Returns `method` for a sensor with two gains.
    pub fn of_two_gains(method: Box<dyn Unwrap>) -> Self {
        Self { method, proof: None, offset: None }
    }

    /// Proves counts, if the lens is one behind which that is possible. Where it hides no edge, `lines` is faster, and
    /// its results are trusted.
    fn prove(
        &mut self,
        y: &Frame,
        scene: &Scene,
        budget: &mut Budget,
    ) -> Result<Option<Proved>, UnwrapError> {
        let may_hide = |lens: Psf| scene.range.alpha() * lens.bend() > edges::SAFE;
        let Some(proof) = self.proof.as_mut().filter(|_| scene.lens.is_some_and(may_hide)) else {
            return Ok(None);
        };
        if !proof.reaches(scene, y) {
            return Ok(None);
        }
        let (codes, (height, width, channels)) = (Integers::checked(y, scene.range)?, y.dim());
        let is_left = budget.take(budget::PROOF * (height * width * channels) as f64);
        Ok(if is_left { proof.decode(codes, y.dim(), budget) } else { None })
    }

    /// Writes the result for `y`, whose counts are proved but for those that are left out.
    fn write_proved(&self, y: &Frame, scene: &Scene, left_out: Vec<usize>, out: &mut Recovered) {
        out.prepare(y.dim(), PROOF);
        self.proof.as_ref().expect("it has proved the counts").write(out.buffers().1);
        let defects = left_out.len() as f32 / out.k.len() as f32;
        out.report = Report {
            method: PROOF,
            quality: Some(QualityMetrics { defects, ..QualityMetrics::default() }),
            trust: Trust::Trusted,
            offset: Some(OffsetEvidence::OpticalBlack),
            is_over_budget: false,
        };
        out.defects = left_out;
        out.leave_out();
        if scene.radiance {
            out.fill(y, scene.range);
        }
    }

    /// Judges a result for `y`.
    fn judge(&mut self, y: &Frame, scene: &Scene, out: &mut Recovered) {
        let arrangement = match (&self.offset, y.mosaic()) {
            (None, _) => Arrangement::TwoGains,
            (Some(_), Some(_)) => Arrangement::Mosaic,
            (Some(_), None) => Arrangement::Next,
        };
        edges::withhold_trust(y, out, arrangement, scene);
        if let Some(offset) = &mut self.offset {
            offset.settle(y, out, scene.range);
        }
        // What does not contradict itself would not have become better.
        out.report.is_over_budget &= ![Trust::Trusted, Trust::Relative].contains(&out.report.trust);
    }
}

impl Unwrap for Judged {
    fn name(&self) -> &'static str {
        self.method.name()
    }

    fn unwrap(&mut self, y: &Frame, scene: &Scene, out: &mut Recovered) -> Result<(), UnwrapError> {
        let mut budget = Budget::of_ms(scene.work);
        let proved = self.prove(y, scene, &mut budget)?;
        if let Some(Proved::Whole(left_out)) = proved {
            self.write_proved(y, scene, left_out, out);
            return Ok(());
        }
        let scene = &Scene { work: budget.left_ms(), ..*scene };
        self.method.unwrap(y, scene, out)?;
        out.report.is_over_budget |= budget.is_exceeded();
        self.judge(y, scene, out);
        if let (Some(Proved::Part), Some(proof)) = (proved, &self.proof) {
            proof.repair(scene.range, out);
        }
        Ok(())
    }
}
