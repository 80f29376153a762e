//! [`StreamScale`]: how the samples of a stream stand for radiance.

use modulo_core::{DisplayCurve, Transfer};

use crate::sensor::parameters::SensorModel;

/// How the samples of a stream stand for radiance, in peaks of the sensor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StreamScale {
    transfer: Transfer,
    /// The largest sample.
    most: f64,
    /// The radiance of the largest sample, in peaks of the sensor.
    white: f64,
}

impl StreamScale {
    /// Returns the scale of the stream whose topic ends with the name `modulo`, `saturated`, `recovered`, `ideal` or `hdr`, of a
    /// camera with this sensor; `None` for any other topic.
    pub fn of(topic: &str, sensor: &SensorModel) -> Option<Self> {
        let white = sensor.headroom * sensor.alpha;
        let peak = f64::from(1_u32 << sensor.bits);
        let (transfer, most, white) = match topic.rsplit('/').next()? {
            "modulo" => (Transfer::Linear, peak - 1.0, 1.0),
            // Pixels of low gain show what is above the peak.
            "saturated" => (sensor.transfer, peak - 1.0, if sensor.gains.is_some() { white } else { 1.0 }),
            "recovered" | "ideal" => (sensor.transfer, 255.0, white),
            "hdr" => (Transfer::Linear, peak * white, white),
            _ => return None,
        };
        Some(Self { transfer, most, white })
    }

    /// Returns the largest sample; larger ones are clipped.
    pub fn most(self) -> f64 {
        self.most
    }

    /// Returns the radiance of the largest sample, in peaks of the sensor.
    pub fn white(self) -> f64 {
        self.white
    }

    /// Returns the radiance, in peaks of the sensor, of a sample divided by the largest one.
    pub fn radiance(self, code: f64) -> f64 {
        self.white * self.transfer.decode(code)
    }

    /// Returns the codes of 8 bits with which a screen shows the codes 0 to 255, where 255 is the largest sample.
    pub fn shown(self) -> [u8; 256] {
        let curve = DisplayCurve::of_white(self.white);
        std::array::from_fn(|code| (255.0 * curve.code(self.radiance(code as f64 / 255.0))).round() as u8)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_same_radiance_has_the_same_scale_in_each_stream() {
        let sensor = SensorModel { bits: 10, alpha: 4.0, headroom: 0.97, ..SensorModel::default() };
        let radiance = |topic: &str, sample: f64| {
            let scale = StreamScale::of(topic, &sensor).expect("a stream of the camera");
            scale.radiance(sample / scale.most())
        };
        // A quarter of the peak, as whole codes of each stream.
        for (topic, sample, tolerance) in [
            ("/modulo", 256.0, 1e-3),
            ("/front/saturated", 256.0, 1e-3),
            ("/recovered", 16.43, 1e-3),
            ("ideal", 16.43, 1e-3),
            ("/hdr", 256.0, 1e-9),
        ] {
            assert!(
                (radiance(topic, sample) - 0.25).abs() < tolerance,
                "{topic}: {}",
                radiance(topic, sample)
            );
        }
        assert_eq!(StreamScale::of("/confidence", &sensor), None);
    }

    #[test]
    fn a_saturated_image_ends_in_white_and_a_recovered_one_goes_on() {
        let sensor = SensorModel { alpha: 4.0, headroom: 1.0, ..SensorModel::default() };
        let shown = |topic| StreamScale::of(topic, &sensor).expect("a stream of the camera").shown();
        assert_eq!((shown("saturated")[255], shown("recovered")[255]), (255, 255));
        let at_peak = shown("recovered")[64];
        assert!((150..230).contains(&at_peak), "the peak is bright, but not white: {at_peak}");
    }
}
