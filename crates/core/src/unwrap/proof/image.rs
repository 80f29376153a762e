//! [`Image`]: proves an image, without the samples that contradict others.
//!
//! Beside a sample that does not show the radiance, others are proved that are wrong, and so are those that lean on
//! them: then some samples have no count that is possible, or one that those around them exclude. Which one is the
//! cause is not known. So all around these places is left out, and the image is proved again. What was left out is then
//! proved from outside to inside, where no error travels far.

use std::cmp::Ordering;
use std::collections::HashSet;

use super::agreement::{around, contradictions, counts};
use super::plane::{Plane, View};
use super::stencil::Family;
use super::{Sensor, front};
use crate::unwrap::budget::{self, Budget};
use crate::unwrap::{Integers, of_width};

/// One sample of so many may be left out. Where more contradict others, the lens, range or noise is not as described.
const MOST: usize = 3000;

/// The samples that may contradict others, and those around them, for each one that may be left out.
const CONTRADICTIONS: usize = 10;
const DOUBTED: usize = 100;

/// Samples above this share of the range and so many standard deviations of noise lie at its end. Pictures reach 0.97.
const END: f64 = 63.0 / 64.0;
const SIGMAS_OF_ONE: f64 = 5.0;

/// The number of times that samples are left out.
const TRIES: usize = 3;

/// The rows and columns around a contradiction that are left out.
const AROUND: isize = 3;

/// The most samples that are left out within as many rows and columns as `APART`. A line of them may divide what is
/// right from what is not.
const MOST_AT_ONE_PLACE: usize = 20;
const APART: isize = 10;

/// Which counts of an image are proved.
#[derive(Debug, PartialEq)]
pub(in crate::unwrap) enum Proved {
    /// All but those of these samples, in ascending order: defects, and some beside them.
    Whole(Vec<usize>),
    Part,
}

/// An image that is decoded.
pub(super) struct Image<'a> {
    sensor: &'a Sensor,
    plane: &'a mut Plane,
    y: Integers<'a>,
    dim: (usize, usize, usize),
}

impl<'a> Image<'a> {
    /// Reads `y` (H x W x C).
    pub fn read(
        sensor: &'a Sensor,
        plane: &'a mut Plane,
        y: Integers<'a>,
        dim: (usize, usize, usize),
    ) -> Self {
        let mut image = Self { sensor, plane, y, dim };
        image.begin();
        image
    }

    /// Proves all samples but some defects and those beside them, or a part of them. Returns `None` if these contradict
    /// each other, or the work is not left.
    pub fn prove_all(mut self, budget: &mut Budget) -> Option<Proved> {
        let doubted = self.doubted(budget)?;
        let has_defects = !doubted.is_empty();
        if has_defects {
            if doubted.len() > DOUBTED * self.most() {
                return None;
            }
            self.settle_all(sorted(doubted))?;
        }
        let at_end = self.at_end();
        if let Some(left_out) = self.left_out(&at_end) {
            self.guess(&left_out);
            return Some(Proved::Whole(left_out));
        }
        // Where some samples contradicted others, all that are not at the end of the range must have been settled.
        let is_sound = !has_defects || self.left_out(&[]).is_some();
        self.leave_out_around(&at_end);
        (is_sound && self.contradictions(true).is_empty()).then_some(Proved::Part)
    }

    /// Proves samples until none contradict others, without the ones around those that do. Returns these.
    fn doubted(&mut self, budget: &mut Budget) -> Option<Vec<usize>> {
        let mut wrong = self.prove(&[])?;
        if !wrong.is_empty() && !budget.take(budget::DEFECTS * self.samples() as f64) {
            return None;
        }
        let mut doubted = Vec::new();
        for _ in 0..TRIES {
            if wrong.is_empty() {
                break;
            }
            doubted.extend(around(self.plane, &wrong, AROUND));
            self.begin();
            self.leave_out(&doubted);
            wrong = self.prove(&doubted)?;
        }
        wrong.is_empty().then_some(doubted)
    }

