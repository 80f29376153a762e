//! Unwraps colour mosaics with any method: green first, then red and blue against it.
//!
//! `auto` takes the gradient sums ([`green_sums`](super::green_sums)) for green, unless there is much noise or they contradict each other.
//! Else, and for the other methods, green is unwrapped as follows. If `auto` has no work left for it ([`budget`](super::budget)), the sums stay, or
//! `lines` unwraps each place of the 2 x 2 pixels by itself.
//!
//! The method works along the [`lattice`](super::lattice) of the green pixels. Both other colours go with them as channels, since a jump by
//! one peak in one colour is hardly one in all three.

use ndarray::{Array3, s};

use super::auto::{FEWEST_BITS, STRONG_NOISE};
use super::budget::{self, Budget};
use super::defects::Defects;
use super::green_sums::{FEW_CONTRADICTIONS, GreenSums};
use super::lattice::Lattice;
use super::lines::Lines;
use super::mosaic_image::{MosaicImage, frame};
use super::other_colour::{OtherColour, OtherDoubts};
use super::{
    GRADIENT_SUMS, GradientTree, Integers, Options, QualityMetrics, Range, Recovered, Report, Scene, Trust,
    TrustLimits, Unwrap, UnwrapError, jumps, offset,
};
use crate::frame::Frame;
use crate::mosaic::{Mosaic, PLACES};
use crate::workers::Workers;

/// With more than this share of contradictions, the gradient sums are not used: edges are too sharp for them.
const MANY_CONTRADICTIONS: f64 = 1e-2;

/// The largest share of the red (or blue) pixels that may lie outside the range: a hot one in a dark part may be seen as a little below 0.
const MOST_OUTSIDE: f64 = 5e-5;

/// The jumps of green and of the differences from it that a trusted result of gradient sums may have, over those of other results. Neighbours
/// of one colour are farther apart here, and contradictions show wrong regions as well.
const JUMPS_OF_SUMS: f64 = 20.0;

/// The share of the work that red and blue have beside the lattice.
const OF_OTHERS: f64 = 0.3;

/// Returns the work of the lattice before its trees, in ns.
fn work_of_lattice(image: &MosaicImage<'_>) -> f64 {
    let lattice = Lattice::new(image);
    budget::LATTICE * (lattice.rows * lattice.columns) as f64
}

/// A method that also takes mosaics.
pub(super) struct MosaicUnwrap {
    method: Box<dyn Unwrap>,
    /// Whether the method says which results are to be trusted.
    judges: bool,
    workers: Workers,
    /// Unwrap green where there is little noise, and red and blue.
    sums: GreenSums,
    others: [OtherColour; 2],
    limits: TrustLimits,
    /// Unwraps single places.
    lines: Lines,
    defects: Defects,
    /// The codes of the image without them, where they have 8 bits, as a buffer.
    codes: Vec<u16>,
    /// The result for the lattice, as a buffer.
    green: Recovered,
}

impl MosaicUnwrap {
    /// Wraps `method`, which `options` have made. `judges` says whether it is `auto`, which judges its results.
    ///
    /// # Errors
    /// [`UnwrapError::Workers`] when the threads are not available.
    pub fn new(method: Box<dyn Unwrap>, judges: bool, options: &Options) -> Result<Self, UnwrapError> {
        let other = || OtherColour::new(options);
        Ok(Self {
            method,
            judges,
            workers: Workers::new(options.threads)?,
            sums: GreenSums::new(options.threads)?,
            others: [other()?, other()?],
            limits: options.trust,
            lines: Lines::default(),
            defects: Defects::default(),
            codes: Vec::new(),
            green: Recovered::default(),
        })
    }

    /// Unwraps green along the lattice by the method, and then red and blue, with the work that is `left`.
    fn unwrap_lattice(
        &mut self,
        image: &MosaicImage<'_>,
        range: Range,
        left: &Budget,
        out: &mut Recovered,
    ) -> Result<(), UnwrapError> {
        let lattice = Lattice::new(image);
        let frame = lattice.frame(image, range);
        let scene = Scene { work: (1.0 - OF_OTHERS) * left.left_ms(), ..range.into() };
        self.method.unwrap(&frame, &scene, &mut self.green)?;
        lattice.scatter(&self.green, out);
        out.report = self.green.report;
        // Beyond the margin nothing is steep, which must not make an image look flatter than it is.
        let inside = (image.height * image.width / 2) as f32 / (lattice.rows * lattice.columns) as f32;
        let jumps = jumps::share_of_green(&out.x, image.parity(), range);
        if let Some(quality) = &mut out.report.quality {
            quality.steep /= inside;
            quality.residues /= inside;
            quality.jumps = jumps;
        }
        let mut trust = self.trust_in_green(&frame, jumps, range);
        let others = self.unwrap_others(image, range, OF_OTHERS * left.left_ms(), out)?;
        out.report.is_over_budget |= left.is_exceeded();
        if others.iter().any(|other| other.outside > MOST_OUTSIDE || other.trust != Trust::Trusted) {
            trust = Trust::Untrusted;
        }
        if self.judges {
            out.report.trust = trust;
        }
        Ok(())
    }

