//! The costs of the counts of green beside red and blue, for [`path_sums`](super::path_sums).
//!
//! The colours of a scene are mostly near to grey, and farther from it where it is brighter. Candidate m costs
//! ```text
//!     u_m = 2 ln b + min(e, 9.21),   e = (|R - g_m| + |B - g_m| + |R - B| / 2) / b,   b = 10 + 0.2 (R + g_m + B) / 3
//! ```
//! in 256ths of the peak, with `g_m = y + m 2^b`: the negative logarithm of a Laplace law of both colour differences, whose width b grows
//! with the brightness, and which is cut off at 1e-4. A candidate beyond the range costs 40.
//!
//! Behind a soft lens, neighbours tell more than the colours of a pixel: the costs have a smaller weight there, `w u_m`. How soft the lens
//! is, red and blue tell: with the share s of the second differences of R - B along rows that are above half a peak,
//! `w = min(max((s / 0.04)^2, 0.1), 1)`.

use super::Range;
use super::path_sums::{COST, FULL_SCALE, LARGEST_COLOUR, LARGEST_COST};
use crate::green_rows::GreenRow;
use crate::simd::widest;

/// The width of the law at black, and its share of the brightness.
const WIDTH: f32 = 10.0;
const SHARE: f32 = 0.2;

/// The largest e: -ln(1e-4).
const CUT: f32 = 9.21;

/// The share of sharp colour edges from which on the costs have their full weight.
const SHARP: f64 = 0.04;

/// The weight of the costs in an image without sharp colour edges.
const LEAST_WEIGHT: f64 = 0.1;

/// The costs for one image.
#[derive(Clone, Copy)]
pub(super) struct ColourCosts {
    range: Range,
    weight: f32,
}

impl ColourCosts {
    /// Makes the costs. `sharp` is the share of the second differences of R - B that are above half a peak.
    pub fn new(range: Range, sharp: f64) -> Self {
        Self { range, weight: (sharp / SHARP).powi(2).clamp(LEAST_WEIGHT, 1.0) as f32 }
    }

    /// Returns the distance of two candidates in the units of the colours.
    pub fn peak(self) -> i16 {
        (f64::from(FULL_SCALE) / self.range.alpha()).round() as i16
    }

    /// Writes red, green and blue of a row (three planes, full scale is [`FULL_SCALE`]) and the costs of its candidates, a plane each.
    /// Planes are longer than the row.
    pub fn write(self, row: &GreenRow, colours: &mut [i16], costs: &mut [i16]) {
        let Self { range, weight } = self;
        let pitch = colours.len() / 3;
        let scale = f32::from(FULL_SCALE) / range.limit() as f32;
        for (line, colour) in
            [&row.red, &row.green, &row.blue].into_iter().zip(colours.chunks_exact_mut(pitch))
        {
            widest!(colour.iter_mut().zip(line).for_each(|(colour, value)| {
                *colour = rounded((value * scale).min(f32::from(LARGEST_COLOUR)));
            }));
        }
        // In 256ths of the peak, so that the costs do not depend on the bits.
        let unit = 256.0 / range.peak();
        let limit = 256.0 * range.alpha() as f32;
        for (candidate, costs) in (0u8..).zip(costs.chunks_exact_mut(pitch)) {
            let wraps = 256.0 * f32::from(candidate);
            let samples = row.red.iter().zip(&row.green).zip(&row.blue);
            widest!(costs.iter_mut().zip(samples).for_each(|(cost, ((red, green), blue))| {
                let (red, green, blue) = (red * unit, green * unit + wraps, blue * unit);
                let width = WIDTH + SHARE / 3.0 * (red + green + blue);
                let apart = (red - green).abs() + (blue - green).abs() + 0.5 * (red - blue).abs();
                let sum = 2.0 * ln(width) + (apart / width).min(CUT);
                *cost = if green >= limit { LARGEST_COST } else { rounded(sum * weight * f32::from(COST)) };
            }));
        }
    }
}

/// Returns the nearest whole number; `value` lies within 16 bits.
#[inline(always)]
fn rounded(value: f32) -> i16 {
    // The conversion by `as`, which saturates, has no vector instruction.
    const WHOLE: f32 = (3 << 22) as f32;
    (value + WHOLE).to_bits() as i16
}

/// Returns the natural logarithm of a positive number, to 0.001.
#[inline(always)]
fn ln(x: f32) -> f32 {
    let bits = x.to_bits();
    let exponent = (bits >> 23).cast_signed() - 127;
    let mantissa = f32::from_bits(bits & 0x007f_ffff | 0x3f80_0000);
    // log2 of 1 to 2, the cubic polynomial that interpolates it at Chebyshev's points.
    let fraction = -2.153_620_7 + mantissa * (3.047_884 + mantissa * (-1.051_875 + mantissa * 0.158_248_7));
    (exponent as f32 + fraction) * std::f32::consts::LN_2
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_logarithm_is_near_to_the_true_one() {
        for step in 0..4000 {
            let x = 10.0 * 1.001f32.powi(step);
            assert!((ln(x) - x.ln()).abs() < 1e-3, "{x}: {} {}", ln(x), x.ln());
        }
    }
}
