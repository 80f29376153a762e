//! The orthonormal two-dimensional cosine transform, of any size.
//!
//! This is the one file that names the transform library; a plan owns its
//! scratch, so a transform allocates nothing.

use std::f32::consts::SQRT_2;
use std::sync::Arc;

use rustdct::{DctPlanner, TransformType2And3};

/// Side of the square blocks that a transpose moves at once: two of them fit in the first cache.
const BLOCK: usize = 16;

/// A plan for planes of one size, row-major `f32`.
pub struct Dct2 {
    height: usize,
    width: usize,
    along_row: Arc<dyn TransformType2And3<f32>>,
    along_column: Arc<dyn TransformType2And3<f32>>,
    turned: Vec<f32>,
    scratch: Vec<f32>,
}

/// A plane that is not of the size that was planned.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("plane of {got} samples, planned for {height} x {width}")]
pub struct DctError {
    /// Samples found.
    pub got: usize,
    /// Rows planned.
    pub height: usize,
    /// Columns planned.
    pub width: usize,
}

#[derive(Clone, Copy)]
enum Direction {
    Forward,
    Inverse,
}

impl Dct2 {
    /// Plans transforms of `height` x `width` planes; sides of 0 count as 1.
    pub fn new(height: usize, width: usize) -> Self {
        let (height, width) = (height.max(1), width.max(1));
        let mut planner = DctPlanner::new();
        let along_row = planner.plan_dct2(width);
        let along_column = planner.plan_dct2(height);
        let scratch = along_row.get_scratch_len().max(along_column.get_scratch_len());
        Self {
            height,
            width,
            along_row,
            along_column,
            turned: vec![0.0; height * width],
            scratch: vec![0.0; scratch],
        }
    }

    /// (height, width) of the planes that this plan transforms.
    pub fn dim(&self) -> (usize, usize) {
        (self.height, self.width)
    }

    /// DCT-II in place: `X[u,v] = s_u s_v sum x[i,j] cos(pi u (i+1/2)/H) cos(pi v (j+1/2)/W)`
    /// with `s_0 = sqrt(1/N)` and `s_k = sqrt(2/N)` along each side.
    ///
    /// # Errors
    /// [`DctError`] when the plane is not of the planned size.
    pub fn forward(&mut self, plane: &mut [f32]) -> Result<(), DctError> {
        self.both_sides(plane, Direction::Forward)
    }

    /// DCT-III in place, the inverse of [`Dct2::forward`].
    ///
    /// # Errors
    /// [`DctError`] when the plane is not of the planned size.
    pub fn inverse(&mut self, plane: &mut [f32]) -> Result<(), DctError> {
        self.both_sides(plane, Direction::Inverse)
    }

    fn both_sides(&mut self, plane: &mut [f32], direction: Direction) -> Result<(), DctError> {
        let (height, width) = (self.height, self.width);
        if plane.len() != height * width {
            return Err(DctError { got: plane.len(), height, width });
        }
        each_row(plane, self.along_row.as_ref(), &mut self.scratch, direction);
        transpose(plane, &mut self.turned, width);
        each_row(&mut self.turned, self.along_column.as_ref(), &mut self.scratch, direction);
        transpose(&self.turned, plane, height);
        Ok(())
    }
}

fn each_row(plane: &mut [f32], dct: &dyn TransformType2And3<f32>, scratch: &mut [f32], direction: Direction) {
    let scratch = &mut scratch[..dct.get_scratch_len()];
    let scale = (2.0 / dct.len() as f32).sqrt();
    for row in plane.chunks_exact_mut(dct.len()) {
        match direction {
            Direction::Forward => {
                dct.process_dct2_with_scratch(row, scratch);
                row[0] /= SQRT_2;
            }
            Direction::Inverse => {
                // The library halves the first term, the orthonormal inverse takes it by 1/sqrt(2).
                row[0] *= SQRT_2;
                dct.process_dct3_with_scratch(row, scratch);
            }
        }
        row.iter_mut().for_each(|sample| *sample *= scale);
    }
}

/// `to` (W x H) becomes the transpose of `from` (H x W).
fn transpose(from: &[f32], to: &mut [f32], width: usize) {
    let height = from.len() / width;
    for top in (0..height).step_by(BLOCK) {
        let rows = BLOCK.min(height - top);
        for left in (0..width).step_by(BLOCK) {
            for column in left..(left + BLOCK).min(width) {
                let line = &mut to[column * height + top..][..rows];
                for (sample, row) in line.iter_mut().zip(from[top * width + column..].iter().step_by(width)) {
                    *sample = *row;
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use super::*;

    /// A plane without symmetry, in [-1, 1).
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
    fn inverse_undoes_forward_at_awkward_sizes() {
        for (h, w) in [(374, 1238), (370, 1226), (375, 1242), (376, 1241), (1, 619), (613, 1)] {
            let plane = noise(h * w);
            let mut dct = Dct2::new(h, w);
            let mut got = plane.clone();
            dct.forward(&mut got).unwrap();
            let energy = |p: &[f32]| p.iter().map(|v| f64::from(*v).powi(2)).sum::<f64>();
            assert!((energy(&got) / energy(&plane) - 1.0).abs() < 1e-5, "{h} x {w}: not orthonormal");
            dct.inverse(&mut got).unwrap();
            let worst = plane.iter().zip(&got).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
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
