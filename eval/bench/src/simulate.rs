//! `simulate`: sends images, and the frames of videos, through the sensor and the methods.
//!
//! Files are independent of each other: even the white point of a file is not used for another.

use std::cell::RefCell;
use std::path::{Path, PathBuf};

use clap::Parser;
use modulo_core::{AutoExposure, Sensor, Transfer};
use modulo_images::{ImageError, White, read_image, save_png};
use modulo_runtime::SensorModel;
use modulo_runtime::output::ResultFolder;
use modulo_runtime::sensor::options::{CodingOptions, SensorCommand, SensorOptions};
use modulo_video::{VideoAddress, VideoFile};
use ndarray::{Array3, Axis};

use crate::runner::{Capture, Picture, RunOptions, RunOutcome, Runner, names, save_counts};
use crate::{BenchError, BenchEvent, files};

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
/// `.._modulo.png` and `NAME_alphaA_METHOD.png` for each method, and [`RESULTS`](crate::RESULTS).
///
/// `ideal` and the recovered images have 8 bits as by [`modulo_core::tone::picture`], and are demosaiced; the others hold
/// codes of b bits, with 8 bits a sample for b <= 8, else 16. `auto_exposed` has the exposure at which the image alone
/// settles; in a video it follows the frames. EXR and HDR images are dark to the eye where codes are radiance, so that `linear`
/// becomes `srgb` in the images of theirs that a transfer function encodes.
///
/// # Errors
/// [`BenchError`] before anything is written if the request is wrong, and later if a result cannot be written. An image
/// that cannot be used is skipped, unless it is the only one.
pub fn simulate(
    request: &SimulationRequest,
    tell: &mut dyn FnMut(BenchEvent<'_>),
) -> Result<RunOutcome, BenchError> {
    let sensors = request.sensors()?;
    let folder = ResultFolder::take(request.run.out.as_deref(), "images", None)?;
    let out = folder.path();
    let mut runner = Runner::new(&request.run, out, &sensors[0][0].model)?;
    let files = files(&request.images, tell)?;
    let inputs = files.iter().zip(names(&files)).map(|(file, name)| InputFile::open(request, file, name));
    let inputs = inputs.collect::<Result<Vec<_>, _>>()?;
    let total = inputs.iter().map(InputFile::len).sum();
    let expose = |name: &str, image: &_, sensor| request.expose((out, name), image, sensor);
    runner.run((inputs, total), &sensors, expose, tell)
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
struct Camera {
    model: SensorModel,
    sensor: Sensor,
    normal: RefCell<AutoExposure>,
}

impl Camera {
    fn new(model: SensorModel) -> Result<Self, BenchError> {
        let (sensor, normal) = (model.simulated()?, RefCell::new(model.auto_exposure()?));
        Ok(Self { model, sensor, normal })
    }
}

/// The camera for pictures, and that for images of floats.
type Cameras = [Camera; 2];

impl SimulationRequest {
    fn sensors(&self) -> Result<Vec<Cameras>, BenchError> {
        self.white()?;
        let models = self.sensor.sensors(&["alpha"]).into_iter();
        let sensors = models.map(|model| {
            let shown = if model.transfer == Transfer::Linear { Transfer::Srgb } else { model.transfer };
            Ok([Camera::new(model.clone())?, Camera::new(SensorModel { transfer: shown, ..model })?])
        });
        let sensors = sensors.collect::<Result<Vec<_>, BenchError>>()?;
        if self.counts && sensors.iter().any(|[camera, _]| camera.sensor.range().limit() > 65536.0) {
            let why = "--counts writes images of 16 bits, which cannot hold alpha * 2^bits above 65536";
            return Err(BenchError::Request(why.to_owned()));
        }
        Ok(sensors)
    }

    fn white(&self) -> Result<White, ImageError> {
        White::new(self.coding.of(&self.sensor.first()))
    }

    /// Exposes the sensor to an image, and writes its streams into the folder `out`.
    fn expose<'s>(
        &self,
        (out, name): (&Path, &str),
        Radiance { pixels, is_float, white, is_first }: &Radiance,
        cameras: &'s Cameras,
    ) -> Result<Capture<'s>, BenchError> {
        let Camera { model, sensor, normal } = &cameras[usize::from(*is_float)];
        if *is_first {
            // The exposure of a file must not depend on the files before it.
            normal.replace(model.auto_exposure()?);
        }
        let exposure = sensor.expose(pixels.view(), self.seed)?;
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
        let (range, lens) = (model.range()?, model.of_channels(pixels.len_of(Axis(2))).lens());
        let given = Some(self.coding.white).filter(|white| *white > 0.0);
        let full_scale = white.or(given).filter(|_| *is_float).unwrap_or(1.0);
        let truth = Some((exposure, *white, self.seed));
        Ok(Capture { y, sensor: model, range, lens, name, counts: self.counts, full_scale, truth })
    }
}

/// A file of the request, as its images.
struct InputFile<'a> {
    request: &'a SimulationRequest,
    file: &'a Path,
    name: String,
    /// The frames that are left of a video.
    video: Option<VideoFile>,
    /// Images that were taken.
    number_of_frames: usize,
    /// Whether an image of a video could be read.
    was_read: bool,
}

impl<'a> InputFile<'a> {
    /// Opens a video; an image is read later.
    fn open(request: &'a SimulationRequest, file: &'a Path, name: String) -> Result<Self, BenchError> {
        let video = match VideoAddress::of(&file.to_string_lossy())? {
            Some(VideoAddress::File(path)) => Some(VideoFile::open(&path)?),
            Some(VideoAddress::Live(_)) | None => None,
        };
        Ok(Self { request, file, name, video, number_of_frames: 0, was_read: false })
    }

    fn len(&self) -> usize {
        self.video.as_ref().map_or(1, |video| usize::try_from(video.frames()).unwrap_or(usize::MAX))
    }

    fn read(&self) -> Result<Radiance, BenchError> {
        // A white point for each file: with a common one, the result of a file would depend on the files before it.
        let mut white = self.request.white()?;
        let image = read_image(self.file)?;
        let pixels = white.radiance(&image, self.file.display())?;
        Ok(Radiance { pixels, is_float: image.depth() == 32, white: white.found(), is_first: true })
    }
}

impl Iterator for InputFile<'_> {
    type Item = Picture<Radiance>;

    fn next(&mut self) -> Option<Self::Item> {
        let (file, number) = (self.file.display().to_string(), self.number_of_frames);
        self.number_of_frames += 1;
        let Some(video) = &mut self.video else {
            return (number == 0).then(|| Picture { file, name: self.name.clone(), content: self.read() });
        };
        let coding = self.request.coding.of(&self.request.sensor.first());
        let frame = video.next_frame()?.map_err(BenchError::from);
        let pixels = frame.and_then(|frame| Ok(frame.pixels.radiance(&coding, &file)?));
        let content = pixels.map(|pixels| {
            let is_first = !std::mem::replace(&mut self.was_read, true);
            Radiance { pixels, is_float: false, white: None, is_first }
        });
        Some(Picture {
            file: format!("{file} {number}"),
            name: format!("{}_{number:06}", self.name),
            content,
        })
    }
}
