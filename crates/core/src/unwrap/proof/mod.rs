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
        let Some(lens) = scene.lens.filter(|_| y.mosaic().is_none() && scene.range.black() > 0) else {
            return false;
        };
        let is_last = |last: &Sensor| (last.lens, last.range, last.noise) == (lens, scene.range, scene.noise);
        if !self.sensor.as_ref().is_some_and(is_last) {
            let Scene { range, noise, .. } = *scene;
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
        let mut unknown = usize::MAX;
        let most = range.max_wraps().into();
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
            let left = plane.unknown();
            // A frame of which little is proved is none that squares would complete.
            if left > 0 && left < dim.0 * dim.1 * dim.2 / 4 {
                sensor.make_squares();
                plane.fill(&sensor.squares, most);
            }
            let left = plane.unknown();
            if left == 0 || left >= unknown {
                unknown = left;
                break;
            }
            unknown = left;
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
