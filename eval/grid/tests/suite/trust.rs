//! Tests over real pictures and rendered scenes, in a sample of all sensors, that `auto` never trusts a wrong result, and that it
//! trusts the exact results whose absolute offset is evident.
//!
//! Each picture is exposed by some sensors of [`Condition::at`]; `MODULO_TRUST=1000` tests a thousand of them for each picture, and
//! prints the figures of docs/research/trust.md.

use crate::data;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};

use modulo_core::unwrap::{self, Options, Range, Trust, TrustLimits, by_name, of_gains};
use modulo_core::{Frame, Mosaic, Psf, Recovered, Sensor, SensorConfig};
use modulo_images::{Coding, EXTENSIONS, White, read_image};
use modulo_runtime::SensorModel;
use modulo_scene::{Preset, Scene};
use ndarray::Array3;

/// The sensors that each picture is exposed by, if the variable does not say more.
const FEW: usize = 3;

/// A sensor, a scene whose light is changed, and an alpha that is known to some percent.
#[derive(Debug)]
struct Condition {
    config: SensorConfig,
    /// The brightest radiance over full scale.
    headroom: f32,
    /// The darkest radiance over the brightest one.
    darkest: f32,
    /// The alpha that the method is told over the true one.
    expected: f64,
    /// Whether the method is told the lens.
    has_lens: bool,
}

impl Condition {
    /// Returns the condition with this number. Each number of one product of all values is met once before one is met again.
    fn at(number: usize) -> Self {
        // Prime to the number of all conditions.
        let mut rest = number.wrapping_mul(7_368_787);
        let mut choose = |values: &[f64]| {
            let value = values[rest % values.len()];
            rest /= values.len();
            value
        };
        let headroom = choose(&[0.9, 0.97, 1.0]) as f32;
        let darkest = choose(&[0.0, 0.0, 0.1, 0.3]) as f32;
        let expected = choose(&[0.9, 0.98, 1.0, 1.0, 1.02, 1.1]);
        let alpha = choose(&[1.5, 2.0, 3.0, 4.0, 6.0, 8.0, 10.0]);
        let psf = match choose(&[0.0, 0.5, 0.8, 1.4, 2.0]) {
            0.0 => Psf::None,
            sigma => Psf::Gaussian { sigma },
        };
        let read_noise = choose(&[0.0, 0.0, 3.0, 10.0, 30.0]);
        let hot_pixels = choose(&[0.0, 1e-5]);
        let optical_black = choose(&[0.0, 32.0]) as usize;
        let mosaic = (choose(&[0.0, 0.0, 1.0]) > 0.0).then_some(Mosaic::Rggb);
        let has_lens = choose(&[0.0, 1.0]) > 0.0;
        let sensor = SensorConfig { alpha, psf, read_noise, hot_pixels, ..SensorConfig::default() };
        let config = SensorConfig { optical_black, mosaic, ..sensor };
        Self { config, headroom, darkest, expected, has_lens }
    }
}

fn images_below(folder: &Path, found: &mut Vec<PathBuf>) {
    for entry in std::fs::read_dir(folder).into_iter().flatten().flatten() {
        let path = entry.path();
        let extension = path.extension().and_then(|e| e.to_str()).unwrap_or_default().to_lowercase();
        if path.is_dir() {
            images_below(&path, found);
        // The TIFF files of the data are measured phases and raw codes, and no pictures.
        } else if EXTENSIONS.contains(&extension.as_str()) && !extension.starts_with("tif") {
            found.push(path);
        }
    }
    found.sort();
}

/// The numbers of frames by their result.
#[derive(Default)]
struct Tally {
    frames: usize,
    trusted: usize,
    /// Wholly exact frames behind a soft lens that is known: those that are trusted, that lack evidence for the offset, and that are not
    /// trusted in spite of it.
    exact: [usize; 3],
    /// Wholly exact frames whose second differences are above the limit of trust.
    beyond: usize,
    /// Frames that are exact but for one offset of all counts, of which nothing shows the offset.
    offset: usize,
    wrong: Vec<String>,
}

