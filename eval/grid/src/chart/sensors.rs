//! Which sensor for which scene: for each lens and saturation factor, the simplest sensor and method that keep the accuracy of
//! the ideal image.

use modulo_charts::{
    Axis, AxisDirection, ChartBody, ChartPanel, DataPoint, Scale, Series, SeriesStyle, Unit,
};

use super::{NamedChart, add_point, file_name, models};
use crate::labels::{self, distinct, number};
use crate::results::{Cell, Results, Stream};

/// A choice may have this much less AP50 than the ideal image: one point.
const LOSS: f64 = 0.01;

/// The name of the series of the scenes that no choice suffices for.
const NO_CHOICE: &str = "no choice";

/// One chart for each model and noise whose cells have several lenses and several saturation factors.
pub fn charts(results: &Results) -> Vec<NamedChart> {
    let mut charts = Vec::new();
    let all: Vec<&Cell> = results.cells.iter().collect();
    for model in models(&all) {
        for noise in distinct(all.iter().map(|cell| noise(cell))) {
            let here = |cell: &&Cell| labels::model(&cell.point) == model && self::noise(cell) == noise;
            let cells: Vec<&Cell> = all.iter().copied().filter(here).collect();
            if values(&cells, |cell| cell.point.alpha).len() > 1 && values(&cells, lens).len() > 1 {
                charts.push(chart(results, &cells, &model, noise));
            }
        }
    }
    charts
}

fn noise(cell: &Cell) -> [f64; 2] {
    [cell.point.noise, cell.point.shot_noise]
}

fn lens(cell: &Cell) -> f64 {
    cell.point.psf_sigma
}

/// The distinct values in ascending order.
fn values(cells: &[&Cell], of: fn(&Cell) -> f64) -> Vec<f64> {
    let mut values = distinct(cells.iter().map(|cell| of(cell)));
    values.sort_by(f64::total_cmp);
    values
}

fn chart(results: &Results, cells: &[&Cell], model: &str, [noise, shot_noise]: [f64; 2]) -> NamedChart {
    let groups = distinct(cells.iter().flat_map(|cell| cell.ap50.keys()));
    let mosaics = distinct(cells.iter().map(|cell| cell.point.mosaic.as_str()));
    let panels = groups.iter().flat_map(|group| mosaics.iter().map(|mosaic| panel(cells, group, mosaic)));
    let body = ChartBody::Panels(panels.collect());
    let footer = "Each marker is the first choice in this order whose AP50 is at most 1 point below that of the ideal image of \
                  the same scene, lens and mosaic: the saturated image of a normal chip, of a chip with two gains, three \
                  captures, the raw modulo image, the recovered one, the recovered one of a modulo chip with two gains; each \
                  without deblurring before with it. The 95 % intervals of AP50 are wider than a point: see the other charts.";
    let title = format!("Which sensor for which scene: {model}, {}", labels::noises(noise, shot_noise));
    let name = format!("sensors_{}_noise{noise}_shot{shot_noise}", file_name(model));
    NamedChart::new(name, title, results, footer.to_owned(), body)
}

fn panel(cells: &[&Cell], group: &str, mosaic: &str) -> ChartPanel {
    let cells: Vec<&Cell> = cells.iter().copied().filter(|cell| cell.point.mosaic == mosaic).collect();
    let lenses = values(&cells, lens);
    let mut series: Vec<Series> = Vec::new();
    for alpha in values(&cells, |cell| cell.point.alpha) {
        for &lens in &lenses {
            let here = |cell: &&Cell| cell.point.alpha == alpha && self::lens(cell) == lens;
            let scene: Vec<&Cell> = cells.iter().copied().filter(here).collect();
            // The sharp ideal image is a cell of its own at a lens that no other cell may have.
            let Some(ideal) = ideal(&scene, group).filter(|_| scene.iter().any(|cell| rank(cell).is_some()))
            else {
                continue;
            };
            let (name, hover) = match simplest(&scene, group, ideal) {
                Some((cell, ap50)) => (labels::stream(&cell.point), percent(ap50)),
                None => (NO_CHOICE.to_owned(), "less".to_owned()),
            };
            let hover = format!(
                "alpha {alpha}, lens blur {lens} px: {name}, AP50 of {group} {hover}, ideal {}",
                percent(ideal)
            );
            let point = DataPoint { x: lens, y: alpha, hover, ..DataPoint::default() };
            add_point(&mut series, name, point, SeriesStyle::Markers);
        }
    }
    let most = lenses.last().copied().unwrap_or_default();
    let chip = if mosaic == "none" { "all colours a pixel".to_owned() } else { format!("mosaic {mosaic}") };
    let frames = labels::frames(cells.iter().map(|cell| cell.frames));
    ChartPanel {
        x: Axis {
            label: format!("standard deviation of the lens blur, px ({group}, {frames})"),
            scale: Scale::Linear { from: 0.0, to: most },
            unit: Unit::Plain,
            direction: AxisDirection::Up,
        },
        y: Axis::log(format!("alpha, the saturation factor; {chip}")),
        series,
    }
}

fn percent(share: f64) -> String {
    format!("{} %", number(100.0 * share, 1))
}

fn ap50(cell: &Cell, group: &str) -> Option<f64> {
    *cell.ap50.get(group)?
}

/// AP50 of the ideal image of a scene.
fn ideal(scene: &[&Cell], group: &str) -> Option<f64> {
    scene.iter().find(|cell| cell.point.stream == Stream::Ideal).and_then(|cell| ap50(cell, group))
}

/// The first choice that suffices, and its AP50. Of equally simple choices it is the most accurate one.
fn simplest<'a>(scene: &[&'a Cell], group: &str, ideal: f64) -> Option<(&'a Cell, f64)> {
    let choices = scene.iter().filter_map(|&cell| Some((rank(cell)?, cell, ap50(cell, group)?)));
    let suffices = choices.filter(|(_, _, ap50)| *ap50 >= ideal - LOSS);
    let first = suffices.min_by(|a, b| a.0.cmp(&b.0).then(b.2.total_cmp(&a.2)));
    first.map(|(_, cell, ap50)| (cell, ap50))
}

/// The place of a cell in the order of the choices. `None` for images that no sensor delivers.
fn rank(cell: &Cell) -> Option<u8> {
    let point = &cell.point;
    let two_gains = u8::from(point.pattern().is_some());
    Some(match point.stream {
        Stream::Saturated => two_gains,
        Stream::MultiExposure => 2,
        Stream::Modulo => 3,
        Stream::Recovered => 4 + 2 * two_gains + u8::from(point.deblur),
        Stream::Ideal | Stream::MultiExposureStill => return None,
    })
}
