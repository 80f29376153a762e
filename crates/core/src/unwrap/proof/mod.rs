//! Proof: counts of which no scene in the range of the sensor allows others, behind a lens that is known.
//!
//! The samples behind the black columns have the count 0, since even a white scene beside them stays below one peak
//! there. From there the image is decoded: all counts but one of the next sample would need a scene outside the range
//! ([`stencil`]). Nothing leans on a count that is not proved, so that no error can travel, whatever the picture. Most
//! images are decoded in one sweep ([`front`]).
//!
//! A sample that does not show the radiance, such as a hot one, voids the proof around it and of all that leans on
//! that. So each sample must also agree with those on all sides of it ([`agreement`]); where some do not, the image is
//! proved without them ([`image`]).

mod agreement;
mod front;
mod image;
mod plane;
mod stencil;

use self::agreement::{CHUNK, hole};
use self::image::Image;
pub(super) use self::image::Proved;
use self::plane::Plane;
use self::stencil::{Family, LENS_ERROR, Line, RUN, SIGMAS, corner, lenses, run};
use super::budget::Budget;
use super::{Integers, Recovered, Scene};
use crate::frame::Frame;
use crate::optics::Psf;
use crate::range::Range;

/// The least half width of the stencils with which most images are proved as a whole. With a narrower one, few are.
const LEAST_HALF_WIDTH: f32 = 0.4;

/// The greatest bend of a lens, see [`Psf::bend`]: that of 0.7 px. Behind a sharper one, an edge of one peak bends by
/// half a peak and more if the lens is a fifth sharper than it was described, and then leaves no trace.
const MOST_BEND: f64 = 0.37;

/// The least width of an image: that of the samples that are checked at once, and the runs at both borders. The least
/// height is that of a run, which the mirrored border continues right only so far.
const LEAST_WIDTH: usize = CHUNK + 2 * RUN;

/// The stencils of the last sensor, and buffers.
#[derive(Default)]
pub(super) struct Proof {
    sensor: Option<Sensor>,
    plane: Plane,
}

/// A sensor behind a lens, and its stencils.
struct Sensor {
    lens: Psf,
    range: Range,
    noise: f64,
    /// The stencils of the samples before one, of those above and before it, and of those on all sides.
    run: Family,
    corner: Family,
    hole: Family,
    /// The columns at the left border whose count is 0.
    seeds: usize,
}

impl Proof {
    /// Returns whether this is a sensor whose images are proved: it has one gain for all pixels, no mosaic, black
    /// columns, noise that is known, and a lens that is known and soft enough for its range.
    pub fn reaches(&mut self, scene: &Scene, y: &Frame) -> bool {
        let known = scene.lens.filter(is_soft).zip(scene.noise);
        let known = known.filter(|_| y.mosaic().is_none() && scene.range.black() > 0);
        let Some((lens, noise)) = known else { return false };
        let range = scene.range;
        let is_last = |last: &Sensor| (last.lens, last.range, last.noise) == (lens, range, noise);
        if !self.sensor.as_ref().is_some_and(is_last) {
            let [run, corner, hole] =
                [run(), corner(), hole()].map(|lines| Family::new(lines, lens, range, noise));
            self.sensor =
                Some(Sensor { lens, range, noise, run, corner, hole, seeds: seeds(lens, range, noise) });
        }
        let sensor = self.sensor.as_ref().expect("it was made");
        // Half codes up to the end of the range are exact in f32.
        let is_exact = range.limit() < f64::from(1 << (f32::MANTISSA_DIGITS - 1));
        sensor.corner.half_width() > LEAST_HALF_WIDTH
            && 2 * sensor.seeds >= RUN
            && y.width() >= LEAST_WIDTH
            && y.height() >= RUN
            && is_exact
    }

    /// Decodes `y`, an image of `dim` of the sensor that [`reaches`](Self::reaches) was asked for. Returns which counts
    /// are proved; `None` if no proof is sound, or its work is not left in the `budget`.
    pub fn decode(
        &mut self,
        y: Integers<'_>,
        dim: (usize, usize, usize),
        budget: &mut Budget,
    ) -> Option<Proved> {
        let sensor = self.sensor.as_ref().expect("a sensor within reach has stencils");
        Image::read(sensor, &mut self.plane, y, dim).prove_all(budget)
    }

