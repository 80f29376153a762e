//! [`StreamScale`]: what the samples of a stream mean.

use modulo_core::{DisplayCurve, Transfer};

use crate::sensor::parameters::SensorModel;

/// The bits of a sample of the pictures `recovered` and `ideal`, whatever the bits of the sensor.
const PICTURE: u8 = 8;

/// What the samples of an image mean: which one is white, and the radiance that they stand for. It belongs to the stream of the image:
/// the pictures of a sensor of 6 bits have 8.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StreamScale {
    /// The largest sample, which is white; larger ones are clipped.
    pub most: f64,
    /// How the samples stand for radiance, if that is known.
    pub light: Option<LightScale>,
}

/// How the samples of a stream stand for radiance, in peaks of the sensor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LightScale {
    transfer: Transfer,
    /// The radiance of the largest sample, in peaks of the sensor.
    pub white: f64,
}

impl StreamScale {
    /// The last parts of the names of the topics of images for a detector, which a sensor description covers.
    pub const STREAMS: [&str; 6] = ["modulo", "recovered", "metered", "saturated", "auto_exposed", "ideal"];

    /// Returns whether a sensor description covers the samples of the topics whose names end so.
    pub fn covers(name: &str) -> bool {
        name == "hdr" || Self::STREAMS.contains(&name)
    }

    /// Returns the scale of an image of `depth` bits (8, 16, or 32 for floats) on `topic`, the last part of whose name tells the stream:
    ///
    /// - `recovered`, `metered` and `ideal` of 8 bits are pictures: their largest sample is 255. The exposure of `metered` is that of its frame, so
    ///   that nobody says which radiance its samples stand for.
    /// - `modulo`, `saturated` and `auto_exposed` have the codes of the converter, up to `2^bits - 1`, and `hdr` counts up to
    ///   `alpha * 2^bits` times the headroom. Nobody says which radiance the codes of a changing exposure stand for. `bits` are those of `sensor`, the description of its camera, unless they are given here (0: not given).
    /// - An image of another name, or without a description, has the `bits` that are given, else the whole range of its encoding.
    ///
    /// The samples stand for radiance where a sensor describes one of these streams. `None` for floats of unknown range.
    pub fn of(topic: &str, depth: u8, sensor: Option<&SensorModel>, bits: u8) -> Option<Self> {
        let peak_of = |bits: u8| f64::from(1_u32 << bits);
        let given = Some(bits).filter(|&bits| bits > 0);
        let codes = given.or(sensor.map(|sensor| sensor.bits)).map(|bits| peak_of(bits) - 1.0);
        let encoding = Some(depth).filter(|&depth| depth <= 16).map(|depth| peak_of(depth) - 1.0);
        let light = |white: fn(&SensorModel) -> LightScale| sensor.map(white);
        let (most, light) = match (topic.rsplit('/').next(), sensor) {
            (Some("recovered" | "ideal"), _) if depth == PICTURE => {
                (encoding, light(LightScale::of_pictures))
            }
            (Some("metered"), _) if depth == PICTURE => (encoding, None),
            (Some("modulo"), _) => (codes, light(|_| LightScale { transfer: Transfer::Linear, white: 1.0 })),
            (Some("auto_exposed"), _) => (codes, None),
            (Some("saturated"), _) => (codes, light(LightScale::of_saturated)),
            (Some("hdr"), Some(sensor)) => {
                let light = LightScale { transfer: Transfer::Linear, ..LightScale::of_pictures(sensor) };
                (codes.map(|most| (most + 1.0) * light.white), Some(light))
            }
            _ => (given.map(|bits| peak_of(bits) - 1.0), None),
        };
        // No integer is above its encoding, whatever a description says.
        let most = match (most, encoding) {
            (Some(most), Some(encoding)) => most.min(encoding),
            (most, encoding) => most.or(encoding)?,
        };
        Some(Self { most, light })
    }

    /// Returns the bits that the largest sample needs.
    pub fn bits(self) -> u8 {
        (self.most + 1.0).log2().ceil() as u8
    }
}

