//! `simulate`: sends images, and the frames of videos, through the sensor and the methods.
//!
//! Files are independent of each other: even the white point of a file is not used for another.

use std::cell::{Cell, RefCell};
use std::iter;
use std::path::{Path, PathBuf};

use clap::Parser;
use modulo_core::unwrap::Scene;
use modulo_core::{AutoExposure, Transfer};
use modulo_images::{ImageError, White, read_image, save_png};
use modulo_runtime::SensorModel;
use modulo_runtime::output::ResultFolder;
use modulo_runtime::sensor::options::{CodingOptions, SensorCommand, SensorOptions};
use modulo_video::{VideoAddress, VideoFile};
use ndarray::{Array3, Axis};

use super::files;
use super::runner::{Capture, Picture, RunOptions, RunOutcome, methods, names, run, save_counts};
use crate::GridError;
use crate::progress::GridEvent;

/// Every parameter of the sensor is an option.
#[derive(Clone, Debug, PartialEq)]
pub struct EveryParameter;

impl SensorCommand for EveryParameter {
    fn varies(parameter: &str) -> bool {
        // The names of the images have the alpha.
        parameter == "alpha"
    }
}

/// The settings of a simulation, as options of a command line. The images of two gains have a method of their own; the modulo and
/// saturated images of a mosaic are mosaics, the recovered ones have three colours.
#[derive(Clone, Debug, PartialEq, Parser)]
pub struct SimulationRequest {
    /// Images (PNG or JPEG of 8 or 16 bits, OpenEXR, Radiance HDR), folders of images, and videos, of which each frame is an image
    /// NAME_NUMBER
    #[arg(required = true)]
    pub images: Vec<PathBuf>,
    /// The methods, their times and the folder of the results.
    #[command(flatten)]
    pub run: RunOptions,
    /// The sensor.
    #[command(flatten)]
    pub sensor: SensorOptions<EveryParameter>,
    /// Seed of the noise
    #[arg(long, default_value_t = 0)]
    pub seed: u64,
    /// How the samples of the images stand for radiance; an automatic white is that of each image.
    #[command(flatten)]
    pub coding: CodingOptions,
    /// Also write wrap counts (NAME_alphaA_k.png) and image in code units (NAME_alphaA_x.png, 16 bits): the true ones, and those of
    /// each method (NAME_alphaA_METHOD_k.png and NAME_alphaA_METHOD_x.png)
    #[arg(long)]
    pub counts: bool,
}

