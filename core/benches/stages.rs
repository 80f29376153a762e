//! The time of each stage on a frame of 1242 x 375 px with three channels: `cargo bench -p modulo-core`.

use std::sync::LazyLock;

use divan::{Bencher, counter::ItemsCount};
use modulo_core::sensor::{Sensor, SensorConfig};
use modulo_core::unwrap::{METHODS, Options, by_name};
use modulo_core::{Deblur, Frame, Gains, Psf, Range, Recovered, Transfer, TwoGains, Unwrap as _, tone};
use ndarray::Array3;

#[path = "../tests/library/mod.rs"]
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
    method.unwrap(&MODULO, range(), &mut out).expect("an image of the sensor");
    out
}

#[divan::bench(args = ["none", "1.4 px"])]
fn sense_modulo(bencher: Bencher<'_, '_>, lens: &str) {
    LazyLock::force(&RADIANCE);
    let psf = if lens == "none" { Psf::None } else { Psf::Paper7 };
    bencher.bench(|| sense(psf));
}

#[divan::bench(args = METHODS, consts = [1, 2])]
fn unwrap<const THREADS: usize>(bencher: Bencher<'_, '_>, name: &str) {
    let mut method = by_name(name, &Options { threads: THREADS, ..Options::default() }).expect("a method");
    let mut out = Recovered::default();
    LazyLock::force(&MODULO);
    bencher.bench_local(|| method.unwrap(&MODULO, range(), &mut out).expect("an image of the sensor"));
}

#[divan::bench]
fn unwrap_two_gains(bencher: Bencher<'_, '_>) {
    let gains = Gains::checkerboard(ALPHA);
    let sensor = Sensor::new(SensorConfig { alpha: ALPHA, gains, ..SensorConfig::default() });
    let exposure = sensor.expect("a possible sensor").expose(RADIANCE.view(), 0).expect("finite radiance");
    let (modulo, mut out) = (exposure.modulo(), Recovered::default());
    let mut method = TwoGains::new(gains).expect("two gains");
    bencher.bench_local(|| method.unwrap(&modulo, range(), &mut out).expect("an image of the sensor"));
}

#[divan::bench]
fn tone_linear8(bencher: Bencher<'_, '_>) {
    let x = recovered().x;
    bencher.bench(|| tone::linear8(&x, range()).expect("an image"));
}

#[divan::bench]
fn tone_unit_planes(bencher: Bencher<'_, '_>) {
    let (height, width, channels) = DIM;
    let (row, mut planes) = (vec![77; height * width * channels], [const { Vec::new() }; 3]);
    planes.iter_mut().for_each(|plane| plane.resize(height * width, 0.0));
    bencher.bench_local(|| tone::unit_planes(&row, planes.each_mut().map(Vec::as_mut_slice)));
}

#[divan::bench]
fn deblur(bencher: Bencher<'_, '_>) {
    let (x, deblur) = (recovered().x, Deblur::new(Psf::Paper7));
    bencher.bench_local(|| deblur.picture(&x, range(), Transfer::Linear).expect("an image"));
}

/// Widths of KITTI with other prime factors: 1242 = 2 * 27 * 23, 1241 = 17 * 73, 1238 = 2 * 619.
const WIDTHS: [usize; 3] = [1242, 1241, 1238];

/// The whole method of least squares, two transforms of three planes among others.
#[divan::bench(args = WIDTHS)]
fn least_squares(bencher: Bencher<'_, '_>, width: usize) {
    let (frame, mut out) = (sense_width(width), Recovered::default());
    let mut method = by_name("least_squares", &Options::default()).expect("a method");
    bencher.bench_local(|| method.unwrap(&frame, range(), &mut out).expect("an image of the sensor"));
}

/// A forward and an inverse transform of three planes, as the method of least squares needs them, by the library rustdct.
#[divan::bench(args = WIDTHS)]
fn dct_pair_rustdct(bencher: Bencher<'_, '_>, width: usize) {
    let (height, _, channels) = DIM;
    let (mut plane, mut library) = (vec![0.5; height * width], Library::new(height, width));
    bencher.counter(ItemsCount::new(channels)).bench_local(|| {
        for _ in 0..channels {
            library.transform(&mut plane, Direction::Forward);
            library.transform(&mut plane, Direction::Inverse);
        }
    });
}

fn main() {
    divan::main();
}
