//! SPUD, the paper's method: wrapped gradients, one Poisson equation, a hard threshold (eq. 2 and 3), one channel
//! after the other. Without its threshold it is the method of least squares.

use ndarray::{Array3, ArrayView3, Axis};

use super::congruence::{self, CountRule, Histogram, LaneCountRules};
use super::poisson::{Codes, Poisson, ThresholdOn};
use super::{Range, Recovered, Scene, Unwrap, UnwrapError, check_codes};
use crate::dct::{self, LANES, SampleRun};
use crate::frame::{Frame, check_shape, copy_channel, in_order};
use crate::gradient;
use crate::simd::widest;
use crate::workers::Workers;

/// The peak of [`Codes`], 2^16.
const PEAK: f64 = 65536.0;

/// SPUD with its buffers; it plans anew when the image size changes.
pub struct Spud {
    tau: f64,
    on: ThresholdOn,
    threads: usize,
    workers: Workers,
    codes: Codes,
    poisson: Poisson<[i16; LANES]>,
    histograms: Vec<[Histogram; 3]>,
}

impl Spud {
    /// Makes the method with a threshold of `tau` >= 0 in units of the peak, on one thread.
    ///
    /// # Errors
    /// [`UnwrapError::Tau`] for a negative, infinite or NaN `tau`.
    pub fn new(tau: f64, on: ThresholdOn) -> Result<Self, UnwrapError> {
        Self::with_threads(tau, on, 1)
    }

    /// Makes the method as [`Spud::new`] does, on `threads` threads, 1 to [`MAX_THREADS`](crate::MAX_THREADS).
    ///
    /// # Errors
    /// [`UnwrapError::Tau`] for a negative, infinite or NaN `tau`, [`UnwrapError::Workers`] when the threads are
    /// not available.
    pub fn with_threads(tau: f64, on: ThresholdOn, threads: usize) -> Result<Self, UnwrapError> {
        // The negation refuses NaN, too.
        if !(tau >= 0.0 && tau.is_finite()) {
            return Err(UnwrapError::Tau { tau });
        }
        let workers = Workers::new(threads)?;
        let histograms = vec![std::array::from_fn(|_| Histogram::new()); threads];
        // The size is known at the first frame, which plans anew.
        let poisson = Poisson::new((1, 1, 1), threads);
        Ok(Self { tau, on, threads, workers, codes: Codes::default(), poisson, histograms })
    }

    /// Returns the phi of eq. 3 before congruence: H x W x C in code units, with mean 0 in each channel.
    ///
    /// `y` (H x W x C, code units) lies in `[0, 2^b]` and need not be quantised; 2^b itself is the value of a
    /// multiple of the peak in the paper's scripts.
    ///
    /// # Errors
    /// [`UnwrapError::Code`] when a value is outside or NaN, [`UnwrapError::Shape`] when `y` does not have the
    /// shape of an image.
    pub fn solve(&mut self, y: ArrayView3<'_, f32>, range: Range) -> Result<Array3<f32>, UnwrapError> {
        check_shape(y.dim())?;
        let in_standard = y.as_standard_layout();
        let samples = in_order(in_standard.view());
        check_codes(samples, y.dim(), range, range.peak())?;
        let (height, width, channels) = y.dim();
        let mut out = Array3::zeros(y.dim());
        // The plan of the method itself keeps residuals; this one keeps phi, for one channel at a time.
        let mut poisson = Poisson::<[f32; LANES]>::new((height, width, 1), self.threads);
        let threshold = ((self.tau * f64::from(range.peak())) as f32, self.on);
        let (mut plane, mut rho) = (Vec::new(), vec![0.0; height * width]);
        for channel in 0..channels {
            copy_channel(samples, channels, channel, &mut plane);
            divergence(&plane, width, range, &mut rho);
            poisson.solve(&self.workers, |run| dct::load_run(&rho, width, run), threshold, |_, phi| phi);
            for ((row, column), out) in out.index_axis_mut(Axis(2), channel).indexed_iter_mut() {
                *out = poisson.grid.out(SampleRun { row, sample: column - column % LANES })[column % LANES];
            }
        }
        Ok(out)
    }

    /// Unwraps as [`Unwrap::unwrap`] does, under the name of another method.
    pub(super) fn unwrap_as(
        &mut self,
        name: &'static str,
        y: &Frame,
        range: Range,
        out: &mut Recovered,
    ) -> Result<(), UnwrapError> {
        self.codes.read(y, range)?;
        out.prepare(y.dim(), name);
        if self.poisson.grid.dim() != y.dim() {
            self.poisson = Poisson::new(y.dim(), self.threads);
        }
        let codes = &self.codes;
        // Phi is never stored: its residuals are integers of half the size, and they are all that is needed.
        self.poisson.solve(
            &self.workers,
            #[inline(always)]
            |run| codes.divergence(run),
            ((self.tau * PEAK) as f32, self.on),
            #[inline(always)]
            |run, phi| congruence::residuals(phi, codes.at(run)),
        );
        let rules = self.count_rules(range);
        self.write(rules, range, out);
        Ok(())
    }

