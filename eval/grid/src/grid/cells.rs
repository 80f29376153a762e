//! [`Axes`]: the values that a grid combines, and the cells that follow from them.

use std::path::PathBuf;

use clap::{Parser, ValueEnum};
use modulo_core::TwoGains;
use modulo_core::unwrap::METHODS;
use modulo_runtime::sensor::options::{SensorCommand, SensorOptions};
use modulo_runtime::{ParameterError, ParameterSet as _, SensorModel};

use super::GridError;
use super::pipeline::paper::SPUD_AS_PUBLISHED;
use crate::chart::file_name;
use crate::labels;
use crate::results::{Point, Protocol, Stream};

/// The parameters of the sensor that cells can differ in.
#[derive(Clone, Debug, PartialEq)]
pub struct VariedParameters;

/// Parameters of the sensor that have their default in all cells.
const FIXED: [&str; 3] = ["bits", "psf", "gain_ratio"];
/// The parameters that vary fastest, but for the lens, which varies with the streams. The others vary before them.
const FAST: [&str; 3] = ["alpha", "mosaic", "gains"];
const LENS: &str = "psf_sigma";

impl SensorCommand for VariedParameters {
    const WITHOUT: &'static [&'static str] = &FIXED;

    fn varies(parameter: &str) -> bool {
        // The frames are read once for all cells, and decoded as they are read.
        parameter != "transfer"
    }
}

/// The values that the cells combine. A value may be listed twice; its cells are in the grid once.
#[derive(Clone, Debug, PartialEq, Parser)]
#[command(mut_arg("alpha", |option| option.default_value("1.5,2,3,4")))]
pub struct Axes {
    /// Images that the detector gets
    #[arg(long, value_delimiter = ',', default_value = "ideal,saturated,modulo,recovered")]
    pub stream: Vec<Stream>,
    /// Unwrapping methods, and spud_as_published: SPUD as the scripts of the paper have it, on the image before
    /// quantisation and without congruence [default: auto,spud; spud_as_published,spud for the paper]
    #[arg(long, value_delimiter = ',')]
    pub method: Vec<String>,
    /// Whether the lens blur is removed from recovered images
    #[arg(long, value_enum, default_value_t = DeblurChoice::Both)]
    pub deblur: DeblurChoice,
    /// The sensors. The images of two gains have a method of their own, and their saturated stream is that of spatially varying
    /// exposure; the images of a mosaic are demosaiced for the detector.
    #[command(flatten)]
    pub sensor: SensorOptions<VariedParameters>,
    /// Detection models: ONNX files, or demo for the embedded model
    #[arg(long, value_delimiter = ',', default_value = "demo")]
    pub model: Vec<PathBuf>,
    /// Input sizes of the model: auto (no resizing) or WIDTHxHEIGHT [default: auto; 640x640 for the paper]
    #[arg(long, value_delimiter = ',')]
    pub input: Vec<String>,
}

/// The methods under the protocol of the paper: both forms of SPUD.
const PAPER_METHODS: [&str; 2] = [SPUD_AS_PUBLISHED, "spud"];

/// Whether the lens blur is removed from recovered images.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum DeblurChoice {
    /// With and without deblurring; under the protocol of the paper only without
    Both,
    /// Always
    On,
    /// Never
    Off,
}

/// Stream, method, whether it is deblurred, and the lens blur in px.
type ImageSettings = (Stream, Option<String>, bool, f64);

impl Default for Axes {
    /// The defaults of the command line.
    fn default() -> Self {
        Self::parse_from(["grid"])
    }
}

impl Axes {
    /// The name of a model in cells: its file name without extension.
    pub fn model_name(model: &std::path::Path) -> String {
        model.file_stem().unwrap_or(model.as_os_str()).to_string_lossy().into_owned()
    }

