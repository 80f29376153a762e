//! `simulate`: sends images, and the frames of videos, through the sensor and the methods.
//!
//! Files are independent of each other: even the white point of a file is not used for another.

use std::collections::HashSet;
use std::path::{Path, PathBuf};

use clap::Parser;
use modulo_core::metric::{mse, psnr_db, ssim};
use modulo_core::unwrap::{Options, by_name, of_gains};
use modulo_core::{Exposure, Frame, GainPattern, Range, Recovered, Sensor, Unwrap, UnwrapError, tone};
use modulo_images::{read_image, save_png};
use modulo_runtime::SensorModel;
use modulo_runtime::sensor::options::SensorCommand;
use modulo_video::{VideoAddress, VideoFile};
use ndarray::Array3;
use serde::{Deserialize, Serialize};

use crate::benchmark::timed;
use crate::{BenchError, BenchEvent, ExposureOptions, Skipped, files, make_folder, samples8, write_json};

/// Name of the list of results in the folder.
pub const RESULTS: &str = "results.json";

/// Every parameter of the sensor is an option.
#[derive(Clone, Debug, PartialEq)]
pub struct EveryParameter;

impl SensorCommand for EveryParameter {
    fn has(_: &str) -> bool {
        true
    }

    fn varies(parameter: &str) -> bool {
        // The names of the images have the alpha.
        parameter == "alpha"
    }
}

/// The settings of a simulation, as options of a command line.
#[derive(Clone, Debug, PartialEq, Parser)]
pub struct SimulationRequest {
    /// Images (PNG or JPEG of 8 or 16 bits, OpenEXR, Radiance HDR), folders of images, and videos, of which each frame is an image
    /// NAME_NUMBER
    #[arg(required = true)]
    pub images: Vec<PathBuf>,
    /// Unwrapping methods, for a sensor with one gain [default: auto]
    #[arg(long, value_delimiter = ',')]
    pub method: Vec<String>,
    /// The exposures. The images of two gains have a method of their own; the modulo and saturated images of a mosaic are mosaics,
    /// the recovered ones have three colours.
    #[command(flatten)]
    pub exposure: ExposureOptions<EveryParameter>,
    /// Also write wrap counts (NAME_alphaA_k.png) and image in code units (NAME_alphaA_x.png, 16 bits): the true ones, and those of
    /// each method (NAME_alphaA_METHOD_k.png and NAME_alphaA_METHOD_x.png)
    #[arg(long)]
    pub counts: bool,
    /// Folder for the images and results.json
    #[arg(short, long, value_name = "FOLDER")]
    pub out: PathBuf,
}

/// The result of one method on one image.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SimulationRow {
    /// The file as it was given; of a video, with the number of the frame behind a blank.
    pub file: String,
    /// The radiance that became full scale, of a float image without a given white point.
    pub white: Option<f32>,
    /// The sensor.
    #[serde(flatten, with = "modulo_runtime::parameter::flat")]
    pub sensor: SensorModel,
    /// Seed of the noise.
    pub seed: u64,
    /// Name of the method, as in [`modulo_core::unwrap::METHODS`], or that of the gains.
    pub method: String,
    /// `10 log10(255^2 / mse)` of the recovered against the ideal 8-bit image, over all samples. `None` (`null`) if they
    /// are equal.
    pub psnr_db: Option<f64>,
    /// Mean SSIM of these two images, see [`modulo_core::metric::ssim`]. `None` if a side is shorter than 11 px.
    pub ssim: Option<f64>,
    /// Share of the samples with the true wrap count, 0 to 1; with two gains, of those of full gain.
    pub exact_k: f64,
    /// The method that produced the result: `method` itself, or the one that `auto` selected.
    pub method_used: String,
    /// Whether the method trusts its result. `None` if it makes no statement.
    pub trusted: Option<bool>,
    /// Duration of one call on one thread, ms. For precise timing use `bench unwrap`.
    pub ms: f64,
}

/// Result of a simulation.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SimulationOutcome {
    /// One row for each file, alpha and method. Also in [`RESULTS`].
    pub rows: Vec<SimulationRow>,
    /// Files that could not be read or exposed.
    pub skipped: Vec<Skipped>,
}