/// Runs the simulation. For each image and alpha it writes `NAME_alphaA_ideal.png`, `.._saturated.png`, `.._auto_exposed.png`,
/// `.._modulo.png` and `NAME_alphaA_METHOD.png` for each method, and [`RESULTS`](crate::results::RESULTS).
///
/// `ideal` and the recovered images have 8 bits as by [`modulo_core::tone::picture`], and are demosaiced; the others hold
/// codes of b bits, with 8 bits a sample for b <= 8, else 16. `auto_exposed` has the exposure at which the image alone
/// settles; in a video it follows the frames. EXR and HDR images are dark to the eye where codes are radiance, so that `linear`
/// becomes `srgb` in the images of theirs that a transfer function encodes.
///
/// # Errors
/// [`GridError`] before anything is written if the request is wrong, and later if a result cannot be written. An image
/// that cannot be used is skipped, unless it is the only one.
pub fn simulate(request: &SimulationRequest, tell: &dyn Fn(GridEvent<'_>)) -> Result<RunOutcome, GridError> {
    let cameras = request.cameras()?;
    let folder = ResultFolder::take(request.run.out.as_deref(), "images", None)?;
    let out = folder.path();
    let methods = methods(&request.run, cameras[0].0.gains)?;
    let files = files(&request.images, tell)?;
    let inputs = files.iter().zip(names(&files)).map(|(file, name)| request.open(file, name));
    let inputs = inputs.collect::<Result<Vec<_>, _>>()?;
    let total = inputs.iter().map(|(count, _)| count).sum();
    let inputs = (inputs.into_iter().map(|(_, images)| images), total);
    let expose = |name: &str, image: &_, camera: &_| request.expose((out, name), image, camera);
    run((&request.run, out, methods), inputs, &cameras, expose, tell)
}

/// An image of a file.
struct Radiance {
    /// Rows, columns, channels.
    pixels: Array3<f32>,
    /// Whether its file holds floats, which are radiance.
    is_float: bool,
    /// The white point of a float image.
    white: Option<f32>,
    /// Whether it is the first image of its file.
    is_first: bool,
}

/// A sensor, with the normal camera beside it.
type Camera = (SensorModel, RefCell<AutoExposure>);

impl SimulationRequest {
    fn cameras(&self) -> Result<Vec<Camera>, GridError> {
        self.white()?;
        let camera = |model: SensorModel| {
            if self.counts && model.range()?.limit() > 65536.0 {
                let why = "--counts writes images of 16 bits, which cannot hold alpha * 2^bits above 65536";
                return Err(GridError::Request(why.to_owned()));
            }
            let normal = RefCell::new(model.auto_exposure()?);
            Ok((model, normal))
        };
        self.sensor.sensors().into_iter().map(camera).collect()
    }

    fn white(&self) -> Result<White, ImageError> {
        White::new(self.coding.of(&self.sensor.first()))
    }

    /// Exposes the sensor to an image, and writes its streams into the folder `out`.
    fn expose(
        &self,
        (out, name): (&Path, &str),
        Radiance { pixels, is_float, white, is_first }: &Radiance,
        (model, normal): &Camera,
    ) -> Result<Capture, GridError> {
        let mut sensor = model.clone();
        if *is_float && sensor.transfer == Transfer::Linear {
            sensor.transfer = Transfer::Srgb;
        }
        if *is_first {
            // The exposure of a file must not depend on the files before it.
            normal.replace(sensor.auto_exposure()?);
        }
        let exposure = sensor.simulated()?.expose(pixels.view(), self.seed)?;
        let name = format!("{name}_alpha{}", exposure.range().alpha());
        let path = |stream: &str| out.join(format!("{name}_{stream}.png"));
        let y = exposure.modulo();
        save_png(&path("ideal"), &exposure.ideal().demosaiced())?;
        save_png(&path("saturated"), &exposure.saturated())?;
        save_png(&path("auto_exposed"), &normal.borrow_mut().expose(pixels.view(), self.seed)?)?;
        save_png(&path("modulo"), &y)?;
        if self.counts {
            // The sensor counts whole codes.
            save_counts(path, &exposure.wraps(), &exposure.x().mapv(f32::floor), exposure.range())?;
        }
        let lens = sensor.of_channels(pixels.len_of(Axis(2))).lens();
        let scene = Scene { lens, noise: sensor.noise(), ..sensor.range()?.into() };
        let given = Some(self.coding.white).filter(|white| *white > 0.0);
        let full_scale = white.or(given).filter(|_| *is_float).unwrap_or(1.0);
        let truth = Some((exposure, *white, self.seed));
        Ok(Capture { y, sensor, scene, name, counts: self.counts, full_scale, truth })
    }

    /// Opens a file: the number of its images, and these. A video is opened at once; an image is read when its turn comes.
    fn open<'a>(&'a self, file: &'a Path, name: String) -> Result<(usize, Images<'a>), GridError> {
        let shown = file.display().to_string();
        let Some(VideoAddress::File(path)) = VideoAddress::of(&file.to_string_lossy())? else {
            let read = move || Picture { file: shown, name, content: self.read(file) };
            return Ok((1, Box::new(iter::once_with(read))));
        };
        let (mut video, coding) = (VideoFile::open(&path)?, self.coding.of(&self.sensor.first()));
        let (count, was_read) = (usize::try_from(video.frames()).unwrap_or(usize::MAX), Cell::new(false));
        let frames = iter::from_fn(move || video.next_frame()).enumerate().map(move |(number, frame)| {
            let pixels = frame.map_err(GridError::from);
            let pixels = pixels.and_then(|frame| Ok(frame.pixels.radiance(&coding, &shown)?));
            let content = pixels.map(|pixels| Radiance {
                pixels,
                is_float: false,
                white: None,
                is_first: !was_read.replace(true),
            });
            Picture { file: format!("{shown} {number}"), name: format!("{name}_{number:06}"), content }
        });
        Ok((count, Box::new(frames)))
    }

    fn read(&self, file: &Path) -> Result<Radiance, GridError> {
        // A white point for each file: with a common one, the result of a file would depend on the files before it.
        let mut white = self.white()?;
        let image = read_image(file)?;
        let pixels = white.radiance(&image, file.display())?;
        Ok(Radiance { pixels, is_float: image.depth() == 32, white: white.found(), is_first: true })
    }
}

/// The images of a file.
type Images<'a> = Box<dyn Iterator<Item = Picture<Radiance>> + 'a>;
