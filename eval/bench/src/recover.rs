//! `unwrap`: unwraps modulo images of a real or simulated sensor, given as files.

use std::path::{Path, PathBuf};

use clap::Parser;
use clap::builder::Resettable;
use modulo_core::unwrap::{DefectMap, Options, Sharpness, of_gains};
use modulo_core::{Frame, GainPattern, Mosaic, Psf, Recovered, Unwrap, UnwrapError, tone};
use modulo_images::{read_codes, save_png};
use modulo_runtime::SensorModel;
use modulo_runtime::sensor::options::{SensorCommand, SensorOptions};
use serde::Serialize;

use crate::benchmark::timed;
use crate::simulate::{RESULTS, methods_of, names, save_counts};
use crate::{BenchError, BenchEvent, Skipped, files, make_folder, write, write_json};

/// Name of the file with the defects that were learned: the value of the parameter `defects` of the node `unwrap`.
pub const DEFECTS: &str = "defects.csv";

/// The parameters of the sensor that unwrapping needs are options, with one value each.
#[derive(Clone, Debug, PartialEq)]
pub struct OneSensor;

impl SensorCommand for OneSensor {
    fn has(parameter: &str) -> bool {
        // Its noise is the only thing that unwrapping need not know.
        let noise = ["read_noise", "shot_noise", "full_well_electrons", "prnu", "hot_pixels"];
        !noise.contains(&parameter)
    }

    fn varies(_: &str) -> bool {
        false
    }
}

/// The images and their sensor, as options of a command line.
#[derive(Clone, Debug, PartialEq, Parser)]
#[command(mut_arg("alpha", |option| option.default_value(Resettable::Reset).required(true)))]
pub struct UnwrapRequest {
    /// Modulo images, or folders of them: PNG of 8 or 16 bits with the codes of the sensor
    #[arg(required = true)]
    pub images: Vec<PathBuf>,
    /// The sensor.
    #[command(flatten)]
    pub sensor: SensorOptions<OneSensor>,
    /// Unwrapping methods, for a sensor with one gain [default: auto]
    #[arg(long, value_delimiter = ',')]
    pub method: Vec<String>,
    /// Folder for the images and results.json
    #[arg(short, long, value_name = "FOLDER")]
    pub out: PathBuf,
}

/// The result of one method on one image.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct UnwrapRow {
    /// The file as it was given.
    pub file: String,
    /// Bits of the sensor.
    pub bits: u8,
    /// Saturation factor.
    pub alpha: f64,
    /// The full scale of a picture over `alpha * 2^bits`.
    pub headroom: f64,
    /// Transfer function of the recovered image: `linear`, `srgb`, `gamma22` or `rec709`.
    pub transfer: &'static str,
    /// Columns at the left border that a field stop shades.
    pub optical_black: usize,
    /// Pixels or colours with a lower gain, see [`GainPattern::WORDS`].
    pub gains: &'static str,
    /// Colour filters: `none`, `rggb`, `bggr`, `grbg` or `gbrg`.
    pub mosaic: &'static str,
    /// Name of the method, as in [`modulo_core::unwrap::METHODS`], or that of the gains.
    pub method: String,
    /// The method that produced the result: `method` itself, or the one that `auto` selected.
    pub method_used: String,
    /// Whether the method trusts its result. `None` if it makes no statement.
    pub trusted: Option<bool>,
    /// The largest wrap count.
    pub most_k: u8,
    /// Duration of one call on one thread, ms.
    pub ms: f64,
}

/// Result of [`unwrap_files`].
#[derive(Clone, Debug, Default, PartialEq)]
pub struct UnwrapOutcome {
    /// One row for each file and method. Also in [`RESULTS`].
    pub rows: Vec<UnwrapRow>,
    /// Files that could not be read, or are no image of such a sensor.
    pub skipped: Vec<Skipped>,
}

