//! Times every unwrapping method, or those named, on one thread: ms of the whole frame, least and median.
//!
//! `cargo run --release -p modulo-core --example time_unwrap -- [IMAGE_FOLDER | -] [RUNS] [METHOD ...]`
//!
//! Images of the folder (`-`: a rendered street of 1242 x 375), 8 bits, alpha = 4, the paper's lens, no noise.

use std::path::Path;
use std::time::Instant;

use modulo_core::scene::{Preset, Scene};
use modulo_core::unwrap::{METHODS, Options, by_name};
use modulo_core::{Exposure, Psf, Recovered, Sensor, SensorConfig};
use ndarray::Array3;

type Failure = Box<dyn std::error::Error>;

fn main() -> Result<(), Failure> {
    let mut arguments = std::env::args().skip(1);
    let folder = arguments.next().unwrap_or_else(|| "-".to_owned());
    let runs: usize = arguments.next().map_or(Ok(20), |runs| runs.parse())?;
    let named: Vec<String> = arguments.collect();
    let methods = if named.is_empty() { METHODS.iter().map(ToString::to_string).collect() } else { named };
    let exposures = exposures(&folder)?;
    for method in &methods {
        time(method, &exposures, runs.max(1))?;
    }
    Ok(())
}

fn time(method: &str, exposures: &[Exposure], runs: usize) -> Result<(), Failure> {
    let (mut unwrap, mut out) = (by_name(method, &Options::default())?, Recovered::default());
    let (mut least, mut median, mut exact) = (0.0, 0.0, 0);
    for exposure in exposures {
        let y = exposure.modulo();
        unwrap.unwrap(&y, exposure.range(), &mut out)?;
        exact += usize::from(out.k == exposure.wraps());
        let mut times = Vec::with_capacity(runs);
        for _ in 0..runs {
            let start = Instant::now();
            unwrap.unwrap(&y, exposure.range(), &mut out)?;
            times.push(start.elapsed().as_secs_f64() * 1e3);
        }
        times.sort_by(f64::total_cmp);
        least += times[0];
        median += times[times.len() / 2];
    }
    let count = exposures.len() as f64;
    println!(
        "{method:>14}: min {:7.3} ms, p50 {:7.3} ms, {exact}/{} exact",
        least / count,
        median / count,
        exposures.len()
    );
    Ok(())
}

fn exposures(folder: &str) -> Result<Vec<Exposure>, Failure> {
    let radiance = match folder {
        "-" => vec![Scene::new(Preset::Day, 1).render(0, 375, 1242).radiance],
        _ => read(folder.as_ref())?,
    };
    let config = SensorConfig { bits: 8, alpha: 4.0, psf: Psf::Paper7, read_noise: 0.0, shot_noise: 0.0 };
    let sensor = Sensor::new(config)?;
    Ok(radiance.iter().map(|radiance| sensor.expose(radiance.view(), 0)).collect::<Result<_, _>>()?)
}

fn read(folder: &Path) -> Result<Vec<Array3<f32>>, Failure> {
    let mut paths = std::fs::read_dir(folder)?
        .map(|entry| entry.map(|entry| entry.path()))
        .collect::<Result<Vec<_>, _>>()?;
    paths.sort();
    paths
        .iter()
        .map(|path| {
            let image = image::open(path)?.to_rgb8();
            let dim = (image.height() as usize, image.width() as usize, 3);
            let samples = image.into_raw().iter().map(|&sample| f32::from(sample) / 255.0).collect();
            Ok(Array3::from_shape_vec(dim, samples)?)
        })
        .collect()
}
