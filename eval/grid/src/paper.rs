//! The steps of a frame before the detector as in the scripts of the paper: all of them ([`PaperSensor`],
//! `--protocol paper`), or their SPUD behind the sensor of the suite ([`published_spud`]).
//!
//! The nodes of the suite work differently. For the detector, values become 8 bits by truncation, not by rounding.

use modulo_bags::source::SourceFrame;
use modulo_core::unwrap::{Range, Recovered, Spud, ThresholdOn, Unwrap};
use modulo_core::{Frame, Psf, UnwrapError, optics, tone};
use modulo_runtime::{Context, SensorModel};
use ndarray::Array3;

use crate::GridError;
use crate::handed::{HandedFrame, Make};

/// The method of a cell with SPUD as the scripts of the paper have it: it takes the modulo image before quantisation, and
/// stretches phi over all channels from minimum to maximum, without congruence. `spud` takes the quantised image y, and
/// its result is y plus whole periods.
pub const SPUD_AS_PUBLISHED: &str = "spud_as_published";

/// Threshold of SPUD on phi, in units of the peak.
const TAU: f64 = 0.1;

/// SPUD on the exposures of `sensor` as the scripts of the paper apply it.
pub fn published_spud(sensor: &SensorModel) -> Result<Make, GridError> {
    let (sensor, mut spud) = (sensor.simulated()?, Spud::new(TAU, ThresholdOn::Phi)?);
    let range = sensor.range();
    Ok(Box::new(move |HandedFrame { frame, .. }, seed, _, cx| {
        let y = cx.stage("sense", || {
            let exposure = sensor.expose(frame.radiance.view(), seed)?;
            Ok::<_, GridError>(exposure.x().mapv(|x| x % range.peak()))
        })?;
        // The result has an arbitrary offset and scale, and therefore no wrap counts.
        cx.stage("unwrap", || bytes(&stretched(&spud.solve(y.view(), range)?)))
    }))
}

/// The images of the scripts of the paper, whose sensor has this alpha, and whose SPUD is that as published or made congruent.
pub fn maker(sensor: &SensorModel, as_published: bool) -> Result<Make, GridError> {
    let mut paper = PaperSensor::new(sensor, as_published)?;
    Ok(Box::new(move |HandedFrame { frame, .. }, _, stream, cx| paper.run(frame, stream, cx)))
}

/// Truncates to bytes, as the scripts convert an image for the detector.
fn bytes(image: &Array3<f32>) -> Result<Frame, GridError> {
    Ok(Frame::from_u8(image.mapv(|v| v as u8)).map_err(UnwrapError::from)?)
}

/// The sensor and the unwrapping.
pub struct PaperSensor {
    as_published: bool,
    range: Range,
    spud: Spud,
}

impl PaperSensor {
    /// The sensor. Its lens is always that of the paper.
    pub fn new(sensor: &SensorModel, as_published: bool) -> Result<Self, GridError> {
        Ok(Self { as_published, range: sensor.range()?, spud: Spud::new(TAU, ThresholdOn::Phi)? })
    }

    /// The image of `stream`.
    pub fn run(
        &mut self,
        frame: &SourceFrame,
        stream: &str,
        cx: &mut Context<'_>,
    ) -> Result<Frame, GridError> {
        let image = cx.stage("sense", || match stream {
            // The original frame in codes of 8 bits, without a lens.
            "ideal" => codes(frame),
            "saturated" => self.exposed(frame).mapv(|v| v.clamp(0.0, 1.0) * 255.0),
            _ => self.exposed(frame).mapv(wrapped),
        });
        bytes(&match stream {
            "recovered" => cx.stage("unwrap", || self.recovered(&image))?,
            "modulo" => image.mapv(|v| v * 255.0),
            _ => image,
        })
    }

    /// `alpha * blurred` of the stretched image in [0, 1]. The blur comes before the scaling.
    fn exposed(&self, frame: &SourceFrame) -> Array3<f32> {
        let alpha = self.range.alpha() as f32;
        // The scripts stretch each image to 0..255 and truncate it to whole codes before anything else. They blur it
        // with seven taps, sigma 1.4 px, before they multiply it by alpha. The text of the paper does not mention the
        // blur.
        let x = stretched(&codes(frame)).mapv(|v| v / 255.0);
        optics::blurred(x, Psf::Paper7).mapv(|v| v * alpha)
    }

