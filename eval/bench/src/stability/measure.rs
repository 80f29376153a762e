//! [`score`]: measures one method on one scene.

use modulo_core::metric::exact_share;
use modulo_core::unwrap::{Options, Report, by_name};
use modulo_core::{Exposure, Frame, Recovered};
use ndarray::{Array3, Axis};

use crate::BenchError;

/// Accuracy of a result.
#[derive(Clone, Copy, Debug)]
pub struct Score {
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
pub fn score(method: &str, y: &Frame, truth: &Exposure) -> Result<(Score, Array3<f32>), BenchError> {
    let mut out = Recovered::default();
    by_name(method, &Options::default())?.unwrap(y, truth.range(), &mut out)?;
    let wraps = truth.wraps();
    let off = out.k.mapv(i16::from) - wraps.mapv(i16::from);
    let score = Score {
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
        let mut counts = [0usize; 511];
        off.index_axis(Axis(2), channel).iter().for_each(|off| counts[usize::from(off.abs_diff(-255))] += 1);
        counts.into_iter().max().expect("there are counts")
    };
    (0..off.dim().2).map(most_frequent).sum::<usize>() as f64 / off.len() as f64
}

fn psnr(x: &Array3<f32>, truth: &Exposure) -> Option<f64> {
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