    /// Returns the samples at the end of the range. Around them may lie light above it, for which no bound holds.
    fn at_end(&self) -> Vec<usize> {
        let end = END * self.sensor.range.limit() + SIGMAS_OF_ONE * self.sensor.noise;
        let end = end as f32 / self.sensor.range.peak();
        match self.plane.known_up_to(end) == self.samples() {
            true => Vec::new(),
            false => (0..self.samples()).filter(|&at| self.plane.x[at] > end).collect(),
        }
    }

    /// Returns the samples that are not proved, and those around the end of the range, in ascending order, if they are
    /// a few that lie apart.
    fn left_out(&self, at_end: &[usize]) -> Option<Vec<usize>> {
        let few = self.samples() - self.plane.known_up_to(f32::INFINITY) + at_end.len();
        if few == 0 || few > self.most() {
            return (few == 0).then(Vec::new);
        }
        let open = (0..self.samples()).filter(|&at| !self.plane.is_known(at));
        let left_out = sorted(open.chain(around(self.plane, at_end, AROUND)).collect());
        (left_out.len() <= self.most() && self.are_apart(&left_out)).then_some(left_out)
    }

    /// Proves samples that were left out, where all others are right. Returns `None` if too many contradict these.
    fn settle_all(&mut self, doubted: Vec<usize>) -> Option<()> {
        let mut defects = self.settle(&doubted);
        let mut beside = sorted(around(self.plane, &defects, AROUND));
        beside.retain(|at| defects.binary_search(at).is_err());
        self.leave_out(&defects);
        let wrong = self.settle(&beside);
        defects.extend(around(self.plane, &wrong, AROUND));
        self.leave_out(&defects);
        self.prove(&defects)?.is_empty().then_some(())
    }

    fn samples(&self) -> usize {
        self.dim.0 * self.dim.1 * self.dim.2
    }

    /// Returns how many samples may be left out.
    fn most(&self) -> usize {
        self.samples() / MOST
    }

    /// Begins anew, with the seeds.
    fn begin(&mut self) {
        let (peak, seeds) = (self.sensor.range.peak(), self.sensor.seeds);
        of_width!(self.y, y => self.plane.read(y, self.dim, peak, seeds));
    }

    /// Makes samples neither proved nor open.
    fn leave_out(&mut self, samples: &[usize]) {
        samples.iter().for_each(|&at| self.plane.x[at] = f32::NAN);
    }

    /// Makes samples in ascending order neither proved nor open, and all channels around them.
    fn leave_out_around(&mut self, samples: &[usize]) {
        let away = AROUND * self.plane.channels.cast_signed();
        // Neighbours are left out together. In a bright sky, one by one would take long.
        for run in samples.chunk_by(|at, next| at + 1 == *next) {
            for row in -AROUND..=AROUND {
                let down = row * (self.plane.width * self.plane.channels).cast_signed();
                let place =
                    |at: usize, right: isize| at.saturating_add_signed(down + right).min(self.samples());
                let (first, end) = (place(run[0], -away), place(run[run.len() - 1], away + 1));
                self.plane.x[first..end].fill(f32::NAN);
            }
        }
    }

