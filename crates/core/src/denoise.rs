//! Removes the noise of a known sensor from recovered radiance by total variation.
//!
//! The result u of radiance x minimises (Rudin, Osher and Fatemi 1992, *Physica D* 60, 259)
//! ```text
//!     sum over pixels of |grad u|  +  sum over samples of (u - x)^2 / (2 sigma),   sigma^2 = read^2 + shot x + (prnu x)^2 + 1/12
//! ```
//! `|grad u|` is the length of the differences to the right and down in all channels together (Blomgren and Chan 1998), so that the
//! channels keep their common edges. Nothing is estimated from the image: sigma is the noise of the sensor at the brightness of the sample,
//! rounding to whole codes included.
//!
//! The minimum is found by projected gradients of the dual problem (Chambolle 2004, *J. Math. Imaging Vis.* 20, 89) with the momentum of
//! Beck and Teboulle 2009 (*IEEE Trans. Image Process.* 18, 2419), which needs a third of the steps.

use ndarray::{Array3, ArrayRef3};

use crate::frame::in_order;
use crate::mosaic::by_colour;
use crate::sensor::SensorConfig;
use crate::simd::widest;

/// The steps of the minimisation. More of them change the result by a small part of the noise.
const STEPS: usize = 8;

/// The variance of rounding to whole codes.
const OF_ROUNDING: f64 = 1.0 / 12.0;

/// A divergence has four terms, and an edge two ends: the greatest step with which the dual problem converges is the inverse of
/// their product times sigma.
const LARGEST_STEP: f32 = 0.125;

/// The denoising of the radiance of one sensor.
#[derive(Clone, Debug)]
pub struct Denoise {
    sensor: SensorConfig,
}

impl Denoise {
    /// Makes the denoising for images of `sensor`; `None` if it has no noise.
    pub fn new(sensor: SensorConfig) -> Option<Self> {
        let SensorConfig { read_noise, shot_noise, prnu, .. } = sensor;
        (read_noise > 0.0 || shot_noise > 0.0 || prnu > 0.0).then_some(Self { sensor })
    }

    /// Returns `x` (H x W x C, code units of full gain) without most of its noise. A colour mosaic (H x W x 1) stays one.
    pub fn apply(&self, x: &Array3<f32>) -> Array3<f32> {
        match self.sensor.mosaic {
            None => self.smooth(x),
            // Neighbours of the same colour are two pixels away.
            Some(_) => by_colour(x, |x| self.smooth(x)),
        }
    }

    fn smooth(&self, x: &ArrayRef3<f32>) -> Array3<f32> {
        let in_standard = x.as_standard_layout();
        let samples = in_order(in_standard.view());
        let sigma = |(row, column), x| self.sigma((row, column), x);
        let out = match x.dim().2 {
            3 => Problem::<3>::new(samples, x.dim(), sigma).minimise(),
            _ => Problem::<1>::new(samples, x.dim(), sigma).minimise(),
        };
        Array3::from_shape_vec(x.dim(), out).expect("one sample for each of x")
    }

    /// Returns the standard deviation of the noise of a sample at (row, column), in code units of full gain.
    fn sigma(&self, (row, column): (usize, usize), x: f32) -> f32 {
        let SensorConfig { read_noise, shot_noise, prnu, gains, .. } = self.sensor;
        let (x, gain) = (f64::from(x.max(0.0)), gains.at(row, column));
        // Read noise and rounding come after the gain.
        let converter = read_noise * read_noise + OF_ROUNDING;
        (converter / (gain * gain) + shot_noise * x + (prnu * x).powi(2)).sqrt() as f32
    }
}

/// The minimisation for `C` channels. The samples of a row stand channel after channel.
struct Problem<const C: usize> {
    width: usize,
    x: Vec<f32>,
    sigma: Vec<f32>,
    /// The step of the dual variables of each pixel.
    step: Vec<f32>,
    /// The dual variables, to the right and down, before and after the momentum is added.
    duals: [Vec<f32>; 2],
    ahead: [Vec<f32>; 2],
    /// Two rows of u, with one sample more so that each has a right neighbour.
    rows: [Vec<f32>; 2],
}

impl<const C: usize> Problem<C> {
    fn new(
        samples: &[f32],
        (height, width, _): (usize, usize, usize),
        sigma_of: impl Fn((usize, usize), f32) -> f32,
    ) -> Self {
        let (mut x, mut sigma) = (vec![0.0; samples.len()], vec![0.0; samples.len()]);
        for (index, pixel) in samples.as_chunks::<C>().0.iter().enumerate() {
            let (row, column) = (index / width, index % width);
            for (channel, &sample) in pixel.iter().enumerate() {
                let at = (row * C + channel) * width + column;
                (x[at], sigma[at]) = (sample, sigma_of((row, column), sample));
            }
        }
        let step = steps::<C>(&sigma, (height, width));
        let duals = || [vec![0.0; samples.len()], vec![0.0; samples.len()]];
        let rows = || vec![0.0; C * width + 1];
        Self { width, x, sigma, step, duals: duals(), ahead: duals(), rows: [rows(), rows()] }
    }