    /// Unwraps the modulo image `y` in units of the peak, by SPUD as published or made congruent.
    fn recovered(&mut self, y: &Array3<f32>) -> Result<Array3<f32>, GridError> {
        // SPUD of the scripts gets the float image in units of the peak. `Spud` works in codes, and its threshold is in
        // units of the peak, so that scaling by the peak changes nothing.
        let peak = self.range.peak();
        let codes = y.mapv(|v| v * peak);
        if self.as_published {
            // The wrapped field is the gradient of x: phi is x without its mean, in code units.
            return Ok(stretched(&self.spud.solve(codes.view(), self.range)?));
        }
        // Q_b of eq. 1: whole codes, of which 2^b is 0.
        let y = Frame::from_u8(codes.mapv(|v| v as u32 as u8)).map_err(UnwrapError::from)?;
        let mut out = Recovered::default();
        self.spud.unwrap(&y, &self.range.into(), &mut out)?;
        Ok(tone::linear8(&out.x, self.range).map_err(UnwrapError::from)?.to_f32())
    }
}

/// The codes of 8 bits of the image file. Rounding takes away the dither of the source, which the scripts do not have.
fn codes(frame: &SourceFrame) -> Array3<f32> {
    frame.radiance.mapv(|v| (v * 255.0).round())
}

/// `mod(x, 1)`, except that a positive multiple of 1 gives 1.
fn wrapped(x: f32) -> f32 {
    // In the scripts, a positive multiple of the peak becomes the peak and not 0.
    let rest = x.rem_euclid(1.0);
    if rest == 0.0 && x > 0.0 { 1.0 } else { rest }
}

/// Maps minimum and maximum over all channels to 0 and 255 and truncates to whole steps. A constant image becomes 0.
fn stretched(values: &Array3<f32>) -> Array3<f32> {
    let low = f64::from(values.iter().copied().fold(f32::INFINITY, f32::min));
    let high = f64::from(values.iter().copied().fold(f32::NEG_INFINITY, f32::max));
    // The multiplication comes first, so that an image that spans 0 to 255 stays unchanged.
    let step = |v: f32| ((f64::from(v) - low) * 255.0 / (high - low)).floor();
    values.mapv(|v| if high > low { step(v) as f32 } else { 0.0 })
}

#[cfg(test)]
mod tests {
    use modulo_runtime::{ManualClock, SensorModel};

    use super::*;

    /// One row of grey codes of 8 bits.
    fn frame(codes: &[u8]) -> SourceFrame {
        let radiance = Array3::from_shape_fn((1, codes.len(), 1), |(_, x, _)| f32::from(codes[x]) / 255.0);
        let (name, frame_id) = (String::new(), String::new());
        SourceFrame { radiance, name, stamp_ns: None, frame_id, ground_truth: None }
    }

    fn sensor(alpha: f64, psf_sigma: f64) -> SensorModel {
        SensorModel { alpha, headroom: 1.0, psf_sigma, ..SensorModel::default() }
    }

