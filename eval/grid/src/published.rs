//! The figures of the tables of the paper, in its units.

use crate::results::Stream;

/// The saturation factors of table 1.
pub const ALPHAS: [f64; 4] = [1.5, 2.0, 3.0, 4.0];
/// The time that the paper assumes for one capture, ms.
pub const CAPTURE_MS: f64 = 33.0;

const TABLES: &str = include_str!("published.txt");

/// A YOLOv10 model of the paper.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Published(char);

impl Published {
    /// The size of the model: n, s, m, b, l or x.
    pub fn letter(&self) -> char {
        self.0
    }

    /// The model with a name such as `yolov10n` or `yolov10n_dyn_w16`. `None` for other models.
    pub fn of(model: &str) -> Option<Self> {
        let (_, rest) = model.split_once("yolov10")?;
        let mut letters = rest.chars();
        let letter = letters.next().filter(|letter| "nsmblx".contains(*letter))?;
        let ends = !letters.next().is_some_and(|c| c.is_ascii_alphabetic());
        ends.then_some(Self(letter))
    }

    /// IoU, F1 and accuracy of a stream in percent. `None` at an alpha that the paper does not list, and for merged
    /// captures, which the paper assumes to be ideal.
    pub fn figures(&self, stream: Stream, alpha: f64) -> Option<[f64; 3]> {
        let figures = self.row(&stream.name())?;
        if let [iou, f1, accuracy] = figures[..] {
            return Some([iou, f1, accuracy]);
        }
        let column = ALPHAS.iter().position(|other| *other == alpha)?;
        Some([0, 1, 2].map(|figure| figures[ALPHAS.len() * figure + column]))
    }

    /// Time of a frame including its captures, ms: with the saturated or modulo image, with recovery, and with three
    /// captures.
    pub fn ms(&self) -> [f64; 3] {
        self.row("ms").and_then(|times| times.try_into().ok()).expect("each model has a row of three times")
    }

    fn row(&self, name: &str) -> Option<Vec<f64>> {
        let row = TABLES.lines().find_map(|line| line.strip_prefix(&format!("{} {name} ", self.0)))?;
        Some(row.split_whitespace().map(|n| n.parse().expect("the table holds numbers")).collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_finds_its_row() {
        let letter = |name| Published::of(name).map(|model| model.0);
        assert_eq!(letter("yolov10n"), Some('n'));
        assert_eq!(letter("models/yolov10x_dyn_w16.onnx"), Some('x'));
        assert_eq!([letter("demo"), letter("yolov10nano"), letter("yolov10")], [None; 3]);
    }

    #[test]
    fn every_model_has_all_its_figures() {
        for model in "nsmblx".chars().map(Published) {
            for stream in [Stream::Saturated, Stream::Modulo, Stream::Recovered, Stream::Ideal] {
                let found = ALPHAS.map(|alpha| model.figures(stream, alpha));
                assert!(found.iter().flatten().flatten().all(|f| (10.0..80.0).contains(f)), "{found:?}");
                assert!(found.iter().all(Option::is_some), "{model:?}, {stream:?}");
            }
            assert!(model.ms().is_sorted(), "{model:?}");
        }
        assert_eq!(Published('n').figures(Stream::MultiExposure, 2.0), None);
    }

    #[test]
    fn figures_are_those_of_the_table() {
        let figures = |name: &str, stream, alpha| Published::of(name).unwrap().figures(stream, alpha);
        assert_eq!(figures("yolov10s", Stream::Saturated, 4.0), Some([34.5, 16.6, 11.5]));
        assert_eq!(figures("yolov10b", Stream::Recovered, 1.5), Some([68.3, 49.3, 42.2]));
        assert_eq!(figures("yolov10l", Stream::Ideal, 8.0), Some([71.3, 56.3, 45.5]));
        assert_eq!(figures("yolov10n", Stream::Modulo, 8.0), None);
    }
}