    /// The cells. Models and input sizes vary slowest, so that one detector serves all its cells in a row.
    ///
    /// # Errors
    /// [`GridError`] for an empty list, two models of one name, a sensor that is not possible, or another impossible value.
    pub fn points(&self, protocol: Protocol) -> Result<Vec<Point>, GridError> {
        self.check(protocol)?;
        let inputs = or_default(&self.input, &[if protocol == Protocol::Paper { "640x640" } else { "auto" }]);
        let (mut sensors, images) = (self.sensors(), self.images(protocol));
        if protocol == Protocol::Paper {
            // The scripts of the paper scale an image in [0, 1] by alpha, and shade nothing.
            let of_paper = |alpha| SensorModel { alpha, headroom: 1.0, ..paper_lens() };
            sensors.iter_mut().for_each(|sensor| *sensor = of_paper(sensor.alpha));
        }
        // The order of the loops is the order of work: a model and its input size are loaded once for all their cells.
        let mut points = Vec::new();
        for model in self.model.iter().map(|model| Self::model_name(model)) {
            for input in &inputs {
                for sensor in &sensors {
                    for (stream, method, deblur, psf_sigma) in of_sensor(sensor, &images) {
                        let mut sensor = SensorModel { psf_sigma, ..sensor.clone() };
                        if !stream.is_metered() {
                            sensor = sensor.reset(&SensorModel::EXPOSURE_CONTROL);
                        } else if !stream.follows_frames() {
                            sensor = sensor.reset(&SensorModel::FOLLOWING);
                        }
                        let (model, input) = (model.clone(), input.clone());
                        let point = Point { stream, method, deblur, sensor, model, input };
                        // Values may be listed twice, and a lens blur of 0 gives the sharp ideal image a second time.
                        if !points.contains(&point) {
                            points.push(point);
                        }
                    }
                }
            }
        }
        if points.is_empty() {
            let list = self.without_cells(protocol, &points).join("; ");
            Err(GridError::Request(format!("the grid has no cell: {list}")))
        } else {
            Ok(points)
        }
    }

    /// Every sensor behind the first lens.
    fn sensors(&self) -> Vec<SensorModel> {
        let all = SensorModel::descriptors();
        let slow = all.iter().map(|parameter| parameter.name);
        let slow = slow.filter(|name| ![LENS].iter().chain(&FIXED).chain(&FAST).any(|other| other == name));
        self.sensor.sensors(&slow.chain(FAST).collect::<Vec<_>>())
    }

    /// The blur of every lens, px.
    pub(super) fn lenses(&self) -> Vec<f64> {
        self.sensor.sensors(&[LENS]).into_iter().map(|sensor| sensor.psf_sigma).collect()
    }

    /// Every (stream, method, deblur, blur) of a sensor with one gain and no mosaic.
    fn images(&self, protocol: Protocol) -> Vec<ImageSettings> {
        let methods = self.methods(protocol);
        let deblur: &[bool] = match (self.deblur, protocol) {
            (DeblurChoice::Both, Protocol::Suite) => &[false, true],
            (DeblurChoice::Off, _) | (DeblurChoice::Both, Protocol::Paper) => &[false],
            (DeblurChoice::On, _) => &[true],
        };
        let mut images = Vec::new();
        // The ideal image without a lens is the best that a detector can get: deblurring is compared with it.
        if self.stream.contains(&Stream::Ideal) {
            images.push((Stream::Ideal, None, false, 0.0));
        }
        for psf_sigma in self.lenses() {
            for &stream in &self.stream {
                match stream {
                    Stream::Recovered | Stream::Metered => {
                        // Without a lens there is no blur to remove.
                        let possible = |deblur: &&bool| !**deblur || psf_sigma > 0.0;
                        for &deblur in deblur.iter().filter(possible) {
                            let recovered = |m: &String| (stream, Some(m.clone()), deblur, psf_sigma);
                            // The scripts of the paper remove no blur.
                            let possible = |m: &&String| !deblur || *m != SPUD_AS_PUBLISHED;
                            images.extend(methods.iter().filter(possible).map(recovered));
                        }
                    }
                    // The ideal image of the paper never passed a lens.
                    Stream::Ideal if protocol == Protocol::Paper => {}
                    _ => images.push((stream, None, false, psf_sigma)),
                }
            }
        }
        images
    }

    /// The unwrapping methods. The paper has only SPUD.
    pub(super) fn methods(&self, protocol: Protocol) -> Vec<String> {
        or_default(&self.method, if protocol == Protocol::Paper { &PAPER_METHODS } else { &["auto", "spud"] })
    }

