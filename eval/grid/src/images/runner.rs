//! The common work of `simulate`, `unwrap` and the stability suite: each image, taken by each sensor, goes through each method. That gives
//! a picture and a [`Row`].

use std::collections::HashSet;
use std::path::{Path, PathBuf};
use std::slice;

use clap::{Args, value_parser};
use modulo_core::metric::{psnr_db, quantile};
use modulo_core::unwrap::{METHODS, Options, Scene, by_name, of_gains};
use modulo_core::{
    Exposure, Frame, Gains, MAX_THREADS, Range, Recovered, TwoGains, Unwrap, UnwrapError, tone,
};
use modulo_images::{save_exr, save_png};
use modulo_runtime::{Clock as _, SensorModel, SystemClock};
use ndarray::Array3;
use serde::Serialize;

use crate::GridError;
use crate::progress::GridEvent;
use crate::quality::{ImageSimilarity, up_to_offset};
use crate::store::save;

/// The word that stands for the names of all methods.
pub(crate) const ALL: &str = "all";

/// The options of both commands.
#[derive(Clone, Debug, PartialEq, Args)]
pub struct RunOptions {
    /// Unwrapping methods, for a sensor with one gain; `all` stands for each of them [default: auto]
    #[arg(long, value_delimiter = ',')]
    pub method: Vec<String>,
    /// Number of threads that a method may use
    #[arg(long, default_value_t = 1, value_parser = value_parser!(u16).range(1..=MAX_THREADS as i64))]
    pub threads: u16,
    /// Number of calls of a method on an image, whose median is its time; where there are several, one more call before them is not
    /// timed
    #[arg(long, default_value_t = 1, value_parser = value_parser!(u32).range(1..))]
    pub repeats: u32,
    /// Also write the recovered radiance as OpenEXR (NAME_METHOD.exr), demosaiced, in the unit of an EXR or HDR image, else as a fraction
    /// of full scale
    #[arg(long)]
    pub exr: bool,
    /// Folder for the images and results.json; without it a new one in runs
    #[arg(short, long, value_name = "FOLDER")]
    pub out: Option<PathBuf>,
}

/// The result of one method on one image.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Row {
    /// The file as it was given; of a video, with the number of the frame behind a blank.
    pub file: String,
    /// The sensor. The noise of a real one is not known, and has its default.
    #[serde(flatten, with = "modulo_runtime::parameter::flat")]
    pub sensor: SensorModel,
    /// Name of the method, as in [`METHODS`], or that of the gains.
    pub method: String,
    /// The method that produced the result: `method` itself, or the one that `auto` selected.
    pub method_used: String,
    /// Whether the method trusts its result. `None` if it makes no statement.
    pub trusted: Option<bool>,
    /// Why the method does not trust its result.
    pub reason: Option<&'static str>,
    /// The largest wrap count.
    pub most_k: u8,
    /// Median duration of a call, ms.
    pub ms: f64,
    /// The exposure and the scores of a simulated image; `None` for an image of a file.
    #[serde(flatten)]
    pub simulated: Option<Simulated>,
}

/// The exposure of a simulated image, and how near to it the result is.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Simulated {
    /// The radiance that became full scale, of a float image without a given white point.
    pub white: Option<f32>,
    /// Seed of the noise.
    pub seed: u64,
    /// `10 log10(255^2 / mse)` of the recovered against the ideal 8-bit image, over all samples. `None` (`null`) if they
    /// are equal.
    pub psnr_db: Option<f64>,
    /// Mean SSIM of these two images, see [`modulo_core::metric::ssim`]. `None` if a side is shorter than 11 px.
    pub ssim: Option<f64>,
    /// Share of the samples with the true wrap count, 0 to 1; with two gains, of those of full gain.
    pub exact_k: f64,
    /// Share of all samples with the true wrap count after the best offset for each channel.
    pub exact_up_to_offset: f64,
}

/// Result of a command.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct RunOutcome {
    /// The folder of the results.
    pub folder: PathBuf,
    /// One row for each image, sensor and method. Also in [`RESULTS`](crate::results::RESULTS).
    pub rows: Vec<Row>,
    /// The files and frames that cannot be used, each with the reason.
    pub skipped: Vec<String>,
}

pub(crate) struct Picture<T> {
    /// The name in the results, as [`Row::file`].
    pub file: String,
    /// The beginning of the names of the written images.
    pub name: String,
    /// The image, or the reason why it cannot be read.
    pub content: Result<T, GridError>,
}

