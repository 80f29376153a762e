//! The figures of the paper beside those of the grid.

use maud::{Markup, html};

use super::tables::{Td, table};
use crate::grid::CAPTURES;
use crate::labels::{self, GridSetting};
use crate::results::{Cell, Results, Stream};

/// The saturation factors of table 1.
pub const ALPHAS: [f64; 4] = [1.5, 2.0, 3.0, 4.0];
/// The time that the paper assumes for one capture, ms.
pub const CAPTURE_MS: f64 = 33.0;

const TABLES: &str = include_str!("published.txt");

/// A YOLOv10 model of the paper.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Published(char);

impl Published {
    /// The model with a name such as `yolov10n` or `yolov10n_dyn_w16`. `None` for other models.
    pub fn of(model: &str) -> Option<Self> {
        let (_, rest) = model.split_once("yolov10")?;
        let mut letters = rest.chars();
        let letter = letters.next().filter(|letter| "nsmblx".contains(*letter))?;
        // `yolov10nano` would be another model. `yolov10n_dyn_w16` is the same one, exported in another form.
        let ends = !letters.next().is_some_and(|c| c.is_ascii_alphabetic());
        ends.then_some(Self(letter))
    }

    /// IoU, F1 and accuracy of a stream in percent. `None` at an alpha that the paper does not list, and for merged
    /// captures, which the paper assumes to be ideal.
    pub fn figures(&self, stream: Stream, alpha: f64) -> Option<[f64; 3]> {
        let figures = self.row(&stream.name())?;
        // The ideal image does not depend on alpha: its row has three figures, all others have three for each alpha.
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

/// The section with the tables. It is empty if no model is one of the paper.
pub fn section(results: &Results) -> Markup {
    let known = |cell: &Cell| Published::of(&cell.point.model).is_some();
    let columns = GridSetting::columns(&results.cells);
    let mut head = ["stream", "model"].map(str::to_owned).to_vec();
    head.extend(columns.iter().map(|setting| setting.column()));
    head.extend(["IoU", "paper", "F1", "paper", "accuracy", "paper"].map(str::to_owned));
    let rows: Vec<Vec<Td>> = results.cells.iter().filter_map(|cell| accuracy(cell, &columns)).collect();
    let times: Vec<Vec<Td>> = results.cells.iter().filter_map(time).collect();
    let time_head =
        ["stream", "model", "alpha", "capture, assumed", "merge or unwrap, tone", "detector", "sum", "paper"];
    html! {
        @if results.cells.iter().any(known) {
            h2 { "The paper's tables" }
            p {
                "Table 1, in percent. The paper used 100 KITTI images, the official weights, and SPUD for recovery as "
                "spud_as_published has it; spud takes the quantised image and is congruent with it. The other figures "
                "belong to the frames and the model named above."
            }
            (table(&head, &rows))
            @if !times.is_empty() { p {
                "Table 2, in milliseconds. The paper assumes " (CAPTURE_MS) " ms for a capture, and " (CAPTURES)
                " captures for merged exposures. Its times were measured on an RTX 4070; the other times are medians on the "
                "processor named below."
            }
            (table(&time_head, &times)) }
        }
    }
}

fn accuracy(cell: &Cell, columns: &[GridSetting]) -> Option<Vec<Td>> {
    let published = Published::of(&cell.point.model)?.figures(cell.point.stream, cell.point.sensor.alpha);
    let theirs = |index: usize| Td::number(published.map(|figures| figures[index]), 1);
    let point = &cell.point;
    let mut row = vec![Td::Text(labels::stream(point)), Td::Text(labels::model(point))];
    row.extend(columns.iter().map(|setting| Td::setting(setting.of(point))));
    for (index, ours) in [cell.paper.iou, cell.paper.f1, cell.paper.accuracy].into_iter().enumerate() {
        row.extend([Td::percent(Some(ours)), theirs(index)]);
    }
    Some(row)
}

fn time(cell: &Cell) -> Option<Vec<Td>> {
    let published = Published::of(&cell.point.model)?;
    let sum = labels::frame_ms(cell)?;
    let of = |stages: &[&str]| {
        stages.iter().filter_map(|stage| cell.latency_ms.get(*stage)).map(|time| time.p50).sum::<f64>()
    };
    let (captures, theirs) = match cell.point.stream {
        Stream::Saturated | Stream::Modulo => (1.0, Some(published.ms()[0])),
        Stream::Recovered => (1.0, Some(published.ms()[1])),
        Stream::MultiExposure | Stream::MultiExposureStill => (CAPTURES as f64, Some(published.ms()[2])),
        // No sensor delivers the ideal image, and the paper meters nothing.
        Stream::Ideal | Stream::AutoExposed | Stream::Metered => return None,
    };
    // The times of the paper include its captures, which a simulation cannot measure. The time that the paper assumes
    // for them is added to ours, so that the sums can be compared.
    let capture = captures * CAPTURE_MS;
    let point = &cell.point;
    Some(vec![
        Td::Text(labels::stream(point)),
        Td::Text(labels::model(point)),
        Td::setting(point.sensor.alpha),
        Td::number(Some(capture), 0),
        Td::number(Some(of(&["merge", "unwrap", "tone", "deblur"])), 1),
        Td::number(Some(of(&["pre", "infer", "post"])), 1),
        Td::number(Some(capture + sum), 1),
        Td::number(theirs, 2),
    ])
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
