//! Readouts that are less sharp than the lens, in front of a modulo sensor: pixels that add before they wrap, a
//! birefringent filter, defocus.
//!
//! The pictures of the sources are a grid of photosites, 2 x 2 for each pixel of the chips that are compared: all have
//! the same number of pixels, but for the one that reads every photosite. Lengths are in px of these chips. The method
//! knows no lens.

use std::f64::consts::PI;
use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, anyhow};
use clap::Parser;
use modulo_bags::source::{GroundTruth, SourceOptions, open};
use modulo_core::unwrap::{Method, Options as MethodOptions, Scene};
use modulo_core::{Frame, Psf, Recovered, Sensor, SensorConfig, Transfer, optics, tone};
use modulo_lab::{Program, ap50, write_labels, write_picture};
use ndarray::Array3;

/// The photosites of a pixel along one side.
const SITES: usize = 2;

/// Evaluates a detector on the images of modulo sensors with less sharp readouts, and prints which wrap counts are
/// right
#[derive(Parser)]
struct Options {
    #[command(flatten)]
    program: Program,
    /// New folder for the images and the results
    out: PathBuf,
    /// Sources of labelled frames, as `modulo eval --source` takes them
    #[arg(long, required = true)]
    source: Vec<String>,
    /// Saturation factors
    #[arg(long, value_delimiter = ',', default_value = "4,8")]
    alpha: Vec<f64>,
    /// Standard deviations of the blur of the lens, px
    #[arg(long, value_delimiter = ',', default_value = "0,0.8")]
    psf_sigma: Vec<f64>,
    /// Most frames of a source
    #[arg(long, default_value_t = 20)]
    frames: usize,
}

fn main() -> anyhow::Result<()> {
    let options = Options::parse();
    fs::create_dir(&options.out).with_context(|| options.out.display().to_string())?;
    let mut sources = Vec::new();
    for spec in &options.source {
        let mut source = open(spec, &SourceOptions::default())?;
        let frames = std::iter::from_fn(|| source.next()).take(options.frames);
        sources.push(frames.collect::<Result<Vec<_>, _>>()?);
    }
    println!(
        "readout,psf_sigma,mtf50,alpha,frames,exact_k,trusted,vehicles,persons,vehicles_ideal,persons_ideal"
    );
    for &sigma in &options.psf_sigma {
        for readout in READOUTS {
            for &alpha in &options.alpha {
                let name = format!("{}_psf{sigma}_alpha{alpha}", readout.name);
                let mut row = Row { folder: options.out.join(name), ..Row::default() };
                for (drive, frames) in sources.iter().enumerate() {
                    for (number, frame) in frames.iter().enumerate() {
                        let labels = frame.ground_truth.as_deref().unwrap_or_default();
                        row.add(readout, sigma, alpha, &frame.radiance, (drive, number, labels))?;
                    }
                }
                let [recovered, ideal] =
                    ["recovered", "ideal"].map(|stream| row.score(&options.program, stream));
                let (name, mtf50) = (readout.name, readout.mtf50(sigma));
                let (frames, exact, trusted) = (row.frames, 100.0 * row.exact / row.frames, row.trusted);
                println!(
                    "{name},{sigma},{mtf50:.2},{alpha},{frames},{exact:.2},{trusted},{},{}",
                    recovered?, ideal?
                );
            }
        }
    }
    Ok(())
}

/// The filters and the photosites between the lens and the converter.
#[derive(Clone, Copy)]
struct Readout {
    name: &'static str,
    kind: Kind,
}

#[derive(Clone, Copy, PartialEq)]
enum Kind {
    /// Every photosite is a pixel: [`SITES`] squared times as many as in the others.
    Photosites,
    /// One photosite of each pixel is read.
    One,
    /// All photosites of a pixel fill one well: a larger pixel.
    Binned,
    /// The same behind a filter that makes four spots of one, one pixel apart.
    FourSpots,
    /// The same with a lens out of focus: a disc of this radius in px.
    Disc(f64),
}

const READOUTS: [Readout; 6] = [
    Readout { name: "every_photosite", kind: Kind::Photosites },
    Readout { name: "one_photosite", kind: Kind::One },
    Readout { name: "binned", kind: Kind::Binned },
    Readout { name: "birefringent", kind: Kind::FourSpots },
    Readout { name: "defocus_half_px", kind: Kind::Disc(0.5) },
    Readout { name: "defocus_one_px", kind: Kind::Disc(1.0) },
];

/// A weight, and the row and column of the photosite that it belongs to, from the first one of the pixel on.
type Weight = (isize, isize, f64);

impl Readout {
    /// Returns the photosites along a side from one pixel to the next.
    fn pitch(self) -> usize {
        if self.kind == Kind::Photosites { 1 } else { SITES }
    }