impl LightScale {
    fn of_pictures(sensor: &SensorModel) -> Self {
        Self { transfer: sensor.transfer, white: sensor.headroom * sensor.alpha }
    }

    fn of_saturated(sensor: &SensorModel) -> Self {
        let pictures = Self::of_pictures(sensor);
        // Pixels of low gain show what is above the peak.
        if sensor.gains { pictures } else { Self { white: 1.0, ..pictures } }
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

    fn light(topic: &str, sensor: &SensorModel) -> LightScale {
        StreamScale::of(topic, 8, Some(sensor), 0)
            .and_then(|scale| scale.light)
            .expect("a stream of the camera")
    }

    #[test]
    fn the_same_radiance_has_the_same_scale_in_each_stream() {
        let sensor = SensorModel { bits: 10, alpha: 4.0, headroom: 0.97, ..SensorModel::default() };
        let radiance = |topic: &str, depth, sample: f64| {
            let scale = StreamScale::of(topic, depth, Some(&sensor), 0).expect("a scale");
            Some(scale.light?.radiance(sample / scale.most))
        };
        // A quarter of the peak, as whole codes of each stream.
        for (topic, depth, sample, tolerance) in [
            ("/modulo", 16, 256.0, 1e-3),
            ("/front/saturated", 16, 256.0, 1e-3),
            ("/recovered", 8, 16.43, 1e-3),
            ("ideal", 8, 16.43, 1e-3),
            ("/hdr", 16, 256.0, 1e-9),
            ("/hdr", 32, 256.0, 1e-9),
        ] {
            let got = radiance(topic, depth, sample).expect("a stream of the camera");
            assert!((got - 0.25).abs() < tolerance, "{topic}: {got}");
        }
        assert_eq!(radiance("/confidence", 8, 1.0), None);
    }

    /// The bits of a sensor are those of its codes alone, at any number of bits, and the parameter of a reader changes no more.
    #[test]
    fn pictures_have_8_bits_and_codes_those_of_the_sensor() {
        for bits in 1..=16 {
            let sensor = SensorModel { bits, alpha: 4.0, headroom: 1.0, ..SensorModel::default() };
            let depth = if bits <= 8 { 8 } else { 16 };
            let most = |topic, depth, sensor, given| {
                StreamScale::of(topic, depth, sensor, given).map(|scale| (scale.most, scale.bits()))
            };
            let codes = Some((f64::from((1_u32 << bits) - 1), bits));
            let other = SensorModel::default();
            for (sensor, given) in [(Some(&sensor), 0), (None, bits), (Some(&other), bits)] {
                assert_eq!(most("/recovered", 8, sensor, given), Some((255.0, 8)), "{bits}");
                assert_eq!(most("front/ideal", 8, sensor, given), Some((255.0, 8)), "{bits}");
                assert_eq!(most("modulo", depth, sensor, given), codes);
                assert_eq!(most("/saturated", depth, sensor, given), codes);
            }
            let hdr = f64::from(4 << bits);
            assert_eq!(most("/hdr", 32, Some(&sensor), 0), Some((hdr, bits + 3)));
            // Of another topic, a description says nothing: it may be what the camera has sensed.
            assert_eq!(most("/camera/image_raw", depth, None, bits), codes);
            assert_eq!(most("/camera/image_raw", 8, Some(&sensor), 0), Some((255.0, 8)));
            assert_eq!(most("/camera/image_raw", 16, Some(&sensor), 0), Some((65535.0, 16)));
        }
        assert_eq!(StreamScale::of("/image", 32, None, 0), None, "floats have no range of their own");
    }

    #[test]
    fn a_saturated_image_ends_in_white_and_a_recovered_one_goes_on() {
        let sensor = SensorModel { alpha: 4.0, headroom: 1.0, ..SensorModel::default() };
        let shown = |topic| light(topic, &sensor).shown();
        assert_eq!((shown("saturated")[255], shown("recovered")[255]), (255, 255));
        let at_peak = shown("recovered")[64];
        assert!((150..230).contains(&at_peak), "the peak is bright, but not white: {at_peak}");
    }
}
