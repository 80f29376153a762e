//! [`StreamScale`]: what the samples of a stream mean, which its [`StreamKind`] and the sensor tell.

use modulo_core::{DisplayCurve, Transfer};

use crate::sensor::parameters::SensorModel;

/// The bits of a sample of the pictures `recovered` and `ideal`, whatever the bits of the sensor.
const PICTURE: u8 = 8;

/// A stream whose samples a sensor description covers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StreamKind {
    /// The wrapped codes of the sensor.
    Modulo,
    /// Pictures of the recovered radiance, whose white is the end of the range.
    Recovered,
    /// Pictures of the recovered radiance, exposed anew.
    Metered,
    /// The codes of a normal sensor of the same exposure.
    Saturated,
    /// The codes of a normal camera with automatic exposure.
    AutoExposed,
    /// Pictures of the radiance itself, whose white is the end of the range.
    Ideal,
    /// The counts of the sensor beyond its peak.
    Hdr,
}

impl StreamKind {
    /// Each kind with the word that stands for it in descriptions, which is also the name that its node declares. The
    /// last one is not made for detectors.
    pub const WORDS: [(&'static str, Self); 7] = [
        ("modulo", Self::Modulo),
        ("recovered", Self::Recovered),
        ("metered", Self::Metered),
        ("saturated", Self::Saturated),
        ("auto_exposed", Self::AutoExposed),
        ("ideal", Self::Ideal),
        ("hdr", Self::Hdr),
    ];

    /// Returns the words of the streams for a detector, in the order in which they are listed.
    pub fn for_detectors() -> impl Iterator<Item = &'static str> {
        Self::WORDS.iter().filter(|(_, kind)| *kind != Self::Hdr).map(|(word, _)| *word)
    }

    /// Returns the kind that `word` stands for.
    pub fn of_word(word: &str) -> Option<Self> {
        Self::WORDS.iter().find(|(of_kind, _)| *of_kind == word).map(|(_, kind)| *kind)
    }

    /// Returns the word of this kind.
    pub fn word(self) -> &'static str {
        Self::WORDS.iter().find(|(_, kind)| *kind == self).expect("each kind has a word").0
    }
}

