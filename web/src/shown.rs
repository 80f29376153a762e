//! A result as images for a screen, as codes and as figures.

use modulo_core::{DisplayCurve, Frame, Samples, UnwrapError, tone};
use ndarray::Array3;

use crate::capture::Capture;
use crate::picture::TRANSFER;

/// The first and the last stop of the histogram, from the peak of the sensor, and its bins in a stop.
const STOPS: (f64, f64) = (-8.0, 4.0);
const BINS_OF_A_STOP: f64 = 2.0;

/// What the page may ask for.
pub fn output(capture: &Capture, number: u32) -> Result<Vec<u8>, UnwrapError> {
    let range = capture.exposure.range();
    let (peak, white) = (f64::from(range.peak()), range.white() / f64::from(range.peak()));
    Ok(match number {
        0 => figures(capture).iter().flat_map(|figure| figure.to_le_bytes()).collect(),
        1 => by_curve(&capture.exposure.saturated_radiance(), peak, 1.0),
        2 => rgba(&capture.modulo.to_f32(), |code| (255.0 * code / (peak - 1.0)).round() as u8),
        3 => by_curve(&capture.recovered.x, peak, white),
        4 => codes(&capture.modulo),
        5 => codes(&tone::picture(&capture.recovered.x, range, TRANSFER)?),
        _ => capture.recovered.report.method.into(),
    })
}

/// Shows whole codes by the display curve of images whose full scale is `white`, in peaks.
fn by_curve(x: &Array3<f32>, peak: f64, white: f64) -> Vec<u8> {
    let curve = DisplayCurve::of_white(white);
    rgba(x, |x| (255.0 * curve.code(x / peak)).round() as u8)
}

/// Returns red, green, blue and opacity of each pixel, where `shown` is the byte of a whole code.
fn rgba(x: &Array3<f32>, shown: impl Fn(f64) -> u8) -> Vec<u8> {
    // A power for each code takes less time than one for each sample.
    let table: Vec<u8> = (0..=largest(x)).map(|code| shown(code as f64)).collect();
    let channels = x.dim().2;
    let byte = |row: usize, column: usize, channel: usize| table[x[(row, column, channel)] as usize];
    let pixels = (0..x.dim().0).flat_map(|row| (0..x.dim().1).map(move |column| (row, column)));
    pixels
        .flat_map(|(i, j)| [byte(i, j, 0), byte(i, j, channels / 2), byte(i, j, channels - 1), 255])
        .collect()
}

/// Returns the largest whole code.
fn largest(x: &Array3<f32>) -> usize {
    x.iter().copied().fold(0.0, f32::max) as usize
}

/// Returns the samples of integers, 1 or 2 bytes each, little-endian, as `modulo simulate` writes them.
fn codes(frame: &Frame) -> Vec<u8> {
    match frame.samples() {
        Samples::U8(codes) => codes.iter().copied().collect(),
        Samples::U16(codes) => codes.iter().flat_map(|code| code.to_le_bytes()).collect(),
        Samples::F32(_) => Vec::new(),
    }
}

/// Returns rows, columns, the share of exact counts, the number of the reason, the largest wrap count, the share of the samples at the peak and
/// above, the largest alpha of a fit sensor, the jumps per sample, and the histogram.
fn figures(capture: &Capture) -> Vec<f64> {
    let Capture { exposure, recovered, .. } = capture;
    let (height, width, _) = exposure.x().dim();
    let most_k = recovered.k.iter().copied().max().unwrap_or_default();
    let wrapped = exposure.wraps().iter().filter(|&&k| k > 0).count() as f64 / recovered.k.len() as f64;
    let exact = exposure.exact_share(&recovered.k).unwrap_or_default();
    let mut figures = vec![height as f64, width as f64, exact, f64::from(capture.reason() as u8)];
    figures.extend([f64::from(most_k), wrapped, capture.fit_up_to(), capture.jumps()]);
    figures.extend(histogram(&recovered.x, f64::from(exposure.range().peak())));
    figures
}

/// Returns the shares of the samples in each part of a stop. What is darker or brighter is in the first or the last bin.
fn histogram(x: &Array3<f32>, peak: f64) -> Vec<f64> {
    let mut shares = vec![0.0; ((STOPS.1 - STOPS.0) * BINS_OF_A_STOP) as usize];
    let bin = |code: usize| ((code as f64 / peak).log2() - STOPS.0) * BINS_OF_A_STOP;
    // The conversion by `as` sends what is below the first bin to it.
    let bins: Vec<_> = (0..=largest(x)).map(|code| (bin(code) as usize).min(shares.len() - 1)).collect();
    x.iter().for_each(|&x| shares[bins[x as usize]] += 1.0);
    shares.iter().map(|count| count / x.len() as f64).collect()
}