    fn check(&self, protocol: Protocol) -> Result<(), GridError> {
        for (what, empty) in
            [("the list of streams", self.stream.is_empty()), ("the list of models", self.model.is_empty())]
        {
            if empty {
                return Err(GridError::empty(what));
            }
        }
        for (parameter, value) in self.sensor.first().declared() {
            if FIXED.contains(&parameter.name) && value != parameter.default {
                let why = format!("must be {} in a grid", parameter.default);
                return Err(ParameterError::new(parameter.name, value, why).into());
            }
        }
        if protocol == Protocol::Paper {
            self.check_paper()?;
        }
        let of_suite = [METHODS, &[SPUD_AS_PUBLISHED]].concat();
        let known: &[&str] = if protocol == Protocol::Paper { &PAPER_METHODS } else { &of_suite };
        if let Some(method) =
            self.methods(protocol).into_iter().find(|method| !known.contains(&method.as_str()))
        {
            return Err(GridError::value("method", method, format!("one of {}", known.join(", "))));
        }
        self.check_models()
    }

    /// The scripts of the paper have a fixed lens and no noise. Other values would be ignored, which the results would not
    /// show.
    fn check_paper(&self) -> Result<(), GridError> {
        let all = self.sensors().into_iter();
        let mut all = all.flat_map(|sensor| {
            self.lenses().into_iter().map(move |psf_sigma| SensorModel { psf_sigma, ..sensor.clone() })
        });
        let plain = SensorModel::default();
        let is_plain = |sensor: &SensorModel| {
            // What is not given has its default, for which the paper has a headroom of 1 and no black columns.
            [plain.headroom, 1.0].contains(&sensor.headroom)
                && [&plain, &paper_lens()].contains(&&sensor.reset(&["alpha", "headroom"]))
        };
        let Some(other) = all.find(|sensor| !is_plain(sensor)) else { return Ok(()) };
        let possible = "that of the paper: blur 1.4 px (7 taps), headroom 1, no black columns, no noise, one gain, no mosaic";
        Err(GridError::value("the sensor", labels::sensor(&other, &[]), possible))
    }

    fn check_models(&self) -> Result<(), GridError> {
        // A cell names its model without the folder. Two files of one name would share their cells and files.
        let mut models: Vec<&PathBuf> = self.model.iter().collect();
        models.sort();
        models.dedup();
        let name = |model: &&PathBuf| file_name(&Self::model_name(model));
        let mut names: Vec<String> = models.iter().map(name).collect();
        names.sort();
        if let Some(pair) = names.windows(2).find(|pair| pair[0] == pair[1]) {
            return Err(GridError::value("model", format!("twice {}", pair[0]), "one file for each name"));
        }
        Ok(())
    }
}

/// The sensor of the paper behind a Gaussian of about its lens.
fn paper_lens() -> SensorModel {
    let SensorModel { psf, psf_sigma, .. } = SensorModel::default();
    SensorModel { psf, psf_sigma, ..SensorModel::unknown() }
}

/// The images that this sensor has of those of a sensor with one gain and no mosaic.
fn of_sensor(sensor: &SensorModel, images: &[ImageSettings]) -> Vec<ImageSettings> {
    let mut images = images.to_vec();
    if sensor.gains {
        // The gains decide the method. The raw image of two gains is no image for a detector, and the ideal image does not
        // depend on the gains.
        images.retain(|(stream, ..)| *stream == Stream::Saturated || stream.is_unwrapped());
        images.iter_mut().for_each(|(_, method, ..)| *method = Some(TwoGains::NAME.to_owned()));
    }
    images
        .retain(|(stream, method, ..)| sensor.mosaic.is_none() || can_be_mosaic(*stream, method.as_deref()));
    images
}

/// Returns whether the pipeline of a stream simulates a mosaic. Elsewhere a cell of a mosaic would show the figures of three chips.
pub(super) fn can_be_mosaic(stream: Stream, method: Option<&str>) -> bool {
    !matches!(stream, Stream::MultiExposure | Stream::MultiExposureStill) && method != Some(SPUD_AS_PUBLISHED)
}

