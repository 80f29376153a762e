//! Turns an estimate into integers: wrap counts that agree with y, at the absolute offset that gradients do not
//! contain.

use super::{Range, Recovered};

/// The share of the pixels that may be out of range at a greater base level: hot pixels and small wrong regions
/// must not raise the whole image.
const TOLERANCE: f64 = 0.02;

/// Finds the absolute offset of `k`, clamps to the range, and writes one channel of `out`, which must be
/// prepared. `levels` is a buffer.
pub(super) fn write_channel(
    k: &[i32],
    y: &[f32],
    range: Range,
    channel: usize,
    levels: &mut Vec<usize>,
    out: &mut Recovered,
) {
    let most = i32::from(range.max_wraps());
    let zero = base_level(k, most, levels);
    let k = k.iter().map(|k| (k.saturating_sub(zero)).clamp(0, most) as u8);
    let peak = range.peak();
    let channels = out.x.dim().2;
    let (x, counts) = out.buffers();
    let pixels = x.chunks_exact_mut(channels).zip(counts.chunks_exact_mut(channels));
    for (((x, count), k), y) in pixels.zip(k).zip(y) {
        x[channel] = y + f32::from(k) * peak;
        count[channel] = k;
    }
}

/// Returns the count that stands for k = 0. Of all levels that leave nearly as many pixels in `0..=most` as the
/// best one does, it is the highest, which makes the image darkest.
fn base_level(k: &[i32], most: i32, levels: &mut Vec<usize>) -> i32 {
    let low = *k.iter().min().expect("an image has pixels");
    let high = *k.iter().max().expect("an image has pixels");
    levels.clear();
    // Steps of at most one from pixel to pixel: no image of this size needs more, so that none is made twice.
    levels.reserve(k.len());
    levels.resize(high.abs_diff(low) as usize + 1, 0);
    k.iter().for_each(|&k| levels[k.abs_diff(low) as usize] += 1);
    // An estimate may contain any integers, so no sum may overflow.
    low.saturating_add(base_level_index(levels, most) as i32)
}

/// Returns the index of the [`base_level`] for `counts` pixels at each level. A level below the first holds no
/// more pixels than the first itself.
pub(super) fn base_level_index(counts: &[usize], most: i32) -> usize {
    let pixels = counts.iter().sum();
    let in_range = |zero: usize| counts[zero..].iter().take(most as usize + 1).sum::<usize>();
    let best = (0..counts.len()).map(in_range).max().expect("an image has at least one level");
    let enough = (0..counts.len()).rfind(|&zero| is_enough(in_range(zero), best, pixels));
    enough.expect("the best level is enough")
}

/// Returns whether `share` is nearly `best`, within the tolerance for so many `pixels`.
pub(super) fn is_enough(share: usize, best: usize, pixels: usize) -> bool {
    share as f64 >= best as f64 - TOLERANCE * pixels as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn darkest_offset_that_keeps_the_image_in_range() {
        assert_eq!(base_level(&[5, 5, 6, 7], 3, &mut Vec::new()), 5);
        assert_eq!(base_level(&[-1, -1, 0, 0], 1, &mut Vec::new()), -1);
    }

    #[test]
    fn hot_pixels_do_not_lift_the_image() {
        let mut k = vec![3; 1000];
        k[500..].fill(4);
        k[..19].fill(-7);
        assert_eq!(base_level(&k, 1, &mut Vec::new()), 3);
        k[..30].fill(2);
        assert_eq!(base_level(&k, 2, &mut Vec::new()), 2, "more than 2 % are no outliers");
    }
}