    /// Returns the trust in green, by its second differences above one peak, per green pixel.
    ///
    /// `auto` judges all three channels of the lattice and the pixels beyond the image, too. Where only those have jumps, the result of
    /// the tree is not worse.
    fn trust_in_green(&self, green: &Frame, jumps: f32, range: Range) -> Trust {
        let report = self.green.report;
        match report.trust {
            _ if f64::from(jumps) > self.limits.jumps => Trust::Untrusted,
            Trust::Untrusted if report.method == GradientTree::NAME && range.bits() >= FEWEST_BITS => {
                offset::trust(green, &self.green, range)
            }
            trust => trust,
        }
    }

    /// Unwraps an image with little noise by gradient sums. Returns whether the result stays: the lattice is better where many sums contradict
    /// each other and the work for it is `left`, and then red and blue are left out here.
    fn sum(
        &mut self,
        image: &MosaicImage<'_>,
        range: Range,
        left: &mut Budget,
        out: &mut Recovered,
    ) -> Result<bool, UnwrapError> {
        let contradictions = self.sums.find(image, range, left)?;
        if contradictions > MANY_CONTRADICTIONS && left.take(work_of_lattice(image)) {
            return Ok(false);
        }
        let outside = self.sums.write(image, range, out);
        let jumps = jumps::share_of_green(&out.x, image.parity(), range);
        let others = self.unwrap_others(image, range, left.left_ms(), out)?;
        let is_sound = range.bits() >= FEWEST_BITS
            && contradictions <= FEW_CONTRADICTIONS
            && outside <= MOST_OUTSIDE
            && f64::from(jumps) <= JUMPS_OF_SUMS * self.limits.jumps
            && others.iter().all(|other| {
                other.outside <= MOST_OUTSIDE && other.jumps <= JUMPS_OF_SUMS * self.limits.jumps
            });
        out.report.method = GRADIENT_SUMS;
        out.report.is_over_budget |= left.is_exceeded();
        out.report.trust = if is_sound { offset::trust_of_mosaic(out, range) } else { Trust::Untrusted };
        let (residues, clamped) = (contradictions as f32, outside as f32);
        out.report.quality = Some(QualityMetrics { residues, clamped, jumps, ..QualityMetrics::default() });
        Ok(true)
    }

    /// Unwraps each place of the 2 x 2 pixels by itself; the result is not trusted.
    fn unwrap_places(
        &mut self,
        image: &MosaicImage<'_>,
        range: Range,
        out: &mut Recovered,
    ) -> Result<(), UnwrapError> {
        for (row, column) in PLACES {
            let dim = ((image.height - row).div_ceil(2), (image.width - column).div_ceil(2), 1);
            let codes = Array3::from_shape_fn(dim, |(i, j, _)| {
                image.codes[(2 * i + row) * image.width + 2 * j + column]
            });
            self.lines.unwrap(&frame(codes, range), &range.into(), &mut self.green)?;
            let place = s![row..;2, column..;2, ..];
            out.x.slice_mut(place).assign(&self.green.x);
            out.k.slice_mut(place).assign(&self.green.k);
        }
        let Report { method, quality, .. } = self.green.report;
        out.report =
            Report { method, quality, trust: Trust::Untrusted, is_over_budget: true, ..Report::default() };
        Ok(())
    }

    /// Unwraps red and blue beside green in `out`, with so much work in ms; returns what speaks against the results.
    fn unwrap_others(
        &mut self,
        image: &MosaicImage<'_>,
        range: Range,
        work: f64,
        out: &mut Recovered,
    ) -> Result<[OtherDoubts; 2], UnwrapError> {
        let (row, column) = image.mosaic.red();
        let places = [(row, column), (1 - row, 1 - column)];
        let x = out.x.as_slice().expect("prepare has made the layout standard");
        let mut done = [Ok(()), Ok(())];
        self.workers.each_chunk((&mut self.others, &mut done), 1, |at, other, done| {
            done[0] = other[0].find(image, x, places[at], range, work / 2.0);
        });
        done.into_iter().collect::<Result<(), _>>()?;
        let doubts = [0, 1].map(|at| self.others[at].write(image, places[at], range, out));
        out.report.is_over_budget |= doubts.iter().any(|doubts| doubts.is_over_budget);
        Ok(doubts)
    }
}