fn or_default(list: &[String], default: &[&str]) -> Vec<String> {
    if list.is_empty() { default.iter().map(|&word| word.to_owned()).collect() } else { list.to_vec() }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn axes(options: &str) -> Axes {
        Axes::parse_from(["grid"].into_iter().chain(options.split(' ')))
    }

    #[test]
    fn models_vary_slowest_then_noise_alpha_mosaic_and_gains() {
        let options = "--read-noise 0,1 --alpha 2,4 --gains none,checkerboard --mosaic none,rggb --stream saturated --model a,b";
        let points = axes(options).points(Protocol::Suite).expect("possible");
        let key = |point: &Point| {
            let SensorModel { read_noise, alpha, mosaic, gains, .. } = point.sensor;
            (point.model.clone(), read_noise, alpha, mosaic.is_some(), gains)
        };
        assert_eq!(points.len(), 32);
        assert!(points.iter().map(key).is_sorted(), "{points:?}");
    }

    #[test]
    fn what_no_sensor_can_have_is_refused_with_the_possible_values() {
        for (option, value, possible) in
            [("--alpha", "0", "0.001 to 256"), ("--read-noise", "x", "double"), ("--mosaic", "rgbg", "rggb")]
        {
            let why = Axes::try_parse_from(["grid", option, value]).expect_err("impossible").to_string();
            assert!([option, value, possible].iter().all(|text| why.contains(text)), "{why}");
        }
        let mut chip = Axes::default();
        chip.sensor.take_chip(&SensorModel { bits: 10, ..SensorModel::default() });
        let why = chip.points(Protocol::Suite).expect_err("10 bits").to_string();
        assert!(why.contains("'bits' = 10: must be 8"), "{why}");
    }

    #[test]
    fn the_default_grid_has_one_sharp_ideal_an_alpha_and_deblurs_what_was_recovered() {
        let points = Axes::default().points(Protocol::Suite).expect("possible");
        // Sharp, blurred, saturated, modulo, and two methods with and without.
        assert_eq!(points.len(), 4 * (4 + 2 * 2));
        assert!(points.iter().all(|p| (p.stream == Stream::Recovered) == p.method.is_some()));
        assert!(points.iter().all(|p| !p.deblur || p.stream == Stream::Recovered));
        let sharp = points.iter().filter(|p| p.stream == Stream::Ideal && p.sensor.psf_sigma == 0.0);
        assert_eq!(sharp.count(), 4);
    }

    #[test]
    fn no_cell_is_there_twice_and_nothing_is_deblurred_without_a_lens() {
        let axes = axes("--psf-sigma 0,0 --alpha 2,2");
        let points = axes.points(Protocol::Suite).expect("possible");
        assert_eq!(points.len(), 3 + 2);
        assert!(points.iter().all(|p| !p.deblur));
    }

    #[test]
    fn what_no_cell_can_have_is_refused() {
        for (axes, expected) in [
            (Axes { stream: vec![], ..Axes::default() }, "streams is empty"),
            (axes("--method magic"), "magic"),
            (axes("--model a/x.onnx,b/x.onnx"), "twice x"),
        ] {
            let why = axes.points(Protocol::Suite).expect_err(expected).to_string();
            assert!(why.contains(expected), "{why}");
        }
        let auto = axes("--method auto");
        assert!(auto.points(Protocol::Paper).is_err(), "the paper has no auto");
        for other in [
            "--read-noise 1",
            "--prnu 0.1",
            "--psf-sigma 1.4,0",
            "--gains none,checkerboard",
            "--mosaic rggb",
            "--headroom 0.9",
        ] {
            let why = axes(other).points(Protocol::Paper).expect_err("nor these").to_string();
            assert!(why.contains("the paper"), "{why}");
        }
        let shot = axes("--shot-noise 0,1");
        assert!(shot.points(Protocol::Paper).is_err(), "nor shot noise");
        let points = shot.points(Protocol::Suite).expect("possible");
        assert_eq!(points.len(), 2 * Axes::default().points(Protocol::Suite).expect("possible").len());
    }

    #[test]
    fn the_paper_has_four_streams_two_forms_of_spud_and_640() {
        let points = Axes::default().points(Protocol::Paper).expect("possible");
        assert_eq!(points.len(), 4 * 5);
        assert!(points.iter().all(|p| p.input == "640x640"
            && !p.deblur
            && p.sensor.headroom == 1.0
            && p.sensor.optical_black == 0));
        for same in ["--headroom 1", "--optical-black 0"] {
            assert_eq!(axes(same).points(Protocol::Paper).expect("possible"), points);
        }
        assert!(
            points.iter().filter_map(|p| p.method.as_deref()).all(|method| PAPER_METHODS.contains(&method))
        );
        let published = axes("--method spud_as_published");
        let points = published.points(Protocol::Suite).expect("possible");
        assert_eq!(points.len(), 4 * 5, "it is never deblurred");
    }
}
