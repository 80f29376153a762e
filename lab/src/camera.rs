//! The cameras that want to see a high dynamic range, as simulated chips: what each reads of a scene, and the radiance
//! that follows from it.
//!
//! All see the same scene through the same lens. No exposure takes longer than that of the modulo sensor, and the full
//! well and the read noise are those of the modulo sensor; what differs stands at each [`Kind`].

#[path = "bracket.rs"]
mod bracket;

use bracket::Bracket;
use modulo_core::unwrap::{Method, Options};
use modulo_core::{
    AutoExposure, Exposure, ExposureControl, Frame, Gains, Metering, Psf, Range, Recovered, Sensor,
    SensorConfig, SensorError, Transfer, TwoGains, Unwrap, exposed_anew, tone,
};
use ndarray::{Array3, Zip};

/// The number of captures that are merged.
pub const CAPTURES: usize = 3;

/// The picture whose white is the end of the range, or the full well of a camera with a fixed exposure.
pub const FIXED_WHITE: &str = "fixed_white";
/// The picture whose exposure is chosen from the image: after the capture, but before it in a camera with automatic
/// exposure.
pub const METERED: &str = "metered";

/// The goal of the metering, the middle grey of photography, and the largest factor between two exposures, both the
/// defaults of the suite.
const TARGET: f64 = 0.18;
const STEP: f64 = 2.0;

/// The bits of the modulo sensor and of a normal camera.
const BITS: u8 = 8;
/// The step of the converters of two gains at one pixel, of 12 bits for a full well, in code units.
const FINE_STEP: f32 = 1.0 / 16.0;
/// The light of the small photodiode of a split pixel over that of the large one.
const SMALL: f64 = 1.0 / 16.0;
/// The steps of a linear image of 20 bits over the whole range.
const LINEAR: f32 = (1 << 20) as f32;

/// Knee points of an automotive sensor that sends 20 bits as 12 (AR0820): codes, and the linear values that they stand
/// for.
const KNEES_12: [(f32, f32); 13] = [
    (0.0, 0.0),
    (512.0, 512.0),
    (1024.0, 1024.0),
    (2048.0, 2048.0),
    (2080.0, 4096.0),
    (2144.0, 8192.0),
    (2272.0, 16384.0),
    (2528.0, 32768.0),
    (3040.0, 65536.0),
    (3104.0, 131_072.0),
    (3232.0, 262_144.0),
    (3488.0, 524_288.0),
    (4000.0, LINEAR),
];

/// A camera, with what its link carries.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rival {
    /// The name, also of its folder.
    pub name: &'static str,
    /// The bits that are read for a pixel and frame; 0 for the perfect camera.
    pub bits: usize,
    /// The captures of a frame.
    pub captures: usize,
    kind: Kind,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Kind {
    /// No wrap, no end of the range.
    Ideal,
    /// A fixed exposure that clips at the full well.
    Fixed,
    /// An exposure that follows the frames with this delay.
    Auto(usize),
    /// Every second pixel has a lower gain; the others clip, and are predicted there.
    TwoGains,
    /// Three exposures one after the other, or of a scene that stands still.
    Captures { is_still: bool },
    /// The charge of a pixel is read with two gains, the lower one of `1 / alpha` where a capacitor takes what
    /// overflows (LOFIC), each with the read noise of its converter.
    Overflow(Link),
    /// A pixel has a large and a small photodiode of [`SMALL`] of the light; the small one is read where the large one
    /// is full.
    Split,
    /// Each pixel wraps; `auto` counts the wraps, or with two gains their neighbours.
    Modulo { has_two_gains: bool },
}

/// The form in which a linear image of 20 bits is sent.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Link {
    Linear,
    /// 12 bits by [`KNEES_12`].
    Knees12,
    /// 8 bits by eight lines near a square root, whose steps are below the shot noise.
    Root8,
}

const fn rival(name: &'static str, bits: usize, captures: usize, kind: Kind) -> Rival {
    Rival { name, bits, captures, kind }
}

