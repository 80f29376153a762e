//! The cosine transforms of the library rustdct, one lane after the other: for lengths that have a large prime factor.

use std::f32::consts::{FRAC_1_SQRT_2, SQRT_2};
use std::sync::Arc;

use rustdct::{DctPlanner, TransformType2And3};

use super::lanes::{Complex, LANES};

/// A plan of the orthonormal DCT-II and DCT-III of one length.
pub(super) struct LibraryPlan {
    cosine: Arc<dyn TransformType2And3<f32>>,
}

impl LibraryPlan {
    /// Plans transforms of length `n`, at least 1.
    pub fn new(n: usize) -> Self {
        Self { cosine: DctPlanner::new().plan_dct2(n) }
    }

    /// Returns the length of the scratch: a line, and what the library needs.
    pub fn scratch_len(&self) -> usize {
        self.cosine.len() + self.cosine.get_scratch_len()
    }

    /// Computes the DCT-II of each lane in place.
    pub fn forward(&self, data: &mut [Complex], scratch: &mut [f32]) {
        self.each_lane(data, scratch, |line, scratch| {
            self.cosine.process_dct2_with_scratch(line, scratch);
            line[0] *= FRAC_1_SQRT_2;
        });
    }

    /// Computes the DCT-III of each lane in place, the inverse of [`LibraryPlan::forward`].
    pub fn inverse(&self, data: &mut [Complex], scratch: &mut [f32]) {
        self.each_lane(data, scratch, |line, scratch| {
            // The library halves the first term, the orthonormal inverse takes it by 1/sqrt(2).
            line[0] *= SQRT_2;
            self.cosine.process_dct3_with_scratch(line, scratch);
        });
    }

    fn each_lane(
        &self,
        data: &mut [Complex],
        scratch: &mut [f32],
        transform: impl Fn(&mut [f32], &mut [f32]),
    ) {
        let (line, scratch) = scratch.split_at_mut(data.len());
        let scale = (2.0 / data.len() as f32).sqrt();
        for lane in 0..LANES {
            line.iter_mut().zip(&mut *data).for_each(|(value, number)| *value = *number.lane_mut(lane));
            transform(line, scratch);
            data.iter_mut().zip(&*line).for_each(|(number, value)| *number.lane_mut(lane) = scale * value);
        }
    }
}
