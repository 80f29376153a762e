//! Growth: the largest part of a result that does not contradict itself grows over the rest, the best predicted pixel first (Xu and
//! Cumming, "A region-growing algorithm for InSAR phase unwrapping", IEEE TGRS 37(1), 1999).
//!
//! The part is the largest region of [`Recovered::confidence`](super::Recovered::confidence): connected pixels at which no second
//! difference is above 3/8 of the peak P. From each of the four sides u from which a pixel p has a known neighbour, known pixels predict it by
//! ```text
//!     x(p+u) + a (x(p+u) - x(p+2u)) + b (x(p+2u) - x(p+3u)) + c mean_v (x(p+v) - x(p+u+v)),   v across u
//! ```
//! Least squares over the part give a, b and c for each of the nine sets of neighbours that may be known. So the predictor follows the lens and
//! the noise of the frame. Its weight w is the variance of `x(p) - x(p+u)` over that of its error; the sides are averaged by their weights.
//! With `r = M(y - prediction) / P` by channel, the next pixel is the one with the least doubt
//! ```text
//!     sum_c |r_c| + 2 (max_c r_c - min_c r_c) + disagreement of the sides + 3 / sqrt(sum of w)
//! ```
//! and its count is the one nearest to its prediction. The last term prefers the pixels that many known ones predict.

use ndarray::Array3;

use super::Range;
use super::congruence::base_level;
use super::jumps::Regions;
use crate::simd::widest;

/// The least weight of the best predictor with which a frame can be predicted. Strong noise and the contours of a perfect lens have less.
const LEAST_WEIGHT: f32 = 2.0;

/// The least share of the pixels that the part needs: in a more divided image, it may be a wrong one.
const LEAST_SHARE: f64 = 0.2;

/// The number of pixels beyond the border that are never known.
const MARGIN: usize = 3;

/// The levels of doubt in the queue, and those of a doubt of 1.
const LEVELS: usize = 2048;
const LEVELS_PER_DOUBT: f32 = 128.0;

/// One pixel of so many is used for the fit.
const SAMPLED: usize = 3;

/// The method with its buffers.
#[derive(Default)]
pub(super) struct Growth {
    regions: Regions,
    /// The image and what is known of it, with a margin of [`MARGIN`] pixels, so that a neighbour has a place at the border, too.
    pixels: Vec<Pixel>,
    states: Vec<State>,
    queue: Queue,
    /// The counts of a channel of the part, and how many samples have each, as buffers.
    counts: Vec<i32>,
    levels: Vec<usize>,
    /// By the known pixels along a side after the nearest, 0 to 2, and by those across it, 0 to 2.
    predictors: [[Predictor; 3]; 3],
}

/// The pixels that may be next by their doubt; the last one of the least level comes first.
#[derive(Default)]
struct Queue {
    /// The pixels of each level, and some that have left it.
    levels: Vec<Vec<u32>>,
    /// The level of each pixel; [`LEVELS`] outside of the queue.
    of_pixels: Vec<u16>,
    /// No level below has a pixel.
    lowest: usize,
}

impl Queue {
    /// Empties the queue, for so many pixels.
    fn start(&mut self, pixels: usize) {
        self.levels.resize_with(LEVELS, Vec::new);
        self.levels.iter_mut().for_each(Vec::clear);
        self.of_pixels.clear();
        self.of_pixels.resize(pixels, LEVELS as u16);
        self.lowest = LEVELS;
    }

    /// Puts a pixel to the level of its doubt.
    #[inline(always)]
    fn push(&mut self, at: usize, doubt: f32) {
        let level = ((doubt * LEVELS_PER_DOUBT) as usize).min(LEVELS - 1);
        if usize::from(self.of_pixels[at]) != level {
            self.of_pixels[at] = level as u16;
            self.levels[level].push(at as u32);
            self.lowest = self.lowest.min(level);
        }
    }

    /// Takes a pixel of the least level out.
    fn pop(&mut self) -> Option<usize> {
        while let Some(level) = self.levels.get_mut(self.lowest) {
            match level.pop().map(|at| at as usize) {
                Some(at) if usize::from(self.of_pixels[at]) == self.lowest => {
                    self.of_pixels[at] = LEVELS as u16;
                    return Some(at);
                }
                Some(_) => {}
                None => self.lowest += 1,
            }
        }
        None
    }
}

/// The coefficients a, b and c, and the weight.
#[derive(Clone, Copy, Default)]
struct Predictor {
    of: [f32; 3],
    weight: f32,
}

/// A pixel in a vector: three colours, of which the last is there twice, or one, which is there four times.
type Pixel = [f32; 4];

/// What is known of a pixel.
#[derive(Clone, Copy, PartialEq)]
enum State {
    Beyond,
    Unknown,
    Known,
}