/// The meaning of the samples of an image: which one is white, and the radiance that they stand for. It belongs to the
/// stream of the image: the pictures of a sensor of 6 bits have 8.
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
    /// Returns the scale of an image of `depth` bits (8, 16, or 32 for floats) of the stream `kind`:
    ///
    /// - `recovered`, `metered` and `ideal` of 8 bits are pictures: their largest sample is 255. The exposure of
    ///   `metered` is that of its frame, so that nobody says which radiance its samples stand for.
    /// - `modulo`, `saturated` and `auto_exposed` have the codes of the converter, up to `2^bits - 1`, and `hdr` counts
    ///   up to `alpha * 2^bits` times the headroom. Nobody says which radiance the codes of a changing exposure stand
    ///   for. `bits` are those of `sensor`, the description of its camera, unless they are given here (0: not given).
    /// - An image of another kind (`None`), or without a description, has the `bits` that are given, else the whole
    ///   range of its encoding.
    ///
    /// The samples stand for radiance where a sensor describes one of these streams. `None` for floats of unknown
    /// range.
    pub fn of(kind: Option<StreamKind>, depth: u8, sensor: Option<&SensorModel>, bits: u8) -> Option<Self> {
        let peak_of = |bits: u8| f64::from(1_u32 << bits);
        let given = Some(bits).filter(|&bits| bits > 0);
        let codes = given.or(sensor.map(|sensor| sensor.bits)).map(|bits| peak_of(bits) - 1.0);
        let encoding = Some(depth).filter(|&depth| depth <= 16).map(|depth| peak_of(depth) - 1.0);
        let light = |white: fn(&SensorModel) -> LightScale| sensor.map(white);
        let (most, light) = match (kind, sensor) {
            (Some(StreamKind::Recovered | StreamKind::Ideal), _) if depth == PICTURE => {
                (encoding, light(LightScale::of_pictures))
            }
            (Some(StreamKind::Metered), _) if depth == PICTURE => (encoding, None),
            (Some(StreamKind::Modulo), _) => {
                (codes, light(|_| LightScale { transfer: Transfer::Linear, white: 1.0 }))
            }
            (Some(StreamKind::AutoExposed), _) => (codes, None),
            (Some(StreamKind::Saturated), _) => (codes, light(LightScale::of_saturated)),
            (Some(StreamKind::Hdr), Some(sensor)) => {
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

    fn light(kind: StreamKind, sensor: &SensorModel) -> LightScale {
        StreamScale::of(Some(kind), 8, Some(sensor), 0)
            .and_then(|scale| scale.light)
            .expect("a stream of the camera")
    }

    #[test]
    fn the_same_radiance_has_the_same_scale_in_each_stream() {
        let sensor = SensorModel { bits: 10, alpha: 4.0, headroom: 0.97, ..SensorModel::default() };
        let radiance = |kind, depth, sample: f64| {
            let scale = StreamScale::of(kind, depth, Some(&sensor), 0).expect("a scale");
            Some(scale.light?.radiance(sample / scale.most))
        };
        // A quarter of the peak, as whole codes of each stream.
        for (kind, depth, sample, tolerance) in [
            (StreamKind::Modulo, 16, 256.0, 1e-3),
            (StreamKind::Saturated, 16, 256.0, 1e-3),
            (StreamKind::Recovered, 8, 16.43, 1e-3),
            (StreamKind::Ideal, 8, 16.43, 1e-3),
            (StreamKind::Hdr, 16, 256.0, 1e-9),
            (StreamKind::Hdr, 32, 256.0, 1e-9),
        ] {
            let got = radiance(Some(kind), depth, sample).expect("a stream of the camera");
            assert!((got - 0.25).abs() < tolerance, "{kind:?}: {got}");
        }
        assert_eq!(radiance(None, 8, 1.0), None);
    }

    /// The bits of a sensor are those of its codes alone, at any number of bits, and the parameter of a reader changes
    /// no more.
    #[test]
    fn pictures_have_8_bits_and_codes_those_of_the_sensor() {
        for bits in 1..=16 {
            let sensor = SensorModel { bits, alpha: 4.0, headroom: 1.0, ..SensorModel::default() };
            let depth = if bits <= 8 { 8 } else { 16 };
            let most = |kind, depth, sensor, given| {
                StreamScale::of(kind, depth, sensor, given).map(|scale| (scale.most, scale.bits()))
            };
            let codes = Some((f64::from((1_u32 << bits) - 1), bits));
            let other = SensorModel::default();
            for (sensor, given) in [(Some(&sensor), 0), (None, bits), (Some(&other), bits)] {
                assert_eq!(most(Some(StreamKind::Recovered), 8, sensor, given), Some((255.0, 8)), "{bits}");
                assert_eq!(most(Some(StreamKind::Ideal), 8, sensor, given), Some((255.0, 8)), "{bits}");
                assert_eq!(most(Some(StreamKind::Modulo), depth, sensor, given), codes);
                assert_eq!(most(Some(StreamKind::Saturated), depth, sensor, given), codes);
            }
            let hdr = f64::from(4 << bits);
            assert_eq!(most(Some(StreamKind::Hdr), 32, Some(&sensor), 0), Some((hdr, bits + 3)));
            // Of another topic, a description says nothing: it may be what the camera has sensed.
            assert_eq!(most(None, depth, None, bits), codes);
            assert_eq!(most(None, 8, Some(&sensor), 0), Some((255.0, 8)));
            assert_eq!(most(None, 16, Some(&sensor), 0), Some((65535.0, 16)));
        }
        assert_eq!(StreamScale::of(None, 32, None, 0), None, "floats have no range of their own");
    }

    #[test]
    fn a_saturated_image_ends_in_white_and_a_recovered_one_goes_on() {
        let sensor = SensorModel { alpha: 4.0, headroom: 1.0, ..SensorModel::default() };
        let shown = |kind| light(kind, &sensor).shown();
        assert_eq!((shown(StreamKind::Saturated)[255], shown(StreamKind::Recovered)[255]), (255, 255));
        let at_peak = shown(StreamKind::Recovered)[64];
        assert!((150..230).contains(&at_peak), "the peak is bright, but not white: {at_peak}");
    }
}
