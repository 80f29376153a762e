//! The radiance of a result from its counts.

use crate::simd::widest;
use crate::unwrap::{Integers, Range, Recovered, Trust};

/// Completes `out` from its counts, of which `outside` were out of range.
pub(super) fn finish(outside: usize, y: Integers<'_>, range: Range, out: &mut Recovered) {
    if outside > 0 {
        out.report.trust = Trust::Untrusted;
    }
    match y {
        Integers::U8(y) => write_radiance(y, range, out),
        Integers::U16(y) => write_radiance(y, range, out),
    }
}

fn write_radiance<T: Copy + Into<f32>>(y: &[T], range: Range, out: &mut Recovered) {
    let (x, k) = out.buffers();
    let peak = range.peak();
    widest!({
        for ((x, y), k) in x.iter_mut().zip(y).zip(&*k) {
            *x = (*y).into() + f32::from(*k) * peak;
        }
    });
}
