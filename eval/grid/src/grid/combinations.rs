//! The combinations of options that give no cell, each with the reason.

use modulo_core::GainPattern;

use super::cells::{Axes, DeblurChoice, can_be_mosaic};
use crate::labels::distinct;
use crate::results::{Point, Protocol, Stream};

/// The options of an image: stream, method, lens blur in px, gains, mosaic.
struct Combination<'a> {
    stream: Stream,
    method: Option<&'a str>,
    psf_sigma: f64,
    gains: &'a str,
    mosaic: &'a str,
}

impl Axes {
    /// The combinations of the lists that none of `points` has, such as `--stream modulo --gains rows (REASON)`.
    pub fn without_cells(&self, protocol: Protocol, points: &[Point]) -> Vec<String> {
        let methods = self.methods(protocol);
        let mut without = Vec::new();
        for (gains, mosaic) in self.gains.iter().flat_map(|gains| self.mosaic.iter().map(move |m| (gains, m)))
        {
            for (stream, &psf_sigma) in
                self.stream.iter().flat_map(|stream| self.psf_sigma.iter().map(move |psf| (*stream, psf)))
            {
                // Gains have a method of their own.
                let choice = stream == Stream::Recovered && gains == "none";
                let methods = if choice {
                    methods.iter().map(|method| Some(method.as_str())).collect()
                } else {
                    vec![None]
                };
                for method in methods {
                    let wanted = Combination { stream, method, psf_sigma, gains, mosaic };
                    if !points.iter().any(|point| wanted.has(point)) {
                        without.push(wanted.text(self.deblur));
                    }
                }
            }
        }
        distinct(without.into_iter())
    }

    /// A sentence if `--method` was given, but each sensor has a method of its own.
    pub fn unused_method(&self) -> Option<String> {
        let own: Option<Vec<&str>> =
            self.gains.iter().map(|gains| Some(GainPattern::named(gains)?.method())).collect();
        let own = own.filter(|_| !self.method.is_empty())?;
        Some(format!(
            "--method has no effect: the images of --gains {} are unwrapped by {}",
            self.gains.join(","),
            own.join(",")
        ))
    }
}

impl Combination<'_> {
    /// Whether a cell has these options.
    fn has(&self, point: &Point) -> bool {
        // The ideal image of the paper has no lens.
        point.stream == self.stream
            && self.method.is_none_or(|method| point.method.as_deref() == Some(method))
            && (self.stream == Stream::Ideal || point.psf_sigma == self.psf_sigma)
            && (point.gains == self.gains && point.mosaic == self.mosaic)
    }

    /// The options with the reason.
    fn text(&self, deblur: DeblurChoice) -> String {
        let mut options = vec![format!("--stream {}", self.stream.name())];
        options.extend(self.method.map(|method| format!("--method {method}")));
        let two_gains = self.gains != "none";
        let why = if two_gains && !matches!(self.stream, Stream::Saturated | Stream::Recovered) {
            options.push(format!("--gains {}", self.gains));
            "a sensor with two gains has the streams saturated and recovered only"
        } else if self.mosaic != "none" && !can_be_mosaic(self.stream, self.method) {
            options.push(format!("--mosaic {}", self.mosaic));
            "merged captures and spud_as_published have three chips only"
        } else if deblur == DeblurChoice::On && self.psf_sigma == 0.0 {
            options.extend([format!("--psf-sigma {}", self.psf_sigma), "--deblur on".to_owned()]);
            "without a lens there is no blur to remove"
        } else {
            options.push("--deblur on".to_owned());
            "spud_as_published removes no blur"
        };
        format!("{} ({why})", options.join(" "))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn axes(streams: &[Stream]) -> Axes {
        Axes { stream: streams.to_vec(), ..Axes::default() }
    }

    /// The sentence about a grid without a cell.
    fn refused(axes: &Axes) -> String {
        axes.points(Protocol::Suite).expect_err("no cell").to_string()
    }

    #[test]
    fn a_grid_without_a_cell_names_the_combination() {
        let gains = Axes { gains: vec!["checkerboard".into()], ..axes(&[Stream::Modulo]) };
        let text = refused(&gains);
        assert!(text.contains("--stream modulo --gains checkerboard (a sensor with two gains"), "{text}");
        let method = vec!["spud_as_published".into()];
        let mosaic =
            Axes { mosaic: vec!["rggb".into()], method: method.clone(), ..axes(&[Stream::Recovered]) };
        let text = refused(&mosaic);
        assert!(text.contains("--stream recovered --method spud_as_published --mosaic rggb"), "{text}");
        let sharp = Axes { psf_sigma: vec![0.0], deblur: DeblurChoice::On, ..axes(&[Stream::Recovered]) };
        assert!(refused(&sharp).contains("--psf-sigma 0 --deblur on"), "{}", refused(&sharp));
        let published = Axes { deblur: DeblurChoice::On, method, ..axes(&[Stream::Recovered]) };
        assert!(refused(&published).contains("removes no blur"), "{}", refused(&published));
    }

    #[test]
    fn single_combinations_without_a_cell_are_named_and_whole_grids_name_none() {
        let without = |axes: &Axes, protocol| {
            let points = axes.points(protocol).expect("cells");
            axes.without_cells(protocol, &points)
        };
        let gains = vec!["none".to_owned(), "rows".to_owned()];
        let some = Axes { gains, ..axes(&[Stream::Modulo, Stream::Recovered]) };
        let [one] = &without(&some, Protocol::Suite)[..] else { panic!("one combination") };
        assert!(one.starts_with("--stream modulo --gains rows"), "{one}");
        for protocol in [Protocol::Suite, Protocol::Paper] {
            assert_eq!(without(&Axes::default(), protocol), Vec::<String>::new());
        }
        let lenses = Axes { psf_sigma: vec![0.0, 1.4], ..Axes::default() };
        assert_eq!(without(&lenses, Protocol::Suite), Vec::<String>::new());
    }

    #[test]
    fn a_method_that_no_sensor_uses_is_named() {
        let method = vec!["spud".to_owned()];
        let two = Axes { gains: vec!["rows".into()], method: method.clone(), ..Axes::default() };
        assert!(two.unused_method().expect("a sentence").contains("row_gains"));
        assert_eq!(Axes { method, ..Axes::default() }.unused_method(), None);
    }
}