    /// What `work` makes in a step.
    fn in_step<T>(work: impl FnOnce(&mut Context<'_>) -> T) -> T {
        work(&mut Context::new("/paper", &ManualClock::default(), &[]))
    }

    fn shown(stream: &str, alpha: f64, frame: &SourceFrame) -> Vec<u8> {
        shown_by(&mut PaperSensor::new(&sensor(alpha, 0.0), true).expect("possible"), stream, frame)
    }

    fn shown_by(paper: &mut PaperSensor, stream: &str, frame: &SourceFrame) -> Vec<u8> {
        let image = in_step(|cx| paper.run(frame, stream, cx)).expect("passed");
        image.as_u8().expect("8 bits").iter().copied().collect()
    }

    /// 0 on the left, the brightest on the right, flat in between and at the ends beyond the lens.
    fn steps(middle: u8) -> SourceFrame {
        frame(&[vec![0; 20], vec![middle; 20], vec![255; 20]].concat())
    }

    #[test]
    fn x_raw_is_stretched_over_all_channels_and_cut() {
        let values = Array3::from_shape_vec((1, 2, 3), vec![10.0, 11.0, 12.0, 13.0, 14.0, 20.0]).expect("6");
        let got: Vec<f32> = stretched(&values).iter().copied().collect();
        assert_eq!(got, [0.0, 25.0, 51.0, 76.0, 102.0, 255.0]);
        let all = frame(&(0..=255).collect::<Vec<u8>>());
        let same: Vec<f32> = (0u8..=255).map(f32::from).collect();
        assert_eq!(
            stretched(&all.radiance).iter().copied().collect::<Vec<_>>(),
            same,
            "what spans all stays"
        );
        assert!(stretched(&Array3::from_elem((2, 2, 3), 0.4)).iter().all(|v| *v == 0.0));
    }

    #[test]
    fn the_ideal_is_the_original_without_a_lens() {
        let codes: Vec<u8> = (0..60).map(|i| if i % 2 == 0 { 3 } else { 200 }).collect();
        assert_eq!(shown("ideal", 4.0, &frame(&codes)), codes);
    }

    #[test]
    fn the_blur_lies_before_the_scaling_and_the_clipping() {
        let got = shown("saturated", 2.0, &steps(0));
        // The step from 0 to 1 behind seven taps, doubled, then clipped: half of the way is above the peak already.
        let taps = [0.03125, 0.140625, 0.359375, 0.640625, 0.859375f64];
        let want: Vec<u8> = taps.map(|share| (2.0 * share * 255.0).min(255.0) as u8).to_vec();
        assert_eq!(got[37..42], want);
        assert_eq!((got[30], got[50]), (0, 255));
    }

    #[test]
    fn modulo_is_wrapped_in_float_and_cut_to_8_bits() {
        // 2.5 * 121 = 302.5 of 255: the rest is 47.5, which would be 48 if it were rounded.
        assert_eq!(shown("modulo", 2.5, &steps(121))[30], 47);
        let got = shown("modulo", 3.0, &steps(121));
        assert_eq!(got[50], 255, "three times the peak is the peak, not 0");
        assert_eq!(got[5], 0, "but nothing is nothing");
        assert_eq!([wrapped(0.0), wrapped(1.0), wrapped(1.25), wrapped(2.0)], [0.0, 1.0, 0.25, 1.0]);
    }

    #[test]
    fn what_spud_gives_is_stretched_over_all_channels() {
        let radiance = Array3::from_shape_fn((32, 256, 3), |(_, x, _)| x as f32 / 256.0);
        let ramp = SourceFrame { radiance, ..frame(&[0]) };
        let got = shown("recovered", 1.5, &ramp);
        let row: Vec<u8> = (0..256).map(|x| got[(16 * 256 + x) * 3]).collect();
        assert_eq!((got.iter().min(), got.iter().max()), (Some(&0), Some(&255)), "minimum and maximum");
        // The lens bends the ends of the ramp, and tau takes small cosines away.
        let near = |x: usize| (i32::from(row[x]) - x as i32).abs() <= 4;
        assert!((0..256).all(near), "{row:?}");
    }

    #[test]
    fn spud_is_stretched_as_published_and_absolute_where_it_is_congruent() {
        let radiance = Array3::from_shape_fn((32, 256, 1), |(_, x, _)| x as f32 / 384.0);
        let ramp = SourceFrame { radiance: radiance.clone(), ..frame(&[0]) };
        let mut published = published_spud(&sensor(1.5, 1.4)).expect("possible");
        let handed = HandedFrame { place: 0, drive: 0, frame: ramp.clone(), around: None };
        let image = in_step(|cx| published(&handed, 0, "recovered", cx)).expect("passed");
        let brightest = |image: &[u8]| *image.iter().max().expect("pixels");
        assert_eq!(brightest(image.as_u8().expect("8 bits").as_slice().expect("in order")), 255);
        // The protocol of the paper stretches x itself, too: there, full scale is the brightest sample in both.
        let mut spud = PaperSensor::new(&sensor(1.5, 1.4), false).expect("possible");
        let congruent = shown_by(&mut spud, "recovered", &ramp);
        assert!((250..=255).contains(&brightest(&congruent)), "{}", brightest(&congruent));
        assert!(congruent[16 * 256] <= 5, "an absolute level, found by the darkest pixels");
    }

    #[test]
    fn spud_sees_less_than_a_code() {
        let mut way = PaperSensor::new(&sensor(1.5, 0.0), true).expect("possible");
        // Half a code from left to right, hidden from 8 bits; tau would drop it, so that the ramp is large in all.
        let y = Array3::from_shape_fn((64, 64, 1), |(_, x, _)| 0.1 + x as f32 / 64.0 * 0.5 / 256.0);
        way.spud = Spud::new(0.0, ThresholdOn::Phi).expect("possible");
        let got = way.recovered(&y).expect("recovered");
        assert!(got[(32, 60, 0)] > got[(32, 30, 0)] && got[(32, 30, 0)] > got[(32, 4, 0)]);
    }
}
