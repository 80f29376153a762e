//! Three captures with different exposure times, merged as a normal camera does for a high dynamic range.
//!
//! The captures are three consecutive frames of a drive with the longest exposure last; the middle one is the frame that is scored. Moving
//! objects leave ghosts: the captures are not aligned.

mod bracket;

use std::fs;
use std::path::PathBuf;

use anyhow::{Context, anyhow};
use bracket::Bracket;
use clap::Parser;
use modulo_bags::source::{Source, SourceFrame, SourceOptions, open};
use modulo_core::{Frame, Psf, Range, Sensor, SensorConfig, SensorError, Transfer, tone};
use modulo_lab::{Program, ap50, write_labels, write_picture};
use ndarray::Array3;

/// The number of captures that are merged.
const CAPTURES: usize = 3;

/// Merges three captures for each frame of drives, and prints the accuracy of a detector on the merged images
#[derive(Parser)]
struct Options {
    #[command(flatten)]
    program: Program,
    /// New folder for the images and the results
    out: PathBuf,
    /// Sources of labelled frames, as `modulo eval --source` takes them
    #[arg(long, required = true)]
    source: Vec<String>,
    /// Saturation factor of the longest capture
    #[arg(long, default_value_t = 4.0)]
    alpha: f64,
    /// Full scale of a picture over the end of the range
    #[arg(long, default_value_t = 0.97)]
    headroom: f64,
    /// Standard deviation of the blur of the lens, px
    #[arg(long, default_value_t = 1.4)]
    psf_sigma: f64,
    /// Electrons of a full well at 8 bits; 0 without shot noise
    #[arg(long, default_value_t = 0.0)]
    full_well_electrons: f64,
    /// Standard deviation of the read noise, code units
    #[arg(long, default_value_t = 0.0)]
    read_noise: f64,
}

fn main() -> anyhow::Result<()> {
    let options = Options::parse();
    fs::create_dir(&options.out).with_context(|| options.out.display().to_string())?;
    let camera = Camera::new(&options)?;
    println!("captures,frames,ap50_vehicle,ap50_person");
    for (name, is_still) in [("moving", false), ("still", true)] {
        let mut arguments = Vec::new();
        let mut seed = 0;
        for (number, spec) in options.source.iter().enumerate() {
            let folder = options.out.join(name).join(number.to_string());
            for [before, now, after] in threes(&mut *open(spec, &SourceOptions::default())?)? {
                let scenes = if is_still { [&now; CAPTURES] } else { [&before, &now, &after] };
                let scenes = scenes.map(|frame| &frame.radiance);
                // A name of digits, because the frames of a drive are evaluated in the order of their names.
                let file = format!("{seed:06}");
                write_picture(&folder, &file, &camera.picture(scenes, seed)?)?;
                write_labels(&folder, &file, now.ground_truth.as_deref().unwrap_or_default())?;
                seed += 1;
            }
            let folder = folder.to_str().ok_or_else(|| anyhow!("{}: is no text", folder.display()))?;
            arguments.extend(["--kitti".to_owned(), folder.to_owned()]);
        }
        let arguments: Vec<&str> = arguments.iter().map(String::as_str).collect();
        let found = options.program.evaluate(&arguments, &options.out.join(format!("results_{name}")))?;
        let cell = &found["cells"][0];
        println!("{name},{},{},{}", cell["frames"], ap50(cell, "vehicle"), ap50(cell, "person"));
    }
    Ok(())
}

/// Returns each frame of a drive but its ends, between the frames before and after it.
fn threes(source: &mut dyn Source) -> anyhow::Result<Vec<[SourceFrame; CAPTURES]>> {
    let frames = std::iter::from_fn(|| source.next()).collect::<Result<Vec<_>, _>>()?;
    let three = |three: &[SourceFrame]| [0, 1, 2].map(|at| three[at].clone());
    Ok(frames.windows(CAPTURES).map(three).collect())
}

/// The sensor with each of the exposure times, and the merging.
struct Camera {
    range: Range,
    bracket: Bracket,
    sensors: Vec<Sensor>,
}

impl Camera {
    fn new(options: &Options) -> anyhow::Result<Self> {
        let Options { alpha, headroom, read_noise, full_well_electrons, .. } = *options;
        let shot_noise = if full_well_electrons > 0.0 { 256.0 / full_well_electrons } else { 0.0 };
        let psf = Psf::of_sigma(options.psf_sigma);
        let config = SensorConfig { alpha, headroom, psf, read_noise, shot_noise, ..SensorConfig::PLAIN };
        let range = Range::new(8, alpha)?.with_headroom(headroom)?;
        let bracket = Bracket::new(range, CAPTURES);
        // An exposure of a fraction of the time sees that fraction of the light: alpha is multiplied by the time.
        let of_time = |time: &f32| Sensor::new(SensorConfig { alpha: alpha * f64::from(*time), ..config });
        let sensors = bracket.times().iter().map(of_time).collect::<Result<_, _>>()?;
        Ok(Self { range, bracket, sensors })
    }

    /// Returns the merged picture of one scene for each capture.
    fn picture(&self, scenes: [&Array3<f32>; CAPTURES], seed: u64) -> anyhow::Result<Frame> {
        let capture = |(index, (sensor, scene)): (u64, (&Sensor, &Array3<f32>))| {
            // Each capture has its own noise. The upper bits keep its seed apart from those of the following frames.
            Ok(sensor.expose(scene.view(), seed.wrapping_add(index << 48))?.saturated())
        };
        let captures = (0..).zip(self.sensors.iter().zip(scenes)).map(capture);
        let x = self.bracket.merge(&captures.collect::<Result<Vec<_>, SensorError>>()?)?;
        Ok(tone::picture(&x, self.range, Transfer::Linear)?)
    }
}