/// All cameras.
pub const RIVALS: [Rival; 14] = [
    rival("ideal", 0, 1, Kind::Ideal),
    rival("fixed", 8, 1, Kind::Fixed),
    rival("auto_delay_1", 8, 1, Kind::Auto(1)),
    rival("auto_delay_2", 8, 1, Kind::Auto(2)),
    rival("auto_delay_3", 8, 1, Kind::Auto(3)),
    rival("two_gains_saturating", 8, 1, Kind::TwoGains),
    rival("captures_moving", 24, CAPTURES, Kind::Captures { is_still: false }),
    rival("captures_still", 24, CAPTURES, Kind::Captures { is_still: true }),
    rival("overflow_20_bits", 20, 1, Kind::Overflow(Link::Linear)),
    rival("overflow_companded_12", 12, 1, Kind::Overflow(Link::Knees12)),
    rival("overflow_companded_8", 8, 1, Kind::Overflow(Link::Root8)),
    rival("split_pixel_20_bits", 20, 1, Kind::Split),
    rival("modulo", 8, 1, Kind::Modulo { has_two_gains: false }),
    rival("modulo_two_gains", 8, 1, Kind::Modulo { has_two_gains: true }),
];

/// The radiance and the pictures that a camera has of a frame.
pub struct Seen {
    /// Its radiance, H x W x C in code units of the modulo sensor, rounded down as a converter does.
    pub x: Array3<f32>,
    /// The samples that were read at the end of their range: what is brighter reads the same.
    pub clipped: Array3<bool>,
    /// The pictures for a detector with their names.
    pub pictures: Vec<(&'static str, Frame)>,
}

/// The modulo sensor, which is the measure of all others.
#[derive(Clone, Copy)]
pub struct Chip {
    config: SensorConfig,
    range: Range,
}

impl Chip {
    /// Makes the chip. `full_well_electrons` fill the codes of one period; 0: without shot noise.
    pub fn new(
        alpha: f64,
        headroom: f64,
        psf_sigma: f64,
        full_well_electrons: f64,
        read_noise: f64,
    ) -> anyhow::Result<Self> {
        let shot_noise =
            if full_well_electrons > 0.0 { f64::from(BITS).exp2() / full_well_electrons } else { 0.0 };
        let psf = Psf::of_sigma(psf_sigma);
        let config =
            SensorConfig { bits: BITS, alpha, headroom, psf, read_noise, shot_noise, ..SensorConfig::PLAIN };
        Ok(Self { config, range: Sensor::new(config)?.range() })
    }

    /// Returns the end of one period, and the radiance of white, in code units.
    pub fn peak_and_white(&self) -> (f32, f32) {
        (self.range.peak(), self.range.white() as f32)
    }

    /// Returns the radiance of a scene without noise and without a converter.
    pub fn truth(&self, scene: &Array3<f32>) -> anyhow::Result<Array3<f32>> {
        let config = SensorConfig { read_noise: 0.0, shot_noise: 0.0, ..self.config };
        Ok(Sensor::new(config)?.expose(scene.view(), 0)?.x().clone())
    }

    /// Makes a camera that has seen no frame.
    pub fn camera(&self, rival: Rival) -> anyhow::Result<Camera> {
        let config = self.config;
        let sensor = |config| Sensor::new(config);
        let two_gains = SensorConfig { gains: Gains::checkerboard(config.alpha), ..config };
        let eye = match rival.kind {
            Kind::Ideal => Eye::Ideal(sensor(config)?),
            Kind::Fixed => Eye::Normal(sensor(config)?),
            Kind::Auto(delay) => {
                let control = ExposureControl { metering: Metering::Mean, target: TARGET, delay, step: STEP };
                Eye::Auto(AutoExposure::new(config, control)?)
            }
            Kind::TwoGains => Eye::Normal(sensor(two_gains)?),
            Kind::Captures { is_still } => self.bracketed(is_still)?,
            Kind::Overflow(link) => {
                Eye::Switched(self.switched(config.alpha.recip().min(1.0), 1.0)?, self.knees(link))
            }
            Kind::Split => Eye::Switched(self.switched(SMALL, SMALL)?, None),
            Kind::Modulo { has_two_gains } => {
                let config = if has_two_gains { two_gains } else { config };
                let of_gains = TwoGains::new(config.gains).map(|method| Box::new(method) as Box<dyn Unwrap>);
                let method = of_gains.map_or_else(|| Method::Auto.build(&Options::default()), Ok)?;
                Eye::Modulo(sensor(config)?, method, Recovered::default())
            }
        };
        // The white of a camera with a fixed exposure is its own full well.
        let range = if rival.kind == Kind::Fixed { Range::new(BITS, 1.0)? } else { self.range };
        Ok(Camera { range, eye })
    }

    fn bracketed(&self, is_still: bool) -> Result<Eye, SensorError> {
        let (bracket, config) = (Bracket::new(self.range, CAPTURES), self.config);
        // An exposure of a fraction of the time sees that fraction of the light, as if alpha were so much smaller.
        let of_time =
            |time: &f32| Sensor::new(SensorConfig { alpha: config.alpha * f64::from(*time), ..config });
        let sensors = bracket.times().iter().map(of_time).collect::<Result<_, _>>()?;
        Ok(Eye::Captures { bracket, sensors, is_still })
    }

