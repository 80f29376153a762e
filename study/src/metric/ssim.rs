//! Structural similarity of 8-bit pictures (Wang, Bovik, Sheikh, Simoncelli 2004).

use ndarray::{Array3, ArrayView2, Axis};

use super::{ShapesDiffer, check_shapes};

/// Pictures with a shorter side have no window and so no SSIM, px.
pub const LEAST_SIDE: usize = 11;

const SIGMA: f64 = 1.5;
/// (0.01 * 255)^2 and (0.03 * 255)^2.
const C1: f64 = 6.5025;
const C2: f64 = 58.5225;

/// Weighted sums of a, b, a^2, b^2 and ab under the window.
type Moments = [f64; 5];

/// Mean SSIM, -1 to 1: an 11 x 11 Gaussian window of sigma 1.5 px at every place where it fits, `K1 = 0.01`,
/// `K2 = 0.03`, peak 255, covariance without the sample correction; the mean over places, then over
/// channels. `None` when a side is shorter than [`LEAST_SIDE`].
///
/// # Errors
/// [`ShapesDiffer`].
pub fn ssim(left: &Array3<u8>, right: &Array3<u8>) -> Result<Option<f64>, ShapesDiffer> {
    check_shapes(left.dim(), right.dim())?;
    let (height, width, channels) = left.dim();
    if height.min(width) < LEAST_SIDE || channels == 0 {
        return Ok(None);
    }
    let window = window();
    let planes = left.axis_iter(Axis(2)).zip(right.axis_iter(Axis(2)));
    let sum: f64 = planes.map(|(a, b)| of_plane(a, b, &window)).sum();
    Ok(Some(sum / channels as f64))
}

fn window() -> [f64; LEAST_SIDE] {
    let middle = (LEAST_SIDE / 2) as f64;
    let weights: [f64; LEAST_SIDE] =
        std::array::from_fn(|i| (-0.5 * ((i as f64 - middle) / SIGMA).powi(2)).exp());
    let sum: f64 = weights.iter().sum();
    weights.map(|weight| weight / sum)
}

fn of_plane(a: ArrayView2<'_, u8>, b: ArrayView2<'_, u8>, window: &[f64; LEAST_SIDE]) -> f64 {
    let (height, width) = a.dim();
    let (rows, columns) = (height - LEAST_SIDE + 1, width - LEAST_SIDE + 1);
    let mut below = vec![[0.0; 5]; width];
    let mut sum = 0.0;
    for top in 0..rows {
        below.fill([0.0; 5]);
        for (row, &weight) in (top..).zip(window) {
            for ((moments, &a), &b) in below.iter_mut().zip(a.row(row)).zip(b.row(row)) {
                let (a, b) = (f64::from(a), f64::from(b));
                add(moments, &[a, b, a * a, b * b, a * b], weight);
            }
        }
        sum += below.windows(LEAST_SIDE).map(|columns| at(columns, window)).sum::<f64>();
    }
    sum / (rows * columns) as f64
}

/// SSIM of one window from the sums of its columns.
fn at(columns: &[Moments], window: &[f64; LEAST_SIDE]) -> f64 {
    let mut moments = [0.0; 5];
    columns.iter().zip(window).for_each(|(column, &weight)| add(&mut moments, column, weight));
    let [a, b, aa, bb, ab] = moments;
    let (var_a, var_b, cov) = (aa - a * a, bb - b * b, ab - a * b);
    ((2.0 * a * b + C1) * (2.0 * cov + C2)) / ((a * a + b * b + C1) * (var_a + var_b + C2))
}

fn add(sums: &mut Moments, values: &Moments, weight: f64) {
    sums.iter_mut().zip(values).for_each(|(sum, value)| *sum += weight * value);
}