impl Tally {
    fn take(&mut self, name: &str, radiance: &Array3<f32>, number: usize) {
        let mut condition = Condition::at(number);
        // A mosaic needs colours.
        condition.config.mosaic = condition.config.mosaic.filter(|_| radiance.dim().2 == 3);
        let Condition { config, headroom, darkest, expected, has_lens } = &condition;
        let light = radiance.mapv(|x| headroom * (darkest + (1.0 - darkest) * x.min(1.0)));
        let exposure = Sensor::new(*config).expect("a sensor").expose(light.view(), 1).expect("an image");
        let range = Range::new(8, config.alpha * expected).unwrap().with_optical_black(config.optical_black);
        let mut out = Recovered::default();
        let mut auto = by_name("auto", &Options::default()).expect("listed");
        let scene = unwrap::Scene { lens: Some(config.psf).filter(|_| *has_lens), ..range.into() };
        auto.unwrap(&exposure.modulo(), &scene, &mut out).expect("codes of that sensor");
        let truth = exposure.wraps();
        let right = out.k.iter().zip(&truth).filter(|(k, truth)| k == truth).count();
        let exact = right as f64 / truth.len() as f64;
        let trust = out.report.trust;
        self.frames += 1;
        self.trusted += usize::from(trust == Trust::Trusted);
        if trust == Trust::Trusted && exact < 0.999 {
            let what = format!("{name}, {condition:?}: {exact:.5} {:?}", out.report);
            println!("trusted and wrong: {what}");
            self.wrong.push(what);
        }
        if right == truth.len() {
            let verdict = match trust {
                Trust::Trusted => 0,
                Trust::Relative => 1,
                Trust::Untrusted | Trust::Unobservable => 2,
                Trust::Unknown => unreachable!("auto makes a claim"),
            };
            // Nobody can trust a result for a scene that breaks the assumption itself: its own second differences are above one peak.
            let is_beyond =
                out.report.quality.is_some_and(|q| f64::from(q.jumps) > TrustLimits::default().jumps);
            self.beyond += usize::from(is_beyond);
            // An unknown lens is trusted only where edges show that it is soft, and a sharp one never.
            if !is_beyond && *has_lens && config.psf.sigma() >= 1.4 && config.alpha <= 4.0 {
                self.exact[verdict] += 1;
            }
            if verdict == 2 {
                println!("exact and untrusted: {name}, {condition:?}: {:?}", out.report);
            }
        }
        self.offset += usize::from(trust == Trust::Relative && right == 0);
    }

    fn add(&mut self, other: Self) {
        self.frames += other.frames;
        self.trusted += other.trusted;
        self.exact.iter_mut().zip(other.exact).for_each(|(sum, count)| *sum += count);
        self.beyond += other.beyond;
        self.offset += other.offset;
        self.wrong.extend(other.wrong);
    }
}

/// A picture of the shared data, or a rendered scene.
enum Picture {
    File(PathBuf),
    Rendered(Preset),
}

impl Picture {
    /// Returns all pictures and one scene of each preset.
    fn all() -> Vec<Self> {
        let mut files = Vec::new();
        if let Some(folder) = data::shared("data") {
            images_below(&folder, &mut files);
        }
        let scenes = Preset::ALL.iter().map(|preset| Self::Rendered(*preset));
        files.into_iter().map(Self::File).chain(scenes).collect()
    }

    fn name(&self) -> String {
        match self {
            Self::File(path) => path.file_name().unwrap().to_string_lossy().into_owned(),
            Self::Rendered(preset) => preset.name().to_owned(),
        }
    }

    /// Returns the radiance; `None` if the file cannot be decoded, or has codes of unknown full scale.
    fn radiance(&self) -> Option<Array3<f32>> {
        match self {
            Self::File(path) => {
                let mut white = White::new(Coding::default()).unwrap();
                white.radiance(&read_image(path).ok()?, path.display()).ok()
            }
            Self::Rendered(preset) => Some(Scene::new(*preset, 1).render(0, 120, 320).radiance),
        }
    }
}

