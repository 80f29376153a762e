//! The protocol of the paper: the steps of its scripts before the detector, and its three figures.
//!
//! The nodes of the suite work differently. The images become files, in which the program detects as they are. Values become 8 bits by truncation,
//! not by rounding.

mod figures;

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use clap::Parser;
use figures::{Paper, mean, of_image};
use modulo_core::unwrap::{Range, Recovered, Spud, ThresholdOn, Unwrap};
use modulo_core::{BBox, Detection, Frame, Psf, Samples, optics, tone};
use modulo_images::read_image;
use modulo_lab::{Program, ap50, bbox, jsons, percent, write_picture};
use ndarray::Array3;
use serde_json::Value;

/// Threshold of SPUD on phi, in units of the peak.
const TAU: f64 = 0.1;
/// The classes of COCO by those of KITTI, as the scripts map them.
const CLASSES: &str = include_str!("paper_classes.yaml");

/// Evaluates a detector on KITTI images by the protocol of the paper, and prints a line of figures for each image and alpha
#[derive(Parser)]
struct Options {
    #[command(flatten)]
    program: Program,
    /// KITTI object folder (image_2, label_2)
    kitti: PathBuf,
    /// New folder for the images and the results
    out: PathBuf,
    /// Saturation factors
    #[arg(long, value_delimiter = ',', default_value = "1.5,2,3,4")]
    alpha: Vec<f64>,
    /// Number of frames, in the order of their names; all by default
    #[arg(long)]
    frames: Option<usize>,
}

/// The images of the detector but the ideal one.
const IMAGES: [&str; 4] = ["saturated", "modulo", "spud_as_published", "spud"];

fn main() -> anyhow::Result<()> {
    let options = Options::parse();
    fs::create_dir(&options.out).with_context(|| options.out.display().to_string())?;
    let classes = options.out.join("classes.yaml");
    fs::write(&classes, CLASSES)?;
    let folder = |image: &str, alpha: f64| options.out.join(format!("{image}_{alpha}"));
    let mut sets = vec![("ideal", 1.0)];
    sets.extend(options.alpha.iter().flat_map(|&alpha| IMAGES.map(|image| (image, alpha))));
    for name in names(&options)? {
        let file = options.kitti.join("image_2").join(format!("{name}.png"));
        let read = read_image(&file)?;
        let Samples::U8(codes) = read.samples() else { bail!("{}: has no codes of 8 bits", file.display()) };
        for (image, alpha) in &sets {
            let mut paper = PaperSensor::new(*alpha)?;
            write_picture(&folder(image, *alpha), &name, &paper.picture(image, codes)?)?;
            let labels = Path::new("label_2").join(format!("{name}.txt"));
            if options.kitti.join(&labels).exists() {
                fs::copy(options.kitti.join(&labels), folder(image, *alpha).join(labels))?;
            }
        }
    }
    println!("image,alpha,frames,ap50_vehicle,ap50_person,iou,f1,accuracy");
    for (image, alpha) in sets {
        let (pictures, results) = (folder(image, alpha), folder(&format!("results_{image}"), alpha));
        let arguments = ["--kitti", text(&pictures)?, "--class-map", text(&classes)?, "--input", "640x640"];
        let found = options.program.evaluate(&arguments, &results)?;
        let (cell, Paper { iou, f1, accuracy }) = (&found["cells"][0], figures_of(&results)?);
        let groups = ["vehicle", "person"].map(|group| ap50(cell, group)).join(",");
        let figures = [iou, f1, accuracy].map(|figure| percent(Some(figure))).join(",");
        println!("{image},{alpha},{},{groups},{figures}", cell["frames"]);
    }
    Ok(())
}

fn text(path: &Path) -> anyhow::Result<&str> {
    path.to_str().with_context(|| format!("{}: is no text", path.display()))
}

/// Returns the names of the frames.
fn names(options: &Options) -> anyhow::Result<Vec<String>> {
    let folder = options.kitti.join("image_2");
    let entries = fs::read_dir(&folder).with_context(|| folder.display().to_string())?;
    let name = |path: PathBuf| {
        let is_png = path.extension().is_some_and(|extension| extension == "png");
        is_png.then(|| Some(path.file_stem()?.to_str()?.to_owned())).flatten()
    };
    let mut names: Vec<String> = entries.flatten().filter_map(|entry| name(entry.path())).collect();
    names.sort();
    names.truncate(options.frames.unwrap_or(usize::MAX));
    Ok(names)
}