/// Runs the simulation. For each file and alpha it writes `NAME_alphaA_ideal.png`, `.._saturated.png`, `.._modulo.png`
/// and `NAME_alphaA_METHOD.png` for each method; after each file it writes [`RESULTS`] with all rows so far.
///
/// `ideal` and the recovered images have 8 bits as by [`tone::picture`], and are demosaiced; `modulo` and `saturated` hold codes of b bits, with 8 bits a sample for b <= 8, else 16.
///
/// # Errors
/// [`BenchError`] before anything is written if the request is wrong, and later if a result cannot be written. A file
/// that cannot be used is skipped, unless it is the only one.
pub fn simulate(
    request: &SimulationRequest,
    tell: &mut dyn FnMut(BenchEvent<'_>),
) -> Result<SimulationOutcome, BenchError> {
    let sensors = sensors(request)?;
    let mut methods = methods_of(&request.method, sensors[0].0.gains)?;
    let files = files(&request.images, tell)?;
    let inputs = files.iter().zip(names(&files)).map(|(file, name)| InputFile::open(file, name));
    let mut inputs = inputs.collect::<Result<Vec<_>, _>>()?;
    make_folder(&request.out)?;
    let total = inputs.iter().map(InputFile::len).sum::<usize>() * sensors.len();
    let (mut outcome, mut done) = (SimulationOutcome::default(), 0);
    for input in &mut inputs {
        while let Some((picture, radiance)) = input.next(request) {
            let rows = radiance.and_then(|radiance| {
                let mut rows = Vec::new();
                for ((model, sensor), step) in sensors.iter().zip(done..) {
                    let next = format!("{} alpha {}", picture.file, sensor.range().alpha());
                    tell(BenchEvent::Step { done: step, total, next: &next });
                    rows.extend(match of_gains(sensor.gains(), &Options::default())? {
                        Some(method) => picture.sense(&radiance, (model, sensor), &mut [method])?,
                        None => picture.sense(&radiance, (model, sensor), &mut methods)?,
                    });
                }
                Ok(rows)
            });
            done += sensors.len();
            match rows {
                Ok(rows) => outcome.rows.extend(rows),
                // Only faults of an image are skipped. An error of a method or of the disk would come back with every one.
                Err(why @ (BenchError::Image(_) | BenchError::Sensor(_) | BenchError::Video(_)))
                    if total > sensors.len() =>
                {
                    let skipped = Skipped { file: picture.file.clone(), why: why.to_string() };
                    tell(BenchEvent::Skipped(&skipped));
                    outcome.skipped.push(skipped);
                }
                Err(why) => return Err(why),
            }
        }
        write_json(&request.out.join(RESULTS), &outcome.rows)?;
    }
    Ok(outcome)
}

/// A file of the request.
struct InputFile<'a> {
    file: &'a Path,
    name: String,
    /// The frames that are left of a video.
    video: Option<VideoFile>,
    /// Images that were taken.
    taken: usize,
}

impl<'a> InputFile<'a> {
    /// Opens a video; an image is read later.
    fn open(file: &'a Path, name: String) -> Result<Self, BenchError> {
        let video = match VideoAddress::of(&file.to_string_lossy())? {
            Some(VideoAddress::File(path)) => Some(VideoFile::open(&path)?),
            Some(VideoAddress::Live(_)) | None => None,
        };
        Ok(Self { file, name, video, taken: 0 })
    }

    fn len(&self) -> usize {
        self.video.as_ref().map_or(1, |video| usize::try_from(video.frames()).unwrap_or(usize::MAX))
    }

    /// Returns the next image with its radiance, or the reason why it cannot be read; `None` at the end.
    fn next(
        &mut self,
        request: &'a SimulationRequest,
    ) -> Option<(InputImage<'a>, Result<Array3<f32>, BenchError>)> {
        let (file, number) = (self.file.display().to_string(), self.taken);
        self.taken += 1;
        if let Some(video) = &mut self.video {
            let frame = video.next_frame()?;
            let radiance = frame.map_err(BenchError::from);
            let transfer = request.exposure.transfer();
            let radiance = radiance.and_then(|frame| Ok(frame.pixels.radiance(transfer, &file)?));
            let (name, file) = (format!("{}_{number:06}", self.name), format!("{file} {number}"));
            return Some((InputImage { file, name, request, white: None }, radiance));
        }
        // A white point for each file: with a common one, the result of a file would depend on the files before it.
        let read = |path: &Path| {
            let mut white = request.exposure.white()?;
            let radiance = white.radiance(&read_image(path)?, path.display())?;
            Ok((radiance, white.found()))
        };
        let (radiance, white) = match (number == 0).then(|| read(self.file))? {
            Ok((radiance, white)) => (Ok(radiance), white),
            Err(why) => (Err(why), None),
        };
        Some((InputImage { file, name: self.name.clone(), request, white }, radiance))
    }
}

/// An image of the request.
struct InputImage<'a> {
    file: String,
    name: String,
    request: &'a SimulationRequest,
    white: Option<f32>,
}