/// Unwraps the images. For each method it writes `NAME_METHOD.png` (8 bits as by [`tone::picture`], demosaiced),
/// `NAME_METHOD_x.png` (16 bits, x in code units) and `NAME_METHOD_k.png` (8 bits, the wrap counts); after each file it writes
/// [`RESULTS`] with all rows so far. Samples that the first method finds as defects in most of 30 images of one size are left out of the
/// images that follow, and stand in [`DEFECTS`] at the end.
///
/// # Errors
/// [`BenchError`] before anything is written if the request is wrong, and later if a result cannot be written. A file
/// that cannot be used is skipped, unless it is the only one.
pub fn unwrap_files(
    request: &UnwrapRequest,
    tell: &mut dyn FnMut(BenchEvent<'_>),
) -> Result<UnwrapOutcome, BenchError> {
    let sensor = request.sensor.first();
    let range = sensor.range()?;
    if range.limit() > 65536.0 {
        let why = "the results have 16 bits, which cannot hold alpha * 2^bits above 65536; use the node unwrap for floats";
        return Err(BenchError::Option(why.to_owned()));
    }
    let mut methods = methods_of(&request.method, sensor.gains)?;
    if let Some(method) = of_gains(sensor.gains()?, &Options::default())? {
        methods = vec![method];
    }
    let files = files(&request.images, tell)?;
    // A single file that is refused leaves no folder behind.
    if let [file] = &files[..] {
        modulo_image(file, &sensor)?;
    }
    make_folder(&request.out)?;
    let mut methods: Vec<_> = methods.into_iter().map(|method| (method, DefectMap::default())).collect();
    let mut outcome = UnwrapOutcome::default();
    for (done, (file, name)) in files.iter().zip(names(&files)).enumerate() {
        let next = file.display().to_string();
        tell(BenchEvent::Step { done, total: files.len(), next: &next });
        match of_file(request, (file, &name), &sensor, &mut methods) {
            Ok(rows) => outcome.rows.extend(rows),
            Err(why @ (BenchError::Image(_) | BenchError::NotCodes(..))) if files.len() > 1 => {
                let skipped = Skipped { file: next, why: why.to_string() };
                tell(BenchEvent::Skipped(&skipped));
                outcome.skipped.push(skipped);
            }
            Err(why) => return Err(why),
        }
        write_json(&request.out.join(RESULTS), &outcome.rows)?;
    }
    if let Some((_, map)) = methods.first().filter(|(_, map)| !map.is_empty()) {
        write(&request.out.join(DEFECTS), map.to_string().as_bytes())?;
    }
    Ok(outcome)
}

/// Reads an image with the codes of `sensor`.
fn modulo_image(file: &Path, sensor: &SensorModel) -> Result<Frame, BenchError> {
    let refuse = |why: String| Err(BenchError::NotCodes(file.to_owned(), why));
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

/// Unwraps one file by all methods.
fn of_file(
    request: &UnwrapRequest,
    (file, name): (&Path, &str),
    sensor: &SensorModel,
    methods: &mut [(Box<dyn Unwrap>, DefectMap)],
) -> Result<Vec<UnwrapRow>, BenchError> {
    // A sigma of 0 stands for a lens that is not given.
    let sharpness = if sensor.psf() == Psf::None { Sharpness::Unknown } else { sensor.sharpness() };
    let (range, gains, mosaic) = (sensor.range()?, sensor.gains()?, sensor.mosaic);
    let y = modulo_image(file, sensor)?;
    let row = |(method, map): &mut (Box<dyn Unwrap>, DefectMap)| {
        let mut recovered = Recovered::default();
        method.expect_edges(sharpness);
        map.fit(y.dim()).expect("a map that was not read has no size of its own");
        let (unwrapped, ms) = timed(|| map.unwrap(method.as_mut(), &y, range, gains, &mut recovered));
        unwrapped.map_err(|why| BenchError::NotCodes(file.to_owned(), why.to_string()))?;
        let path = |what: &str| request.out.join(format!("{name}_{}{what}.png", method.name()));
        let colours = mosaic.map(|mosaic| mosaic.demosaic(recovered.x.view()));
        let x = colours.as_ref().unwrap_or(&recovered.x);
        save_png(&path(""), &tone::picture(x, range, sensor.transfer).map_err(UnwrapError::from)?)?;
        save_counts(|what| path(&format!("_{what}")), &recovered.k, &recovered.x, range)?;
        Ok(UnwrapRow {
            file: file.display().to_string(),
            bits: range.bits(),
            alpha: range.alpha(),
            headroom: sensor.headroom,
            transfer: sensor.transfer.word(),
            optical_black: sensor.optical_black,
            gains: sensor.gains.map_or("none", GainPattern::word),
            mosaic: mosaic.map_or("none", Mosaic::word),
            method: method.name().to_owned(),
            method_used: recovered.report.method.to_owned(),
            trusted: recovered.report.trust.claim(),
            most_k: recovered.k.iter().copied().max().unwrap_or_default(),
            ms,
        })
    };
    methods.iter_mut().map(row).collect()
}
