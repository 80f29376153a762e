//! [`Axes`]: the values that a grid combines, and the cells that follow from them.

use std::path::PathBuf;

use clap::{Parser, ValueEnum};
use modulo_camera::CameraParameters;
use modulo_core::unwrap::METHODS;
use modulo_core::{GainPattern, Mosaic};
use modulo_runtime::SensorModel;
use modulo_runtime::sensor::parameters::BlurShape;

use super::GridError;
use super::pipeline::BITS;
use super::pipeline::paper::SPUD_AS_PUBLISHED;
use crate::results::{Point, Protocol, Stream};

/// The values that the cells combine. A value may be listed twice; its cells are in the grid once.
#[derive(Clone, Debug, PartialEq, Parser)]
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
    /// Saturation factors: brightest radiance divided by the peak of the sensor
    #[arg(long, value_delimiter = ',', default_value = "1.5,2,3,4")]
    pub alpha: Vec<f64>,
    /// Standard deviations of the lens blur in px
    #[arg(long, value_delimiter = ',', default_value = "1.4")]
    pub psf_sigma: Vec<f64>,
    /// Standard deviations of the read noise in code units
    #[arg(long, alias = "noise", value_delimiter = ',', default_value = "0")]
    pub read_noise: Vec<f64>,
    /// Strengths of the shot noise: its standard deviation at the signal x is sqrt(strength * x) in code units
    #[arg(long, value_delimiter = ',', default_value = "0")]
    pub shot_noise: Vec<f64>,
    /// Pixels with a lower gain (1 / alpha), which do not wrap; their images have a method of their own, and the saturated
    /// stream is then that of spatially varying exposure
    #[arg(long, value_delimiter = ',', default_value = "none", value_parser = ["none", "checkerboard", "rows"])]
    pub gains: Vec<String>,
    /// Colour filters of a sensor with one chip, whose images are demosaiced for the detector
    #[arg(long, value_delimiter = ',', default_value = "none", value_parser = ["none", "rggb", "bggr", "grbg", "gbrg"])]
    pub mosaic: Vec<String>,
    /// Photo response non-uniformity of all cells, a fraction. Only a sensor file sets it
    #[arg(skip)]
    pub prnu: f64,
    /// Share of the samples that are hot in all cells. Only a sensor file sets it
    #[arg(skip)]
    pub hot_pixels: f64,
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
    /// Replaces the lens, noise, gains and mosaic by those of `camera`.
    ///
    /// # Errors
    /// [`GridError::Value`] for a chip that does not have 8 bits and for the lens of the paper.
    pub fn take_sensor(&mut self, camera: &CameraParameters) -> Result<(), GridError> {
        let SensorModel { bits, psf, psf_sigma, gains, .. } = camera.sensor;
        if bits != BITS {
            return Err(GridError::Value {
                what: "bits",
                value: bits.to_string(),
                possible: BITS.to_string(),
            });
        }
        if psf != BlurShape::Gaussian {
            let possible = "gaussian, or --protocol paper".to_owned();
            return Err(GridError::Value { what: "psf", value: "paper7".to_owned(), possible });
        }
        self.psf_sigma = vec![psf_sigma];
        self.read_noise = vec![camera.read_noise];
        self.shot_noise = vec![camera.shot_variance()];
        self.gains = vec![gains.map_or("none", GainPattern::word).to_owned()];
        self.mosaic = vec![camera.mosaic.map_or("none", Mosaic::word).to_owned()];
        (self.prnu, self.hot_pixels) = (camera.prnu, camera.hot_pixels);
        Ok(())
    }

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
        // The order of the loops is the order of work: a model and its input size are loaded once for all their cells.
        let mut points = Vec::new();
        for model in self.model.iter().map(|model| Self::model_name(model)) {
            for input in &inputs {
                for ([read_noise, shot_noise, alpha], mosaic) in self.exposures() {
                    for (gains, (stream, method, deblur, psf_sigma)) in self.gained_images(protocol) {
                        if mosaic != "none" && !can_be_mosaic(stream, method.as_deref()) {
                            continue;
                        }
                        let (model, input, mosaic) = (model.clone(), input.clone(), mosaic.clone());
                        let point = Point {
                            stream,
                            method,
                            deblur,
                            alpha,
                            psf_sigma,
                            read_noise,
                            shot_noise,
                            prnu: self.prnu,
                            hot_pixels: self.hot_pixels,
                            gains,
                            mosaic,
                            model,
                            input,
                        };
                        // Values may be listed twice, and a lens blur of 0 gives the sharp ideal image a second time.
                        if !points.contains(&point) {
                            points.push(point);
                        }
                    }
                }
            }
        }
        if points.is_empty() {
            Err(GridError::NoCell(self.without_cells(protocol, &points)))
        } else {
            Ok(points)
        }
    }

    /// Every [read noise, shot noise, alpha] with every mosaic.
    fn exposures(&self) -> Vec<([f64; 3], &String)> {
        let noises =
            self.read_noise.iter().flat_map(|read| self.shot_noise.iter().map(move |shot| [*read, *shot]));
        let exposures =
            noises.flat_map(|[read, shot]| self.alpha.iter().map(move |alpha| [read, shot, *alpha]));
        exposures.flat_map(|exposure| self.mosaic.iter().map(move |mosaic| (exposure, mosaic))).collect()
    }

    /// Every image at one alpha, with the gains of its sensor.
    fn gained_images(&self, protocol: Protocol) -> Vec<(String, ImageSettings)> {
        let of_gains = |gains: &String| -> Vec<(String, ImageSettings)> {
            let images = self.images(protocol).into_iter();
            let Some(pattern) = GainPattern::named(gains) else {
                return images.map(|image| (gains.clone(), image)).collect();
            };
            // The gains decide the method. The raw image of two gains is no image for a detector, and the ideal image does not
            // depend on the gains.
            let of_two =
                images.filter(|(stream, ..)| matches!(stream, Stream::Saturated | Stream::Recovered));
            let method = Some(pattern.method().to_owned());
            of_two
                .map(|(stream, _, deblur, sigma)| (gains.clone(), (stream, method.clone(), deblur, sigma)))
                .collect()
        };
        self.gains.iter().flat_map(of_gains).collect()
    }

    /// Every (stream, method, deblur, blur) at one alpha.
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
        for &psf_sigma in &self.psf_sigma {
            for &stream in &self.stream {
                match stream {
                    Stream::Recovered => {
                        // Without a lens there is no blur to remove.
                        for &deblur in deblur.iter().filter(|deblur| !**deblur || psf_sigma > 0.0) {
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
        for (what, empty) in [
            ("the list of streams", self.stream.is_empty()),
            ("the list of alphas", self.alpha.is_empty()),
            ("the list of lens blurs", self.psf_sigma.is_empty()),
            ("the list of read noises", self.read_noise.is_empty()),
            ("the list of shot noises", self.shot_noise.is_empty()),
            ("the list of gains", self.gains.is_empty()),
            ("the list of mosaics", self.mosaic.is_empty()),
            ("the list of models", self.model.is_empty()),
        ] {
            if empty {
                return Err(GridError::Empty(what));
            }
        }
        // Checked as the camera does it, before any frame is read.
        for ([read_noise, shot_noise, alpha], _) in self.exposures() {
            for &psf_sigma in &self.psf_sigma {
                let sensor = SensorModel { alpha, psf_sigma, ..SensorModel::default() };
                let defaults = CameraParameters::default();
                CameraParameters { sensor, read_noise, shot_noise, ..defaults }.sensor()?;
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
            let possible = format!("one of {}", known.join(", "));
            return Err(GridError::Value { what: "method", value: method, possible });
        }
        self.check_models()
    }

    /// The scripts of the paper have a fixed lens and no noise. Other values would be ignored, which the results would not
    /// show.
    fn check_paper(&self) -> Result<(), GridError> {
        let plain = self.psf_sigma == [1.4]
            && self.read_noise == [0.0]
            && self.shot_noise == [0.0]
            && [self.prnu, self.hot_pixels] == [0.0, 0.0]
            && self.gains == ["none"]
            && self.mosaic == ["none"];
        if !plain {
            let Self { psf_sigma, read_noise, shot_noise, gains, mosaic, .. } = self;
            let value = format!(
                "{psf_sigma:?} px with read noise {read_noise:?}, shot noise {shot_noise:?}, gains {gains:?} and mosaic {mosaic:?}"
            );
            let possible =
                "the lens of the paper: blur 1.4 px (7 taps), no noise, one gain, no mosaic".to_owned();
            return Err(GridError::Value { what: "the lens", value, possible });
        }
        Ok(())
    }

    fn check_models(&self) -> Result<(), GridError> {
        // A cell names its model without the folder. Two files of one name would share their cells.
        let mut models: Vec<&PathBuf> = self.model.iter().collect();
        models.sort();
        models.dedup();
        let mut names: Vec<String> = models.iter().map(|model| Self::model_name(model)).collect();
        names.sort();
        if let Some(pair) = names.windows(2).find(|pair| pair[0] == pair[1]) {
            let (value, possible) = (format!("twice {}", pair[0]), "one file for each name".to_owned());
            return Err(GridError::Value { what: "model", value, possible });
        }
        Ok(())
    }
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

    #[test]
    fn the_default_grid_has_one_sharp_ideal_an_alpha_and_deblurs_what_was_recovered() {
        let points = Axes::default().points(Protocol::Suite).expect("possible");
        // Sharp, blurred, saturated, modulo, and two methods with and without.
        assert_eq!(points.len(), 4 * (4 + 2 * 2));
        assert!(points.iter().all(|p| (p.stream == Stream::Recovered) == p.method.is_some()));
        assert!(points.iter().all(|p| !p.deblur || p.stream == Stream::Recovered));
        let sharp = points.iter().filter(|p| p.stream == Stream::Ideal && p.psf_sigma == 0.0);
        assert_eq!(sharp.count(), 4);
    }

    #[test]
    fn no_cell_is_there_twice_and_nothing_is_deblurred_without_a_lens() {
        let axes = Axes { psf_sigma: vec![0.0, 0.0], alpha: vec![2.0, 2.0], ..Axes::default() };
        let points = axes.points(Protocol::Suite).expect("possible");
        assert_eq!(points.len(), 3 + 2);
        assert!(points.iter().all(|p| !p.deblur));
    }

    #[test]
    fn what_no_cell_can_have_is_refused() {
        for (axes, told) in [
            (Axes { alpha: vec![], ..Axes::default() }, "alphas is empty"),
            (Axes { method: vec!["magic".into()], ..Axes::default() }, "magic"),
            (Axes { model: vec!["a/x.onnx".into(), "b/x.onnx".into()], ..Axes::default() }, "twice x"),
        ] {
            let why = axes.points(Protocol::Suite).expect_err(told).to_string();
            assert!(why.contains(told), "{why}");
        }
        let auto = Axes { method: vec!["auto".into()], ..Axes::default() };
        assert!(auto.points(Protocol::Paper).is_err(), "the paper has no auto");
        let noisy = Axes { read_noise: vec![1.0], ..Axes::default() };
        assert!(noisy.points(Protocol::Paper).is_err(), "nor noise");
        let shot = Axes { shot_noise: vec![0.0, 1.0], ..Axes::default() };
        assert!(shot.points(Protocol::Paper).is_err(), "nor shot noise");
        let points = shot.points(Protocol::Suite).expect("possible");
        assert_eq!(points.len(), 2 * Axes::default().points(Protocol::Suite).expect("possible").len());
    }

    #[test]
    fn the_paper_has_four_streams_two_forms_of_spud_and_640() {
        let points = Axes::default().points(Protocol::Paper).expect("possible");
        assert_eq!(points.len(), 4 * 5);
        assert!(points.iter().all(|p| p.input == "640x640" && !p.deblur));
        assert!(
            points.iter().filter_map(|p| p.method.as_deref()).all(|method| PAPER_METHODS.contains(&method))
        );
        let published = Axes { method: vec![SPUD_AS_PUBLISHED.into()], ..Axes::default() };
        let points = published.points(Protocol::Suite).expect("possible");
        assert_eq!(points.len(), 4 * 5, "it is never deblurred");
    }
}