    /// Returns the rules from residuals to wrap counts, by channel.
    fn count_rules(&mut self, range: Range) -> [CountRule; 3] {
        let grid = &self.poisson.grid;
        let (height, width, channels) = grid.dim();
        // Each thread has histograms of its own; their sum does not depend on the number of threads.
        let each = height.div_ceil(self.threads);
        self.workers.each(&mut self.histograms, |part, histograms| {
            histograms.iter_mut().for_each(Histogram::clear);
            let rows = (part * each).min(height)..((part + 1) * each).min(height);
            // Bands outside and rows inside: the residuals of a band are neighbours in memory.
            for sample in (0..width * channels).step_by(LANES) {
                let inside = LANES.min(width * channels - sample);
                let channel: [usize; LANES] = std::array::from_fn(|lane| (sample + lane) % channels);
                for residuals in &grid.outs(sample)[rows.clone()] {
                    for (&residual, &channel) in residuals[..inside].iter().zip(&channel) {
                        histograms[channel].count(residual);
                    }
                }
            }
        });
        let (all, others) = self.histograms.split_first_mut().expect("there is one histogram a thread");
        for other in others {
            all.iter_mut().zip(other).for_each(|(all, other)| all.add(other));
        }
        std::array::from_fn(|channel| all[channel].count_rule(range))
    }

    /// Writes `out`, which must be prepared.
    fn write(&self, rules: [CountRule; 3], range: Range, out: &mut Recovered) {
        let (height, width, channels) = self.poisson.grid.dim();
        let stride = width * channels;
        let (x, k) = out.buffers();
        // Each worker gets whole blocks of sixteen rows, as `write_rows` goes through them.
        let each = height.div_ceil(self.threads).next_multiple_of(LANES);
        self.workers.each_chunk((x, k), each * stride, |part, x, k| {
            let rows = part * each;
            widest!(self.write_rows(rows, stride, rules, range, x, k));
        });
    }

    /// Writes a part of the image in blocks of sixteen rows, so that the outputs of a band are read in the order
    /// of memory.
    #[inline(always)]
    fn write_rows(
        &self,
        first: usize,
        stride: usize,
        rules: [CountRule; 3],
        range: Range,
        x: &mut [f32],
        k: &mut [u8],
    ) {
        let channels = self.poisson.grid.dim().2;
        // By channel of the first sample of a run.
        let lanes: [LaneCountRules; 3] =
            std::array::from_fn(|first| LaneCountRules::new(|lane| rules[(first + lane) % channels]));
        let blocks = x.chunks_mut(LANES * stride).zip(k.chunks_mut(LANES * stride));
        for (row, (x, k)) in (first..).step_by(LANES).zip(blocks) {
            for sample in (0..stride).step_by(LANES) {
                let rule = &lanes[sample % channels];
                let rows = x.chunks_exact_mut(stride).zip(k.chunks_exact_mut(stride));
                for (row, (x, k)) in (row..).zip(rows) {
                    self.write_run(
                        SampleRun { row, sample },
                        rule,
                        range,
                        &mut x[sample..],
                        &mut k[sample..],
                    );
                }
            }
        }
    }

    /// Writes a run of sixteen samples, or the rest of a row.
    #[inline(always)]
    fn write_run(&self, run: SampleRun, rule: &LaneCountRules, range: Range, x: &mut [f32], k: &mut [u8]) {
        let (scale, peak) = (range.peak() / PEAK as f32, range.peak());
        let counts = rule.wraps(self.poisson.grid.out(run));
        let codes = self.codes.at(run);
        let mut radiance = [0.0; LANES];
        for lane in 0..LANES {
            radiance[lane] = f32::from(codes[lane]) * scale + f32::from(counts[lane]) * peak;
        }
        match (x.first_chunk_mut(), k.first_chunk_mut()) {
            (Some(x), Some(k)) => (*x, *k) = (radiance, counts),
            _ => {
                x.iter_mut().zip(radiance).for_each(|(x, value)| *x = value);
                k.iter_mut().zip(counts).for_each(|(k, value)| *k = value);
            }
        }
    }
}

impl Unwrap for Spud {
    fn name(&self) -> &'static str {
        "spud"
    }

    fn unwrap(&mut self, y: &Frame, scene: &Scene, out: &mut Recovered) -> Result<(), UnwrapError> {
        self.unwrap_as(self.name(), y, scene.range, out)
    }
}

/// Computes `D^T M_b(D y)` of a plane of real numbers.
fn divergence(y: &[f32], width: usize, range: Range, rho: &mut [f32]) {
    let (mut gx, mut gy) = (Vec::new(), Vec::new());
    gradient::dx(y, width, &mut gx);
    gradient::dy(y, width, &mut gy);
    for d in gx.iter_mut().chain(&mut gy) {
        *d = gradient::wrap_centered(*d, range.bits());
    }
    gradient::adjoint(&gx, &gy, width, rho);
}

/// The method of least squares: SPUD without its threshold, made congruent with y.
///
/// D. C. Ghiglia and L. A. Romero, "Robust two-dimensional weighted and unweighted phase unwrapping that uses fast
/// transforms and iterative methods", JOSA A 11(1), 1994.
pub struct LeastSquares {
    solver: Spud,
}

impl LeastSquares {
    /// Makes the method on `threads` threads, 1 to [`MAX_THREADS`](crate::MAX_THREADS).
    ///
    /// # Errors
    /// [`UnwrapError::Workers`] when the threads are not available.
    pub fn new(threads: usize) -> Result<Self, UnwrapError> {
        Ok(Self { solver: Spud::with_threads(0.0, ThresholdOn::Phi, threads)? })
    }
}

impl Unwrap for LeastSquares {
    fn name(&self) -> &'static str {
        "least_squares"
    }

    fn unwrap(&mut self, y: &Frame, scene: &Scene, out: &mut Recovered) -> Result<(), UnwrapError> {
        self.solver.unwrap_as(self.name(), y, scene.range, out)
    }
}