#[test]
fn pictures_are_never_trusted_and_wrong() {
    let pictures = Picture::all();
    let count =
        std::env::var("MODULO_TRUST").map_or(FEW, |count| count.parse().expect("a number of sensors"));
    let next = AtomicUsize::new(0);
    let work = || {
        let mut tally = Tally::default();
        while let Some((number, picture)) =
            pictures.iter().enumerate().nth(next.fetch_add(1, Ordering::Relaxed))
        {
            let name = picture.name();
            match picture.radiance() {
                Some(radiance) => (0..count).for_each(|at| tally.take(&name, &radiance, number * count + at)),
                None => println!("skipped: {name} cannot be decoded"),
            }
        }
        tally
    };
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let mut tally = Tally::default();
    std::thread::scope(|scope| {
        let workers: Vec<_> = (0..cores).map(|_| scope.spawn(work)).collect();
        workers.into_iter().for_each(|worker| tally.add(worker.join().expect("a worker does not panic")));
    });
    let [trusted, relative, untrusted] = tally.exact;
    println!(
        "{} frames of {} pictures, {} trusted, {} of them wrong",
        tally.frames,
        pictures.len(),
        tally.trusted,
        tally.wrong.len()
    );
    println!(
        "wholly exact: {trusted} behind a soft lens trusted, {relative} without evidence for the offset, {untrusted} not trusted; {} with \
         jumps of their own; {} wrong by one offset and without evidence",
        tally.beyond, tally.offset
    );
    assert!(tally.wrong.is_empty(), "{:#?}", tally.wrong);
    // Rendered scenes are few, so that their share says nothing about pictures.
    if pictures.iter().any(|picture| matches!(picture, Picture::File(_))) {
        assert!(trusted as f64 >= 0.95 * (trusted + untrusted) as f64, "exact results are trusted");
    }
}
/// Numbers between 0 and 1, by splitmix64.
struct Draws(u64);