impl InputImage<'_> {
    /// Writes all streams at one alpha, and returns a row for each method.
    fn sense(
        &self,
        radiance: &Array3<f32>,
        (model, sensor): (&SensorModel, &Sensor),
        methods: &mut [Box<dyn Unwrap>],
    ) -> Result<Vec<SimulationRow>, BenchError> {
        let exposure = sensor.expose(radiance.view(), self.request.exposure.seed)?;
        let path = |stream: &str| self.path(exposure.range().alpha(), stream);
        save_png(&path("ideal"), &exposure.ideal().demosaiced())?;
        save_png(&path("saturated"), &exposure.saturated())?;
        save_png(&path("modulo"), &exposure.modulo())?;
        if self.request.counts {
            // The sensor counts whole codes.
            save_counts(path, &exposure.wraps(), &exposure.x().mapv(f32::floor), exposure.range())?;
        }
        methods.iter_mut().map(|method| self.recover(model, &exposure, method.as_mut())).collect()
    }

    fn recover(
        &self,
        model: &SensorModel,
        exposure: &Exposure,
        method: &mut dyn Unwrap,
    ) -> Result<SimulationRow, BenchError> {
        let (range, modulo) = (exposure.range(), exposure.modulo());
        method.expect_edges(model.sharpness());
        let mut recovered = Recovered::default();
        // One call, with the allocation of its buffers: the duration is only a rough figure.
        let (unwrapped, ms) = timed(|| method.unwrap(&modulo, range, &mut recovered));
        unwrapped?;
        let colours = exposure.mosaic().map(|mosaic| mosaic.demosaic(recovered.x.view()));
        let x = colours.as_ref().unwrap_or(&recovered.x);
        let picture = tone::picture(x, range, model.transfer).map_err(UnwrapError::from)?;
        save_png(&self.path(range.alpha(), method.name()), &picture)?;
        if self.request.counts {
            let path = |what: &str| self.path(range.alpha(), &format!("{}_{what}", method.name()));
            save_counts(path, &recovered.k, &recovered.x, range)?;
        }
        let (ideal, picture) = (samples8(exposure.ideal().demosaiced().into_owned()), samples8(picture));
        Ok(SimulationRow {
            file: self.file.clone(),
            white: self.white,
            sensor: model.clone(),
            seed: self.request.exposure.seed,
            method: method.name().to_owned(),
            psnr_db: psnr_db(mse(&picture, &ideal)?),
            ssim: ssim(&picture, &ideal)?,
            exact_k: exposure.exact_share(&recovered.k).expect("a method keeps the shape of its image"),
            method_used: recovered.report.method.to_owned(),
            trusted: recovered.report.trust.claim(),
            ms,
        })
    }

    fn path(&self, alpha: f64, stream: &str) -> PathBuf {
        self.request.out.join(format!("{}_alpha{alpha}_{stream}.png", self.name))
    }
}

/// Makes the sensor of each alpha.
fn sensors(request: &SimulationRequest) -> Result<Vec<(SensorModel, Sensor)>, BenchError> {
    let sensors = request.exposure.sensors()?;
    if request.counts && sensors.iter().any(|(_, sensor)| sensor.range().limit() > 65536.0) {
        let why = "--counts writes images of 16 bits, which cannot hold alpha * 2^bits above 65536";
        return Err(BenchError::Option(why.to_owned()));
    }
    Ok(sensors)
}

/// The methods of these names, or `auto`.
///
/// # Errors
/// [`BenchError`] for an unknown name, and for any name where the gains decide the method.
pub(crate) fn methods_of(
    names: &[String],
    gains: Option<GainPattern>,
) -> Result<Vec<Box<dyn Unwrap>>, BenchError> {
    if let (Some(gains), [_, ..]) = (gains, names) {
        return Err(BenchError::Option(format!(
            "--method {} has no effect with --gains {}, whose images are unwrapped by {}: leave out one of these options",
            names.join(","),
            gains.word(),
            gains.method()
        )));
    }
    let method = |name: &str| {
        match name {
        // The method of the scripts of the paper, which is none for y.
        "spud_as_published" => Err(BenchError::Option(
            "spud_as_published needs the image before quantisation, which only modulo eval gives it; spud is the same \
             method on the modulo image"
                .to_owned(),
        )),
        name => Ok(by_name(name, &Options::default())?),
    }
    };
    match names {
        [] => Ok(vec![method("auto")?]),
        names => names.iter().map(|name| method(name)).collect(),
    }
}

/// The name of each file without extension, with `-2`, `-3` and so on if another file has it already.
pub(crate) fn names(files: &[PathBuf]) -> Vec<String> {
    // Files of two folders can have one name. A numbered name can exist as a file, too (`x-2.jpg`), so that each name
    // is checked against all names before it.
    let mut taken = HashSet::new();
    let free = |file: &PathBuf| {
        let stem = file.file_stem().unwrap_or(file.as_os_str()).to_string_lossy().into_owned();
        let numbered = (2..).map(|n: u32| format!("{stem}-{n}"));
        let mut names = std::iter::once(stem.clone()).chain(numbered);
        names.find(|name| taken.insert(name.clone())).expect("there are more numbers than files")
    };
    files.iter().map(free).collect()
}

/// Writes the wrap counts `k` as a PNG of 8 bits at `path("k")`, and `x` in code units as one of 16 bits at `path("x")`.
///
/// # Errors
/// [`BenchError`] if a file cannot be written, or the range of the sensor does not fit 16 bits.
pub(crate) fn save_counts(
    path: impl Fn(&str) -> PathBuf,
    k: &Array3<u8>,
    x: &Array3<f32>,
    range: Range,
) -> Result<(), BenchError> {
    save_png(&path("k"), &Frame::from_u8(k.clone()).map_err(UnwrapError::from)?)?;
    Ok(save_png(&path("x"), &tone::hdr(x, range).map_err(UnwrapError::from)?)?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equal_stems_are_told_apart() {
        let files = ["a/x.png", "b/x.png", "x-2.jpg", "x.exr", "y"].map(PathBuf::from);
        assert_eq!(names(&files), ["x", "x-2", "x-2-2", "x-3", "y"]);
    }
}
