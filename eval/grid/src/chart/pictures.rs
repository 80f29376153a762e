//! Images with boxes: figure 2 of the paper, and the worst frame of each stream.

use modulo_draw::{ChartBody, Picture, Pictures, class_colour};

use super::NamedChart;
use crate::labels::{self, distinct, number};
use crate::results::{Cell, Point, Results, Stream};

/// A cell, and the number of a frame among those that are scored.
pub type CellFrame = (Point, usize);

/// The image of a frame in a cell, with its boxes.
#[derive(Clone, Debug, PartialEq)]
pub struct DetectionPicture {
    /// The cell and the frame.
    pub of: CellFrame,
    /// The classes of the objects that were found.
    pub classes: Vec<String>,
    /// The image with the boxes.
    pub picture: Picture,
}

/// A chart whose images are not made yet.
pub struct PictureChart {
    name: &'static str,
    title: String,
    columns: Vec<Point>,
    /// The heading and the images of each row.
    rows: Vec<(String, Vec<CellFrame>)>,
}

const FOOTER: &str = "White boxes are labelled objects. Coloured boxes are objects that were found with a score of at least 0.25, in the colour of \
     their class.";

/// The charts of the first model, lens and method: frame `busiest` at all alphas, and the worst frame of each stream at the
/// alpha nearest to 4. `names` has the names of the frames.
pub fn planned(results: &Results, busiest: usize, names: &[String]) -> Vec<PictureChart> {
    let cells = selected(results);
    let four = labels::nearest_to_four(&cells);
    let Some(alpha) = four.first().map(|cell| cell.point.sensor.alpha) else { return Vec::new() };
    let columns = || four.iter().map(|cell| cell.point.clone()).collect();
    let row =
        |cells: &[&Cell], number: usize| cells.iter().map(|cell| (cell.point.clone(), number)).collect();
    let frame = |number: usize| names.get(number).map_or("", String::as_str);
    let at_alpha = |alpha: f64| {
        let cells: Vec<&Cell> =
            cells.iter().filter(|cell| cell.point.sensor.alpha == alpha).copied().collect();
        (format!("alpha {alpha}"), row(&cells, busiest))
    };
    let worst = |cell: &&Cell| {
        let worst = cell.worst.first()?;
        let (what, f1) = (labels::stream(&cell.point), number(100.0 * worst.f1, 1));
        Some((format!("worst of {what}: F1 {f1} %, frame {}", frame(worst.number)), row(&four, worst.number)))
    };
    let streams = PictureChart {
        name: "pictures_streams",
        title: format!("What the detector sees: frame {}", frame(busiest)),
        columns: columns(),
        rows: labels::alphas(&cells).into_iter().map(at_alpha).collect(),
    };
    let title = format!("The worst frame of each stream, alpha {alpha}");
    let rows = four.iter().filter_map(worst).collect();
    vec![streams, PictureChart { name: "pictures_worst", title, columns: columns(), rows }]
}

impl PictureChart {
    /// The cells and frames that the chart shows.
    pub fn wanted(&self) -> impl Iterator<Item = &CellFrame> {
        self.rows.iter().flat_map(|(_, row)| row)
    }

    /// The chart with its images among `pictures`.
    pub fn with(self, results: &Results, pictures: &[DetectionPicture]) -> NamedChart {
        let find =
            |of: CellFrame| pictures.iter().find(|picture| picture.of == of).map(|one| one.picture.clone());
        let row = |(heading, row): (String, Vec<CellFrame>)| (heading, row.into_iter().map(find).collect());
        let classes = distinct(pictures.iter().flat_map(|picture| picture.classes.iter().cloned()));
        let body = ChartBody::Pictures(Pictures {
            columns: self.columns.iter().map(labels::stream).collect(),
            rows: self.rows.into_iter().map(row).collect(),
            legend: classes.into_iter().map(|class| (class.clone(), class_colour(&class))).collect(),
        });
        let mut named = NamedChart::new(self.name.to_owned(), self.title, results, FOOTER.to_owned(), body);
        if let Some(point) = self.columns.first() {
            let conditions = labels::conditions(&labels::conditions_of(point));
            let subtitle = &mut named.chart.subtitle;
            *subtitle = format!("{}, {conditions} · {subtitle}", labels::model(point));
        }
        named
    }
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
