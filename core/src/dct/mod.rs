//! The orthonormal two-dimensional cosine transform of any size.
//!
//! From short to long: `fft` composes Fourier transforms from those of its radices, `bluestein` adds the lengths
//! without such factors, `cosine` makes a cosine transform of them, `rows` transforms the rows of an image, and `grid`
//! its columns and the whole. All work on the vectors of `lanes`. A plan owns its scratch, so a transform allocates
//! nothing.

mod bluestein;
mod cosine;
mod fft;
mod grid;
mod lanes;
mod rows;

pub(crate) use grid::ImageDct;
pub(crate) use lanes::LANES;
pub(crate) use rows::{SampleRun, SpectralFilter};

/// A plan of transforms of planes of one size, row-major `f32`.
pub struct Dct2 {
    grid: ImageDct<()>,
}

/// Error: the plane does not have the size that was planned.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("plane of {got} samples, planned for {height} x {width}")]
pub struct DctError {
    /// The number of samples of the plane.
    pub got: usize,
    /// The number of rows that was planned.
    pub height: usize,
    /// The number of columns that was planned.
    pub width: usize,
}

impl Dct2 {
    /// Plans transforms of `height` x `width` planes; sides of 0 count as 1.
    pub fn new(height: usize, width: usize) -> Self {
        Self { grid: ImageDct::new((height.max(1), width.max(1), 1), 1) }
    }

    /// Returns (height, width) of the planes that this plan transforms.
    pub fn dim(&self) -> (usize, usize) {
        let (height, width, _) = self.grid.dim();
        (height, width)
    }

    /// Computes the DCT-II in place: `X[u,v] = s_u s_v sum x[i,j] cos(pi u (i+1/2)/H) cos(pi v (j+1/2)/W)` with
    /// `s_0 = sqrt(1/N)` and `s_k = sqrt(2/N)` along each side.
    ///
    /// # Errors
    /// [`DctError`] when the plane does not have the planned size.
    pub fn forward(&mut self, plane: &mut [f32]) -> Result<(), DctError> {
        self.check(plane)?;
        let (_, width) = self.dim();
        self.grid.forward_columns(
            #[inline(always)]
            |run| load_run(plane, width, run),
        );
        self.grid.forward_rows(
            #[inline(always)]
            |run, values| store_run(plane, width, run, values),
        );
        Ok(())
    }

    /// Computes the DCT-III in place, the inverse of [`Dct2::forward`].
    ///
    /// # Errors
    /// [`DctError`] when the plane does not have the planned size.
    pub fn inverse(&mut self, plane: &mut [f32]) -> Result<(), DctError> {
        self.check(plane)?;
        let (_, width) = self.dim();
        self.grid.inverse_rows(
            #[inline(always)]
            |run| load_run(plane, width, run),
        );
        self.grid.inverse_columns(
            #[inline(always)]
            |run, values| store_run(plane, width, run, values),
        );
        Ok(())
    }

    fn check(&self, plane: &[f32]) -> Result<(), DctError> {
        let (height, width) = self.dim();
        if plane.len() == height * width {
            return Ok(());
        }
        Err(DctError { got: plane.len(), height, width })
    }
}

/// Loads a run of sixteen samples of a row-major plane, with 0 beyond the end of the row.
#[inline(always)]
pub(crate) fn load_run<T: Copy + Default>(plane: &[T], width: usize, run: SampleRun) -> [T; LANES] {
    let SampleRun { row, sample } = run;
    let row = &plane[row * width..][..width];
    // Only the last run of a row can be short. Its copy is out of line, so that all others stay one load.
    match row[sample..].first_chunk() {
        Some(samples) => *samples,
        None => tail(&row[sample..]),
    }
}

#[cold]
#[inline(never)]
fn tail<T: Copy + Default>(rest: &[T]) -> [T; LANES] {
    std::array::from_fn(|lane| rest.get(lane).copied().unwrap_or_default())
}

/// Stores a run of samples, the inverse of [`load_run`].
#[inline(always)]
fn store_run(plane: &mut [f32], width: usize, SampleRun { row, sample }: SampleRun, values: [f32; LANES]) {
    let row = &mut plane[row * width..][..width];
    match row[sample..].first_chunk_mut() {
        Some(samples) => *samples = values,
        None => row[sample..].iter_mut().zip(values).for_each(|(sample, value)| *sample = value),
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use super::*;

    /// Returns a plane without symmetry, in [-1, 1).
    fn noise(n: usize) -> Vec<f32> {
        (0..n as u32)
            .map(|i| {
                ((i.wrapping_mul(2_654_435_761) ^ 0x9E37).wrapping_mul(40503) >> 8) as f32 / (1 << 23) as f32
                    - 1.0
            })
            .collect()
    }

    fn basis(k: usize, i: usize, n: usize) -> f64 {
        let scale = if k == 0 { 1.0 } else { 2.0 } / n as f64;
        scale.sqrt() * (PI * k as f64 * (i as f64 + 0.5) / n as f64).cos()
    }

    fn naive(plane: &[f32], h: usize, w: usize) -> Vec<f64> {
        let term = |u, v, i, j| f64::from(plane[i * w + j]) * basis(u, i, h) * basis(v, j, w);
        let at = |u, v| (0..h).flat_map(|i| (0..w).map(move |j| (i, j))).map(|(i, j)| term(u, v, i, j)).sum();
        (0..h).flat_map(|u| (0..w).map(move |v| (u, v))).map(|(u, v)| at(u, v)).collect()
    }

    #[test]
    fn forward_is_the_definition() {
        for (h, w) in [(1, 1), (1, 7), (7, 1), (8, 8), (13, 19), (16, 31), (2, 3)] {
            let plane = noise(h * w);
            let mut got = plane.clone();
            Dct2::new(h, w).forward(&mut got).unwrap();
            let worst = naive(&plane, h, w)
                .iter()
                .zip(&got)
                .map(|(a, b)| (a - f64::from(*b)).abs())
                .fold(0.0, f64::max);
            assert!(worst < 5e-6, "{h} x {w}: off by {worst}");
        }
    }

    #[test]
    fn another_size_is_refused() {
        let mut dct = Dct2::new(4, 5);
        assert_eq!(dct.forward(&mut [0.0; 21]), Err(DctError { got: 21, height: 4, width: 5 }));
        assert_eq!(Dct2::new(0, 3).dim(), (1, 3));
    }
}