    /// Returns the two readings of a pixel: that of the full well, and one of a lower `gain`, whose photodiode gets
    /// this share of the `light`.
    fn switched(&self, gain: f64, light: f64) -> Result<Switched, SensorError> {
        let SensorConfig { read_noise, shot_noise, .. } = self.config;
        let (read_noise, shot_noise) = (read_noise / gain, shot_noise / light);
        Ok(Switched {
            high: Sensor::new(self.config)?,
            low: Sensor::new(SensorConfig { read_noise, shot_noise, ..self.config })?,
            low_step: FINE_STEP / gain as f32,
        })
    }

    fn knees(&self, link: Link) -> Option<Knees> {
        let limit = self.range.limit() as f32;
        let points = match link {
            Link::Linear => return None,
            Link::Knees12 => KNEES_12.map(|(code, value)| (code, value / LINEAR * limit)).to_vec(),
            Link::Root8 => (0..=8u8).map(f32::from).map(|n| (32.0 * n, (n / 8.0).powi(2) * limit)).collect(),
        };
        Some(Knees(points))
    }
}

/// A camera, which may remember the frames before.
pub struct Camera {
    /// The range whose white is the white of its pictures.
    range: Range,
    eye: Eye,
}

enum Eye {
    Ideal(Sensor),
    Normal(Sensor),
    Auto(AutoExposure),
    Captures { bracket: Bracket, sensors: Vec<Sensor>, is_still: bool },
    Switched(Switched, Option<Knees>),
    Modulo(Sensor, Box<dyn Unwrap>, Recovered),
}

impl Camera {
    /// Takes a frame: the scenes before, at, and after its time.
    pub fn see(&mut self, scenes: [&Array3<f32>; CAPTURES], seed: u64) -> anyhow::Result<Seen> {
        let mut seen = self.read(scenes, seed)?;
        if seen.pictures.is_empty() {
            let metered = exposed_anew(&seen.x, self.range, Metering::Mean, TARGET);
            let picture = |range| tone::picture(&seen.x, range, Transfer::Linear);
            seen.pictures = vec![(FIXED_WHITE, picture(self.range)?), (METERED, picture(metered)?)];
        }
        Ok(seen)
    }