impl Unwrap for MosaicUnwrap {
    fn name(&self) -> &'static str {
        self.method.name()
    }

    fn unwrap(&mut self, y: &Frame, scene: &Scene, out: &mut Recovered) -> Result<(), UnwrapError> {
        match y.mosaic() {
            Some(mosaic) => self.unwrap_mosaic(y, mosaic, scene, out),
            None => self.method.unwrap(y, scene, out),
        }
    }
}

impl MosaicUnwrap {
    fn unwrap_mosaic(
        &mut self,
        y: &Frame,
        mosaic: Mosaic,
        scene: &Scene,
        out: &mut Recovered,
    ) -> Result<(), UnwrapError> {
        let range = scene.range;
        let codes = Integers::checked(y, range)?;
        let mut defects = std::mem::take(&mut self.defects);
        let sound = if self.judges { defects.remove(y, codes, range) } else { None };
        let (sound, share) = match sound {
            Some((sound, share)) => (Integers::of(sound, range)?, share),
            None => (codes, 0.0),
        };
        let mut words = std::mem::take(&mut self.codes);
        if let Integers::U8(_) = sound {
            sound.widen(&mut words);
        }
        let codes_of_sound = if let Integers::U16(codes) = sound { codes } else { &words };
        let image = MosaicImage { codes: codes_of_sound, height: y.height(), width: y.width(), mosaic };
        let done = self.unwrap_sound(&image, scene, out);
        if let Some(quality) = &mut out.report.quality {
            quality.defects = share;
        }
        defects.restore(codes, range, out);
        (self.defects, self.codes) = (defects, words);
        done
    }

    /// Unwraps an image without defects.
    fn unwrap_sound(
        &mut self,
        image: &MosaicImage<'_>,
        scene: &Scene,
        out: &mut Recovered,
    ) -> Result<(), UnwrapError> {
        let range = scene.range;
        out.prepare((image.height, image.width, 1), self.name());
        // A method that was asked for by its name is run whatever it takes.
        let mut left = if self.judges { Budget::of_ms(scene.work) } else { Budget::default() };
        if self.judges && self.sums.read(image, range) <= STRONG_NOISE {
            if self.sum(image, range, &mut left, out)? {
                return Ok(());
            }
        } else if !left.take(work_of_lattice(image)) {
            return self.unwrap_places(image, range, out);
        }
        self.unwrap_lattice(image, range, &left, out)
    }
}

#[cfg(test)]
mod tests {
    use ndarray::Array3;
    use proptest::prelude::*;

    use super::*;
    use crate::unwrap::Method;
    use crate::{Exposure, Psf, Sensor, SensorConfig};

    /// A coloured scene of waves, behind the lens and the mosaic of a sensor.
    fn exposure(dim: (usize, usize), alpha: f64, mosaic: Mosaic) -> Exposure {
        let radiance = Array3::from_shape_fn((dim.0, dim.1, 3), |(i, j, c)| {
            let wave = (i as f32 / 19.0 + c as f32 / 5.0).sin() * (j as f32 / 23.0).cos();
            (0.5 + 0.49 * wave) * [1.0, 0.95, 0.92][c]
        });
        let config = SensorConfig { alpha, mosaic: Some(mosaic), ..SensorConfig::default() };
        Sensor::new(config).unwrap().expose(radiance.view(), 0).unwrap()
    }

