//! [`Axes`]: what a grid varies, and the cells that come of it.

use std::path::PathBuf;

use modulo_core::unwrap::METHODS;

use super::GridError;
use crate::results::{Point, Protocol, Stream};

/// What is varied. Lists may hold a value twice; the grid does not.
#[derive(Clone, Debug, PartialEq)]
pub struct Axes {
    /// What the detector sees.
    pub streams: Vec<Stream>,
    /// Unwrapping methods.
    pub methods: Vec<String>,
    /// Whether the lens is undone in what was recovered.
    pub deblur: Vec<bool>,
    /// Saturation factors.
    pub alphas: Vec<f64>,
    /// Blurs of the lens, px.
    pub psf_sigmas: Vec<f64>,
    /// Sigmas of the read noise, code units.
    pub noises: Vec<f64>,
    /// Detection models: ONNX files, or `demo`.
    pub models: Vec<PathBuf>,
    /// Input sizes: `auto` or `WIDTHxHEIGHT`.
    pub inputs: Vec<String>,
}

impl Default for Axes {
    /// All streams, `auto` and `spud`, with and without deblurring, the paper's alphas, its lens, no noise, the
    /// embedded model, no resizing.
    fn default() -> Self {
        Self {
            streams: vec![Stream::Ideal, Stream::Saturated, Stream::Modulo, Stream::Recovered],
            methods: vec!["auto".into(), "spud".into()],
            deblur: vec![false, true],
            alphas: vec![1.5, 2.0, 3.0, 4.0],
            psf_sigmas: vec![1.4],
            noises: vec![0.0],
            models: vec!["demo".into()],
            inputs: vec!["auto".into()],
        }
    }
}

impl Axes {
    /// The defaults of a protocol: the paper's has SPUD alone, never undoes a lens, and takes 640 x 640.
    pub fn for_protocol(protocol: Protocol) -> Self {
        let suite = Self::default();
        match protocol {
            Protocol::Suite => suite,
            Protocol::Paper => Self {
                methods: vec!["spud".into()],
                deblur: vec![false],
                inputs: vec!["640x640".into()],
                ..suite
            },
        }
    }

    /// What a model is called in cells: the stem of its file.
    pub fn model_name(model: &std::path::Path) -> String {
        model.file_stem().unwrap_or(model.as_os_str()).to_string_lossy().into_owned()
    }

    /// The cells, models and inputs outermost, so that a detector serves all its cells in one go.
    ///
    /// # Errors
    /// [`GridError`] for an empty list, two models of one name, or a value that no cell can have.
    pub fn points(&self, protocol: Protocol) -> Result<Vec<Point>, GridError> {
        self.check(protocol)?;
        let mut points = Vec::new();
        for model in self.models.iter().map(|model| Self::model_name(model)) {
            for input in &self.inputs {
                for &noise in &self.noises {
                    for &alpha in &self.alphas {
                        for (stream, method, deblur, psf_sigma) in self.ways(protocol) {
                            let (model, input) = (model.clone(), input.clone());
                            let point =
                                Point { stream, method, deblur, alpha, psf_sigma, noise, model, input };
                            if !points.contains(&point) {
                                points.push(point);
                            }
                        }
                    }
                }
            }
        }
        Ok(points)
    }

    /// (stream, method, deblur, blur) at one alpha.
    fn ways(&self, protocol: Protocol) -> Vec<(Stream, Option<String>, bool, f64)> {
        let mut ways = Vec::new();
        if self.streams.contains(&Stream::Ideal) {
            ways.push((Stream::Ideal, None, false, 0.0));
        }
        for &psf_sigma in &self.psf_sigmas {
            for &stream in &self.streams {
                match stream {
                    Stream::Recovered => {
                        let deblurs = self.deblur.iter().filter(|deblur| !**deblur || psf_sigma > 0.0);
                        for &deblur in deblurs {
                            let recovered = |m: &String| (stream, Some(m.clone()), deblur, psf_sigma);
                            ways.extend(self.methods.iter().map(recovered));
                        }
                    }
                    // The paper's ideal never went through a lens.
                    Stream::Ideal if protocol == Protocol::Paper => {}
                    _ => ways.push((stream, None, false, psf_sigma)),
                }
            }
        }
        ways
    }

    fn check(&self, protocol: Protocol) -> Result<(), GridError> {
        for (what, empty) in [
            ("the list of streams", self.streams.is_empty()),
            ("the list of methods", self.methods.is_empty()),
            ("the list of deblurrings", self.deblur.is_empty()),
            ("the list of alphas", self.alphas.is_empty()),
            ("the list of lens blurs", self.psf_sigmas.is_empty()),
            ("the list of noises", self.noises.is_empty()),
            ("the list of models", self.models.is_empty()),
            ("the list of input sizes", self.inputs.is_empty()),
        ] {
            if empty {
                return Err(GridError::Empty(what));
            }
        }
        if protocol == Protocol::Paper && (self.psf_sigmas != [1.4] || self.noises != [0.0]) {
            let value = format!("{:?} px with noise {:?}", self.psf_sigmas, self.noises);
            let possible = "the paper's own: blur 1.4 px (7 taps), no noise".to_owned();
            return Err(GridError::Value { what: "the lens", value, possible });
        }
        let known: &[&str] = if protocol == Protocol::Paper { &["spud"] } else { METHODS };
        if let Some(method) = self.methods.iter().find(|method| !known.contains(&method.as_str())) {
            let possible = format!("one of {}", known.join(", "));
            return Err(GridError::Value { what: "method", value: method.clone(), possible });
        }
        let mut models: Vec<&PathBuf> = self.models.iter().collect();
        models.sort();
        models.dedup();
        let mut names: Vec<String> = models.iter().map(|model| Self::model_name(model)).collect();
        names.sort();
        if let Some(pair) = names.windows(2).find(|pair| pair[0] == pair[1]) {
            let (value, possible) = (format!("twice {}", pair[0]), "one file a name".to_owned());
            return Err(GridError::Value { what: "model", value, possible });
        }
        Ok(())
    }
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
        let axes = Axes { psf_sigmas: vec![0.0, 0.0], alphas: vec![2.0, 2.0], ..Axes::default() };
        let points = axes.points(Protocol::Suite).expect("possible");
        assert_eq!(points.len(), 3 + 2);
        assert!(points.iter().all(|p| !p.deblur));
    }

    #[test]
    fn what_no_cell_can_have_is_refused() {
        for (axes, told) in [
            (Axes { alphas: vec![], ..Axes::default() }, "alphas is empty"),
            (Axes { methods: vec!["magic".into()], ..Axes::default() }, "magic"),
            (Axes { models: vec!["a/x.onnx".into(), "b/x.onnx".into()], ..Axes::default() }, "twice x"),
        ] {
            let why = axes.points(Protocol::Suite).expect_err(told).to_string();
            assert!(why.contains(told), "{why}");
        }
        assert!(Axes::default().points(Protocol::Paper).is_err(), "the paper has no auto");
        let noisy = Axes { noises: vec![1.0], ..Axes::for_protocol(Protocol::Paper) };
        assert!(noisy.points(Protocol::Paper).is_err(), "nor noise");
    }

    #[test]
    fn the_paper_has_four_streams_spud_alone_and_640() {
        let points = Axes::for_protocol(Protocol::Paper).points(Protocol::Paper).expect("possible");
        assert_eq!(points.len(), 4 * 4);
        assert!(points.iter().all(|p| p.input == "640x640" && !p.deblur));
        assert!(points.iter().all(|p| p.method.as_deref().is_none_or(|method| method == "spud")));
    }
}
