//! The figures that the paper gives, in its own units.

use crate::results::Stream;

/// The saturation factors of its table 1.
pub const ALPHAS: [f64; 4] = [1.5, 2.0, 3.0, 4.0];
/// What it assumes of one capture, ms.
pub const CAPTURE_MS: f64 = 33.0;

/// What the paper says of one YOLOv10.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Published {
    /// n, s, m, b, l or x.
    pub letter: char,
    /// Table 1 of the saturated image.
    pub saturated: Row,
    /// Of the modulo image.
    pub modulo: Row,
    /// Of SPUD's recovery.
    pub recovery: Row,
    /// Of the ideal image, which has no alpha.
    pub ideal: [f64; 3],
    /// Table 2: saturated or modulo, recovery, ideal from three captures; captures included, ms.
    pub ms: [f64; 3],
}

/// IoU, F1 and accuracy at each of [`ALPHAS`], percent.
pub type Row = [[f64; 4]; 3];

/// All models of the paper.
pub const PUBLISHED: [Published; 6] = [
    Published {
        letter: 'n',
        saturated: [[58.9, 55.3, 53.4, 50.6], [37.8, 37.0, 35.2, 35.2], [29.8, 28.5, 28.5, 25.0]],
        modulo: [[60.2, 58.4, 56.2, 53.2], [40.0, 40.1, 38.6, 36.7], [29.8, 29.0, 29.0, 28.4]],
        recovery: [[61.0, 59.3, 57.4, 53.0], [41.1, 40.0, 39.7, 39.7], [30.2, 28.7, 26.8, 26.8]],
        ideal: [62.1, 42.0, 32.0],
        ms: [56.18, 62.95, 122.85],
    },
    Published {
        letter: 's',
        saturated: [[56.6, 55.1, 44.4, 34.5], [36.5, 34.3, 23.6, 16.6], [27.3, 25.6, 16.3, 11.5]],
        modulo: [[61.8, 60.1, 57.6, 54.3], [42.2, 39.3, 36.0, 31.1], [31.5, 29.6, 26.7, 23.0]],
        recovery: [[62.0, 61.8, 60.1, 54.2], [41.6, 41.3, 39.3, 35.1], [31.6, 32.0, 29.6, 26.0]],
        ideal: [62.6, 42.1, 32.1],
        ms: [57.23, 65.34, 123.97],
    },
    Published {
        letter: 'm',
        saturated: [[61.8, 60.7, 58.7, 56.8], [40.8, 42.3, 40.5, 40.5], [38.7, 38.1, 37.7, 36.1]],
        modulo: [[65.4, 64.3, 64.0, 63.6], [43.5, 43.0, 42.6, 42.7], [40.0, 38.7, 36.7, 35.1]],
        recovery: [[65.4, 64.2, 63.5, 63.5], [44.2, 43.6, 43.5, 43.1], [41.1, 40.0, 39.8, 39.0]],
        ideal: [65.8, 45.9, 41.2],
        ms: [59.32, 68.23, 126.17],
    },
    Published {
        letter: 'b',
        saturated: [[65.4, 65.0, 64.8, 64.7], [43.5, 43.2, 42.6, 41.8], [39.8, 38.7, 37.9, 35.7]],
        modulo: [[67.3, 67.1, 66.7, 66.4], [44.4, 43.6, 42.6, 41.8], [41.1, 40.7, 39.6, 38.6]],
        recovery: [[68.3, 68.0, 67.3, 67.0], [49.3, 49.0, 48.3, 48.1], [42.2, 41.2, 40.3, 40.1]],
        ideal: [70.0, 51.2, 43.6],
        ms: [59.87, 71.34, 128.17],
    },
    Published {
        letter: 'l',
        saturated: [[65.1, 63.0, 57.1, 47.8], [44.6, 42.3, 33.0, 24.8], [34.3, 32.1, 23.3, 17.6]],
        modulo: [[69.4, 68.7, 65.4, 58.8], [53.3, 53.3, 46.2, 38.4], [41.6, 40.9, 36.0, 28.5]],
        recovery: [[69.9, 69.9, 68.4, 60.6], [52.7, 52.5, 50.3, 42.2], [42.0, 41.8, 36.1, 31.9]],
        ideal: [71.3, 56.3, 45.5],
        ms: [63.56, 73.49, 131.68],
    },
    Published {
        letter: 'x',
        saturated: [[65.5, 63.1, 57.8, 48.8], [44.9, 42.2, 35.4, 27.1], [34.3, 31.4, 25.9, 19.3]],
        modulo: [[71.0, 70.0, 67.9, 62.3], [54.8, 54.1, 51.7, 43.9], [44.1, 42.4, 41.2, 33.6]],
        recovery: [[72.0, 71.2, 70.7, 67.9], [56.1, 55.7, 52.1, 48.1], [45.2, 45.1, 42.2, 36.2]],
        ideal: [72.9, 62.3, 50.2],
        ms: [65.84, 79.25, 136.34],
    },
];

impl Published {
    /// That of a model's name, such as `yolov10n` or `yolov10n_dyn_w16`.
    pub fn of(model: &str) -> Option<&'static Self> {
        let (_, rest) = model.split_once("yolov10")?;
        let mut letters = rest.chars();
        let letter = letters.next()?;
        let ends = !letters.next().is_some_and(|c| c.is_ascii_alphabetic());
        PUBLISHED.iter().find(|row| ends && row.letter == letter)
    }

    /// IoU, F1 and accuracy of a stream, percent; `None` at an alpha that the paper does not have.
    pub fn figures(&self, stream: Stream, alpha: f64) -> Option<[f64; 3]> {
        let column = ALPHAS.iter().position(|other| *other == alpha);
        let at = |row: &Row| column.map(|column| row.map(|figure| figure[column]));
        match stream {
            Stream::Ideal => Some(self.ideal),
            Stream::Saturated => at(&self.saturated),
            Stream::Modulo => at(&self.modulo),
            Stream::Recovered => at(&self.recovery),
            // It assumes that these are ideal.
            Stream::MultiExposure | Stream::MultiExposureStill => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_finds_its_row() {
        let letter = |name| Published::of(name).map(|row| row.letter);
        assert_eq!(letter("yolov10n"), Some('n'));
        assert_eq!(letter("models/yolov10x_dyn_w16.onnx"), Some('x'));
        assert_eq!([letter("demo"), letter("yolov10nano"), letter("yolov10")], [None; 3]);
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
