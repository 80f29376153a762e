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
use self::stencil::{RUN, Stencil, stencils};
use super::{Integers, Scene};
use crate::frame::Frame;
use crate::optics::Psf;
use crate::range::Range;

/// The stencils of the last sensor, and buffers.
#[derive(Default)]
pub(super) struct Proof {
    sensor: Option<(Psf, Range)>,
    stencils: Vec<Stencil>,
    /// The samples at the left border whose count is 0.
    seeds: usize,
    plane: Plane,
}

impl Proof {
    /// Returns whether this is a sensor of which counts are proved: it has one gain for all pixels, no mosaic, black columns, and a lens that is known
    /// and soft enough.
    pub fn reaches(&mut self, scene: &Scene, y: &Frame) -> bool {
        let Some(lens) = scene.lens.filter(|_| y.mosaic().is_none() && scene.range.black() > 0) else { return false };
        if self.sensor != Some((lens, scene.range)) {
            self.stencils = stencils(lens, scene.range).to_vec();
            self.seeds = seeds(lens, scene.range);
            self.sensor = Some((lens, scene.range));
        }
        self.stencils[0].half_width() > 0.0 && 2 * self.seeds >= RUN && y.width() > self.seeds
    }

    /// Writes the counts of `y` to `k`, and returns how many of them are not proved.
    pub fn decode(&mut self, y: Integers<'_>, dim: (usize, usize, usize), range: Range, k: &mut [u8]) -> usize {
        let Self { stencils, seeds, plane, .. } = self;
        match y {
            Integers::U8(y) => plane.read(y, dim, range.peak(), *seeds),
            Integers::U16(y) => plane.read(y, dim, range.peak(), *seeds),
        }
        let rule = Rule { stencils, most: range.max_wraps().into() };
        let mut unknown = usize::MAX;
        while unknown > 0 {
            plane.over_columns(rule, false);
            let sweeps: [&dyn Fn(&mut Plane); 3] = [
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
            if left >= unknown {
                break;
            }
            unknown = left;
        }
        if unknown == 0 && !plane.is_possible(&stencils[0]) {
            return dim.0 * dim.1 * dim.2;
        }
        plane.write(k);
        unknown
    }
}

/// Returns the number of the black columns at the border whose radiance is below one peak beside any scene.
fn seeds(lens: Psf, range: Range) -> usize {
    let taps = lens.taps();
    let top = (range.white() as f32 + 1.0) / range.peak();
    // A column so far from the light gets what these taps let through.
    let leak = |away: usize| taps[..(taps.len() / 2 + 1).saturating_sub(away)].iter().sum::<f32>();
    (1..=range.black()).rev().take_while(|&away| top * leak(away) + range.peak().recip() < 1.0).count()
}
