//! The share of exact wrap counts.

use ndarray::Array3;

use super::{ShapesDiffer, check_shapes};

/// Share of the samples (all channels) whose wrap count is the true one, 0 to 1; no shift is forgiven.
///
/// # Errors
/// [`ShapesDiffer`].
pub fn exact_share(found: &Array3<u8>, truth: &Array3<u8>) -> Result<f64, ShapesDiffer> {
    check_shapes(found.dim(), truth.dim())?;
    let exact = found.iter().zip(truth).filter(|(a, b)| a == b).count();
    Ok(exact as f64 / truth.len().max(1) as f64)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn counts_samples() {
        let truth = Array3::from_shape_fn((2, 2, 3), |(i, j, c)| (i + j + c) as u8);
        let mut found = truth.clone();
        found[(1, 0, 2)] += 1;
        assert_eq!(exact_share(&found, &truth), Ok(11.0 / 12.0));
        assert!(exact_share(&Array3::zeros((2, 3, 2)), &truth).is_err());
    }
}
