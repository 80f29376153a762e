//! The centred wrap M_b, and the differences of neighbours with their adjoint.
//!
//! Planes are row-major slices. Differences are forward with Neumann borders: no difference crosses an edge of
//! the image.

use crate::range::peak;

/// Returns `M_b(d) = ((d + 2^(b-1)) mod 2^b) - 2^(b-1)`, in `[-2^(b-1), 2^(b-1))`; `M_b(2^(b-1)) = -2^(b-1)`.
///
/// The result is exact for a difference `d` of two modulo images, `|d| <= 2^b`. Outside that it is `d`, moved by
/// one peak towards 0.
pub fn wrap_centered(d: f32, bits: u8) -> f32 {
    d + peak(bits) * wrap_step(d, bits) as f32
}

/// Returns the n in {-1, 0, 1} with `M_b(d) = d + n * 2^b`, for `|d| <= 2^b`.
pub(crate) fn wrap_step(d: f32, bits: u8) -> i32 {
    // Half the peak belongs to the negative end, as in two's complement.
    let half = peak(bits) / 2.0;
    i32::from(d < -half) - i32::from(d >= half)
}

/// Writes the horizontal differences, H x (W-1): `out[i, j] = x[i, j+1] - x[i, j]`.
pub(crate) fn dx(x: &[f32], width: usize, out: &mut Vec<f32>) {
    out.clear();
    for row in x.chunks_exact(width) {
        out.extend(row[1..].iter().zip(row).map(|(next, here)| next - here));
    }
}

/// Writes the vertical differences, (H-1) x W: `out[i, j] = x[i+1, j] - x[i, j]`.
pub(crate) fn dy(x: &[f32], width: usize, out: &mut Vec<f32>) {
    out.clear();
    out.extend(x[width..].iter().zip(x).map(|(below, here)| below - here));
}

/// Writes the adjoint of (`dx`, `dy`): `out = dx^T gx + dy^T gy`, H x W.
pub(crate) fn adjoint(gx: &[f32], gy: &[f32], width: usize, out: &mut [f32]) {
    out.fill(0.0);
    // A plane of one column has no horizontal difference, and `chunks_exact(0)` would panic.
    if width > 1 {
        for (row, gx) in out.chunks_exact_mut(width).zip(gx.chunks_exact(width - 1)) {
            row[..width - 1].iter_mut().zip(gx).for_each(|(o, g)| *o -= g);
            row[1..].iter_mut().zip(gx).for_each(|(o, g)| *o += g);
        }
    }
    // `gy` is one row shorter than the plane: the first zip ends before the last row, the second starts at row 1.
    out.iter_mut().zip(gy).for_each(|(o, g)| *o -= g);
    out[width..].iter_mut().zip(gy).for_each(|(o, g)| *o += g);
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn centered_wrap_is_the_definition(a in 0u32..65536, b in 0u32..65536, bits in 1u8..=16) {
            let mask = (1i64 << bits) - 1;
            let d = (i64::from(a) & mask) - (i64::from(b) & mask);
            let half = 1i64 << (bits - 1);
            let definition = ((d + half) & mask) - half;
            prop_assert_eq!(wrap_centered(d as f32, bits), definition as f32);
        }

        #[test]
        fn centered_wrap_of_any_difference_is_in_range(a in 0f32..=1.0, b in 0f32..=1.0, bits in 1u8..=16) {
            let d = wrap_centered((a - b) * peak(bits), bits);
            prop_assert!(d >= -peak(bits) / 2.0 && d < peak(bits) / 2.0);
        }

        #[test]
        fn adjoint_identity(h in 1usize..12, w in 1usize..12, seed in proptest::collection::vec(-50i32..50, 3 * 144)) {
            // Small integers: every sum below is exact in f32.
            let n = h * w;
            let values: Vec<f32> = seed.iter().map(|&v| v as f32).collect();
            let (x, gx, gy) = (&values[..n], &values[144..144 + h * (w - 1)], &values[288..288 + (h - 1) * w]);
            let (mut ax, mut ay, mut back) = (Vec::new(), Vec::new(), vec![0.0; n]);
            dx(x, w, &mut ax);
            dy(x, w, &mut ay);
            adjoint(gx, gy, w, &mut back);
            let dot = |a: &[f32], b: &[f32]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f32>();
            prop_assert_eq!((ax.len(), ay.len()), (gx.len(), gy.len()));
            prop_assert_eq!(dot(&ax, gx) + dot(&ay, gy), dot(x, &back));
        }
    }
}