    /// Returns the radiance, and the picture of a camera that has exposed for it.
    fn read(&mut self, scenes: [&Array3<f32>; CAPTURES], seed: u64) -> anyhow::Result<Seen> {
        let (now, most) = (scenes[1].view(), self.range.peak() - 1.0);
        let whole =
            |x: Array3<f32>| Seen { clipped: Array3::from_elem(x.dim(), false), x, pictures: Vec::new() };
        Ok(match &mut self.eye {
            Eye::Ideal(sensor) => whole(sensor.expose(now, seed)?.x().mapv(f32::floor)),
            Eye::Normal(sensor) => {
                let exposure = sensor.expose(now, seed)?;
                Seen { clipped: full(&exposure, most), ..whole(exposure.saturated_radiance()) }
            }
            Eye::Auto(camera) => seen_by(camera, scenes[1], seed)?,
            Eye::Captures { bracket, sensors, is_still } => {
                let scenes = if *is_still { [scenes[1]; CAPTURES] } else { scenes };
                let captures = captures(sensors, scenes, seed)?;
                let clipped = captures[0].to_f32().mapv(|code| code >= most);
                // The merging takes a code for its middle.
                Seen { clipped, ..whole(bracket.merge(&captures)?.mapv_into(|x| x - 0.5)) }
            }
            Eye::Switched(switched, knees) => {
                let x = switched.read(scenes[1], seed, self.range)?;
                let returned = |x| knees.as_ref().map_or(x, |knees| knees.returned(x + 0.5) - 0.5);
                whole(x.mapv_into(returned))
            }
            Eye::Modulo(sensor, method, recovered) => {
                let exposure = sensor.expose(now, seed)?;
                method.unwrap(&exposure.modulo(), &exposure.scene(), recovered)?;
                whole(recovered.x.clone())
            }
        })
    }
}

/// Takes a frame with automatic exposure, which is the picture of this camera.
fn seen_by(camera: &mut AutoExposure, scene: &Array3<f32>, seed: u64) -> anyhow::Result<Seen> {
    let picture = camera.expose(scene.view(), seed)?;
    let exposure = camera.exposure().unwrap_or(1.0) as f32;
    let (time, gain) = (exposure.min(1.0), exposure.max(1.0));
    let codes = picture.to_f32();
    let most = f32::from(u8::MAX);
    let x = codes.mapv(|code| (code / gain + 0.5) / time - 0.5);
    Ok(Seen { x, clipped: codes.mapv(|code| code >= most), pictures: vec![(METERED, picture)] })
}

/// Returns the samples of full gain that reach the end of their codes.
fn full(exposure: &Exposure, most: f32) -> Array3<bool> {
    let mut clipped = exposure.x().mapv(|x| x.floor() >= most);
    for ((row, column, _), is_clipped) in clipped.indexed_iter_mut() {
        *is_clipped &= exposure.gain(row, column) == 1.0;
    }
    clipped
}

fn captures(
    sensors: &[Sensor],
    scenes: [&Array3<f32>; CAPTURES],
    seed: u64,
) -> Result<Vec<Frame>, SensorError> {
    let capture = |(index, (sensor, scene)): (u64, (&Sensor, &Array3<f32>))| {
        Ok(sensor.expose(scene.view(), of_reading(seed, index))?.saturated())
    };
    (0..).zip(sensors.iter().zip(scenes)).map(capture).collect()
}

/// Returns the seed of one reading of a frame. The upper bits keep it apart from those of the following frames.
fn of_reading(seed: u64, index: u64) -> u64 {
    seed.wrapping_add(index << 48)
}

/// Two readings of one pixel, of which the less sensitive one is taken where the other is full.
struct Switched {
    high: Sensor,
    low: Sensor,
    /// The step of the converter of the lower gain, in code units.
    low_step: f32,
}

impl Switched {
    /// Returns the radiance of a scene in steps of 20 bits, half a code unit too low on average as that of a converter
    /// that rounds down.
    fn read(&self, scene: &Array3<f32>, seed: u64, range: Range) -> Result<Array3<f32>, SensorError> {
        let expose = |sensor: &Sensor, index| sensor.expose(scene.view(), of_reading(seed, index));
        let (high, low) = (expose(&self.high, 0)?, expose(&self.low, 1)?);
        let (most, step) = (range.peak() - FINE_STEP, range.limit() as f32 / LINEAR);
        let middle = |x: f32, step: f32| ((x / step).floor() + 0.5) * step;
        Ok(Zip::from(high.x()).and(low.x()).map_collect(|&high, &low| {
            let x = if high < most { middle(high, FINE_STEP) } else { middle(low, self.low_step) };
            middle(x, step) - 0.5
        }))
    }
}

/// The knee points of companded codes: codes, and radiance in code units, both ascending from 0.
struct Knees(Vec<(f32, f32)>);

impl Knees {
    /// Returns the radiance of the code that is sent for the radiance `x`.
    fn returned(&self, x: f32) -> f32 {
        let last = self.0.len() - 1;
        let at = self.0.partition_point(|point| point.1 <= x).clamp(1, last);
        let [(code, value), (next_code, next_value)] = [self.0[at - 1], self.0[at]];
        let slope = (next_value - value) / (next_code - code);
        let most = next_code - code - 1.0;
        value + (((x - value) / slope).floor().clamp(0.0, most) + 0.5) * slope
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// Returns the largest distance between a still scene and the estimate of a camera without noise, in code units.
    fn step(rival: Rival, x: f32, alpha: f32) -> f32 {
        match rival.kind {
            Kind::Captures { .. } => CAPTURES as f32 * alpha,
            Kind::Overflow(Link::Root8) => (0.5 + x / (256.0 * alpha)).min(1.0) * alpha,
            // A thousandth of the range, half of the longest step.
            Kind::Overflow(Link::Knees12) => 0.25 * alpha,
            Kind::Overflow(Link::Linear) => FINE_STEP * alpha,
            // A pixel of low gain has a step of alpha; what clips is predicted from such pixels around.
            Kind::TwoGains | Kind::Modulo { has_two_gains: true } => alpha,
            _ => 1.0,
        }
    }

    fn is_exact_in_any_scene(rival: &Rival) -> bool {
        !matches!(rival.kind, Kind::Fixed | Kind::Auto(_) | Kind::TwoGains | Kind::Modulo { .. })
    }

    /// Returns the radiance that a camera without noise sees, and that of the scene.
    fn seen(rival: Rival, scene: &Array3<f32>, alpha: f64) -> (Seen, Array3<f32>) {
        let chip = Chip::new(alpha, 1.0, 0.0, 0.0, 0.0).expect("a chip");
        let seen = chip.camera(rival).expect("a camera").see([scene; CAPTURES], 0).expect("a frame");
        (seen, chip.truth(scene).expect("the truth"))
    }

    #[test]
    fn a_smooth_scene_is_found_by_every_camera_of_the_range() {
        let scene = Array3::from_shape_fn((24, 128, 3), |(_, column, _)| column as f32 / 130.0);
        for rival in RIVALS.iter().filter(|rival| !matches!(rival.kind, Kind::Fixed | Kind::Auto(_))) {
            let (seen, truth) = seen(*rival, &scene, 4.0);
            for (x, truth) in seen.x.iter().zip(&truth) {
                // A ramp is predicted exactly but at its ends.
                let largest = step(*rival, *truth, 4.0) + 8.0 * f32::from(rival.kind == Kind::TwoGains);
                assert!((x + 0.5 - truth).abs() <= largest, "{}: {x} for {truth}", rival.name);
            }
        }
    }

    #[test]
    fn what_is_brighter_than_the_full_well_is_clipped_in_a_normal_camera_only() {
        let scene = Array3::from_shape_fn((8, 32, 3), |(_, column, _)| if column < 16 { 0.2 } else { 0.9 });
        for rival in RIVALS {
            let (seen, _) = seen(rival, &scene, 4.0);
            let clipped = seen.clipped.iter().filter(|is_clipped| **is_clipped).count();
            let expected = match rival.kind {
                Kind::Fixed => 8 * 16 * 3,
                Kind::TwoGains => 8 * 8 * 3,
                // It has settled before the first frame, with some highlights left.
                Kind::Auto(_) => continue,
                _ => 0,
            };
            assert_eq!(clipped, expected, "{}", rival.name);
        }
    }

    #[test]
    fn the_light_of_a_camera_with_automatic_exposure_is_that_of_the_scene() {
        let scene = Array3::from_elem((8, 8, 3), 0.3);
        let (seen, truth) = seen(RIVALS[2], &scene, 4.0);
        let step = 1024.0 * 0.3 / (0.18 * 255.0);
        assert!(seen.x.iter().zip(&truth).all(|(x, truth)| (x + 0.5 - truth).abs() <= step));
        assert_eq!(seen.pictures.len(), 1);
    }

    #[test]
    fn two_gains_at_one_pixel_are_noisier_above_the_switch() {
        let noise = |name: &str, level: f32| {
            let chip = Chip::new(4.0, 1.0, 0.0, 10_000.0, 0.5).expect("a chip");
            let rival = *RIVALS.iter().find(|rival| rival.name == name).expect("a rival");
            let scene = Array3::from_elem((64, 64, 3), level / 1024.0);
            let seen = chip.camera(rival).expect("a camera").see([&scene; CAPTURES], 7).expect("a frame");
            f64::from(seen.x.mapv(|x| (x + 0.5 - level).powi(2)).mean().expect("samples").sqrt())
        };
        // In electrons: the root of the shot noise and the read noise; 39.0625 electrons are a code.
        let expected = |read: f64, light: f64, level: f64| {
            ((level * 39.0625 / light) + (read * 39.0625).powi(2)).sqrt() / 39.0625
        };
        for (name, below, above) in [
            ("overflow_20_bits", (0.5, 1.0), (2.0, 1.0)),
            ("split_pixel_20_bits", (0.5, 1.0), (8.0, 1.0 / 16.0)),
        ] {
            for (level, (read, light)) in [(200.0, below), (320.0, above)] {
                let (found, expected) = (noise(name, level), expected(read, light, f64::from(level)));
                assert!((found / expected - 1.0).abs() < 0.05, "{name} at {level}: {found}, not {expected}");
            }
        }
    }

    proptest! {
        /// The scene itself is the oracle: at any range, a still scene is found within a step.
        #[test]
        fn what_stands_still_is_found_to_within_a_step(
            values in prop::collection::vec(0.0f32..0.99, 12),
            alpha in 1.0f64..16.0,
        ) {
            let scene = Array3::from_shape_vec((2, 2, 3), values).expect("12 values");
            for rival in RIVALS.iter().filter(|rival| is_exact_in_any_scene(rival)) {
                let (seen, truth) = seen(*rival, &scene, alpha);
                for (x, truth) in seen.x.iter().zip(&truth) {
                    let largest = step(*rival, *truth, alpha as f32);
                    prop_assert!((x + 0.5 - truth).abs() <= largest, "{}: {x} for {truth}", rival.name);
                }
            }
        }
    }
}
