//! Times the calls of one method on all frames. This is the only file of the crate that reads a clock: durations are
//! reported, and decide nothing.

use std::time::Instant;

use modulo_core::metric::{exact_share, mse, psnr_db, quantile};
use modulo_core::{Recovered, Unwrap, UnwrapError, tone};

use super::frames::SensedFrame;
use crate::{BenchError, samples8};

/// The result of `work` and its duration in ms.
pub(crate) fn timed<T>(work: impl FnOnce() -> T) -> (T, f64) {
    let start = Instant::now();
    let result = work();
    (result, start.elapsed().as_secs_f64() * 1e3)
}

/// Durations and errors of one method.
pub struct Measured {
    /// Duration of every timed call in ms, ascending.
    times: Vec<f64>,
    /// Median over frames of the interquartile range of the calls divided by their median.
    pub spread: f64,
    /// Number of samples of all frames.
    pub samples: u64,
    exact: f64,
    squares: f64,
}

/// Calls the method on each frame once to warm up buffers and caches, then `repeats` times with timing.
pub fn measure(
    method: &mut dyn Unwrap,
    samples: &[SensedFrame],
    repeats: usize,
) -> Result<Measured, BenchError> {
    let mut out = Recovered::default();
    let mut all = Measured { times: Vec::new(), spread: 0.0, samples: 0, exact: 0.0, squares: 0.0 };
    let mut spreads = Vec::new();
    for sample in samples {
        // The first call on a frame can allocate buffers, and fills caches. It is not timed, but scored: all calls give
        // the same result.
        method.unwrap(&sample.modulo, sample.range, &mut out)?;
        all.score(sample, &out)?;
        let mut times = Vec::with_capacity(repeats);
        for _ in 0..repeats {
            let (unwrapped, ms) = timed(|| method.unwrap(&sample.modulo, sample.range, &mut out));
            unwrapped?;
            times.push(ms);
        }
        times.sort_by(f64::total_cmp);
        // The interquartile range of the calls on one frame shows disturbances of the machine. The spread over all
        // frames would also contain the differences between frames.
        spreads.push((at(&times, 0.75) - at(&times, 0.25)) / at(&times, 0.5).max(1e-9));
        all.times.append(&mut times);
    }
    all.times.sort_by(f64::total_cmp);
    spreads.sort_by(f64::total_cmp);
    all.spread = at(&spreads, 0.5);
    Ok(all)
}

impl Measured {
    fn score(&mut self, sample: &SensedFrame, out: &Recovered) -> Result<(), BenchError> {
        let picture = tone::linear8(&out.x, sample.range).map_err(UnwrapError::from)?;
        let count = sample.wraps.len() as f64;
        self.samples += sample.wraps.len() as u64;
        self.exact += count * exact_share(&out.k, &sample.wraps)?;
        self.squares += count * mse(&samples8(picture), &sample.ideal)?;
        Ok(())
    }

    /// Quantile `q` (0 to 1) of all calls by the nearest rank, ms.
    pub fn ms(&self, q: f64) -> f64 {
        at(&self.times, q)
    }

    /// Share of exact wrap counts over all frames, 0 to 1.
    pub fn exact_k(&self) -> f64 {
        // The sum consists of counts that were divided and multiplied again: rounding restores them.
        self.exact.round() / self.samples.max(1) as f64
    }

    /// PSNR of the mean squared error over all frames, dB. `None` without any error.
    pub fn psnr_db(&self) -> Option<f64> {
        psnr_db(self.squares / self.samples.max(1) as f64)
    }
}

fn at(sorted: &[f64], q: f64) -> f64 {
    quantile(sorted, q).expect("there is a frame, and each is timed at least once")
}
