//! Pictures with boxes: the paper's figure 2, and the worst frame of each stream.

use modulo_charts::{Body, Picture, Pictures};

use super::Named;
use crate::results::{Cell, Point, Results, Stream};
use crate::wording::{self, distinct};

/// What one detector saw of one frame.
#[derive(Clone, Debug, PartialEq)]
pub struct Shot {
    /// The cell.
    pub point: Point,
    /// Of the frame, among those that are scored.
    pub number: usize,
    /// Of the frame, as the data calls it.
    pub frame: String,
    /// With the boxes.
    pub picture: Picture,
}

const FOOTER: &str = "Blue: labelled. Orange: found, with a score of at least 0.25.";

/// Which frames are needed of which cells: `busiest` at all alphas, and the worst of each stream at the alpha nearest
/// to 4.
pub fn wanted(results: &Results, busiest: usize) -> Vec<(Point, usize)> {
    let mut wanted = Vec::new();
    let cells = shown(results);
    wanted.extend(cells.iter().map(|cell| (cell.point.clone(), busiest)));
    for (_, number) in worst(&cells) {
        wanted.extend(wording::nearest_to_four(&cells).iter().map(|cell| (cell.point.clone(), number)));
    }
    distinct(wanted.into_iter())
}

/// The charts that `shots` allow.
pub fn charts(results: &Results, shots: &[Shot]) -> Vec<Named> {
    let cells = shown(results);
    if cells.is_empty() || shots.is_empty() {
        return Vec::new();
    }
    let mut alphas = distinct(cells.iter().map(|cell| cell.point.alpha));
    alphas.sort_by(f64::total_cmp);
    let worst = worst(&cells);
    let four = wording::nearest_to_four(&cells);
    let alpha = four.first().map_or(4.0, |cell| cell.point.alpha);
    // The frame that every cell has.
    let busiest =
        shots.iter().find(|shot| cells.iter().all(|cell| find(shots, &cell.point, shot.number).is_some()));
    let by_alpha = busiest.map(|busiest| {
        let row = |alpha: &f64| {
            let cells: Vec<&Cell> = cells.iter().filter(|cell| cell.point.alpha == *alpha).copied().collect();
            (format!("alpha {alpha}"), row(shots, &cells, busiest.number))
        };
        let title = format!("What the detector sees: frame {}", busiest.frame);
        named(results, "pictures_streams", title, &four, alphas.iter().map(row).collect())
    });
    let row = |(what, number): &(String, usize)| {
        let frame = shots.iter().find(|shot| shot.number == *number).map_or("", |shot| &shot.frame);
        (format!("{what}, frame {frame}"), row(shots, &four, *number))
    };
    let title = format!("The worst frame of each stream, alpha {alpha}");
    let worst = named(results, "pictures_worst", title, &four, worst.iter().map(row).collect());
    by_alpha.into_iter().chain([worst]).collect()
}

type Row = (String, Vec<Option<Picture>>);

fn named(results: &Results, name: &str, title: String, cells: &[&Cell], rows: Vec<Row>) -> Named {
    let columns = cells.iter().map(|cell| wording::stream(&cell.point)).collect();
    let body = Body::Pictures(Pictures { columns, rows });
    let mut named = Named::new(name.to_owned(), title, results, FOOTER.to_owned(), body);
    if let Some(Cell { point, .. }) = cells.first() {
        let conditions = wording::conditions(wording::conditions_of(point));
        named.chart.subtitle = format!("{}, {conditions} · {}", wording::model(point), named.chart.subtitle);
    }
    named
}

fn row(shots: &[Shot], cells: &[&Cell], number: usize) -> Vec<Option<Picture>> {
    cells.iter().map(|cell| find(shots, &cell.point, number).map(|shot| shot.picture.clone())).collect()
}

fn find<'a>(shots: &'a [Shot], point: &Point, number: usize) -> Option<&'a Shot> {
    shots.iter().find(|shot| shot.number == number && shot.point == *point)
}

/// One cell for each of the paper's streams and each alpha, in the paper's order: the first model, lens, noise and
/// method.
fn shown(results: &Results) -> Vec<&Cell> {
    let Some(first) = wording::all_conditions(&results.cells).first().copied() else { return Vec::new() };
    let own = |cell: &&Cell| wording::conditions_of(&cell.point) == first;
    let cells: Vec<&Cell> = results.cells.iter().filter(own).collect();
    let Some(model) = cells.first().map(|cell| wording::model(&cell.point)) else { return Vec::new() };
    let method = cells.iter().find_map(|cell| cell.point.method.clone());
    let of = |cell: &&&Cell| {
        let point = &cell.point;
        let method = point.method.is_none() || point.method == method;
        wording::model(point) == model && method && !point.deblur
    };
    let mut shown: Vec<&Cell> = cells.iter().filter(of).copied().collect();
    let order = [Stream::Ideal, Stream::Saturated, Stream::Modulo, Stream::Recovered];
    shown.retain(|cell| order.contains(&cell.point.stream));
    shown.sort_by_key(|cell| order.iter().position(|stream| *stream == cell.point.stream));
    shown
}

/// For each stream at that alpha: what it is, and the number of its worst frame.
fn worst(cells: &[&Cell]) -> Vec<(String, usize)> {
    let of = |cell: &&Cell| {
        let worst = cell.worst.first()?;
        let what = wording::stream(&cell.point);
        Some((format!("worst of {what}: F1 {:.1} %", 100.0 * worst.f1), worst.number))
    };
    wording::nearest_to_four(cells).iter().filter_map(of).collect()
}