pub(crate) struct Capture {
    pub y: Frame,
    pub sensor: SensorModel,
    /// The description of the sensor that the methods get.
    pub scene: Scene,
    /// The beginning of the names of the written images.
    pub name: String,
    /// Whether wrap counts and code units are written, too.
    pub counts: bool,
    /// The value of full scale in an EXR file.
    pub full_scale: f32,
    /// The exposure with its white point and its seed, of a simulated image.
    pub truth: Option<(Exposure, Option<f32>, u64)>,
}

/// Takes the pictures of each of `files`, `total` in number, by each of `sensors` with `capture`, and unwraps them by `methods`, or that of the
/// gains. After each file it writes [`RESULTS`](crate::results::RESULTS) with all rows so far into the folder `out`. A picture that cannot be
/// used is skipped, unless it is the only one.
pub(crate) fn run<T, S>(
    (options, out, mut methods): (&RunOptions, &Path, Vec<Box<dyn Unwrap>>),
    (files, total): (impl IntoIterator<Item = impl Iterator<Item = Picture<T>>>, usize),
    sensors: &[S],
    capture: impl Fn(&str, &T, &S) -> Result<Capture, GridError>,
    tell: &dyn Fn(GridEvent<'_>),
) -> Result<RunOutcome, GridError> {
    let mut outcome = RunOutcome { folder: out.to_owned(), ..RunOutcome::default() };
    let (mut done, steps) = (0, total * sensors.len());
    for file in files {
        for Picture { file, name, content } in file {
            let rows = content.and_then(|content| {
                let mut rows = Vec::new();
                for (sensor, done) in sensors.iter().zip(done..) {
                    tell(GridEvent::Cell { frames: (done as u64, steps as u64), name: &file });
                    let capture = capture(&name, &content, sensor)?;
                    // The ratio of the gains depends on alpha, so that this method belongs to one sensor.
                    let mut of_gains = of_gains(capture.sensor.gains()?);
                    let methods = of_gains.as_mut().map_or(&mut methods[..], slice::from_mut);
                    for method in methods {
                        rows.push(recover((options, out), (&file, &capture), method.as_mut())?);
                    }
                    tell(GridEvent::Frame);
                }
                Ok(rows)
            });
            done += sensors.len();
            match rows {
                Ok(rows) => outcome.rows.extend(rows),
                Err(why) if total > 1 && is_of_a_picture(&why) => {
                    tell(GridEvent::Warning(&format!("skipped: {why}")));
                    outcome.skipped.push(why.to_string());
                }
                Err(why) => return Err(why),
            }
        }
        save(out, &outcome.rows)?;
    }
    Ok(outcome)
}

/// Whether an error is that of one picture. One of a method or of the disk would come back with every picture.
fn is_of_a_picture(why: &GridError) -> bool {
    matches!(why, GridError::Image(_) | GridError::Sensor(_) | GridError::Video(_) | GridError::NotCodes(..))
}

/// Makes the methods that are asked for, or `auto`. Where the gains decide the method, none may be named.
pub(crate) fn methods(options: &RunOptions, has_two_gains: bool) -> Result<Vec<Box<dyn Unwrap>>, GridError> {
    let names: Vec<&str> = options.method.iter().map(String::as_str).collect();
    let names = match &names[..] {
        [] => vec!["auto"],
        names if names.contains(&ALL) => METHODS.to_vec(),
        _ => names,
    };
    if has_two_gains && !options.method.is_empty() {
        return Err(GridError::Request(format!(
            "--method {} has no effect with --gains {}, whose images are unwrapped by {}: leave out one of these options",
            options.method.join(","),
            Gains::word(true),
            TwoGains::NAME
        )));
    }
    // The method of the scripts of the paper is none for y.
    if names.contains(&"spud_as_published") {
        return Err(GridError::Request(
            "spud_as_published needs the image before quantisation, which only modulo eval gives it; spud is the same \
             method on the modulo image"
                .to_owned(),
        ));
    }
    let options = Options { threads: options.threads.into(), ..Options::default() };
    names.iter().map(|name| Ok(by_name(name, &options)?)).collect()
}

fn recover(
    (options, out): (&RunOptions, &Path),
    (file, capture): (&str, &Capture),
    method: &mut dyn Unwrap,
) -> Result<Row, GridError> {
    let Capture { y, sensor, scene, truth, .. } = capture;
    let (mut recovered, range) = (Recovered::default(), scene.range);
    let ms = median_time(options.repeats, || method.unwrap(y, scene, &mut recovered));
    let ms = ms.map_err(|why| match truth {
        Some(_) => why.into(),
        // A file may hold codes that the sensor cannot have.
        None => GridError::NotCodes(file.into(), why.to_string()),
    })?;
    let path = |what: &str| out.join(format!("{}_{}{what}.png", capture.name, method.name()));
    let colours = sensor.mosaic.map(|mosaic| mosaic.demosaic(recovered.x.view()));
    let x = colours.as_ref().unwrap_or(&recovered.x);
    let picture = tone::picture(x, range, sensor.transfer).map_err(UnwrapError::from)?;
    save_png(&path(""), &picture)?;
    if options.exr {
        let scale = f64::from(capture.full_scale) / range.white();
        // The converter has rounded down, by half a code on average.
        let radiance = x.mapv(|x| ((f64::from(x) + 0.5) * scale) as f32);
        save_exr(&out.join(format!("{}_{}.exr", capture.name, method.name())), &radiance)?;
    }
    if capture.counts {
        save_counts(|what| path(&format!("_{what}")), &recovered.k, &recovered.x, range)?;
    }
    Ok(Row {
        file: file.to_owned(),
        sensor: sensor.clone(),
        method: method.name().to_owned(),
        method_used: recovered.report.method.to_owned(),
        trusted: recovered.report.trust.claim(),
        reason: recovered.report.reason(),
        most_k: recovered.k.iter().copied().max().unwrap_or_default(),
        ms,
        simulated: truth.as_ref().map(|truth| compare(truth, &recovered.k, &picture)),
    })
}

/// Unwraps an image as often as it is asked for. Returns the median of the times, ms.
fn median_time(
    repeats: u32,
    mut unwrap: impl FnMut() -> Result<(), UnwrapError>,
) -> Result<f64, UnwrapError> {
    let clock = SystemClock::default();
    let mut call = || {
        let start = clock.ticks_ns();
        unwrap().map(|()| (clock.ticks_ns() - start) as f64 / 1e6)
    };
    // The first call allocates buffers and fills caches.
    let first = call()?;
    if repeats == 1 {
        return Ok(first);
    }
    Ok(median((0..repeats).map(|_| call()).collect::<Result<_, UnwrapError>>()?))
}

/// Returns the median of `values`, of which there is one.
pub fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    quantile(&values, 0.5).expect("there is a value")
}