    /// Writes the counts of an image that was [decoded](Self::decode) as a whole to `k`.
    pub fn write(&self, k: &mut [u8]) {
        self.plane.write(k);
    }

    /// Takes the proved counts of an image that was [decoded](Self::decode) in part into another result for it.
    pub fn repair(&self, range: Range, out: &mut Recovered) {
        let samples = &self.plane.x[..out.k.len()];
        let are_known = |pixel: &[f32]| if pixel.iter().all(|x| *x > 0.0) { u8::MAX } else { 0 };
        let proved = samples.chunks_exact(self.plane.channels).map(are_known).collect();
        let (x, k) = out.buffers();
        for (at, sample) in samples.iter().enumerate().filter(|(_, sample)| **sample > 0.0) {
            k[at] = *sample as u8;
            if let Some(x) = x.get_mut(at) {
                // The middle of a code becomes the code.
                *x = sample * range.peak() - 0.5;
            }
        }
        out.proved = proved;
    }
}

/// The alphas between which limits are sought.
const ALPHAS: (f64, f64) = (0.1, 128.0);

/// Returns the largest alpha up to which each scene has one set of counts, whatever it shows, and the one up to which
/// most pictures are proved as a whole: behind this lens, for a sensor of so many bits (1 to 16) with black columns and
/// noise of this standard deviation in code units. `None`: behind so sharp a lens, nothing is proved.
pub fn proved_up_to(lens: Psf, bits: u8, noise: f64) -> Option<[f64; 2]> {
    let up_to = |lines: fn() -> Vec<Line>, least: f32| {
        let (mut proved, mut not) = ALPHAS;
        while not > 1.02 * proved {
            let alpha = (proved * not).sqrt();
            let is_wide = |range| Family::half_width_of(lines(), lens, range, noise) > least;
            if Range::new(bits, alpha).is_ok_and(is_wide) { proved = alpha } else { not = alpha }
        }
        (10.0 * proved).floor() / 10.0
    };
    is_soft(&lens).then(|| [up_to(run, 0.5), up_to(corner, LEAST_HALF_WIDTH)])
}

/// Returns whether a lens is soft enough for proofs.
fn is_soft(lens: &Psf) -> bool {
    lens.bend() < MOST_BEND
}

/// Returns the number of the black columns at the border whose radiance is below one peak beside any scene.
fn seeds(lens: Psf, range: Range, noise: f64) -> usize {
    let [.., taps] = lenses(lens, LENS_ERROR);
    // The light, half a code that the converter may round up, and the noise.
    let [top, code] = [range.limit(), 1.0 + SIGMAS * noise].map(|codes| codes / f64::from(range.peak()));
    // A column so far from the light gets what these taps let through.
    let leak = |away: usize| taps[..(taps.len() / 2 + 1).saturating_sub(away)].iter().sum::<f64>();
    (1..=range.black()).rev().take_while(|&away| top * leak(away) + code < 1.0).count()
}

#[cfg(test)]
mod tests {
    use ndarray::Array3;
    use proptest::prelude::*;

    use super::*;
    use crate::sensor::{Exposure, Sensor as Camera, SensorConfig};
    use crate::unwrap::{Method, Options, PROOF};

    /// Returns a scene of one of several kinds: noise of black and white, blocks of both, random blocks, or walks.
    fn scene(kind: usize, values: &[f32], (height, width): (usize, usize)) -> Array3<f32> {
        let value = |i: usize, j: usize| values[(i * 131 + j * 17) % values.len()];
        let mut walk = 0.5;
        Array3::from_shape_fn((height, width, 1), |(i, j, _)| match kind {
            0 => value(i, j).round(),
            1 => value(i / 4, j / 4).round(),
            2 => value(i / 8, j / 8),
            3 => {
                walk = (walk + 0.1 * (value(i, j) - 0.5)).clamp(0.0, 1.0);
                walk
            }
            // Gratings of the periods that are hardest.
            _ => f32::from(u8::from((j + i / 8) % (4 + kind % 3) < 2)),
        })
    }

