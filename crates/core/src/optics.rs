//! The lens: a small separable blur of the radiance before it is sampled.
//!
//! The sensor continues the image beyond its border by half-sample symmetry (`dcba|abcd|dcba`). A symmetric
//! kernel keeps this symmetry, so that [`Deblur`](crate::Deblur) can undo the blur up to the border.

use ndarray::Array3;

use crate::frame::in_order;
use crate::simd::widest;

/// The point spread function of a lens, in pixels of the sensor.
#[derive(Clone, Copy, Debug, PartialEq, Default)]
pub enum Psf {
    /// A perfect lens, which does not blur.
    #[default]
    None,
    /// A Gaussian of `sigma` pixels, cut at radius `ceil(3 sigma)`.
    Gaussian {
        /// The standard deviation in px, in (0, 100].
        sigma: f64,
    },
    /// The 7 taps of the paper, which OpenCV's `getGaussianKernel` returns for size 7 without a sigma: a fixed
    /// table that stands for sigma = 1.4 px.
    Paper7,
}

/// The largest sigma that [`Psf::Gaussian`] takes, px.
pub const MAX_SIGMA: f64 = 100.0;

const PAPER_TAPS: [f32; 7] = [0.03125, 0.109375, 0.21875, 0.28125, 0.21875, 0.109375, 0.03125];

impl Psf {
    /// Returns the blur of a lens of this sigma in px: 0 is a perfect lens, any other value a Gaussian, which
    /// [`Sensor::new`](crate::Sensor::new) checks.
    pub fn of_sigma(sigma: f64) -> Self {
        if sigma == 0.0 { Self::None } else { Self::Gaussian { sigma } }
    }

    /// Returns sigma in px: 0 for a perfect lens, 1.4 for [`Psf::Paper7`].
    pub fn sigma(self) -> f64 {
        match self {
            Self::None => 0.0,
            Self::Paper7 => 1.4,
            Self::Gaussian { sigma } => sigma,
        }
    }

    /// Returns the kernel along one side, odd in length, with sum 1; the single tap 1 for [`Psf::None`].
    pub fn taps(self) -> Vec<f32> {
        match self {
            Self::None => vec![1.0],
            Self::Paper7 => PAPER_TAPS.to_vec(),
            Self::Gaussian { sigma } => gaussian(sigma).collect(),
        }
    }

    /// Returns the largest second difference, along a row or a column, of an edge of height 1 behind the lens: 1 for a perfect one.
    pub fn bend(self) -> f64 {
        // The differences of the edge are the taps themselves.
        match self {
            Self::None => 1.0,
            Self::Paper7 => largest_step(PAPER_TAPS.into_iter()),
            Self::Gaussian { sigma } => largest_step(gaussian(sigma)),
        }
    }
}

fn gaussian(sigma: f64) -> impl Iterator<Item = f32> {
    // Beyond 3 sigma a weight is at most 1.1 % of the middle one; dividing by the sum keeps the brightness.
    let radius = (3.0 * sigma).ceil() as i32;
    let weights = (-radius..=radius).map(move |t| (-0.5 * (f64::from(t) / sigma).powi(2)).exp());
    let sum: f64 = weights.clone().sum();
    weights.map(move |weight| (weight / sum) as f32)
}

/// Returns the largest difference between neighbouring `taps`, and between the first one and 0.
fn largest_step(taps: impl Iterator<Item = f32>) -> f64 {
    let mut before = 0.0;
    let step = |tap: f32| f64::from((tap - std::mem::replace(&mut before, tap)).abs());
    taps.map(step).fold(0.0, f64::max)
}

/// The rule that continues an image `abcd` beyond its border.
#[derive(Clone, Copy)]
pub(crate) enum Border {
    /// Half-sample symmetry, `dcba|abcd|dcba`: the sample at the border is repeated.
    HalfSample,
    /// Whole-sample symmetry, `dcb|abcd|cba`: OpenCV's default, `BORDER_REFLECT_101`.
    WholeSample,
}