    /// Returns u, H x W x C, interleaved.
    fn minimise(mut self) -> Vec<f32> {
        let stride = C * self.width;
        let height = self.x.len() / stride;
        let mut pace = 1.0f32;
        for _ in 0..STEPS {
            let next = (1.0 + (1.0 + 4.0 * pace * pace).sqrt()) / 2.0;
            let momentum = (pace - 1.0) / next;
            widest!(self.sweep(height, momentum));
            pace = next;
        }
        let mut out = vec![0.0; self.x.len()];
        // The minimum belongs to the projected variables, which have no momentum.
        self.ahead = std::mem::take(&mut self.duals);
        for (row, out) in out.chunks_exact_mut(stride).enumerate() {
            self.write_row(row);
            let row = &self.rows[1];
            for (column, pixel) in out.as_chunks_mut::<C>().0.iter_mut().enumerate() {
                *pixel = std::array::from_fn(|channel| row[channel * self.width + column]);
            }
        }
        out
    }

    /// Makes one step at all pixels, row by row: u of the next row is computed before this row changes.
    #[inline(always)]
    fn sweep(&mut self, height: usize, momentum: f32) {
        self.write_row(0);
        for row in 0..height {
            self.rows.swap(0, 1);
            if row + 1 < height {
                self.write_row(row + 1);
            } else {
                // Beyond the last row nothing changes.
                let [here, below] = &mut self.rows;
                below.copy_from_slice(here);
            }
            self.step_row(row, momentum);
        }
    }

    /// Writes u = x - sigma div^T(dual) of a row.
    #[inline(always)]
    fn write_row(&mut self, row: usize) {
        let stride = C * self.width;
        let at = row * stride..(row + 1) * stride;
        let Self { x, sigma, ahead: [right, down], rows: [_, u], .. } = self;
        let (x, sigma, right, below) =
            (&x[at.clone()], &sigma[at.clone()], &right[at.clone()], &down[at.clone()]);
        let u = &mut u[..stride];
        for i in 0..stride {
            u[i] = x[i] + sigma[i] * (right[i] + below[i]);
        }
        // The last pixel of a line has no right neighbour and a dual variable of 0, so that lines need not be told apart.
        for (i, right) in right[..stride - 1].iter().enumerate() {
            u[i + 1] -= sigma[i + 1] * right;
        }
        if row > 0 {
            let above = &down[at.start - stride..at.start];
            for i in 0..stride {
                u[i] -= sigma[i] * above[i];
            }
        }
    }

    /// Moves the dual variables of a row along the gradient of u, and shortens those that are longer than 1.
    #[inline(always)]
    fn step_row(&mut self, row: usize, momentum: f32) {
        let (width, stride) = (self.width, C * self.width);
        let at = row * stride..(row + 1) * stride;
        let Self { step, duals: [last_right, last_down], ahead: [right, down], rows: [here, below], .. } =
            self;
        let step = &step[row * width..][..width];
        let [right, down, last_right, last_down] =
            [right, down, last_right, last_down].map(|dual| lines_mut::<C>(&mut dual[at.clone()], width));
        let [here, next, below] =
            [&here[..stride], &here[1..], &below[..stride]].map(|lines| lines_of::<C>(lines, width));
        for j in 0..width {
            // The difference at the end of a line leads into the next one.
            let step_right = if j + 1 < width { step[j] } else { 0.0 };
            let (mut to_right, mut to_down, mut square) = ([0.0; C], [0.0; C], 0.0);
            for c in 0..C {
                to_right[c] = right[c][j] + step_right * (next[c][j] - here[c][j]);
                to_down[c] = down[c][j] + step[j] * (below[c][j] - here[c][j]);
                square += to_right[c] * to_right[c] + to_down[c] * to_down[c];
            }
            let shorten = 1.0 / square.max(1.0).sqrt();
            for c in 0..C {
                let (to_right, to_down) = (to_right[c] * shorten, to_down[c] * shorten);
                right[c][j] = to_right + momentum * (to_right - last_right[c][j]);
                down[c][j] = to_down + momentum * (to_down - last_down[c][j]);
                (last_right[c][j], last_down[c][j]) = (to_right, to_down);
            }
        }
    }
}

/// Returns the lines of `C` channels in a row.
#[inline(always)]
fn lines_of<const C: usize>(row: &[f32], width: usize) -> [&[f32]; C] {
    std::array::from_fn(|channel| &row[channel * width..][..width])
}

/// Returns the lines of `C` channels in a row.
#[inline(always)]
fn lines_mut<const C: usize>(row: &mut [f32], width: usize) -> [&mut [f32]; C] {
    let mut lines = row.chunks_exact_mut(width);
    std::array::from_fn(|_| lines.next().expect("a row has a line for each channel"))
}

/// Returns the step of each pixel, which is that for the greatest sigma of the pixel and its neighbours to the right and below.
fn steps<const C: usize>(sigma: &[f32], (height, width): (usize, usize)) -> Vec<f32> {
    let greatest = |row: usize, column: usize| {
        (0..C).fold(0.0, |most: f32, channel| most.max(sigma[(row * C + channel) * width + column]))
    };
    let mut steps = vec![0.0; height * width];
    for (index, step) in steps.iter_mut().enumerate() {
        let (row, column) = (index / width, index % width);
        let [right, below] = [(row, (column + 1).min(width - 1)), ((row + 1).min(height - 1), column)];
        let most = greatest(row, column).max(greatest(right.0, right.1)).max(greatest(below.0, below.1));
        *step = LARGEST_STEP / most;
    }
    steps
}