fn compare(
    (exposure, white, seed): &(Exposure, Option<f32>, u64),
    k: &Array3<u8>,
    picture: &Frame,
) -> Simulated {
    const SHAPE: &str = "a method keeps the shape of its image";
    let ideal = ImageSimilarity::of(picture, &exposure.ideal().demosaiced()).expect(SHAPE);
    Simulated {
        white: *white,
        seed: *seed,
        psnr_db: psnr_db(ideal.mse),
        ssim: ideal.ssim,
        exact_k: exposure.exact_share(k).expect(SHAPE),
        exact_up_to_offset: up_to_offset(exposure, k),
    }
}

/// The name of each file without extension, with `-2`, `-3` and so on if another file has it already.
pub(crate) fn names(files: &[PathBuf]) -> Vec<String> {
    // Files of two folders can have one name. A numbered name can exist as a file, too (`x-2.jpg`), so that each name
    // is checked against all names before it.
    let mut used = HashSet::new();
    let free = |file: &PathBuf| {
        let stem = file.file_stem().unwrap_or(file.as_os_str()).to_string_lossy().into_owned();
        let numbered = (2..).map(|n: u32| format!("{stem}-{n}"));
        let mut names = std::iter::once(stem.clone()).chain(numbered);
        names.find(|name| used.insert(name.clone())).expect("there are more numbers than files")
    };
    files.iter().map(free).collect()
}

/// Writes the wrap counts `k` as a PNG of 8 bits at `path("k")`, and `x` in code units as one of 16 bits at `path("x")`.
pub(crate) fn save_counts(
    path: impl Fn(&str) -> PathBuf,
    k: &Array3<u8>,
    x: &Array3<f32>,
    range: Range,
) -> Result<(), GridError> {
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
