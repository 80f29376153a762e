//! The time of each stage on a frame of 1242 x 375 px with three channels: `cargo bench -p modulo-core --bench stages -- [WORD]...` runs
//! those whose name has one of the words, all without a word.

use std::hint::black_box;
use std::sync::LazyLock;
use std::time::{Duration, Instant};

use modulo_core::sensor::{Sensor, SensorConfig};
use modulo_core::unwrap::{METHODS, Options, by_name};
use modulo_core::{Deblur, Frame, Gains, Psf, Range, Recovered, Transfer, TwoGains, Unwrap as _, tone};
use ndarray::Array3;

mod library;

use library::{Direction, Library};

const DIM: (usize, usize, usize) = (375, 1242, 3);
const ALPHA: f64 = 4.0;

/// Radiance that rises and falls, with edges and a texture.
static RADIANCE: LazyLock<Array3<f32>> = LazyLock::new(|| {
    let triangle = |t: usize, p: usize| (t % (2 * p)).abs_diff(p) as f32 / p as f32;
    Array3::from_shape_fn(DIM, |(i, j, c)| {
        let edge = if (i / 90 + j / 140) % 2 == 0 { 0.3 } else { 0.0 };
        let texture = ((7 * i + 3 * j) % 5) as f32 / 400.0;
        edge + texture + 0.35 * triangle(3 * i + j + 17 * c, 150) + 0.3 * triangle(2 * j + i + 40 * c, 97)
    })
});

/// The modulo frame of [`RADIANCE`].
static MODULO: LazyLock<Frame> = LazyLock::new(|| sense(Psf::Paper7));

fn sensor(psf: Psf) -> Sensor {
    let config = SensorConfig { alpha: ALPHA, psf, ..SensorConfig::default() };
    Sensor::new(config).expect("a possible sensor")
}

fn sense(psf: Psf) -> Frame {
    sensor(psf).expose(RADIANCE.view(), 0).expect("finite radiance").modulo()
}

/// The modulo frame of the first columns of [`RADIANCE`].
fn sense_width(width: usize) -> Frame {
    let radiance = RADIANCE.slice(ndarray::s![.., ..width, ..]);
    sensor(Psf::Paper7).expose(radiance, 0).expect("finite radiance").modulo()
}

fn range() -> Range {
    Range::new(8, ALPHA).expect("a possible range")
}

fn recovered() -> Recovered {
    let mut out = Recovered::default();
    let mut method = by_name("auto", &Options::default()).expect("a method");
    method.unwrap(&MODULO, &range().into(), &mut out).expect("an image of the sensor");
    out
}

/// Widths of KITTI with other prime factors: 1242 = 2 * 27 * 23, 1241 = 17 * 73, 1238 = 2 * 619.
const WIDTHS: [usize; 3] = [1242, 1241, 1238];
/// Calls of a stage, fewer where they take longer than [`LONGEST`].
const CALLS: usize = 100;
/// Longest time for the calls of one stage.
const LONGEST: Duration = Duration::from_secs(3);

/// Prints the least and the median time of a call of `stage`, if one of the words of the command line is in `name`.
fn time<T>(name: &str, mut stage: impl FnMut() -> T) {
    let words: Vec<_> = std::env::args().skip(1).filter(|word| !word.starts_with('-')).collect();
    if !words.is_empty() && !words.iter().any(|word| name.contains(word)) {
        return;
    }
    let (start, mut times) = (Instant::now(), Vec::new());
    while times.len() < CALLS && start.elapsed() < LONGEST {
        let call = Instant::now();
        black_box(stage());
        times.push(call.elapsed().as_secs_f64() * 1e3);
    }
    times.sort_by(f64::total_cmp);
    println!(
        "{name:32} least {:8.3} ms, median {:8.3} ms of {}",
        times[0],
        times[times.len() / 2],
        times.len()
    );
}

fn unwrapping() {
    let mut out = Recovered::default();
    for (name, threads) in METHODS.iter().flat_map(|&name| [(name, 1), (name, 2)]) {
        let mut method = by_name(name, &Options { threads, ..Options::default() }).expect("a method");
        time(&format!("unwrap {name} {threads}"), || {
            method.unwrap(&MODULO, &range().into(), &mut out).expect("an image of the sensor");
        });
    }
    let gains = Gains::checkerboard(ALPHA);
    let sensor = Sensor::new(SensorConfig { alpha: ALPHA, gains, ..SensorConfig::default() });
    let exposure = sensor.expect("a possible sensor").expose(RADIANCE.view(), 0).expect("finite radiance");
    let (modulo, mut method) = (exposure.modulo(), TwoGains::new(gains).expect("two gains"));
    time("unwrap_two_gains", || {
        method.unwrap(&modulo, &range().into(), &mut out).expect("an image of the sensor")
    });
}

fn display() {
    let ((height, width, channels), recovered) = (DIM, recovered());
    time("tone_linear8", || tone::linear8(&recovered.x, range()).expect("an image"));
    let (row, mut planes) = (vec![77; height * width * channels], [const { Vec::new() }; 3]);
    planes.iter_mut().for_each(|plane| plane.resize(height * width, 0.0));
    time("tone_unit_planes", || tone::unit_planes(&row, planes.each_mut().map(Vec::as_mut_slice)));
    let deblur = Deblur::new(Psf::Paper7);
    time("deblur", || deblur.picture(&recovered.x, range(), Transfer::Linear).expect("an image"));
}

/// The whole method of least squares, two transforms of three planes among others; and a forward and an inverse transform of three planes
/// by the library rustdct.
fn transforms() {
    let (height, _, channels) = DIM;
    for width in WIDTHS {
        let (frame, mut out) = (sense_width(width), Recovered::default());
        let mut method = by_name("least_squares", &Options::default()).expect("a method");
        time(&format!("least_squares {width}"), || {
            method.unwrap(&frame, &range().into(), &mut out).expect("an image of the sensor");
        });
        let (mut plane, mut library) = (vec![0.5; height * width], Library::new(height, width));
        time(&format!("dct_pair_rustdct {width}"), || {
            for _ in 0..channels {
                library.transform(&mut plane, Direction::Forward);
                library.transform(&mut plane, Direction::Inverse);
            }
        });
    }
}

fn main() {
    time("sense without a lens", || sense(Psf::None));
    time("sense behind 1.4 px", || sense(Psf::Paper7));
    unwrapping();
    display();
    transforms();
}
