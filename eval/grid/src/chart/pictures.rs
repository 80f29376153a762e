//! Images with boxes: figure 2 of the paper.

use modulo_draw::{ChartBody, Picture, Pictures, class_colour};

use super::NamedChart;
use crate::labels::{self, distinct};
use crate::results::{Cell, Point, Results};

/// Name of the chart with images, which cannot be drawn from the results.
pub(crate) const PICTURES: &str = "pictures_streams";

/// The image of the frame in a cell, with its boxes.
#[derive(Clone, Debug, PartialEq)]
pub struct DetectionPicture {
    /// The cell.
    pub of: Point,
    /// The classes of the objects that were found.
    pub classes: Vec<String>,
    /// The image with the boxes.
    pub picture: Picture,
}

const FOOTER: &str = "White boxes are labelled objects. Coloured boxes are objects that were found with a score of at least 0.25, in the colour of \
     their class.";

/// The chart of the frame called `frame` in `cells`, those of [`selected`]: a row for each alpha, with the images among `pictures`.
pub fn chart(results: &Results, frame: &str, cells: &[&Cell], pictures: &[DetectionPicture]) -> NamedChart {
    let find = |cell: &&Cell| {
        let found = pictures.iter().find(|picture| picture.of == cell.point);
        found.map(|found| found.picture.clone())
    };
    let row = |alpha: f64| {
        let row = cells.iter().filter(|cell| cell.point.sensor.alpha == alpha);
        (format!("alpha {alpha}"), row.map(find).collect())
    };
    let columns = labels::nearest_to_four(cells);
    let classes = distinct(pictures.iter().flat_map(|picture| picture.classes.iter().cloned()));
    let body = ChartBody::Pictures(Pictures {
        columns: columns.iter().map(|cell| labels::stream(&cell.point)).collect(),
        rows: labels::alphas(cells).into_iter().map(row).collect(),
        legend: classes.into_iter().map(|class| (class.clone(), class_colour(&class))).collect(),
    });
    let title = format!("What the detector sees: frame {frame}");
    let mut named = NamedChart::new(PICTURES.to_owned(), title, results, FOOTER, body);
    if let Some(Cell { point, .. }) = columns.first() {
        let conditions = labels::conditions(&labels::conditions_of(point));
        let subtitle = &mut named.chart.subtitle;
        *subtitle = format!("{}, {conditions} · {subtitle}", labels::model(point));
    }
    named
}

/// One cell for each alpha and each stream of the paper, in the order of the paper: those of the first model, lens, noise and
/// method.
pub fn selected(results: &Results) -> Vec<&Cell> {
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
    // The order of the cells is that of the streams.
    cells.sort_by(|a, b| a.point.sensor.alpha.total_cmp(&b.point.sensor.alpha));
    cells
}
