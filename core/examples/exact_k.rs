//! Prints the share of exact wrap counts per method over folders of images, against the radiance that
//! the sensor wrapped, noise included; 8 bits.
//!
//! `cargo run --release -p modulo-core --example exact_k -- [methods=lines,tree] [alphas=1.5,4]
//! [psfs=none,paper7,0.8] [noises=0,5] [part=0/1] FOLDER ...`
//!
//! A psf is `none`, `paper7` or the sigma of a Gaussian in px; noise is the sigma of the read noise in code
//! units; `part=1/2` takes every second file, the second first. HDR images have their 99.9 % percentile
//! at full scale.

use std::path::{Path, PathBuf};
use std::time::Instant;

use modulo_core::unwrap::{Options, by_name};
use modulo_core::{Exposure, Psf, Recovered, Sensor, SensorConfig};
use ndarray::Array3;

type Anything = Box<dyn std::error::Error>;

/// What is asked for.
struct Study {
    methods: Vec<String>,
    alphas: Vec<f64>,
    psfs: Vec<Psf>,
    noises: Vec<f64>,
    part: (usize, usize),
    folders: Vec<PathBuf>,
}

/// Over all images of one setting.
#[derive(Default)]
struct Tally {
    shares: Vec<f64>,
    ms: Vec<f64>,
}

fn main() -> Result<(), Anything> {
    let study = Study::parse(std::env::args().skip(1))?;
    let images = study.images()?;
    println!("{} images; method alpha psf noise: mean %, least %, >= 99.9 %, whole images, ms", images.len());
    for &alpha in &study.alphas {
        for &psf in &study.psfs {
            for &noise in &study.noises {
                study.compare(
                    &images,
                    SensorConfig { bits: 8, alpha, psf, read_noise: noise, shot_noise: 0.0 },
                )?;
            }
        }
    }
    Ok(())
}

impl Study {
    fn parse(arguments: impl Iterator<Item = String>) -> Result<Self, Anything> {
        let mut study = Self {
            methods: words("tree,gradient_tree"),
            alphas: vec![4.0],
            psfs: vec![Psf::Paper7],
            noises: vec![0.0],
            part: (0, 1),
            folders: Vec::new(),
        };
        for argument in arguments {
            match argument.split_once('=') {
                Some(("methods", list)) => study.methods = words(list),
                Some(("alphas", list)) => study.alphas = numbers(list)?,
                Some(("noises", list)) => study.noises = numbers(list)?,
                Some(("psfs", list)) => study.psfs = list.split(',').map(psf).collect::<Result<_, _>>()?,
                Some(("part", part)) => {
                    let (first, step) = part.split_once('/').ok_or("part is FIRST/STEP")?;
                    study.part = (first.parse()?, step.parse::<usize>()?.max(1));
                }
                _ => study.folders.push(argument.into()),
            }
        }
        Ok(study)
    }

    /// Red, green, blue in 0 to 1.
    fn images(&self) -> Result<Vec<Array3<f32>>, Anything> {
        let mut paths = Vec::new();
        for folder in &self.folders {
            let files = std::fs::read_dir(folder)?.map(|entry| entry.map(|entry| entry.path()));
            paths.extend(files.collect::<Result<Vec<_>, _>>()?);
        }
        paths.retain(|path| {
            path.extension().is_some_and(|e| ["png", "jpg", "hdr", "exr"].iter().any(|known| e == *known))
        });
        paths.sort();
        paths.iter().skip(self.part.0).step_by(self.part.1).map(|path| read(path)).collect()
    }

    fn compare(&self, images: &[Array3<f32>], config: SensorConfig) -> Result<(), Anything> {
        let mut tallies: Vec<Tally> = self.methods.iter().map(|_| Tally::default()).collect();
        for (seed, image) in images.iter().enumerate() {
            let exposure = Sensor::new(config)?.expose(image.view(), seed as u64)?;
            for (method, tally) in self.methods.iter().zip(&mut tallies) {
                tally.add(method, &exposure)?;
            }
        }
        for (method, tally) in self.methods.iter().zip(&tallies) {
            let psf = match config.psf {
                Psf::None => "none".into(),
                Psf::Paper7 => "paper7".into(),
                Psf::Gaussian { sigma } => format!("{sigma}"),
            };
            println!("{method} {} {psf} {}: {}", config.alpha, config.read_noise, tally.line());
        }
        Ok(())
    }
}

impl Tally {
    fn add(&mut self, method: &str, exposure: &Exposure) -> Result<(), Anything> {
        let (y, truth) = (exposure.modulo(), exposure.wraps());
        let (mut unwrap, mut out) = (by_name(method, &Options::default())?, Recovered::default());
        let start = Instant::now();
        unwrap.unwrap(&y, exposure.range(), &mut out)?;
        self.ms.push(start.elapsed().as_secs_f64() * 1e3);
        let exact = out.k.iter().zip(&truth).filter(|(k, truth)| k == truth).count();
        self.shares.push(exact as f64 / truth.len() as f64);
        Ok(())
    }

    fn line(&self) -> String {
        let mean = |values: &[f64]| values.iter().sum::<f64>() / values.len() as f64;
        let reach = |least: f64| self.shares.iter().filter(|&&share| share >= least).count();
        let least = self.shares.iter().copied().fold(1.0, f64::min);
        let (mean_share, ms) = (mean(&self.shares) * 100.0, mean(&self.ms));
        format!("{mean_share:.3} {:.3} {} {} {ms:.1}", least * 100.0, reach(0.999), reach(1.0))
    }
}

fn words(list: &str) -> Vec<String> {
    list.split(',').map(str::to_owned).collect()
}

fn numbers(list: &str) -> Result<Vec<f64>, Anything> {
    Ok(list.split(',').map(str::parse).collect::<Result<_, _>>()?)
}

fn psf(word: &str) -> Result<Psf, Anything> {
    Ok(match word {
        "none" => Psf::None,
        "paper7" => Psf::Paper7,
        sigma => Psf::Gaussian { sigma: sigma.parse()? },
    })
}

fn read(path: &Path) -> Result<Array3<f32>, Anything> {
    let image = image::open(path).map_err(|why| format!("{}: {why}", path.display()))?;
    let linear = path.extension().is_some_and(|e| e == "hdr" || e == "exr");
    let image = image.to_rgb32f();
    let dim = (image.height() as usize, image.width() as usize, 3);
    let mut radiance = Array3::from_shape_vec(dim, image.into_raw())?;
    if linear {
        let mut sorted: Vec<f32> = radiance.iter().copied().collect();
        sorted.sort_by(f32::total_cmp);
        let white = sorted[sorted.len() * 999 / 1000].max(f32::MIN_POSITIVE);
        radiance.mapv_inplace(|x| x / white);
    }
    Ok(radiance)
}