impl Draws {
    fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mixed = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let mixed = (mixed ^ (mixed >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((mixed ^ (mixed >> 31)) >> 11) as f64 / (1u64 << 53) as f64
    }

    fn of(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.next()
    }

    fn pick<T: Copy>(&mut self, values: &[T]) -> T {
        values[(self.next() * values.len() as f64) as usize]
    }

    /// A shape with sharp edges: how bright each pixel is, 0 to 1.
    fn shape(&mut self, (height, width): (usize, usize)) -> Array3<f32> {
        let (h, w, kind) = (height as f64, width as f64, (self.next() * 6.0) as usize);
        let [a, b, c, d] = [(); 4].map(|()| self.next());
        let (angle, period) =
            (self.pick(&[0.0, std::f64::consts::FRAC_PI_2, 0.3]), self.of(2.0, 40.0).round());
        let glyphs: Vec<bool> = (0..997).map(|_| self.next() < 0.5).collect();
        let (size, steps) = (1 + (4.0 * c) as usize, 2.0 + (7.0 * d).floor());
        Array3::from_shape_fn((height, width, 1), |(i, j, _)| {
            let (u, v) = (i as f64 / h, j as f64 / w);
            let is_inside = match kind {
                0 => u > 0.8 * a && u < a + 0.2 * c && v > 0.8 * b && v < b + 0.5 * d,
                1 => (u - a).hypot((v - b) * w / h) < 0.05 + 0.4 * c,
                2 => {
                    ((i as f64 * f64::sin(angle) + j as f64 * f64::cos(angle)) / period).rem_euclid(1.0)
                        < 0.2 + 0.6 * a
                }
                3 => return ((if a < 0.5 { u } else { v } * steps).floor() / (steps - 1.0)) as f32,
                // Five by seven dots a letter.
                4 => {
                    let (i, j) = (i / size, j / size);
                    i % 9 < 7 && j % 7 < 5 && glyphs[(i * 131 + j) % glyphs.len()]
                }
                // A triangle.
                _ => u > 0.6 * a && v - b < c * (u - 0.6 * a) && v - b > -d * (u - 0.6 * a),
            };
            f32::from(u8::from(is_inside))
        })
    }
}

/// The kinds of sensors by which shapes are exposed, all with a known lens.
#[derive(Clone, Copy, PartialEq)]
enum Kind {
    /// One gain; some have a mosaic.
    OneGain,
    Mosaic,
    Checkerboard,
}

/// Exposes a sharp shape of any step by any sensor of a kind, whose lens is described as so many times as wide, or not; returns what was drawn, if it is trusted and wrong, and whether it is trusted.
fn drawn(seed: u64, (kind, resets): (Kind, f64), described: Option<f64>) -> (Option<String>, bool) {
    let mut draws = Draws(seed);
    let dim = (draws.of(40.0, 130.0) as usize, draws.of(60.0, 180.0) as usize);
    let alpha =
        if draws.next() < 0.3 { draws.of(1.5, 8.0) } else { draws.pick(&[1.5, 2.0, 3.0, 4.0, 6.0, 8.0]) };
    let psf_sigma = draws.pick(&[0.0, 0.3, 0.5, 0.8, 1.0, 1.2, 1.4, 2.0]);
    let bits = draws.pick(&[8, 8, 8, 4, 6, 10, 12]);
    let read_noise = draws.pick(&[0.0, 0.0, 0.0, 1.0, 3.0, 10.0, 30.0]) * f64::from(1u16 << bits) / 256.0;
    let channels = if kind == Kind::Mosaic { 3 } else { draws.pick(&[1, 1, 3]) };
    let has_mosaic = kind == Kind::Mosaic || kind == Kind::OneGain && channels == 3 && draws.next() < 0.2;
    let mosaic = has_mosaic.then_some(Mosaic::Rggb);
    let gains = kind == Kind::Checkerboard;
    let optical_black = draws.pick(&[0, 32, 32]);
    let step = match (4.0 * draws.next()) as usize {
        0 => (draws.of(0.0, 2.0 * alpha)).floor() / 2.0,
        1 => draws.of(0.9, 1.1) * draws.of(1.0, alpha).floor(),
        2 => alpha,
        _ => draws.of(0.1, alpha),
    };
    let (step, dark) = ((step / alpha).min(1.0) as f32, draws.pick(&[0.0, 0.1, 1.0]) * draws.next() as f32);
    let (slope, inside) = (draws.pick(&[0.0, 0.0, 0.3, 1.0]) / alpha as f32, draws.next() < 0.5);
    let tint = [(); 3].map(|()| if draws.next() < 0.3 { draws.of(0.5, 1.0) as f32 } else { 1.0 });
    let shape = draws.shape(dim);
    let light = Array3::from_shape_fn((dim.0, dim.1, channels), |(i, j, c)| {
        let cover = shape[(i, j, 0)];
        let ramp = if inside && cover == 0.0 { 0.0 } else { slope * (i + j) as f32 / (dim.0 + dim.1) as f32 };
        (tint[c] * (dark * (1.0 - step) + ramp + step * cover)).min(1.0)
    });
    let sensor = SensorModel { bits, alpha, psf_sigma, read_noise, mosaic, gains, ..SensorModel::default() };
    let [modulus, loss, reset_spread] = [(); 3].map(|()| draws.pick(&[0.0, 1.0, 1.0]) * resets);
    let modulus = 1.0 + draws.pick(&[-1.0, 1.0]) * modulus;
    let reset_loss = loss * f64::from(1u16 << bits);
    let sensor = SensorModel { optical_black, modulus, reset_loss, reset_spread, ..sensor };
    let exposure = sensor.simulated().unwrap().expose(light.view(), seed).unwrap();
    let method = of_gains(sensor.gains().unwrap());
    let mut method = method.unwrap_or_else(|| by_name("auto", &Options::default()).unwrap());
    let mut out = Recovered::default();
    let lens = described.map(|times| Psf::of_sigma(psf_sigma * times));
    let scene = unwrap::Scene { lens, ..exposure.scene() };
    method.unwrap(&exposure.modulo(), &scene, &mut out).unwrap();
    let (exact, is_trusted) = (exposure.exact_share(&out.k).unwrap(), out.report.trust == Trust::Trusted);
    let what = || {
        format!(
            "{exact:.5} seed {seed} {dim:?}, step {step}, dark {dark}, slope {slope}: {sensor:?} {:?}",
            out.report
        )
    };
    ((is_trusted && exact < 0.999).then(what), is_trusted)
}

/// Tests 600 shapes; `MODULO_DRAWS=10000` tests so many of them. Behind a lens that is not described, one of a hundred trusted ones may be
/// wrong: a shape behind a sharp lens can be the twin of one behind a soft lens.
fn never_trusted_and_wrong(kind: Kind, described: Option<f64>) {
    never_trusted_and_wrong_by((kind, 0.0), described);
}

/// Tests as [`never_trusted_and_wrong`] does, with chips whose resets deviate by this share from ideal ones.
fn never_trusted_and_wrong_by((kind, resets): (Kind, f64), described: Option<f64>) {
    let count: u64 =
        std::env::var("MODULO_DRAWS").map_or(600, |count| count.parse().expect("a number of draws"));
    let first: u64 = std::env::var("MODULO_FIRST_DRAW").map_or(0, |first| first.parse().expect("a number"));
    let results: Vec<_> = (first..first + count).map(|seed| drawn(seed, (kind, resets), described)).collect();
    let trusted = results.iter().filter(|(_, trusted)| *trusted).count();
    let wrong: Vec<_> = results.into_iter().filter_map(|(wrong, _)| wrong).collect();
    println!(
        "lens times {described:?}, resets {resets}: {count} shapes, {trusted} trusted, {} of them wrong",
        wrong.len()
    );
    let (most, least) = if described.is_some() { (0, 12) } else { (1 + trusted / 100, 100) };
    assert!(wrong.len() <= most, "{wrong:#?}");
    assert!(trusted * least > count as usize, "{trusted} of {count} are trusted");
}

#[test]
fn sharp_shapes_behind_a_known_lens_are_never_trusted_and_wrong() {
    never_trusted_and_wrong(Kind::OneGain, Some(1.0));
}

#[test]
fn sharp_shapes_behind_a_known_lens_by_chips_whose_resets_are_not_ideal_are_never_trusted_and_wrong() {
    for kind in [Kind::OneGain, Kind::Mosaic, Kind::Checkerboard] {
        [0.001, 0.01, 0.05].iter().for_each(|resets| never_trusted_and_wrong_by((kind, *resets), Some(1.0)));
    }
}

#[test]
fn sharp_shapes_on_a_mosaic_behind_a_known_lens_are_never_trusted_and_wrong() {
    never_trusted_and_wrong(Kind::Mosaic, Some(1.0));
}

#[test]
fn sharp_shapes_with_two_gains_behind_a_known_lens_are_never_trusted_and_wrong() {
    never_trusted_and_wrong(Kind::Checkerboard, Some(1.0));
}

#[test]
fn sharp_shapes_behind_a_lens_that_is_described_a_fifth_too_wide_or_narrow_are_never_trusted_and_wrong() {
    [0.8, 1.2].iter().for_each(|described| never_trusted_and_wrong(Kind::OneGain, Some(*described)));
}

#[test]
fn sharp_shapes_behind_an_unknown_lens_are_hardly_ever_trusted_and_wrong() {
    [Kind::OneGain, Kind::Mosaic].iter().for_each(|kind| never_trusted_and_wrong(*kind, None));
}

/// Stairs whose steps are half a peak look like stairs that fall, which leave the range.
#[test]
fn steps_of_half_a_peak_are_not_trusted() {
    for optical_black in [0, 1, 32] {
        let x = Array3::from_shape_fn((64, 128, 1), |(_, j, _)| (j / 16 * 128 % 256) as u8);
        let range = Range::new(8, 4.0).unwrap().with_optical_black(optical_black);
        let mut out = Recovered::default();
        let mut auto = by_name("auto", &Options::default()).unwrap();
        auto.unwrap(&Frame::from_u8(x).unwrap(), &range.into(), &mut out).unwrap();
        assert_ne!(out.report.trust, Trust::Trusted, "{:?}", out.report);
    }
}