    fn unwrapped(method: Method, y: &Frame, scene: &Scene) -> Recovered {
        let mut out = Recovered::default();
        method.build(&Options::default()).unwrap().unwrap(y, scene, &mut out).unwrap();
        out
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(40))]
        #[test]
        fn a_smooth_scene_is_exact_and_trusted(
            dim in (60usize..90, 60usize..90), alpha in 1.5f64..4.0, which in 1usize..5,
        ) {
            let mosaic = Mosaic::WORDS[which].1.unwrap();
            let exposure = exposure(dim, alpha, mosaic);
            let out = unwrapped(Method::Auto, &exposure.modulo(), &Scene { lens: Some(Psf::of_sigma(2.0)), ..exposure.scene() });
            prop_assert_eq!(exposure.exact_share(&out.k), Some(1.0));
            prop_assert_eq!(out.report.trust, Trust::Trusted);
        }

        #[test]
        fn any_codes_of_any_size_give_a_congruent_result(
            (height, width) in (2usize..9, 2usize..9), bits in 1u8..=16, alpha in 0.6f64..200.0, which in 1usize..5, seed in any::<u64>(),
        ) {
            let range = Range::new(bits, alpha).unwrap();
            let mut random = seed | 1;
            let codes = Array3::from_shape_simple_fn((height, width, 1), || {
                random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
                ((random >> 40) % (1 << bits)) as u16
            });
            let y = Frame::from_u16(codes.clone()).unwrap().with_mosaic(Mosaic::WORDS[which].1.unwrap()).unwrap();
            for work in [f64::INFINITY, 0.0] {
                let (mut out, scene) = (Recovered::default(), Scene { work, ..range.into() });
                Method::Auto.build(&Options::default()).unwrap().unwrap(&y, &scene, &mut out).unwrap();
                for ((at, x), y) in out.x.indexed_iter().zip(&codes) {
                    prop_assert_eq!(*x, f32::from(*y) + f32::from(out.k[at]) * range.peak());
                    // As without a mosaic, alpha may be a little larger than it was given.
                    prop_assert!(out.k[at] <= range.widened().max_wraps());
                }
            }
        }

    }

    /// The other colours help to find green, and the lattice reaches beyond the image. Jumps of the counts there do not matter.
    #[test]
    fn exact_results_and_no_others_are_trusted() {
        let (mut cases, mut missed) = ([0, 0], Vec::new());
        for seed in 0u64..4 {
            let mut random = 12345 + seed;
            let mut next = || {
                random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
                (random >> 40) as f32 / (1u64 << 24) as f32
            };
            let mut discs: Vec<[f32; 4]> =
                (0..14).map(|_| [120.0 * next(), 160.0 * next(), 5.0 + 20.0 * next(), next()]).collect();
            // A result without a bright part has no evidence for its offset.
            discs.insert(0, [0.0, 0.0, 50.0, 1.0]);
            let radiance = Array3::from_shape_fn((120, 160, 3), |(i, j, c)| {
                let covers = |disc: &&[f32; 4]| (i as f32 - disc[0]).hypot(j as f32 - disc[1]) < disc[2];
                discs.iter().rfind(covers).map_or(0.05, |disc| disc[3]) * [0.96, 1.0, 0.93][c]
            });
            for (alpha, sigma) in
                [(3.0, 1.4), (4.0, 2.0), (4.0, 1.7), (1.5, 0.8), (4.0, 0.5), (6.0, 0.8), (8.0, 0.8)]
            {
                let psf = Psf::Gaussian { sigma };
                let mosaic = Some(Mosaic::Rggb);
                let config = SensorConfig { alpha, psf, mosaic, ..SensorConfig::default() };
                let exposure = Sensor::new(config).unwrap().expose(radiance.view(), 0).unwrap();
                let out = unwrapped(Method::Auto, &exposure.modulo(), &exposure.scene());
                let is_exact = exposure.exact_share(&out.k) == Some(1.0);
                let is_trusted = out.report.trust == Trust::Trusted;
                let what = format!("{seed}, alpha {alpha}, lens of {sigma} px: {:?}", out.report);
                assert!(exposure.exact_share(&out.k) >= Some(0.999) || !is_trusted, "{what}");
                missed.extend((is_exact && !is_trusted).then_some(what));
                cases[usize::from(is_exact)] += 1;
            }
        }
        assert!(cases.iter().all(|cases| *cases > 5), "both are met: {cases:?}");
        assert!(missed.len() < 2, "exact, but not trusted: {missed:#?}");
    }

    #[test]
    fn behind_a_lens_edges_of_all_directions_are_recovered() {
        // Discs of all directions and contrasts, which the lens spreads over a few pixels.
        let radiance = Array3::from_shape_fn((120, 160, 3), |(i, j, c)| {
            let disc =
                |row: f32, column: f32, radius: f32| (i as f32 - row).hypot(j as f32 - column) < radius;
            let light = if disc(40.0, 50.0, 25.0) {
                0.8
            } else if disc(80.0, 110.0, 30.0) {
                0.45
            } else {
                0.05
            };
            light * [0.9, 1.0, 0.8][c]
        });
        let psf = Psf::Gaussian { sigma: 1.4 };
        let config = SensorConfig { alpha: 2.0, psf, mosaic: Some(Mosaic::Rggb), ..SensorConfig::default() };
        let exposure = Sensor::new(config).unwrap().expose(radiance.view(), 0).unwrap();
        let out = unwrapped(Method::Auto, &exposure.modulo(), &exposure.scene());
        assert_eq!(exposure.exact_share(&out.k), Some(1.0));
    }
}