/// Returns the three figures of the boxes and labels that lie in a folder of results.
fn figures_of(results: &Path) -> anyhow::Result<Paper> {
    let (frames, cells) = (jsons(&results.join("frames"))?, jsons(&results.join("cells"))?);
    let all = |files: &[(PathBuf, Value)]| -> Vec<Value> {
        files.iter().flat_map(|(_, file)| file["frames"].as_array().into_iter().flatten()).cloned().collect()
    };
    let (frames, found) = (all(&frames), all(&cells));
    let of_frame = |frame: &Value| {
        let own = found.iter().find(|own| own["place"] == frame["place"])?;
        let truth = frame["truth"].as_array()?.iter().filter(|label| label[1] != "dontcare");
        let truth: Vec<(BBox, &str)> =
            truth.filter_map(|label| Some((bbox(&label[0])?, label[1].as_str()?))).collect();
        let boxes = own["boxes"].as_array().into_iter().flatten().filter_map(detection);
        Some(of_image(&boxes.collect::<Vec<_>>(), &truth))
    };
    Ok(mean(&frames.iter().filter_map(of_frame).collect::<Vec<_>>()))
}

/// Reads a box in the class of the labels. One without a counterpart is dropped.
fn detection(row: &Value) -> Option<Detection> {
    let own = row[2].as_str()?;
    let lines = CLASSES.lines().filter_map(|line| line.split_once(": "));
    let class = lines.into_iter().find(|(from, _)| *from == own)?.1.to_owned();
    Some(Detection { bbox: bbox(&row[0])?, score: row[1].as_f64()? as f32, class })
}

/// The sensor and the unwrapping of the scripts. Its lens is always that of the paper.
struct PaperSensor {
    range: Range,
    spud: Spud,
}

impl PaperSensor {
    fn new(alpha: f64) -> anyhow::Result<Self> {
        Ok(Self { range: Range::new(8, alpha)?, spud: Spud::new(TAU, ThresholdOn::Phi)? })
    }

    /// Returns the picture called `image` of a file with these codes.
    fn picture(&mut self, image: &str, codes: &Array3<u8>) -> anyhow::Result<Frame> {
        let codes = codes.mapv(f32::from);
        let exposed = || self.exposed(&codes);
        bytes(&match image {
            // The original frame, without a lens.
            "ideal" => codes,
            "saturated" => exposed().mapv(|v| v.clamp(0.0, 1.0) * 255.0),
            "modulo" => exposed().mapv(|v| wrapped(v) * 255.0),
            _ => {
                let y = exposed().mapv(wrapped);
                self.recovered(&y, image == "spud_as_published")?
            }
        })
    }

    /// Returns `alpha * blurred` of the stretched image in [0, 1]. The blur comes before the scaling.
    fn exposed(&self, codes: &Array3<f32>) -> Array3<f32> {
        let alpha = self.range.alpha() as f32;
        // The scripts stretch each image to 0..255 and truncate it to whole codes before anything else. They blur it
        // with seven taps, sigma 1.4 px, before they multiply it by alpha. The text of the paper does not mention the
        // blur.
        let x = stretched(codes).mapv(|v| v / 255.0);
        optics::blurred(x, Psf::Paper7).mapv(|v| v * alpha)
    }

    /// Unwraps the modulo image `y` in units of the peak, by SPUD as published or made congruent.
    fn recovered(&mut self, y: &Array3<f32>, as_published: bool) -> anyhow::Result<Array3<f32>> {
        // SPUD of the scripts gets the float image in units of the peak. `Spud` works in codes, and its threshold is in
        // units of the peak, so that scaling by the peak changes nothing.
        let peak = self.range.peak();
        let codes = y.mapv(|v| v * peak);
        if as_published {
            // The wrapped field is the gradient of x: phi is x without its mean, in code units.
            return Ok(stretched(&self.spud.solve(codes.view(), self.range)?));
        }
        // Q_b of eq. 1: whole codes, of which 2^b is 0.
        let y = Frame::from_u8(codes.mapv(|v| v as u32 as u8))?;
        let mut out = Recovered::default();
        self.spud.unwrap(&y, &self.range.into(), &mut out)?;
        Ok(tone::linear8(&out.x, self.range)?.to_f32())
    }
}

/// Truncates to bytes, as the scripts convert an image for the detector.
fn bytes(image: &Array3<f32>) -> anyhow::Result<Frame> {
    Ok(Frame::from_u8(image.mapv(|v| v as u8))?)
}

