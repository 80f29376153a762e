//! The cosine transform by the rustdct library with blocked transposes, as a reference for results and times.

use std::f32::consts::SQRT_2;
use std::sync::Arc;

use rustdct::{DctPlanner, TransformType2And3};

/// The side of the square blocks that a transpose moves at once: two of them fit in the first cache.
const BLOCK: usize = 16;

#[derive(Clone, Copy)]
pub enum Direction {
    Forward,
    Inverse,
}

/// A plan for planes of one size, row-major.
pub struct Library {
    along_row: Arc<dyn TransformType2And3<f32>>,
    along_column: Arc<dyn TransformType2And3<f32>>,
    turned: Vec<f32>,
    scratch: Vec<f32>,
}

impl Library {
    pub fn new(height: usize, width: usize) -> Self {
        let mut planner = DctPlanner::new();
        let along_row = planner.plan_dct2(width);
        let along_column = planner.plan_dct2(height);
        let scratch = vec![0.0; along_row.get_scratch_len().max(along_column.get_scratch_len())];
        Self { along_row, along_column, turned: vec![0.0; height * width], scratch }
    }

    /// Runs the orthonormal transform in place.
    pub fn transform(&mut self, plane: &mut [f32], direction: Direction) {
        let (height, width) = (self.along_column.len(), self.along_row.len());
        each_row(plane, self.along_row.as_ref(), &mut self.scratch, direction);
        transpose(plane, &mut self.turned, width);
        each_row(&mut self.turned, self.along_column.as_ref(), &mut self.scratch, direction);
        transpose(&self.turned, plane, height);
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

/// Writes to `to` (W x H) the transpose of `from` (H x W).
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
