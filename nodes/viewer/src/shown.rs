//! [`ShownImage`]: an image as 8 bits for a browser, and the histogram of its radiance.

use modulo_core::{Frame, Samples, Transfer, tone};
use modulo_runtime::{LightScale, StreamScale};

/// The least radiance of the histogram, in stops from the peak of the sensor.
pub const LEAST_STOP: f64 = -8.0;
pub const BINS_OF_A_STOP: f64 = 2.0;
/// Bins of the histogram, up to 8 stops above the peak.
const BINS: usize = 32;
/// Pixels that the histogram looks at.
const LOOKED_AT: usize = 20_000;

pub struct ShownImage {
    /// Codes of sRGB for images of radiance, else codes in proportion to the samples.
    pub frame: Frame,
    /// The radiance of the code 255, in peaks of the sensor; `None` for an image of something else.
    pub peaks: Option<f64>,
    /// The share of the samples in each bin of the radiance.
    pub stops: Vec<f32>,
}

impl ShownImage {
    /// Makes 8 bits of `frame`, whose samples have this `scale`, if it is known.
    pub fn of(frame: &Frame, scale: Option<StreamScale>) -> Self {
        match scale.and_then(|scale| Some((scale.most, scale.light?))) {
            Some(scale) => of_radiance(frame, scale),
            None => of_samples(frame),
        }
    }
}

/// A page gets sRGB's codes of radiance: dark parts keep their steps, which it may show brighter.
fn of_radiance(frame: &Frame, (most, light): (f64, LightScale)) -> ShownImage {
    let code = |sample: f64| {
        let radiance = light.radiance((sample / most).min(1.0));
        (255.0 * Transfer::Srgb.encode(radiance / light.white)).round() as u8
    };
    let shown = match frame.samples() {
        Samples::U8(codes) => {
            let table: [u8; 256] = std::array::from_fn(|sample| code(sample as f64));
            codes.mapv(|sample| table[usize::from(sample)])
        }
        Samples::U16(codes) => {
            let table: Vec<u8> = (0..=u16::MAX).map(|sample| code(f64::from(sample))).collect();
            codes.mapv(|sample| table[usize::from(sample)])
        }
        Samples::F32(values) => values.mapv(|sample| code(f64::from(sample))),
    };
    let shown = Frame::from_u8(shown).expect("the shape is that of a frame");
    ShownImage { frame: shown, peaks: Some(light.white), stops: stops(frame, (most, light)) }
}

/// Samples of more than 8 bits keep their ratio; the largest one becomes white.
fn of_samples(frame: &Frame) -> ShownImage {
    let frame = match frame.samples() {
        Samples::U8(_) => frame.clone(),
        _ => tone::eight_bits(frame, frame.to_f32().iter().copied().fold(1.0, f32::max)).into_owned(),
    };
    ShownImage { frame, peaks: None, stops: Vec::new() }
}

/// Returns the share of the samples in each bin. A sample counts for the whole interval of radiance that its code stands for, so that
/// the few codes of dark parts leave no gaps.
fn stops(frame: &Frame, (most, light): (f64, LightScale)) -> Vec<f32> {
    let step = (frame.height() * frame.width() * frame.channels()).div_ceil(LOOKED_AT).max(1);
    // A step that shares no divisor with the channels and, mostly, the width sees all of them.
    let step = step | 1;
    let mut bins = [0.0; BINS];
    let mut all = 0.0;
    let mut add = |sample: f64, count: f32| {
        let at = |sample: f64| {
            let radiance = light.radiance((sample / most).clamp(0.0, 1.0));
            ((radiance.log2() - LEAST_STOP) * BINS_OF_A_STOP).clamp(0.0, BINS as f64 - 1e-6)
        };
        let (from, to) = (at(sample), at(sample + 1.0));
        for (share, bin) in bins[from as usize..=to as usize].iter_mut().zip(from as usize..) {
            let inside = to.min(bin as f64 + 1.0) - from.max(bin as f64);
            *share += count * if to > from { (inside / (to - from)) as f32 } else { 1.0 };
        }
        all += count;
    };
    match frame.samples() {
        Samples::U8(codes) => {
            let mut counts = [0.0; 256];
            codes.iter().step_by(step).for_each(|&code| counts[usize::from(code)] += 1.0);
            counts.iter().enumerate().for_each(|(code, &count)| add(code as f64, count));
        }
        Samples::U16(codes) => codes.iter().step_by(step).for_each(|&code| add(code.into(), 1.0)),
        Samples::F32(values) => values.iter().step_by(step).for_each(|&value| add(value.into(), 1.0)),
    }
    bins.iter().map(|share| share / all).collect()
}

#[cfg(test)]
mod tests {
    use modulo_runtime::{SensorModel, StreamKind};
    use ndarray::Array3;

    use super::*;

    fn scale(kind: StreamKind, depth: u8) -> Option<StreamScale> {
        let sensor = SensorModel { alpha: 4.0, headroom: 1.0, ..SensorModel::default() };
        StreamScale::of(Some(kind), depth, Some(&sensor), 0)
    }

    #[test]
    fn a_stop_has_its_bin_and_all_shares_are_one() {
        // Codes 63 and 64 of the recovered image, whose 255 are two stops above the peak, are about the peak.
        let frame = Frame::from_u8(Array3::from_elem((40, 30, 3), 64)).expect("a frame");
        let shown = ShownImage::of(&frame, scale(StreamKind::Recovered, 8));
        let peak = (-LEAST_STOP * BINS_OF_A_STOP) as usize;
        assert!(shown.stops[peak] > 0.9, "{:?}", shown.stops);
        assert!((shown.stops.iter().sum::<f32>() - 1.0).abs() < 1e-4);
        assert_eq!(shown.peaks, Some(4.0));
        let black = Frame::from_u8(Array3::from_elem((4, 3, 1), 0)).expect("a frame");
        let stops = ShownImage::of(&black, scale(StreamKind::Recovered, 8)).stops;
        assert!((stops.iter().sum::<f32>() - 1.0).abs() < 1e-4 && stops[peak..].iter().all(|s| *s == 0.0));
    }

    #[test]
    fn an_image_of_16_bits_has_the_white_of_its_sensor_and_any_other_one_its_largest_sample() {
        let frame = Frame::from_u16(Array3::from_elem((4, 3, 1), 512)).expect("a frame");
        let shown = ShownImage::of(&frame, scale(StreamKind::Hdr, 16));
        assert_eq!((shown.peaks, shown.frame.to_f32()[[0, 0, 0]]), (Some(4.0), 188.0), "sRGB's half");
        let shown = ShownImage::of(&frame, None);
        assert_eq!((shown.peaks, shown.frame.to_f32()[[0, 0, 0]]), (None, 255.0));
    }
}
