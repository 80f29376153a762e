//! Images with boxes: figure 2 of the paper, and the worst frame of each stream.

use modulo_draw::{ChartBody, Picture, Pictures, class_colour};

use super::NamedChart;
use crate::labels::{self, distinct, number};
use crate::results::{Cell, Point, Results, Stream};

/// The image of one frame in one cell, with its boxes.
#[derive(Clone, Debug, PartialEq)]
pub struct DetectionPicture {
    /// The cell.
    pub point: Point,
    /// Number of the frame among those that are scored.
    pub number: usize,
    /// Name of the frame in the data.
    pub frame: String,
    /// The classes of the objects that were found.
    pub classes: Vec<String>,
    /// The image with the boxes.
    pub picture: Picture,
}

const FOOTER: &str = "White boxes are labelled objects. Coloured boxes are objects that were found with a score of at least 0.25, in the colour of \
     their class.";

/// The cells and frames that the charts show: frame `busiest` at all alphas, and the worst frame of each stream at the
/// alpha nearest to 4.
pub fn wanted(results: &Results, busiest: usize) -> Vec<(Point, usize)> {
    let mut wanted = Vec::new();
    let cells = selected(results);
    wanted.extend(cells.iter().map(|cell| (cell.point.clone(), busiest)));
    for (_, number) in worst(&cells) {
        wanted.extend(labels::nearest_to_four(&cells).iter().map(|cell| (cell.point.clone(), number)));
    }
    distinct(wanted.into_iter())
}

/// The charts of `pictures`.
pub fn charts(results: &Results, pictures: &[DetectionPicture]) -> Vec<NamedChart> {
    let cells = selected(results);
    if cells.is_empty() || pictures.is_empty() {
        return Vec::new();
    }
    let mut alphas = distinct(cells.iter().map(|cell| cell.point.sensor.alpha));
    alphas.sort_by(f64::total_cmp);
    let worst = worst(&cells);
    let four = labels::nearest_to_four(&cells);
    let alpha = four.first().map_or(4.0, |cell| cell.point.sensor.alpha);
    // The pictures do not say which of them belong to the busiest frame. It is the only frame that was drawn for all
    // cells.
    let busiest = pictures
        .iter()
        .find(|picture| cells.iter().all(|cell| find(pictures, &cell.point, picture.number).is_some()));
    let by_alpha = busiest.map(|busiest| {
        let row = |alpha: &f64| {
            let cells: Vec<&Cell> =
                cells.iter().filter(|cell| cell.point.sensor.alpha == *alpha).copied().collect();
            (format!("alpha {alpha}"), row(pictures, &cells, busiest.number))
        };
        let title = format!("What the detector sees: frame {}", busiest.frame);
        named(results, "pictures_streams", title, &four, (alphas.iter().map(row).collect(), legend(pictures)))
    });
    let row = |(what, number): &(String, usize)| {
        let frame =
            pictures.iter().find(|picture| picture.number == *number).map_or("", |picture| &picture.frame);
        (format!("{what}, frame {frame}"), row(pictures, &four, *number))
    };
    let title = format!("The worst frame of each stream, alpha {alpha}");
    let worst =
        named(results, "pictures_worst", title, &four, (worst.iter().map(row).collect(), legend(pictures)));
    by_alpha.into_iter().chain([worst]).collect()
}

type Row = (String, Vec<Option<Picture>>);
type Legend = Vec<(String, [u8; 3])>;

/// The colours of the classes of `pictures`.
fn legend(pictures: &[DetectionPicture]) -> Legend {
    let classes = distinct(pictures.iter().flat_map(|picture| picture.classes.iter().cloned()));
    classes.into_iter().map(|class| (class.clone(), class_colour(&class))).collect()
}

fn named(
    results: &Results,
    name: &str,
    title: String,
    cells: &[&Cell],
    (rows, legend): (Vec<Row>, Legend),
) -> NamedChart {
    let columns = cells.iter().map(|cell| labels::stream(&cell.point)).collect();
    let body = ChartBody::Pictures(Pictures { columns, rows, legend });
    let mut named = NamedChart::new(name.to_owned(), title, results, FOOTER.to_owned(), body);
    if let Some(Cell { point, .. }) = cells.first() {
        let conditions = labels::conditions(&labels::conditions_of(point));
        named.chart.subtitle = format!("{}, {conditions} · {}", labels::model(point), named.chart.subtitle);
    }
    named
}

fn row(pictures: &[DetectionPicture], cells: &[&Cell], number: usize) -> Vec<Option<Picture>> {
    cells
        .iter()
        .map(|cell| find(pictures, &cell.point, number).map(|picture| picture.picture.clone()))
        .collect()
}

fn find<'a>(pictures: &'a [DetectionPicture], point: &Point, number: usize) -> Option<&'a DetectionPicture> {
    pictures.iter().find(|picture| picture.number == number && picture.point == *point)
}

/// One cell for each stream of the paper and each alpha, in the order of the paper: those of the first model, lens, noise
/// and method.
fn selected(results: &Results) -> Vec<&Cell> {
    let Some(first) = labels::all_conditions(&results.cells).into_iter().next() else { return Vec::new() };
    let own = |cell: &&Cell| labels::conditions_of(&cell.point) == first;
    let cells: Vec<&Cell> = results.cells.iter().filter(own).collect();
    let Some(model) = cells.first().map(|cell| labels::model(&cell.point)) else { return Vec::new() };
    // All methods, lenses and models would make a table of hundreds of images. The first ones in the order of the grid
    // are those that the user named first.
    let method = cells.iter().find_map(|cell| cell.point.method.clone());
    let of = |cell: &&&Cell| {
        let point = &cell.point;
        let method = point.method.is_none() || point.method == method;
        labels::model(point) == model && method && !point.deblur
    };
    let mut cells: Vec<&Cell> = cells.iter().filter(of).copied().collect();
    let order = [Stream::Ideal, Stream::Saturated, Stream::Modulo, Stream::Recovered];
    cells.retain(|cell| order.contains(&cell.point.stream));
    cells.sort_by_key(|cell| order.iter().position(|stream| *stream == cell.point.stream));
    cells
}

/// For each stream at the alpha nearest to 4: a heading and the number of its worst frame.
fn worst(cells: &[&Cell]) -> Vec<(String, usize)> {
    let of = |cell: &&Cell| {
        let worst = cell.worst.first()?;
        let what = labels::stream(&cell.point);
        Some((format!("worst of {what}: F1 {} %", number(100.0 * worst.f1, 1)), worst.number))
    };
    labels::nearest_to_four(cells).iter().filter_map(of).collect()
}