/// The places of the pixels in an image with a margin.
#[derive(Clone, Copy, Default)]
struct Layout {
    width: usize,
}

impl Layout {
    /// Returns the way from a pixel to the one below it.
    fn stride(self) -> usize {
        self.width + MARGIN
    }

    /// Returns the place of a pixel of the image. A margin on the right of a row is also the one on the left of the next.
    fn place(self, at: usize) -> usize {
        (at / self.width + MARGIN) * self.stride() + at % self.width
    }

    /// Returns for each side the ways to its next pixel and to the one across it.
    #[inline(always)]
    fn sides(self) -> [[isize; 2]; 4] {
        let down = self.stride().cast_signed();
        [[1, down], [-1, down], [down, 1], [-down, 1]]
    }
}

impl Growth {
    /// Finds the part of the result `x` (code units) from which it can grow, and fits the predictors to it. Returns the share of the pixels in
    /// the part; `None` if it cannot grow.
    pub fn read(&mut self, x: &Array3<f32>, range: Range) -> Option<f64> {
        let (height, width, channels) = x.dim();
        let layout = Layout { width };
        let samples = x.as_slice().expect("prepare has made the layout standard");
        let len = (height + 2 * MARGIN) * layout.stride();
        self.states.clear();
        self.states.resize(len, State::Beyond);
        self.pixels.clear();
        self.pixels.resize(len, Pixel::default());
        for (row, samples) in samples.chunks_exact(width * channels).enumerate() {
            let places = layout.place(row * width)..layout.place(row * width) + width;
            self.states[places.clone()].fill(State::Unknown);
            for (pixel, samples) in self.pixels[places].iter_mut().zip(samples.chunks_exact(channels)) {
                *pixel = std::array::from_fn(|lane| samples[lane.min(channels - 1)]);
            }
        }
        let mut size = 0;
        self.regions.find(x, 1, range);
        for run in self.regions.largest() {
            size += run.len();
            self.states[layout.place(run.start)..][..run.len()].fill(State::Known);
        }
        self.fit(height * width, channels, layout);
        let (weight, share) = (self.predictors[2][2].weight, size as f64 / (height * width) as f64);
        (weight >= LEAST_WEIGHT && share >= LEAST_SHARE).then_some(share)
    }

    /// Grows the part of `x` that was read over the rest. The part first gets an absolute offset of its own, since that of `x` is one of regions
    /// that may be wrong; a share of `outliers` of the part may be below its least count.
    pub fn grow(&mut self, x: &mut Array3<f32>, range: Range, outliers: f64) {
        let (_, width, channels) = x.dim();
        let layout = Layout { width };
        for channel in 0..channels {
            self.lower((channel, channels), layout, range, outliers);
        }
        match channels {
            1 => widest!(self.spread::<1>(layout, range)),
            _ => widest!(self.spread::<3>(layout, range)),
        }
        let samples = x.as_slice_mut().expect("prepare has made the layout standard");
        for (row, samples) in samples.chunks_exact_mut(width * channels).enumerate() {
            let pixels = &self.pixels[layout.place(row * width)..][..width];
            for (samples, pixel) in samples.chunks_exact_mut(channels).zip(pixels) {
                samples.copy_from_slice(&pixel[..channels]);
            }
        }
    }

    /// Lowers a channel of the part by whole peaks until its least count is 0. A share of `outliers` may lie below, and gets 0, too.
    fn lower(&mut self, (channel, channels): (usize, usize), layout: Layout, range: Range, outliers: f64) {
        let Self { regions, counts, levels, pixels, .. } = self;
        let places = || regions.largest().flat_map(|run| (layout.place(run.start)..).take(run.len()));
        counts.clear();
        counts.extend(places().map(|at| (pixels[at][channel] / range.peak()) as i32));
        if counts.is_empty() {
            return;
        }
        let least = base_level(counts, range, outliers, levels);
        let lanes = if channel + 1 == channels { channel..4 } else { channel..channel + 1 };
        for (at, &count) in places().zip(&*counts) {
            pixels[at][lanes.clone()].iter_mut().for_each(|x| *x -= count.min(least) as f32 * range.peak());
        }
    }

    #[inline(always)]
    fn spread<const C: usize>(&mut self, layout: Layout, range: Range) {
        self.queue.start(self.pixels.len());
        for at in 0..self.pixels.len() {
            self.offer::<C>(at, layout, range);
        }
        while let Some(at) = self.queue.pop() {
            let Some((predicted, _)) = self.predict::<C>(at, layout, range) else { continue };
            for (x, predicted) in self.pixels[at].iter_mut().zip(predicted) {
                let code = *x - (*x / range.peak()).floor() * range.peak();
                *x = range.nearest(code, predicted).0;
            }
            self.states[at] = State::Known;
            for [step, _] in layout.sides() {
                self.offer::<C>(at.wrapping_add_signed(step), layout, range);
            }
        }
    }