    /// Returns the families of stencils by which samples are proved, and the greatest count.
    fn rule(&self) -> ([&'a Family; 2], f32) {
        ([&self.sensor.corner, &self.sensor.run], self.sensor.range.max_wraps().into())
    }

    /// Sweeps in all views as long as that proves most of what is left. Returns the samples that contradict others, but
    /// for those `left_out`; `None` if these are too many.
    fn prove(&mut self, left_out: &[usize]) -> Option<Vec<usize>> {
        let (families, greatest) = self.rule();
        let (mut unknown, mut before, mut impossible) = (self.plane.unknown(), usize::MAX, 0);
        while unknown > 0 && unknown <= before / 2 {
            before = unknown;
            for view in View::all() {
                if unknown > 0 {
                    let found = front::sweep(self.plane, view, &families, greatest);
                    unknown -= found.proved + found.impossible;
                    impossible += found.impossible;
                }
                if impossible > self.most() {
                    return None;
                }
            }
        }
        let mut wrong = self.contradictions(impossible > 0 || !left_out.is_empty());
        if impossible > 0 {
            let left_out: HashSet<usize> = left_out.iter().copied().collect();
            wrong.extend(
                (0..self.samples()).filter(|at| self.plane.x[*at].is_nan() && !left_out.contains(at)),
            );
        }
        (wrong.len() <= CONTRADICTIONS * self.most()).then_some(wrong)
    }

    /// Returns the samples that those before them in their row, those above them, or those on all sides exclude. What
    /// is wrong up to a line agrees with all that is not on the other side of it, and what is wrong up to a corner,
    /// with the row above and the column before; so that all three look. Where nothing is wrong, as `is_wrong` and the
    /// first two say, the third does not.
    fn contradictions(&self, is_wrong: bool) -> Vec<usize> {
        let Sensor { run, hole, .. } = self.sensor;
        let above: Vec<_> = run.places.iter().map(|[row, column]| [*column, *row]).collect();
        let of_one = |places, family: &Family| contradictions(self.plane, places, &family.stencils[0]);
        let mut wrong = of_one(&run.places, run);
        wrong.extend(of_one(&above, run));
        if is_wrong || !wrong.is_empty() {
            wrong.extend(of_one(&hole.places, hole));
        }
        wrong
    }

    /// Proves samples anew by all around them, from outside to inside. Returns those that contradict others, in order.
    fn settle(&mut self, samples: &[usize]) -> Vec<usize> {
        let (families, greatest) = self.rule();
        for &at in samples {
            self.plane.x[at] = -self.code(at);
        }
        let (mut open, mut before) = (samples.to_vec(), usize::MAX);
        while open.len() < before {
            before = open.len();
            // All of a round are found before any is used.
            let found: Vec<_> = open.iter().map(|&at| counts(self.plane, &families, at, greatest)).collect();
            for (&at, (least, most)) in open.iter().zip(found) {
                match least.total_cmp(&most) {
                    Ordering::Less => {}
                    Ordering::Equal => self.plane.x[at] = least - self.plane.x[at],
                    Ordering::Greater => self.plane.x[at] = f32::NAN,
                }
            }
            open.retain(|&at| self.plane.x[at] < 0.0);
        }
        let is_wrong = |&at: &usize| {
            let (x, (least, most)) = (self.plane.x[at], counts(self.plane, &families, at, greatest));
            x.is_nan() || x > 0.0 && !(least..=most).contains(&x.floor())
        };
        let wrong = samples.iter().copied().filter(is_wrong);
        sorted(wrong.chain(self.contradictions(true)).collect())
    }

    /// Gives samples that are not proved the counts that bring them nearest to the mean of the proved ones around.
    fn guess(&mut self, left_out: &[usize]) {
        let guess = |&at: &usize| {
            let known = around(self.plane, &[at], AROUND).into_iter().filter(|&at| self.plane.is_known(at));
            let (sum, count) =
                known.fold((0.0, 0.0), |(sum, count), at| (sum + self.plane.x[at], count + 1.0));
            let code = self.code(at);
            code + (sum / f32::max(count, 1.0) - code).round().clamp(0.0, self.rule().1)
        };
        let guesses: Vec<f32> = left_out.iter().map(guess).collect();
        left_out.iter().zip(guesses).for_each(|(&at, x)| self.plane.x[at] = x);
    }

    /// Returns the middle of the code of a sample, in peaks.
    fn code(&self, at: usize) -> f32 {
        (f32::from(self.y.at(at)) + 0.5) / self.sensor.range.peak()
    }

    /// Returns whether what is left out lies apart.
    fn are_apart(&self, left_out: &[usize]) -> bool {
        let beside = |at| around(self.plane, &[at], APART).into_iter().filter(|&at| !self.plane.is_known(at));
        left_out.iter().all(|&at| beside(at).count() <= MOST_AT_ONE_PLACE)
    }
}

/// Returns samples in ascending order, each once.
fn sorted(mut samples: Vec<usize>) -> Vec<usize> {
    samples.sort_unstable();
    samples.dedup();
    samples
}