    /// Returns the radiance in peaks of proved samples (below 0 or NaN for others), and the result of `decode`.
    fn decoded(exposure: &Exposure, lens: Psf) -> (Vec<f32>, Option<Proved>) {
        let (y, mut proof) = (exposure.modulo(), Proof::default());
        if !proof.reaches(&Scene { lens: Some(lens), ..exposure.scene() }, &y) {
            return (vec![-1.0; y.height() * y.width()], None);
        }
        let codes = Integers::checked(&y, exposure.range()).expect("codes");
        let proved = proof.decode(codes, y.dim(), &mut Budget::default());
        (proof.plane.x, proved)
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(400))]
        #[test]
        fn no_count_that_is_proved_is_wrong(
            kind in 0usize..7,
            values in prop::collection::vec(0.0f32..1.0, 200..400),
            (psf, alpha) in prop::sample::select(vec![
                (0.8, 2.0), (0.8, 3.0), (1.0, 3.0), (1.0, 4.0), (1.0, 8.0), (1.4, 4.0), (1.4, 8.0), (2.0, 8.0), (0.5, 2.0),
            ]),
            (read_noise, prnu) in prop::sample::select(vec![(0.0, 0.0), (0.0, 0.0), (1.0, 0.0), (3.0, 0.0), (0.0, 0.005)]),
            [modulus, loss, reset_spread] in prop::array::uniform3(prop::sample::select(vec![0.0, 0.0, 0.001, 0.01, 0.05])),
            is_lower in any::<bool>(),
            seed in any::<u64>(),
        ) {
            let psf = Psf::of_sigma(psf);
            let (modulus, reset_loss) = (1.0 + if is_lower { -modulus } else { modulus }, 256.0 * loss);
            let sensor = SensorConfig { modulus, reset_loss, reset_spread, ..SensorConfig::default() };
            let config = SensorConfig { alpha, psf, read_noise, prnu, optical_black: 32, ..sensor };
            let light = scene(kind, &values, (24, 80));
            let exposure = Camera::new(config).expect("a sensor").expose(light.view(), seed).expect("an image");
            let (x, proved) = decoded(&exposure, psf);
            prop_assert!(!matches!(proved, Some(Proved::Whole(left_out)) if !left_out.is_empty()), "nothing is a defect");
            for (x, truth) in x.iter().zip(&exposure.wraps()) {
                prop_assert!(x.is_nan() || *x < 0.0 || *x as u8 == *truth, "{kind} {config:?}");
            }
        }
    }

    proptest! {
        /// Beyond the border, the scene is mirrored only as far as the image is high.
        #[test]
        fn auto_proves_nothing_wrong_of_small_images(
            kind in 0usize..7,
            values in prop::collection::vec(0.0f32..1.0, 200..400),
            (height, width, channels) in (1usize..12, 33usize..100, prop::sample::select(vec![1, 3])),
            (psf, alpha) in prop::sample::select(vec![(0.8, 2.0), (1.0, 3.0), (1.4, 4.0), (1.4, 8.0)]),
            seed in any::<u64>(),
        ) {
            let psf = Psf::of_sigma(psf);
            let config = SensorConfig { alpha, psf, optical_black: 32, ..SensorConfig::default() };
            let light = scene(kind, &values, (height, width));
            let light = light.broadcast((channels, height, width, 1)).expect("the same light for each channel");
            let light = light.remove_axis(ndarray::Axis(3)).permuted_axes([1, 2, 0]).to_owned();
            let exposure = Camera::new(config).expect("a sensor").expose(light.view(), seed).expect("an image");
            let (mut method, mut out) = (Method::Auto.build(&Options::default()).expect("auto"), Recovered::default());
            method.unwrap(&exposure.modulo(), &exposure.scene(), &mut out).expect("codes");
            let is_proved = out.report.method == PROOF || !out.proved.is_empty();
            prop_assert!(!is_proved || height >= RUN && width >= LEAST_WIDTH, "{height} x {width}");
            let claims: Vec<f32> = out.confidence(None, exposure.range()).to_f32().into_iter().collect();
            for (at, (k, truth)) in out.k.iter().zip(&exposure.wraps()).enumerate() {
                let is_claimed = is_proved && claims[at / channels] > 0.0;
                prop_assert!(!is_claimed || k == truth, "{kind} {psf:?} {alpha} {height} x {width}");
            }
        }
    }

    /// Lenses as much sharper and softer as they may be, and samples that do not show the radiance.
    #[test]
    fn a_lens_that_differs_a_little_and_defects_prove_nothing_wrong() {
        let mut proved = 0;
        for seed in 0..60 {
            let (stated, alpha) = [(0.8, 2.0), (1.0, 3.0), (1.4, 4.0), (1.4, 8.0)][seed % 4];
            let light = Array3::from_shape_fn((60, 120, 1), |(i, j, _)| {
                let (u, v) = (i as f32 / (4.0 + seed as f32), j as f32 / 9.0);
                (0.4 + 0.3 * u.sin() * v.cos() + 0.2 * f32::from(u8::from((i + j) / 17 % 2 == 0)))
                    .clamp(0.0, 1.0)
            });
            let psf = Psf::of_sigma(stated * [0.981, 1.0, 1.019][seed % 3]);
            let hot_pixels = [0.0, 2e-4, 1e-3][seed / 3 % 3];
            let config =
                SensorConfig { alpha, psf, hot_pixels, optical_black: 32, ..SensorConfig::default() };
            let exposure =
                Camera::new(config).expect("a sensor").expose(light.view(), seed as u64).expect("an image");
            let sound = Camera::new(SensorConfig { hot_pixels: 0.0, ..config }).expect("a sensor");
            let sound = sound.expose(light.view(), seed as u64).expect("an image");
            let (x, found) = decoded(&exposure, Psf::of_sigma(stated));
            let left_out = match found {
                Some(Proved::Whole(left_out)) => left_out,
                Some(Proved::Part) => Vec::new(),
                None => continue,
            };
            proved += 1;
            let is_hot = |at: usize| {
                exposure.x().as_slice() != sound.x().as_slice()
                    && exposure.x().as_slice().expect("in order")[at]
                        != sound.x().as_slice().expect("in order")[at]
            };
            for (at, (x, truth)) in x.iter().zip(&exposure.wraps()).enumerate() {
                let is_open = x.is_nan() || *x < 0.0 || left_out.contains(&at);
                assert!(is_open || is_hot(at) || *x as u8 == *truth, "{seed}, sample {at}");
            }
        }
        assert!(proved > 30, "{proved}");
    }

    #[test]
    fn the_part_that_is_proved_repairs_any_result() {
        let psf = Psf::of_sigma(1.4);
        let light = Array3::from_shape_fn((60, 120, 3), |(i, j, c)| {
            let is_bright = c == 1 && i.abs_diff(30) < 8 && j.abs_diff(80) < 8;
            if is_bright { 1.0 } else { 0.3 + 0.2 * (j as f32 / 9.0).sin() }
        });
        let config =
            SensorConfig { alpha: 8.0, psf, optical_black: 32, headroom: 1.0, ..SensorConfig::default() };
        let exposure = Camera::new(config).expect("a sensor").expose(light.view(), 0).expect("an image");
        let (y, range, truth) = (exposure.modulo(), exposure.range(), exposure.wraps());
        let mut proof = Proof::default();
        assert!(proof.reaches(&exposure.scene(), &y));
        let codes = Integers::checked(&y, range).expect("codes");
        assert_eq!(proof.decode(codes, y.dim(), &mut Budget::default()), Some(Proved::Part));
        let wrong = Array3::from_elem(y.dim(), 9);
        let mut out = Recovered { x: y.to_f32(), k: wrong, ..Recovered::default() };
        proof.repair(range, &mut out);
        assert_eq!(
            [30, 10].map(|row| out.proved[row * 120 + 80]),
            [0, u8::MAX],
            "light at the end of the range"
        );
        let codes = y.to_f32();
        let samples = out.x.iter().zip(&codes).zip(out.k.iter().zip(&truth));
        let are_right =
            samples.map(|((x, y), (k, truth))| k == truth && *x == y + f32::from(*k) * range.peak());
        for (at, is_right) in are_right.enumerate() {
            assert!(is_right || out.proved[at / 3] == 0, "sample {at}");
        }
        let mut method = Method::Auto.build(&Options::default()).expect("auto");
        let mut of_auto = Recovered::default();
        method.unwrap(&y, &exposure.scene(), &mut of_auto).expect("codes");
        assert!(of_auto.proved == out.proved);
        assert!(of_auto.confidence(None, range).as_u8().expect("8 bits").iter().eq(&out.proved));
    }

    /// The bounds do not hold for light that is brighter before the lens than the range, such as the sun.
    #[test]
    fn nothing_is_proved_at_the_end_of_the_range() {
        let psf = Psf::of_sigma(1.4);
        for (size, is_proved) in [(0, true), (8, false)] {
            let light = Array3::from_shape_fn((60, 120, 1), |(i, j, _)| {
                if i.abs_diff(30) < size && j.abs_diff(80) < size { 1.0 } else { 0.5 }
            });
            let config =
                SensorConfig { alpha: 4.0, psf, optical_black: 32, headroom: 1.0, ..SensorConfig::default() };
            let exposure = Camera::new(config).expect("a sensor").expose(light.view(), 0).expect("an image");
            let (x, proved) = decoded(&exposure, psf);
            assert_eq!(proved == Some(Proved::Whole(Vec::new())), is_proved);
            // Around it, but not far from it.
            assert_eq!(x[30 * 120 + 80] > 0.0, is_proved);
            assert!(x[30 * 120 + 50] > 0.0 && x[30 * 120 + 110] > 0.0);
        }
    }

    #[test]
    fn a_softer_lens_proves_up_to_a_larger_alpha() {
        assert_eq!(proved_up_to(Psf::of_sigma(0.5), 8, 0.0), None);
        let up_to = |sigma, noise| proved_up_to(Psf::of_sigma(sigma), 8, noise).expect("soft");
        let limits = [0.7, 0.8, 1.0, 1.4].map(|sigma| up_to(sigma, 0.0));
        assert!(limits.iter().all(|[every, most]| every < most), "{limits:?}");
        assert!(limits.is_sorted_by(|some, others| some[0] < others[0] && some[1] < others[1]), "{limits:?}");
        let [_, [every, most], ..] = limits;
        assert!((1.5..1.7).contains(&every) && (2.4..3.0).contains(&most), "{limits:?}");
        let noisy = up_to(0.8, 3.0);
        assert!(noisy[0] < every && noisy[1] < most, "{noisy:?}");
    }

    #[test]
    fn a_smooth_scene_is_proved_as_a_whole() {
        let light = Array3::from_shape_fn((40, 120, 3), |(i, j, c)| {
            0.5 + 0.46 * ((i as f32 / 7.0).sin() * (j as f32 / 9.0 + c as f32).cos())
        });
        for (sigma, alpha, bits) in [(0.8, 2.0, 8), (1.0, 4.0, 8), (1.4, 8.0, 8), (2.0, 16.0, 12)] {
            let psf = Psf::of_sigma(sigma);
            let config = SensorConfig { alpha, psf, bits, optical_black: 32, ..SensorConfig::default() };
            let exposure = Camera::new(config).expect("a sensor").expose(light.view(), 0).expect("an image");
            let (x, proved) = decoded(&exposure, psf);
            assert_eq!(proved, Some(Proved::Whole(Vec::new())), "{sigma} px, alpha {alpha}");
            assert!(x.iter().zip(&exposure.wraps()).all(|(&x, &truth)| x as u8 == truth));
        }
    }
}
