//! Peak signal-to-noise ratio of 8-bit pictures.

use ndarray::Array3;

use super::{ShapesDiffer, check_shapes};

/// Mean of the squared differences over all samples of all channels, 0 to 255^2.
///
/// # Errors
/// [`ShapesDiffer`].
pub fn mse(left: &Array3<u8>, right: &Array3<u8>) -> Result<f64, ShapesDiffer> {
    check_shapes(left.dim(), right.dim())?;
    let squares = left.iter().zip(right).map(|(&a, &b)| u64::from(a.abs_diff(b)).pow(2));
    Ok(squares.sum::<u64>() as f64 / left.len().max(1) as f64)
}

/// `10 log10(255^2 / mse)`, dB; `None` where nothing differs and the ratio is infinite.
pub fn psnr_db(mse: f64) -> Option<f64> {
    (mse > 0.0).then(|| 10.0 * (255.0 * 255.0 / mse).log10())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn is_the_ratio_to_the_peak() {
        let zero = Array3::zeros((3, 5, 3));
        let full = Array3::from_elem((3, 5, 3), 255);
        assert_eq!(psnr_db(mse(&zero, &full).unwrap()), Some(0.0));
        assert_eq!(psnr_db(mse(&full, &full).unwrap()), None);
        // One of 45 samples off by 3: mse = 9 / 45.
        let mut near = full.clone();
        near[(2, 4, 1)] = 252;
        let got = psnr_db(mse(&near, &full).unwrap()).unwrap();
        assert!((got - 10.0 * (65025.0f64 / 0.2).log10()).abs() < 1e-12, "{got}");
        assert!(mse(&zero, &Array3::zeros((3, 5, 1))).is_err());
    }
}
