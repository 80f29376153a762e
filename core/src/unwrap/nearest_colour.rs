//! The nearest colour: green is taken as near as possible to the mean of red and blue, which do not wrap.
//! ```text
//!     k = clamp(round(((R + B) / 2 - y) / 2^b), 0, A - 1),   A the number of counts in range
//! ```
//! This is exact where green differs from the mean of red and blue by less than half a peak, and so everywhere in a grey scene.

use super::Range;
use crate::green_rows::GreenRow;
use crate::simd::widest;

/// A residue above this share of the peak makes a count doubtful: it is half of what a right count can have.
const DOUBTFUL: f32 = 0.25;

/// Writes the counts of a row of green, and returns how many of them are doubtful.
pub(super) fn count(row: &GreenRow, range: Range, counts: &mut [u8]) -> u32 {
    /// The floats from here on are whole numbers.
    const WHOLE: f32 = (1 << 23) as f32;
    let (peak, most, limit) = (range.peak(), f32::from(range.max_wraps()), range.limit() as f32);
    let per_peak = peak.recip();
    let samples = row.red.iter().zip(&row.green).zip(&row.blue).zip(counts);
    widest!({
        let mut doubtful = 0;
        for (((red, green), blue), count) in samples {
            // The last period of the range need not be a whole one.
            let most = if green + most * peak < limit { most } else { (most - 1.0).max(0.0) };
            let ahead = ((red + blue) * 0.5 - green) * per_peak;
            // The sum is rounded to the nearest whole number, which its low bits hold.
            let nearest = ahead.max(0.0).min(most) + WHOLE;
            *count = nearest.to_bits() as u8;
            doubtful += u32::from((ahead - (nearest - WHOLE)).abs() > DOUBTFUL);
        }
        doubtful
    })
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn takes_the_possible_count_that_is_nearest_to_the_mean(
            (bits, alpha) in (2u8..=16, 0.3f64..256.0),
            pixels in proptest::collection::vec((0f32..1.1, 0f32..1.0, 0f32..1.1), 1..40),
        ) {
            let range = Range::new(bits, alpha).unwrap();
            let (peak, limit) = (range.peak(), range.limit() as f32);
            let mut row = GreenRow::default();
            for (red, green, blue) in &pixels {
                row.red.push(red * limit);
                row.green.push((green * peak.min(limit)).floor());
                row.blue.push(blue * limit);
            }
            let mut counts = vec![0; pixels.len()];
            count(&row, range, &mut counts);
            for (at, k) in counts.into_iter().enumerate() {
                let x = |k: u8| row.green[at] + f32::from(k) * peak;
                prop_assert!(k <= range.max_wraps() && (k == 0 || x(k) < limit));
                let off = |k: u8| (x(k) - (row.red[at] + row.blue[at]) / 2.0).abs();
                let best = (0..=range.max_wraps()).filter(|&k| k == 0 || x(k) < limit).map(off).fold(f32::MAX, f32::min);
                prop_assert!(off(k) <= best + 1e-3 * peak, "{}: {} {}", k, off(k), best);
            }
        }
    }

    #[test]
    fn more_than_a_quarter_of_the_peak_is_doubtful() {
        let range = Range::new(8, 4.0).unwrap();
        for (green, doubtful) in [(44.0, 0), (107.0, 0), (109.0, 1), (172.0, 1), (236.0, 0)] {
            let mut row = GreenRow::default();
            (row.red, row.green, row.blue) = (vec![280.0], vec![green], vec![320.0]);
            assert_eq!(count(&row, range, &mut [0]), doubtful, "{green}");
        }
    }
}