/// Blurs `image` (H x W x C) as OpenCV's `GaussianBlur` does, which the paper's scripts call.
///
/// The border is `dcb|abcd|cba`, OpenCV's default, so it differs from that of the [`Sensor`](crate::Sensor).
pub fn blurred(image: Array3<f32>, psf: Psf) -> Array3<f32> {
    let dim @ (_, width, channels) = image.dim();
    // An empty image has no sample that its border could repeat.
    if image.is_empty() {
        return image;
    }
    let (image, stride) = (image.as_standard_layout(), width * channels);
    let (samples, mut out) = (in_order(image.view()), vec![0.0; image.len()]);
    let taps = psf.taps();
    let mut filter = RowFilter::new(dim, &taps, Border::WholeSample);
    for out in out.chunks_exact_mut(stride) {
        let read = |row: usize, to: &mut [f32]| to.copy_from_slice(&samples[row * stride..][..stride]);
        filter.next_row(read, out);
    }
    Array3::from_shape_vec(dim, out).expect("every sample has its blurred one")
}

/// Filters an image (H x W x C interleaved) with an odd number of symmetric taps of sum 1 along both sides, and returns it row
/// by row. Each row of the source is read once, and only the rows that the kernel spans are kept: they stay in the cache.
pub(crate) struct RowFilter<'a> {
    dim: (usize, usize, usize),
    taps: &'a [f32],
    border: Border,
    /// A row of the source, continued beyond its border.
    padded: Vec<f32>,
    /// The last rows, filtered along the row: row i of the source lies at i modulo the number of taps.
    across: Vec<f32>,
    /// Start in `across` of the row for each tap.
    starts: Vec<usize>,
    /// Number of rows of the source that were read.
    read: usize,
    returned: usize,
}

/// Number of samples that one pass over the taps sums up: their sums stay in registers.
const BLOCK: usize = 32;

impl<'a> RowFilter<'a> {
    /// Prepares the filter for an image of the shape `dim` = (H, W, C), of at least one sample.
    pub fn new(dim @ (_, width, channels): (usize, usize, usize), taps: &'a [f32], border: Border) -> Self {
        let row = width * channels;
        let padded = vec![0.0; row + (taps.len() - 1) * channels];
        let across = vec![0.0; taps.len() * row];
        Self {
            dim,
            taps,
            border,
            padded,
            across,
            starts: Vec::with_capacity(taps.len()),
            read: 0,
            returned: 0,
        }
    }

    /// Writes the next row of the filtered image (W x C samples) into `out`. `read` writes the row of the source with the index
    /// that it gets; it gets each index once, in order.
    pub fn next_row(&mut self, mut read: impl FnMut(usize, &mut [f32]), out: &mut [f32]) {
        let (height, width, channels) = self.dim;
        let (stride, reach, row) = (width * channels, self.taps.len() / 2, self.returned);
        self.returned += 1;
        // Taps sum to 1, so a single tap changes nothing.
        if reach == 0 {
            return read(row, out);
        }
        // A reflected row is never farther away than the kernel reaches, so that it is at hand, too.
        while self.read < height.min(row + reach + 1) {
            read(self.read, &mut self.padded[reach * channels..][..stride]);
            self.continue_row();
            let across = &mut self.across[self.read % self.taps.len() * stride..][..stride];
            let (padded, taps) = (&self.padded, self.taps);
            widest!(sum_of_taps(across, taps, |t| &padded[t * channels..]));
            self.read += 1;
        }
        // The rows are looked up once, and not for each block of samples.
        self.starts.clear();
        self.starts.extend((0..self.taps.len()).map(|t| {
            let source = self.border.reflect(row as isize + t as isize - reach as isize, height);
            source % self.taps.len() * stride
        }));
        let (across, taps, starts) = (&self.across, self.taps, &self.starts);
        widest!(sum_of_taps(out, taps, |t| &across[starts[t]..][..stride]));
    }

    /// Continues the row in `padded` at both ends.
    fn continue_row(&mut self) {
        let (_, width, channels) = self.dim;
        let reach = self.taps.len() / 2;
        for column in (0..reach).chain(reach + width..2 * reach + width) {
            let source = reach + self.border.reflect(column as isize - reach as isize, width);
            self.padded.copy_within(source * channels..(source + 1) * channels, column * channels);
        }
    }
}

