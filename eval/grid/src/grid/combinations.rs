//! The combinations of options that give no cell, each with the reason.

use modulo_core::{Gains, TwoGains};
use modulo_runtime::SensorModel;

use super::cells::{Axes, DeblurChoice, can_be_mosaic};
use crate::labels::distinct;
use crate::results::{Point, Protocol, Stream};

impl Axes {
    /// The options that no cell has, a sentence for each kind.
    pub fn unused(&self, protocol: Protocol, points: &[Point]) -> Vec<String> {
        let without = self.without_cells(protocol, points).join("; ");
        let without = (!without.is_empty()).then(|| format!("these combinations have no cell: {without}"));
        without.into_iter().chain(self.unused_method()).collect()
    }

    /// The combinations of the lists that none of `points` has, such as `--stream modulo --gains checkerboard (REASON)`.
    pub fn without_cells(&self, protocol: Protocol, points: &[Point]) -> Vec<String> {
        let methods: Vec<Option<String>> = self.methods(protocol).into_iter().map(Some).collect();
        let mut without = Vec::new();
        for sensor in &self.sensor.sensors(&["gains", "mosaic", "psf_sigma"]) {
            for &stream in &self.stream {
                // Gains have a method of their own, and the ideal image of the paper has no lens.
                let choice = stream.is_unwrapped() && !sensor.gains;
                let has = |point: &Point, method: &Option<String>| {
                    point.stream == stream
                        && (method.is_none() || point.method == *method)
                        && (stream == Stream::Ideal || point.sensor.psf_sigma == sensor.psf_sigma)
                        && (point.sensor.gains == sensor.gains && point.sensor.mosaic == sensor.mosaic)
                };
                for method in if choice { &methods[..] } else { &[None] } {
                    if !points.iter().any(|point| has(point, method)) {
                        without.push(missing(stream, method.as_deref(), sensor, self.deblur));
                    }
                }
            }
        }
        distinct(without.into_iter())
    }

    /// A sentence if `--method` was given, but each sensor has a method of its own.
    fn unused_method(&self) -> Option<String> {
        let sensors = self.sensor.sensors(&["gains"]);
        let has_no_effect = !self.method.is_empty() && sensors.iter().all(|sensor| sensor.gains);
        has_no_effect.then(|| {
            let (gains, method) = (Gains::word(true), TwoGains::NAME);
            format!("--method has no effect: the images of --gains {gains} are unwrapped by {method}")
        })
    }
}

/// The options of an image that no cell has, with the reason.
fn missing(stream: Stream, method: Option<&str>, sensor: &SensorModel, deblur: DeblurChoice) -> String {
    let mut options = vec![format!("--stream {}", stream.name())];
    options.extend(method.map(|method| format!("--method {method}")));
    let SensorModel { gains, mosaic, psf_sigma, .. } = *sensor;
    let of_two = stream == Stream::Saturated || stream.is_unwrapped();
    let why = if gains && !of_two {
        options.push(format!("--gains {}", Gains::word(gains)));
        "a sensor with two gains has the streams saturated and recovered only"
    } else if let Some(mosaic) = mosaic.filter(|_| !can_be_mosaic(stream, method)) {
        options.push(format!("--mosaic {}", mosaic.word()));
        "merged captures and spud_as_published have three chips only"
    } else if deblur == DeblurChoice::On && psf_sigma == 0.0 {
        options.extend([format!("--psf-sigma {psf_sigma}"), "--deblur on".to_owned()]);
        "without a lens there is no blur to remove"
    } else {
        options.push("--deblur on".to_owned());
        "spud_as_published removes no blur"
    };
    format!("{} ({why})", options.join(" "))
}

#[cfg(test)]
mod tests {
    use clap::Parser as _;

    use super::*;

    fn axes(options: &str) -> Axes {
        Axes::parse_from(["grid"].into_iter().chain(options.split(' ')))
    }

    /// The sentence about a grid without a cell.
    fn refused(axes: &Axes) -> String {
        axes.points(Protocol::Suite).expect_err("no cell").to_string()
    }

    #[test]
    fn a_grid_without_a_cell_names_the_combination() {
        let text = refused(&axes("--gains checkerboard --stream modulo"));
        assert!(text.contains("--stream modulo --gains checkerboard (a sensor with two gains"), "{text}");
        let text = refused(&axes("--mosaic rggb --method spud_as_published --stream recovered"));
        assert!(text.contains("--stream recovered --method spud_as_published --mosaic rggb"), "{text}");
        let sharp = axes("--psf-sigma 0 --deblur on --stream recovered");
        assert!(refused(&sharp).contains("--psf-sigma 0 --deblur on"), "{}", refused(&sharp));
        let published = axes("--deblur on --method spud_as_published --stream recovered");
        assert!(refused(&published).contains("removes no blur"), "{}", refused(&published));
    }

    #[test]
    fn single_combinations_without_a_cell_are_named_and_whole_grids_name_none() {
        let without = |axes: &Axes, protocol| {
            let points = axes.points(protocol).expect("cells");
            axes.without_cells(protocol, &points)
        };
        let some = axes("--gains none,checkerboard --stream modulo,recovered");
        let [one] = &without(&some, Protocol::Suite)[..] else { panic!("one combination") };
        assert!(one.starts_with("--stream modulo --gains checkerboard"), "{one}");
        for protocol in [Protocol::Suite, Protocol::Paper] {
            assert_eq!(without(&Axes::default(), protocol), Vec::<String>::new());
        }
        let lenses = axes("--psf-sigma 0,1.4");
        assert_eq!(without(&lenses, Protocol::Suite), Vec::<String>::new());
    }

    #[test]
    fn a_method_that_no_sensor_uses_is_named() {
        let two = axes("--gains checkerboard --method spud");
        assert!(two.unused_method().expect("a sentence").contains("checkerboard_gains"));
        assert_eq!(axes("--method spud").unused_method(), None);
    }
}