/// Returns `mod(x, 1)`, except that a positive multiple of 1 gives 1: in the scripts, a positive multiple of the peak becomes the peak and not 0.
fn wrapped(x: f32) -> f32 {
    let rest = x.rem_euclid(1.0);
    if rest == 0.0 && x > 0.0 { 1.0 } else { rest }
}

/// Maps minimum and maximum over all channels to 0 and 255 and truncates to whole steps. A constant image becomes 0.
fn stretched(values: &Array3<f32>) -> Array3<f32> {
    let low = f64::from(values.iter().copied().fold(f32::INFINITY, f32::min));
    let high = f64::from(values.iter().copied().fold(f32::NEG_INFINITY, f32::max));
    // The multiplication comes first, so that an image that spans 0 to 255 stays unchanged.
    let step = |v: f32| ((f64::from(v) - low) * 255.0 / (high - low)).floor();
    values.mapv(|v| if high > low { step(v) as f32 } else { 0.0 })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn shown(image: &str, alpha: f64, codes: Array3<u8>) -> Vec<u8> {
        let mut paper = PaperSensor::new(alpha).expect("possible");
        let picture = paper.picture(image, &codes).expect("passed");
        picture.as_u8().expect("8 bits").iter().copied().collect()
    }

    /// One row of grey codes: 0 on the left, the brightest on the right, flat in between and at the ends beyond the lens.
    fn steps(middle: u8) -> Array3<u8> {
        let codes = [vec![0; 20], vec![middle; 20], vec![255; 20]].concat();
        Array3::from_shape_vec((1, 60, 1), codes).expect("60 codes")
    }

    #[test]
    fn the_ideal_is_the_original_without_a_lens() {
        let codes: Vec<u8> = (0..60).map(|i| if i % 2 == 0 { 3 } else { 200 }).collect();
        let image = Array3::from_shape_vec((1, 60, 1), codes.clone()).expect("60 codes");
        assert_eq!(shown("ideal", 4.0, image), codes);
    }

    #[test]
    fn the_blur_lies_before_the_scaling_and_the_clipping() {
        let got = shown("saturated", 2.0, steps(0));
        // The step from 0 to 1 behind seven taps, doubled, then clipped: half of the way is above the peak already.
        let taps = [0.03125, 0.140625, 0.359375, 0.640625, 0.859375f64];
        let want: Vec<u8> = taps.map(|share| (2.0 * share * 255.0).min(255.0) as u8).to_vec();
        assert_eq!(got[37..42], want);
        assert_eq!((got[30], got[50]), (0, 255));
    }

    #[test]
    fn modulo_is_wrapped_in_float_and_cut_to_8_bits() {
        // 2.5 * 121 = 302.5 of 255: the rest is 47.5, which would be 48 if it were rounded.
        assert_eq!(shown("modulo", 2.5, steps(121))[30], 47);
        let got = shown("modulo", 3.0, steps(121));
        assert_eq!(got[50], 255, "three times the peak is the peak, not 0");
        assert_eq!(got[5], 0, "but nothing is nothing");
        assert_eq!([wrapped(0.0), wrapped(1.0), wrapped(1.25), wrapped(2.0)], [0.0, 1.0, 0.25, 1.0]);
    }

    #[test]
    fn spud_is_stretched_as_published_and_absolute_where_it_is_congruent() {
        let ramp = Array3::from_shape_fn((32, 256, 1), |(_, x, _)| x as u8);
        for image in ["spud_as_published", "spud"] {
            let got = shown(image, 1.5, ramp.clone());
            let row = &got[16 * 256..17 * 256];
            // The lens bends the ends of the ramp, and tau takes small cosines away.
            assert!((0..256).all(|x| (i32::from(row[x]) - x as i32).abs() <= 5), "{image} {row:?}");
        }
    }

    #[test]
    fn spud_sees_less_than_a_code() {
        let mut paper = PaperSensor::new(1.5).expect("possible");
        // Half a code from left to right, hidden from 8 bits; tau would drop it, so that the ramp is large in all.
        let y = Array3::from_shape_fn((64, 64, 1), |(_, x, _)| 0.1 + x as f32 / 64.0 * 0.5 / 256.0);
        paper.spud = Spud::new(0.0, ThresholdOn::Phi).expect("possible");
        let got = paper.recovered(&y, true).expect("recovered");
        assert!(got[(32, 60, 0)] > got[(32, 30, 0)] && got[(32, 30, 0)] > got[(32, 4, 0)]);
    }
}
