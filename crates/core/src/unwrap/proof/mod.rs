//! Proof: counts of which no scene in the range of the sensor allows others, behind a lens that is known.
//!
//! The samples behind the black columns have the count 0, since even a white scene beside them stays below one peak there. From there each row is
//! decoded: all counts but one of the next sample would need a scene outside the range ([`stencil`]). Nothing leans on a count that is not proved, so that
//! no error can travel, whatever the picture.
//!
//! A sample that does not show the radiance, such as a hot one, voids the proof around it. So each sample must also be one that some scene can give
//! with those above it; a row decoded wrong does not agree with its neighbours.

mod plane;
mod stencil;

use self::plane::{Plane, Rule};
use self::stencil::{Family, RUN, run, squares};
use super::{Integers, Scene};
use crate::frame::Frame;
use crate::optics::Psf;
use crate::range::Range;

/// One sample of so many may be left to squares, which take a hundred times as long for one as a sweep.
const FEW: usize = 8;

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
    run: Family,
    /// Those of squares, in all directions; made when they are first needed.
    squares: Vec<Family>,
    /// The columns at the left border whose count is 0.
    seeds: usize,
}

impl Proof {
    /// Returns whether this is a sensor of which counts are proved: it has one gain for all pixels, no mosaic, black columns, and a lens that is known
    /// and soft enough.
    pub fn reaches(&mut self, scene: &Scene, y: &Frame) -> bool {
        let known = scene.lens.zip(scene.noise).filter(|_| y.mosaic().is_none() && scene.range.black() > 0);
        let Some((lens, noise)) = known else { return false };
        let range = scene.range;
        let is_last = |last: &Sensor| (last.lens, last.range, last.noise) == (lens, range, noise);
        if !self.sensor.as_ref().is_some_and(is_last) {
            let run = Family::new(run(), lens, range, noise);
            self.sensor =
                Some(Sensor { lens, range, noise, run, squares: Vec::new(), seeds: seeds(lens, range) });
        }
        let sensor = self.sensor.as_ref().expect("it was made");
        sensor.run.half_width() > 0.0 && 2 * sensor.seeds >= RUN && y.width() > sensor.seeds
    }

    /// Writes the counts of `y` to `k`, and returns how many of them are not proved.
    pub fn decode(
        &mut self,
        y: Integers<'_>,
        dim: (usize, usize, usize),
        range: Range,
        k: &mut [u8],
    ) -> usize {
        let (Some(sensor), plane) = (&mut self.sensor, &mut self.plane) else { return dim.0 * dim.1 * dim.2 };
        match y {
            Integers::U8(y) => plane.read(y, dim, range.peak(), sensor.seeds),
            Integers::U16(y) => plane.read(y, dim, range.peak(), sensor.seeds),
        }
        let (all, most) = (dim.0 * dim.1 * dim.2, range.max_wraps().into());
        let mut unknown = all;
        loop {
            let rule = Rule { family: &sensor.run, most };
            let sweeps: [&dyn Fn(&mut Plane); 4] = [
                &|plane| plane.over_columns(rule, false),
                &|plane| plane.over_rows(rule, false),
                &|plane| plane.over_rows(rule, true),
                &|plane| plane.over_columns(rule, true),
            ];
            for sweep in sweeps {
                if plane.unknown() > 0 {
                    sweep(plane);
                }
            }
            // Squares complete a frame, and begin none.
            if (1..all / FEW).contains(&plane.unknown()) {
                sensor.make_squares();
                plane.fill(&sensor.squares, most);
            }
            let before = std::mem::replace(&mut unknown, plane.unknown());
            // A frame of which much is left is given up early.
            let least = if unknown < all / FEW { 1 } else { before / 10 };
            if unknown == 0 || before - unknown < least {
                break;
            }
        }
        if unknown == 0 && !plane.is_possible(&sensor.run.stencils[0]) {
            return dim.0 * dim.1 * dim.2;
        }
        plane.write(k);
        unknown
    }
}