    /// Returns the photosites that a pixel sees through the filter, with weights of sum 1.
    fn weights(self) -> Vec<Weight> {
        let sites = SITES as isize;
        let binned = || {
            let weight = 1.0 / (SITES * SITES) as f64;
            (0..sites).flat_map(|row| (0..sites).map(move |column| (row, column, weight))).collect()
        };
        match self.kind {
            Kind::Photosites | Kind::One => vec![(0, 0, 1.0)],
            Kind::Binned => binned(),
            // Half a pixel to each side is one photosite.
            Kind::FourSpots => {
                through(&[(-1, -1, 0.25), (-1, 1, 0.25), (1, -1, 0.25), (1, 1, 0.25)], &binned())
            }
            Kind::Disc(radius) => through(&disc(radius * SITES as f64), &binned()),
        }
    }

    /// Returns the image of the pixels, H x W x C, of that of the photosites.
    fn read(self, sites: &Array3<f32>) -> Array3<f32> {
        let ((height, width, channels), pitch, weights) = (sites.dim(), self.pitch(), self.weights());
        let within = |at: isize, side: usize| at.clamp(0, side as isize - 1) as usize;
        Array3::from_shape_fn((height / pitch, width / pitch, channels), |(row, column, channel)| {
            let (row, column) = ((row * pitch) as isize, (column * pitch) as isize);
            let site = |&(down, right, weight): &Weight| {
                let at = (within(row + down, height), within(column + right, width), channel);
                weight * f64::from(sites[at])
            };
            weights.iter().map(site).sum::<f64>() as f32
        })
    }

    /// Returns the spatial frequency along a row at which half of the contrast is left, in cycles per px, with the lens
    /// and the area of a photosite.
    fn mtf50(self, sigma: f64) -> f64 {
        let weights = self.weights();
        let site = 1.0 / SITES as f64;
        let contrast = |frequency: f64| {
            let phase = |right: isize| 2.0 * PI * frequency * right as f64 * site;
            let sum =
                |of: fn(f64) -> f64| weights.iter().map(|(_, right, w)| w * of(phase(*right))).sum::<f64>();
            let area = PI * frequency * site;
            let lens = (-2.0 * (PI * sigma * frequency).powi(2)).exp();
            lens * (area.sin() / area) * sum(f64::cos).hypot(sum(f64::sin))
        };
        (1..4000).map(|step| f64::from(step) / 1000.0).find(|at| contrast(*at) < 0.5).unwrap_or(f64::INFINITY)
    }
}

/// Returns the weights of two filters one behind the other.
fn through(first: &[Weight], second: &[Weight]) -> Vec<Weight> {
    let pair = |a: &Weight, b: &Weight| (a.0 + b.0, a.1 + b.1, a.2 * b.2);
    first.iter().flat_map(|a| second.iter().map(move |b| pair(a, b))).collect()
}

/// Returns the share of a disc of `radius` photosites in each photosite around its middle.
fn disc(radius: f64) -> Vec<Weight> {
    /// The points of a photosite along one side at which the disc is sampled.
    const POINTS: usize = 32;
    let reach = radius.ceil() as isize;
    let offset = |point: usize| (point as f64 + 0.5) / POINTS as f64 - 0.5;
    let covered = |row: isize, column: isize| {
        let is_in =
            |(y, x): (usize, usize)| (row as f64 + offset(y)).hypot(column as f64 + offset(x)) <= radius;
        (0..POINTS).flat_map(|y| (0..POINTS).map(move |x| (y, x))).filter(|point| is_in(*point)).count()
            as f64
    };
    let side = || -reach..=reach;
    let areas: Vec<Weight> =
        side().flat_map(|row| side().map(move |column| (row, column, covered(row, column)))).collect();
    let sum: f64 = areas.iter().map(|(_, _, area)| area).sum();
    areas
        .into_iter()
        .filter(|(_, _, area)| *area > 0.0)
        .map(|(row, column, area)| (row, column, area / sum))
        .collect()
}

/// The results of a sensor.
#[derive(Default)]
struct Row {
    folder: PathBuf,
    frames: f64,
    /// The sum of the shares of the right counts.
    exact: f64,
    trusted: usize,
}