/// Writes the sum of `taps[t] * source(t)` into `out`, in the order of the taps.
#[inline(always)]
fn sum_of_taps<'s>(out: &mut [f32], taps: &[f32], source: impl Fn(usize) -> &'s [f32]) {
    let (blocks, rest) = out.as_chunks_mut::<BLOCK>();
    let first_of_rest = BLOCK * blocks.len();
    for (index, block) in blocks.iter_mut().enumerate() {
        let mut sums = [0.0; BLOCK];
        for (t, &tap) in taps.iter().enumerate() {
            // The compiler must know the length, or the sums would not stay in registers.
            let source =
                source(t)[BLOCK * index..].first_chunk::<BLOCK>().expect("a source is as long as `out`");
            sums.iter_mut().zip(source).for_each(|(sum, s)| *sum += tap * s);
        }
        *block = sums;
    }
    for (index, out) in rest.iter_mut().enumerate() {
        let terms = taps.iter().enumerate().map(|(t, &tap)| tap * source(t)[first_of_rest + index]);
        *out = terms.fold(0.0, |sum, term| sum + term);
    }
}

impl Border {
    /// Returns the index, in a line of `n` samples, of the sample that continues the line at index `i`.
    fn reflect(self, i: isize, n: usize) -> usize {
        // With whole-sample symmetry, a line of one sample would have the period 0, and a remainder by 0 panics.
        let (period, mirror) = match self {
            Self::HalfSample => (2 * n, 2 * n - 1),
            Self::WholeSample => ((2 * n - 2).max(1), 2 * n - 2),
        };
        // The kernel may be longer than the image, which is then reflected more than once.
        let i = i.rem_euclid(period as isize) as usize;
        if i < n { i } else { mirror - i }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn taps_sum_to_one_and_have_the_width_asked_for() {
        for psf in [Psf::None, Psf::Paper7, Psf::Gaussian { sigma: 0.2 }, Psf::Gaussian { sigma: 3.4 }] {
            let taps = psf.taps();
            assert!((taps.iter().sum::<f32>() - 1.0).abs() < 1e-6, "{psf:?}");
        }
        assert_eq!(Psf::Gaussian { sigma: 3.4 }.taps().len(), 2 * 11 + 1);
    }

    #[test]
    fn borders_reflect_with_and_without_the_edge() {
        let line = |border: Border, n| (-4..9).map(|i| border.reflect(i, n)).collect::<Vec<_>>();
        assert_eq!(line(Border::HalfSample, 4), [3, 2, 1, 0, 0, 1, 2, 3, 3, 2, 1, 0, 0]);
        assert_eq!(line(Border::WholeSample, 4), [2, 3, 2, 1, 0, 1, 2, 3, 2, 1, 0, 1, 2]);
        assert_eq!((line(Border::HalfSample, 1), line(Border::WholeSample, 1)), (vec![0; 13], vec![0; 13]));
    }

    #[test]
    fn is_the_separable_sum() {
        let taps = Psf::Gaussian { sigma: 0.9 }.taps();
        let dims = [(5, 8, 3), (1, 9, 1), (9, 1, 3), (2, 2, 1), (1, 1, 3), (12, 45, 3)];
        let cases = dims.map(|dim| [(dim, Border::HalfSample), (dim, Border::WholeSample)]);
        for (dim @ (h, w, c), border) in cases.into_iter().flatten() {
            let image: Vec<f32> = (0..h * w * c).map(|i| ((i * 37) % 23) as f32 / 23.0).collect();
            let mut got = vec![0.0; image.len()];
            let mut filter = RowFilter::new(dim, &taps, border);
            for out in got.chunks_exact_mut(w * c) {
                filter.next_row(|row, to| to.copy_from_slice(&image[row * w * c..][..w * c]), out);
            }
            let reach = taps.len() as isize / 2;
            for (index, value) in got.iter().enumerate() {
                let (i, j, k) = (index / c / w, index / c % w, index % c);
                // The definition with one double sum, in the same precision.
                let mut want = 0.0;
                for (a, ta) in (-reach..).zip(&taps) {
                    for (b, tb) in (-reach..).zip(&taps) {
                        let (i, j) = (border.reflect(i as isize + a, h), border.reflect(j as isize + b, w));
                        want += ta * tb * image[(i * w + j) * c + k];
                    }
                }
                assert!((want - value).abs() < 1e-6, "{dim:?} at {index}: {want} {value}");
            }
        }
    }
}