    /// Puts a pixel into the queue, or moves it there, if it is not known but can be predicted.
    #[inline(always)]
    fn offer<const C: usize>(&mut self, at: usize, layout: Layout, range: Range) {
        if self.states[at] == State::Unknown
            && let Some((_, doubt)) = self.predict::<C>(at, layout, range)
        {
            self.queue.push(at, doubt);
        }
    }

    /// Returns the prediction of a pixel and its doubt; `None` if no neighbour is known.
    #[inline(always)]
    fn predict<const C: usize>(&self, at: usize, layout: Layout, range: Range) -> Option<(Pixel, f32)> {
        let (mut sum, mut total, mut count) = (Pixel::default(), 0.0, 0);
        let mut sides = [(Pixel::default(), 0.0); 4];
        for ways in layout.sides() {
            if let Some((value, weight)) = self.predict_from(at, ways) {
                sum = std::array::from_fn(|lane| sum[lane] + weight * value[lane]);
                total += weight;
                sides[count] = (value, weight);
                count += 1;
            }
        }
        if count == 0 {
            return None;
        }
        let per_peak = range.peak().recip();
        let mean = sum.map(|sum| sum / total);
        let errors: Pixel = std::array::from_fn(|lane| {
            let error = (self.pixels[at][lane] - mean[lane]) * per_peak;
            error - error.round_ties_even()
        });
        let spread = errors.iter().fold(f32::MIN, |most, &error| error.max(most))
            - errors.iter().fold(f32::MAX, |least, &error| error.min(least));
        let differ =
            |(value, weight): &(Pixel, f32)| weight * (0..C).map(|c| (value[c] - mean[c]).abs()).sum::<f32>();
        let differ: f32 = sides[..count].iter().map(differ).sum();
        let size: f32 = errors[..C].iter().map(|error| error.abs()).sum();
        Some((mean, size + 2.0 * spread + differ * per_peak / total + 3.0 / total.sqrt()))
    }

    /// Returns the prediction from the side that `along` leads to, and its weight; `None` if the neighbour there is not known.
    #[inline(always)]
    fn predict_from(&self, here: usize, [along, across]: [isize; 2]) -> Option<(Pixel, f32)> {
        let is_known = |at: usize| self.states[at] == State::Known;
        let near = here.wrapping_add_signed(along);
        if !is_known(near) {
            return None;
        }
        let (far, last) = (near.wrapping_add_signed(along), near.wrapping_add_signed(2 * along));
        let known_along = if is_known(far) { 1 + usize::from(is_known(last)) } else { 0 };
        let (mut slope, mut known_across) = (Pixel::default(), 0);
        for across in [across, -across] {
            let (side, beside) = (here.wrapping_add_signed(across), near.wrapping_add_signed(across));
            if is_known(side) && is_known(beside) {
                known_across += 1;
                let (side, beside) = (self.pixels[side], self.pixels[beside]);
                slope = std::array::from_fn(|lane| slope[lane] + (side[lane] - beside[lane]));
            }
        }
        let Predictor { of: [a, b, of_slope], weight } = self.predictors[known_along][known_across];
        let of_slope = of_slope / known_across.max(1) as f32;
        let near = self.pixels[near];
        let mut value: Pixel = std::array::from_fn(|lane| near[lane] + of_slope * slope[lane]);
        if known_along > 0 {
            let far = self.pixels[far];
            value = std::array::from_fn(|lane| value[lane] + a * (near[lane] - far[lane]));
            if known_along > 1 {
                let last = self.pixels[last];
                value = std::array::from_fn(|lane| value[lane] + b * (far[lane] - last[lane]));
            }
        }
        Some((value, weight))
    }

    /// Fits the predictors to the known ones of so many pixels.
    fn fit(&mut self, pixels: usize, channels: usize, layout: Layout) {
        let mut sums = [[0.0f64; 4]; 4];
        for here in (0..pixels).step_by(SAMPLED).map(|at| layout.place(at)) {
            for [along, across] in layout.sides() {
                let near = here.wrapping_add_signed(along);
                let [far, last] = [along, 2 * along].map(|way| near.wrapping_add_signed(way));
                let [side, beside] = [here, near].map(|at| at.wrapping_add_signed(across));
                let places = [here, near, far, last, side, beside];
                if !places.iter().all(|&at| self.states[at] == State::Known) {
                    continue;
                }
                let pixels = places.map(|at| self.pixels[at]);
                for channel in 0..channels {
                    let [here, near, far, last, side, beside] = pixels.map(|pixel| pixel[channel]);
                    let terms = [near - far, far - last, side - beside, here - near].map(f64::from);
                    for (sums, term) in sums.iter_mut().zip(terms) {
                        sums.iter_mut().zip(terms).for_each(|(sum, other)| *sum += term * other);
                    }
                }
            }
        }
        for (along, across) in (0..3).flat_map(|along| (0..3).map(move |across| (along, across))) {
            self.predictors[along][across] = Predictor::fitted(&sums, [along > 0, along > 1, across > 0]);
        }
    }
}

