//! The lens: a small separable blur of the radiance before it is sampled.
//!
//! The sensor continues the image beyond its border by half-sample symmetry (`dcba|abcd|dcba`). A symmetric
//! kernel is then exactly a product in the domain of the DCT-II, which [`Deblur`](crate::Deblur) inverts.

use ndarray::Array3;

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
            Self::Gaussian { sigma } => gaussian(sigma),
        }
    }
}

fn gaussian(sigma: f64) -> Vec<f32> {
    // Beyond 3 sigma a weight is at most 1.1 % of the middle one; dividing by the sum keeps the brightness.
    let radius = (3.0 * sigma).ceil() as i32;
    let weights: Vec<f64> =
        (-radius..=radius).map(|t| (-0.5 * (f64::from(t) / sigma).powi(2)).exp()).collect();
    let sum: f64 = weights.iter().sum();
    weights.iter().map(|weight| (weight / sum) as f32).collect()
}

/// The rule that continues an image `abcd` beyond its border.
#[derive(Clone, Copy)]
pub(crate) enum Border {
    /// Half-sample symmetry, `dcba|abcd|dcba`: the sample at the border is repeated, as the DCT-II assumes.
    HalfSample,
    /// Whole-sample symmetry, `dcb|abcd|cba`: OpenCV's default, `BORDER_REFLECT_101`.
    WholeSample,
}

/// Blurs `image` (H x W x C) as OpenCV's `GaussianBlur` does, which the paper's scripts call.
///
/// The border is `dcb|abcd|cba`, OpenCV's default, so it differs from that of the [`Sensor`](crate::Sensor).
pub fn blurred(image: Array3<f32>, psf: Psf) -> Array3<f32> {
    let dim = image.dim();
    let mut image = image.as_standard_layout().into_owned();
    let samples = image.as_slice_mut().expect("the layout was made standard");
    // An empty image has no sample that its border could repeat.
    if !samples.is_empty() {
        blur(samples, dim, &psf.taps(), Border::WholeSample);
    }
    image
}

/// Blurs `image` (H x W x C interleaved, of the shape `dim`) in place with an odd number of `taps` along both sides.
pub(crate) fn blur(
    image: &mut [f32],
    (height, width, channels): (usize, usize, usize),
    taps: &[f32],
    border: Border,
) {
    // Taps sum to 1, so a single tap changes nothing.
    if taps.len() < 2 {
        return;
    }
    let stride = width * channels;
    let reach = taps.len() / 2;
    // One tap after the other over a whole row: the inner loop has no border case and runs in wide vectors.
    let mut padded = vec![0.0; (width + 2 * reach) * channels];
    let mut across = vec![0.0; image.len()];
    for (row, out) in image.chunks_exact(stride).zip(across.chunks_exact_mut(stride)) {
        for (column, pixel) in padded.chunks_exact_mut(channels).enumerate() {
            let source = border.reflect(column as isize - reach as isize, width) * channels;
            pixel.copy_from_slice(&row[source..source + channels]);
        }
        taps.iter().enumerate().for_each(|(t, &tap)| add(out, &padded[t * channels..], tap));
    }
    for (row, out) in image.chunks_exact_mut(stride).enumerate() {
        // `image` is free for the result, since the first pass has left everything in `across`.
        out.fill(0.0);
        for (t, &tap) in taps.iter().enumerate() {
            let source = border.reflect(row as isize + t as isize - reach as isize, height) * stride;
            add(out, &across[source..source + stride], tap);
        }
    }
}

fn add(out: &mut [f32], source: &[f32], tap: f32) {
    out.iter_mut().zip(source).for_each(|(o, s)| *o += tap * s);
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
        let dims = [(5, 8, 3), (1, 9, 1), (9, 1, 3), (2, 2, 1), (1, 1, 3)];
        let cases = dims.map(|dim| [(dim, Border::HalfSample), (dim, Border::WholeSample)]);
        for (dim @ (h, w, c), border) in cases.into_iter().flatten() {
            let image: Vec<f32> = (0..h * w * c).map(|i| ((i * 37) % 23) as f32 / 23.0).collect();
            let mut got = image.clone();
            blur(&mut got, dim, &taps, border);
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
