//! How the time of a frame grows with its size, the threads, alpha and the number of cameras: `cargo bench -p modulo-scene --bench growth >
//! docs/research/data/growth.csv` writes a row for each time.

use std::sync::Barrier;
use std::thread;
use std::time::{Duration, Instant};

use modulo_core::sensor::{Sensor, SensorConfig};
use modulo_core::unwrap::{self, Method, Options, Unwrap};
use modulo_core::{Frame, Psf, Recovered};
use modulo_scene::{Preset, Scene};

/// The shape of an image of KITTI.
const KITTI: (usize, usize) = (375, 1242);

/// The shapes of images of 0.1 to 16 megapixels.
const SHAPES: [(usize, usize); 8] =
    [(256, 384), (400, 640), (600, 800), (720, 1280), (1080, 1920), (1600, 2560), (2160, 3840), (3072, 5120)];
const ALPHAS: [f64; 9] = [1.0, 2.0, 3.0, 4.0, 6.0, 8.0, 16.0, 32.0, 80.0];
const CAMERAS: [usize; 4] = [1, 2, 4, 8];

/// The most calls for a time, and the longest duration of them.
const CALLS: usize = 50;
const LONGEST: Duration = Duration::from_secs(3);

/// A modulo image of 8 bits with three colours, and what unwraps it.
struct Unwrapped {
    image: Frame,
    scene: unwrap::Scene,
    method: Box<dyn Unwrap>,
    out: Recovered,
}

impl Unwrapped {
    /// Makes the image of a tunnel behind a lens of 1.4 px, and the method, whose buffers a first call makes.
    fn new((height, width): (usize, usize), alpha: f64, method: &str, threads: usize) -> Self {
        let psf = Psf::of_sigma(1.4);
        let sensor =
            Sensor::new(SensorConfig { alpha, psf, ..SensorConfig::default() }).expect("a possible sensor");
        let scene = Scene::new(Preset::Tunnel, 3).render(0, height, width);
        let exposure = sensor.expose(scene.radiance.view(), 0).expect("finite radiance");
        let options = Options { threads, ..Options::default() };
        let method = method.parse::<Method>().and_then(|method| method.build(&options)).expect("a method");
        let mut all =
            Self { image: exposure.modulo(), scene: exposure.scene(), method, out: Recovered::default() };
        all.call();
        all
    }

    /// Returns the time of a call in ms.
    fn call(&mut self) -> f64 {
        let begin = Instant::now();
        self.method.unwrap(&self.image, &self.scene, &mut self.out).expect("an image of the sensor");
        begin.elapsed().as_secs_f64() * 1e3
    }
}

/// Prints the median time of each method.
fn methods(axis: &str, value: f64, shape: (usize, usize), alpha: f64, threads: usize) {
    for method in ["auto", "gradient_tree", "spud"] {
        let mut unwrapped = Unwrapped::new(shape, alpha, method, threads);
        let (start, mut times) = (Instant::now(), Vec::new());
        while times.len() < CALLS && (times.is_empty() || start.elapsed() < LONGEST) {
            times.push(unwrapped.call());
        }
        times.sort_by(f64::total_cmp);
        print(axis, value, method, &unwrapped, times[times.len() / 2]);
    }
}

/// Prints the time in which a frame of each camera is unwrapped, all at once.
fn cameras(count: usize) {
    let mut all: Vec<_> = (0..count).map(|_| Unwrapped::new(KITTI, 4.0, "auto", 1)).collect();
    let barrier = Barrier::new(count + 1);
    let begin = thread::scope(|scope| {
        for unwrapped in &mut all {
            scope.spawn(|| {
                barrier.wait();
                (0..CALLS).for_each(|_| _ = unwrapped.call());
            });
        }
        barrier.wait();
        Instant::now()
    });
    let ms = begin.elapsed().as_secs_f64() * 1e3 / CALLS as f64;
    print("cameras", count as f64, "auto", &all[0], ms);
}

fn print(axis: &str, value: f64, method: &str, unwrapped: &Unwrapped, ms: f64) {
    println!("{axis},{value:.4},{method},{},{ms:.3}", unwrapped.out.report.method);
}

fn main() {
    println!("axis,value,method,result_of,ms");
    for shape in SHAPES {
        methods("megapixels", (shape.0 * shape.1) as f64 / 1e6, shape, 4.0, 1);
    }
    for threads in [1, 2] {
        methods("threads", threads as f64, KITTI, 16.0, threads);
    }
    for alpha in ALPHAS {
        methods("alpha", alpha, KITTI, alpha, 1);
    }
    CAMERAS.into_iter().for_each(cameras);
}