impl Predictor {
    /// Returns the predictor by the `used` terms, from the sums of the products of all three terms and of the value to predict.
    fn fitted(sums: &[[f64; 4]; 4], used: [bool; 3]) -> Self {
        let mut equations = *sums;
        let (mut of, mut rest) = ([0.0; 3], sums[3][3]);
        let used = || (0..3).filter(|&term| used[term]);
        for pivot in used() {
            let row = equations[pivot];
            for other in used().filter(|&other| other != pivot) {
                let factor = equations[other][pivot] / row[pivot];
                equations[other].iter_mut().zip(row).for_each(|(value, of)| *value -= factor * of);
            }
        }
        for term in used() {
            let value = equations[term][3] / equations[term][term];
            // Of a flat image, nothing can be learned.
            if value.is_finite() {
                of[term] = value as f32;
                rest -= value * sums[term][3];
            }
        }
        Self { of, weight: if rest > 0.0 { (sums[3][3] / rest) as f32 } else { 1.0 } }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn range() -> Range {
        Range::new(8, 4.0).unwrap()
    }

    /// Whole codes of a smooth scene within the range.
    fn scene(dim: (usize, usize, usize)) -> Array3<f32> {
        Array3::from_shape_fn(dim, |(i, j, c)| {
            let slopes = (i as f32 / 9.0 + c as f32).sin() + (j as f32 / 12.0 - c as f32).cos();
            (512.0 + 200.0 * slopes).floor()
        })
    }

    /// The scene with counts that are wrong by one in two blocks: inside the image and at its corner.
    fn divided(scene: &Array3<f32>) -> Array3<f32> {
        let mut x = scene.clone();
        for (rows, columns, peaks) in [(20..34, 30..55, 1.0), (45..60, 0..20, -1.0)] {
            x.slice_mut(ndarray::s![rows, columns, ..]).mapv_inplace(|x| x + 256.0 * peaks);
        }
        x
    }

    /// The tree may have raised the whole image, since a wrong region lies below it.
    #[test]
    fn the_part_has_an_absolute_offset_of_its_own() {
        let scene = scene((60, 80, 3)).mapv(|x| x - 100.0);
        let mut x = divided(&scene).mapv(|x| x + 256.0);
        x.slice_mut(ndarray::s![0..4, 0..4, ..]).mapv_inplace(|x| x % 256.0);
        let mut growth = Growth::default();
        assert!(growth.read(&x, range()).is_some());
        growth.grow(&mut x, range(), 0.0);
        assert_eq!(x, scene);
    }

    #[test]
    fn the_largest_part_grows_over_the_rest_exactly() {
        for channels in [1, 3] {
            let scene = scene((60, 80, channels));
            let mut growth = Growth::default();
            for mut x in [divided(&scene), scene.clone()] {
                assert!(growth.read(&x, range()).is_some(), "{channels} channels");
                growth.grow(&mut x, range(), 0.0);
                assert_eq!(x, scene, "{channels} channels");
            }
        }
    }

    #[test]
    fn an_image_without_a_large_part_or_a_slope_has_nothing_to_grow_from() {
        let mut growth = Growth::default();
        for channels in [1, 3] {
            let dim = (60, 80, channels);
            let squares = Array3::from_shape_fn(dim, |(i, j, _)| 512.0 * ((i / 3 + j / 3) % 2) as f32);
            assert!(growth.read(&squares, range()).is_none(), "no part has a fifth of the pixels");
            assert!(
                growth.read(&Array3::from_elem(dim, 300.0), range()).is_none(),
                "a flat image tells nothing"
            );
            assert!(growth.read(&scene((1, 1, channels)), range()).is_none(), "a pixel has no neighbour");
        }
    }

    #[test]
    fn a_predictor_continues_a_slope() {
        let x = scene((60, 80, 1));
        let mut growth = Growth::default();
        assert!(growth.read(&x, range()).is_some());
        let [first, .., last] = growth.predictors;
        assert_eq!((first[0].of, first[0].weight), ([0.0; 3], 1.0), "the nearest pixel alone is the measure");
        assert!(last[2].weight > last[0].weight.max(first[2].weight), "more neighbours predict better");
    }
}
