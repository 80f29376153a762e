//! A result as images for a screen and for the detector, as codes and as figures.

use modulo_core::{DisplayCurve, Frame, Samples, UnwrapError, tone};
use modulo_scene::Class;
use ndarray::Array3;

use crate::capture::Capture;
use crate::picture::{Origin, Picture};

/// The first and the last stop of the histogram, from the peak of the sensor, and its bins in a stop.
const STOPS: (f64, f64) = (-8.0, 4.0);
const BINS_OF_A_STOP: f64 = 2.0;

/// An image of a capture. The page has a name for each number.
#[derive(Clone, Copy)]
pub enum Stream {
    Normal,
    Modulo,
    Recovered,
    Ideal,
    WrapCount,
}

impl Stream {
    pub const ALL: [Self; 5] = [Self::Normal, Self::Modulo, Self::Recovered, Self::Ideal, Self::WrapCount];

    /// Returns its codes, as `modulo simulate` writes them, and the largest possible one; of wrap counts, the largest one.
    fn codes(
        self,
        Capture { exposure, modulo, recovered, .. }: &Capture,
    ) -> Result<(Frame, f32), UnwrapError> {
        let (range, transfer) = (exposure.range(), exposure.transfer());
        let most = range.peak() - 1.0;
        Ok(match self {
            Self::Normal => (exposure.saturated(), most),
            Self::Modulo => (modulo.clone(), most),
            Self::Recovered => (tone::picture(&recovered.x, range, transfer)?, 255.0),
            Self::Ideal => (exposure.ideal(), 255.0),
            Self::WrapCount => (Frame::from_u8(recovered.k.clone())?, largest(&recovered.k).max(1).into()),
        })
    }

    /// Returns its codes, 1 or 2 bytes each, little-endian.
    pub fn bytes(self, capture: &Capture) -> Result<Vec<u8>, UnwrapError> {
        Ok(match self.codes(capture)?.0.samples() {
            Samples::U8(codes) => codes.iter().copied().collect(),
            Samples::U16(codes) => codes.iter().flat_map(|code| code.to_le_bytes()).collect(),
            Samples::F32(_) => Vec::new(),
        })
    }

    /// Returns the image of 8 bits that a detector reads, interleaved.
    pub fn for_detector(self, capture: &Capture) -> Result<Vec<u8>, UnwrapError> {
        let (codes, most) = self.codes(capture)?;
        Ok(tone::eight_bits(&codes, most).as_u8().expect("it has 8 bits").iter().copied().collect())
    }

    /// Returns red, green, blue and opacity of each pixel for a screen. An ordinary picture looks as it is; radiance needs a curve.
    pub fn shown(self, picture: &Picture, capture: &Capture) -> Result<Vec<u8>, UnwrapError> {
        let (exposure, range) = (&capture.exposure, capture.exposure.range());
        let (peak, white) = (f64::from(range.peak()), range.white() / f64::from(range.peak()));
        let curve = |x: &Array3<f32>, white| {
            let curve = DisplayCurve::of_white(white);
            // A power for each code takes less time than one for each sample.
            let top = x.iter().copied().fold(0.0, f32::max) as usize;
            let table: Vec<u8> =
                (0..=top).map(|x| (255.0 * curve.code(x as f64 / peak)).round() as u8).collect();
            rgba(x.dim(), |place| table[x[place] as usize])
        };
        Ok(match (self, &picture.origin) {
            (Self::Normal, Origin::Rendered(_) | Origin::Radiance) => {
                curve(&exposure.saturated_radiance(), 1.0)
            }
            (Self::Recovered, Origin::Rendered(_) | Origin::Radiance) => curve(&capture.recovered.x, white),
            (Self::Ideal, Origin::Rendered(_) | Origin::Radiance) => curve(exposure.x(), white),
            _ => {
                let (codes, most) = self.codes(capture)?;
                let codes = tone::eight_bits(&codes, most);
                let codes = codes.as_u8().expect("it has 8 bits");
                rgba(codes.dim(), |place| codes[place])
            }
        })
    }
}

/// Returns red, green, blue and opacity of each pixel of an image with one or three channels.
fn rgba(
    (height, width, channels): (usize, usize, usize),
    byte: impl Fn((usize, usize, usize)) -> u8,
) -> Vec<u8> {
    let pixels = (0..height).flat_map(|row| (0..width).map(move |column| (row, column)));
    let pixels = pixels
        .flat_map(|(i, j)| [byte((i, j, 0)), byte((i, j, channels / 2)), byte((i, j, channels - 1)), 255]);
    pixels.collect()
}

fn largest(k: &Array3<u8>) -> u8 {
    k.iter().copied().max().unwrap_or_default()
}

/// Returns rows, columns, the share of exact counts, the number of the reason, the largest wrap count, the share of the samples at the peak and
/// above, the largest alpha of a fit sensor, the jumps per sample, the histogram, and the class and the box of each object of a scene.
pub fn figures(picture: &Picture, capture: &Capture) -> Vec<f64> {
    let Capture { exposure, recovered, .. } = capture;
    let (height, width, _) = exposure.x().dim();
    let wrapped = exposure.wraps().iter().filter(|&&k| k > 0).count() as f64 / recovered.k.len() as f64;
    let exact = exposure.exact_share(&recovered.k).unwrap_or_default();
    let mut figures = vec![height as f64, width as f64, exact, f64::from(capture.reason() as u8)];
    figures.extend([largest(&recovered.k).into(), wrapped, capture.fit_up_to(), capture.jumps()]);
    figures.extend(histogram(&recovered.x, f64::from(exposure.range().peak())));
    if let Origin::Rendered(objects) = &picture.origin {
        for object in objects {
            let class = Class::ALL.iter().position(|class| *class == object.class);
            let bbox = object.bbox;
            figures.push(class.expect("all classes are there") as f64);
            figures.extend([bbox.x1, bbox.y1, bbox.x2, bbox.y2].map(f64::from));
        }
    }
    figures
}

/// Returns the shares of the samples in each part of a stop. What is darker or brighter is in the first or the last bin.
fn histogram(x: &Array3<f32>, peak: f64) -> Vec<f64> {
    let mut shares = vec![0.0; ((STOPS.1 - STOPS.0) * BINS_OF_A_STOP) as usize];
    let bin = |code: usize| ((code as f64 / peak).log2() - STOPS.0) * BINS_OF_A_STOP;
    let top = x.iter().copied().fold(0.0, f32::max) as usize;
    // The conversion by `as` sends what is below the first bin to it.
    let bins: Vec<_> = (0..=top).map(|code| (bin(code) as usize).min(shares.len() - 1)).collect();
    x.iter().for_each(|&x| shares[bins[x as usize]] += 1.0);
    shares.iter().map(|count| count / x.len() as f64).collect()
}