impl Row {
    /// Exposes and recovers a frame, and writes its pictures in the size of the source, to which its labels belong.
    fn add(
        &mut self,
        readout: Readout,
        sigma: f64,
        alpha: f64,
        radiance: &Array3<f32>,
        (drive, number, labels): (usize, usize, &[GroundTruth]),
    ) -> anyhow::Result<()> {
        let seen = readout.read(&optics::blurred(radiance.clone(), Psf::of_sigma(sigma * SITES as f64)));
        let sensor = Sensor::new(SensorConfig { alpha, headroom: 0.97, ..SensorConfig::PLAIN })?;
        let exposure = sensor.expose(seen.view(), number as u64)?;
        let (mut method, mut recovered) =
            (Method::Auto.build(&MethodOptions::default())?, Recovered::default());
        method.unwrap(&exposure.modulo(), &Scene { lens: None, ..exposure.scene() }, &mut recovered)?;
        let recovered_picture = tone::picture(&recovered.x, sensor.range(), Transfer::Linear)?;
        for (stream, picture) in [("recovered", recovered_picture), ("ideal", exposure.ideal())] {
            let folder = self.folder.join(stream).join(drive.to_string());
            let name = format!("{number:06}");
            write_picture(&folder, &name, &enlarged(&picture, readout.pitch(), radiance.dim())?)?;
            write_labels(&folder, &name, labels)?;
        }
        self.frames += 1.0;
        self.exact += exposure.exact_share(&recovered.k).context("the counts have the shape of the image")?;
        self.trusted += usize::from(recovered.report.trust.claim() == Some(true));
        Ok(())
    }

    /// Returns the accuracy on the pictures of a stream.
    fn score(&self, program: &Program, stream: &str) -> anyhow::Result<String> {
        let pictures = self.folder.join(stream);
        let mut drives: Vec<PathBuf> = fs::read_dir(&pictures)?.flatten().map(|drive| drive.path()).collect();
        drives.sort();
        let text = |path: &Path| {
            path.to_str().map(str::to_owned).ok_or_else(|| anyhow!("{}: is no text", path.display()))
        };
        let mut arguments = Vec::new();
        for drive in &drives {
            arguments.extend(["--source".to_owned(), text(drive)?]);
        }
        let arguments: Vec<&str> = arguments.iter().map(String::as_str).collect();
        let found = program.evaluate(&arguments, &self.folder.join(format!("results_{stream}")))?;
        let cell = &found["cells"][0];
        Ok(format!("{},{}", ap50(cell, "vehicle"), ap50(cell, "person")))
    }
}

/// Returns a picture each of whose pixels has `times` the side; rows and columns without a whole pixel repeat the last
/// one.
fn enlarged(picture: &Frame, times: usize, dim: (usize, usize, usize)) -> anyhow::Result<Frame> {
    let codes = picture.as_u8().context("a picture has 8 bits")?;
    let (height, width, _) = codes.dim();
    let at = |at: usize, side: usize| (at / times).min(side - 1);
    let code = |(row, column, channel)| codes[(at(row, height), at(column, width), channel)];
    Ok(Frame::from_u8(Array3::from_shape_fn(dim, code))?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_readout_keeps_the_light() {
        for readout in READOUTS {
            let sum: f64 = readout.weights().iter().map(|(_, _, weight)| weight).sum();
            assert!((sum - 1.0).abs() < 1e-12, "{}: {sum}", readout.name);
            let read = readout.read(&Array3::from_elem((8, 12, 3), 0.25));
            assert!(read.iter().all(|x| (x - 0.25).abs() < 1e-6));
            assert_eq!(read.dim(), (8 / readout.pitch(), 12 / readout.pitch(), 3));
        }
    }

    #[test]
    fn a_binned_pixel_is_the_mean_of_its_photosites_and_a_filter_spreads_it() {
        let mut sites = Array3::zeros((8, 8, 1));
        sites[(2, 2, 0)] = 1.0;
        let [binned, spots] = [READOUTS[2], READOUTS[3]].map(|readout| readout.read(&sites));
        assert_eq!((binned[(1, 1, 0)], binned.sum()), (0.25, 0.25));
        // One spot falls into each of four pixels.
        let of_spots: Vec<f32> =
            [(0, 0), (0, 1), (1, 0), (1, 1)].map(|(row, column)| spots[(row, column, 0)]).into();
        assert_eq!(of_spots, [1.0 / 16.0; 4]);
    }

    #[test]
    fn contrast_is_that_of_the_known_formulas() {
        let near =
            |found: f64, expected: f64| assert!((found - expected).abs() < 0.002, "{found}, not {expected}");
        // sin(pi f) / (pi f) = 1/2 for a pixel; four spots multiply it by cos(pi f).
        near(READOUTS[2].mtf50(0.0), 0.603);
        near(READOUTS[3].mtf50(0.0), 0.302);
        // A photosite has half the side, and one behind a wide lens the contrast of the lens: exp(-2 (pi sigma f)^2) =
        // 1/2.
        near(READOUTS[1].mtf50(0.0), 1.207);
        near(READOUTS[1].mtf50(4.0), f64::sqrt(f64::ln(2.0) / 2.0) / (4.0 * PI));
    }
}