impl Sensor {
    fn make_squares(&mut self) {
        if self.squares.is_empty() {
            for places in squares() {
                let family = Family::new(places, self.lens, self.range, self.noise);
                for way in 0..8 {
                    let turned = family.turned(way);
                    if !self.squares.iter().any(|other| same(&other.places, &turned.places)) {
                        self.squares.push(turned);
                    }
                }
            }
        }
    }
}

/// Returns whether two lists have the same places.
fn same(some: &[[isize; 2]], others: &[[isize; 2]]) -> bool {
    some.len() == others.len() && some.iter().all(|place| others.contains(place))
}

/// Returns the number of the black columns at the border whose radiance is below one peak beside any scene.
fn seeds(lens: Psf, range: Range) -> usize {
    let taps = lens.taps();
    let top = (range.limit() as f32 + 1.0) / range.peak();
    // A column so far from the light gets what these taps let through.
    let leak = |away: usize| taps[..(taps.len() / 2 + 1).saturating_sub(away)].iter().sum::<f32>();
    (1..=range.black()).rev().take_while(|&away| top * leak(away) + range.peak().recip() < 1.0).count()
}

#[cfg(test)]
mod tests {
    use ndarray::Array3;
    use proptest::prelude::*;

    use super::*;
    use crate::sensor::{Exposure, Sensor as Camera, SensorConfig};

    /// Scenes that nothing but their range holds together: noise of black and white, blocks of both, random blocks, and walks.
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

    fn decoded(exposure: &Exposure) -> (Vec<bool>, Vec<u8>) {
        let (y, mut proof) = (exposure.modulo(), Proof::default());
        let mut k = vec![0; y.to_f32().len()];
        if !proof.reaches(&exposure.scene(), &y) {
            return (vec![false; k.len()], k);
        }
        proof.decode(
            Integers::checked(&y, exposure.range()).expect("codes"),
            y.dim(),
            exposure.range(),
            &mut k,
        );
        (proof.plane.proved().collect(), k)
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(400))]
        #[test]
        fn no_count_that_is_proved_is_wrong(
            kind in 0usize..7,
            values in prop::collection::vec(0.0f32..1.0, 200..400),
            (psf, alpha) in prop::sample::select(vec![(0.8, 2.0), (0.8, 3.0), (1.0, 3.0), (1.0, 4.0), (1.0, 8.0), (1.4, 4.0), (1.4, 8.0), (2.0, 8.0), (0.5, 2.0)]),
            read_noise in prop::sample::select(vec![0.0, 0.0, 1.0, 3.0]),
            seed in any::<u64>(),
        ) {
            let config = SensorConfig {
                alpha, psf: Psf::of_sigma(psf), read_noise, optical_black: 32, ..SensorConfig::default()
            };
            let light = scene(kind, &values, (24, 80));
            let exposure = Camera::new(config).expect("a sensor").expose(light.view(), seed).expect("an image");
            let (proved, k) = decoded(&exposure);
            for ((is_proved, k), truth) in proved.iter().zip(&k).zip(&exposure.wraps()) {
                prop_assert!(!is_proved || k == truth, "{kind} {psf} {alpha} {read_noise}");
            }
        }
    }

    #[test]
    fn a_smooth_scene_is_proved_as_a_whole() {
        let light = Array3::from_shape_fn((40, 120, 3), |(i, j, c)| {
            0.5 + 0.49 * ((i as f32 / 7.0).sin() * (j as f32 / 9.0 + c as f32).cos())
        });
        for (sigma, alpha, bits) in [(0.8, 2.0, 8), (1.0, 4.0, 8), (1.4, 8.0, 8), (2.0, 16.0, 12)] {
            let psf = Psf::of_sigma(sigma);
            let config = SensorConfig { alpha, psf, bits, optical_black: 32, ..SensorConfig::default() };
            let exposure = Camera::new(config).expect("a sensor").expose(light.view(), 0).expect("an image");
            let (proved, k) = decoded(&exposure);
            assert!(proved.iter().all(|&is_proved| is_proved), "{sigma} px, alpha {alpha}");
            assert!(k.iter().eq(exposure.wraps().iter()));
        }
    }
}
