//! `unwrap`: unwraps modulo images of a real or simulated sensor, given as files.

use std::path::{Path, PathBuf};
use std::slice;

use clap::Parser;
use clap::builder::Resettable;
use modulo_core::Frame;
use modulo_core::unwrap::Scene;
use modulo_images::read_codes;
use modulo_runtime::SensorModel;
use modulo_runtime::output::ResultFolder;
use modulo_runtime::sensor::options::{SensorCommand, SensorOptions};

use super::files;
use super::runner::{Capture, Picture, RunOptions, RunOutcome, methods, names, run};
use crate::GridError;
use crate::progress::GridEvent;

/// The parameters of the sensor that unwrapping needs are options, with one value each.
#[derive(Clone, Debug, PartialEq)]
pub struct OneSensor;

impl SensorCommand for OneSensor {
    // Its noise is the only thing that unwrapping need not know. A proof must know how its pixels reset themselves.
    const WITHOUT: &'static [&'static str] =
        &["read_noise", "shot_noise", "full_well_electrons", "prnu", "hot_pixels"];

    // The images are of a sensor that somebody else has built.
    fn defaults() -> SensorModel {
        SensorModel::unknown()
    }
}

/// The images and their sensor, as options of a command line.
#[derive(Clone, Debug, PartialEq, Parser)]
#[command(mut_arg("alpha", |option| option.default_value(Resettable::Reset).required(true)))]
pub struct UnwrapRequest {
    /// Modulo images, or folders of them: PNG of 8 or 16 bits with the codes of the sensor
    #[arg(required = true)]
    pub images: Vec<PathBuf>,
    /// The methods, their times and the folder of the results.
    #[command(flatten)]
    pub run: RunOptions,
    /// The sensor.
    #[command(flatten)]
    pub sensor: SensorOptions<OneSensor>,
}

/// Unwraps the images. For each method it writes `NAME_METHOD.png` (8 bits as by [`modulo_core::tone::picture`], demosaiced),
/// `NAME_METHOD_x.png` (16 bits, x in code units), `NAME_METHOD_k.png` (8 bits, the wrap counts), and
/// [`RESULTS`](crate::results::RESULTS).
///
/// # Errors
/// [`GridError`] before anything is written if the request is wrong, and later if a result cannot be written. A file
/// that cannot be used is skipped, unless it is the only one.
pub fn unwrap_files(request: &UnwrapRequest, tell: &dyn Fn(GridEvent<'_>)) -> Result<RunOutcome, GridError> {
    let sensor = request.sensor.first();
    let scene = Scene { lens: sensor.lens(), noise: sensor.noise(), ..sensor.range()?.into() };
    if scene.range.limit() > 65536.0 {
        let why = "the results have 16 bits, which cannot hold alpha * 2^bits above 65536; use the node unwrap for floats";
        return Err(GridError::Request(why.to_owned()));
    }
    sensor.gains()?;
    let folder = ResultFolder::take(request.run.out.as_deref(), "images", None)?;
    let methods = methods(&request.run, sensor.gains)?;
    let files = files(&request.images, tell)?;
    let pictures = files.iter().zip(names(&files)).map(|(file, name)| {
        std::iter::once(Picture {
            file: file.display().to_string(),
            name,
            content: modulo_image(file, &sensor),
        })
    });
    let capture = |name: &str, y: &Frame, sensor: &SensorModel| {
        let (y, sensor, name) = (y.clone(), sensor.clone(), name.to_owned());
        Ok(Capture { y, sensor, scene, name, counts: true, full_scale: 1.0, truth: None })
    };
    let (by, pictures) = ((&request.run, folder.path(), methods), (pictures, files.len()));
    run(by, pictures, slice::from_ref(&sensor), capture, tell)
}

fn modulo_image(file: &Path, sensor: &SensorModel) -> Result<Frame, GridError> {
    let refuse = |why: String| Err(GridError::NotCodes(file.to_owned(), why));
    let (y, depth) = read_codes(file)?;
    let Some(depth) = depth else {
        return refuse(
            "only PNG keeps the codes of a modulo image: JPEG changes them, which destroys the wraps, and OpenEXR and Radiance HDR \
             hold no codes; save the codes of the sensor as PNG"
                .to_owned(),
        );
    };
    if depth < 8 || depth == 8 && sensor.bits > 8 {
        let bits = sensor.bits;
        return refuse(format!(
            "this PNG has {depth} bits a sample, which are not the codes of a sensor of {bits} bits; save its codes as they are, with 8 \
             bits a sample for a sensor of up to 8 bits, else 16, and give its bits as --bits"
        ));
    }
    match sensor.mosaic {
        Some(mosaic) => y.with_mosaic(mosaic).or_else(|why| refuse(why.to_string())),
        None => Ok(y),
    }
}
