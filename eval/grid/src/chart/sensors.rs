//! Which sensor for which scene: for each lens and saturation factor, the simplest sensor and method that keep the accuracy of
//! the ideal image.

use modulo_core::Mosaic;
use modulo_draw::{Axis, ChartBody, ChartPanel, DataPoint, Scale, Series, SeriesStyle, ascending};
use modulo_runtime::SensorModel;

use super::{NamedChart, models};
use crate::labels::{self, distinct, number};
use crate::results::{Cell, Results, file_name};

/// A choice may have this much less AP50 than the ideal image: one point.
const LOSS: f64 = 0.01;

/// The name of the series of the scenes that no choice suffices for.
const NO_CHOICE: &str = "no choice";

/// One chart for each model, noise, mosaic and group of objects whose cells have several lenses and saturation factors.
pub fn charts(results: &Results) -> Vec<NamedChart> {
    let all: Vec<&Cell> = results.cells.iter().collect();
    let mut charts = Vec::new();
    for model in models(&all) {
        for fixed in distinct(all.iter().map(|cell| fixed(cell))) {
            let here = |cell: &&Cell| labels::model(&cell.point) == model && self::fixed(cell) == fixed;
            let cells: Vec<&Cell> = all.iter().copied().filter(here).collect();
            if labels::alphas(&cells).len() > 1 && lenses(&cells).len() > 1 {
                let groups = groups(&cells);
                charts.extend(groups.iter().map(|group| chart(results, &cells, &model, group)));
            }
        }
    }
    charts
}

/// The sensor that all cells of a chart have but for its saturation factor, lens and gains.
fn fixed(cell: &Cell) -> SensorModel {
    SensorModel { psf_sigma: 0.0, mosaic: cell.point.sensor.mosaic, ..labels::conditions_of(&cell.point) }
}

/// The groups, those with the most objects first: the report opens the first chart.
fn groups<'a>(cells: &[&'a Cell]) -> Vec<&'a String> {
    let mut groups = distinct(cells.iter().flat_map(|cell| cell.ap50.keys()));
    let objects = |group: &&String| cells.iter().filter_map(|cell| cell.objects.get(*group)).max();
    groups.sort_by_key(|group| std::cmp::Reverse(objects(group)));
    groups
}

fn lens(cell: &Cell) -> f64 {
    cell.point.sensor.psf_sigma
}

/// The lenses of cells, in ascending order.
fn lenses(cells: &[&Cell]) -> Vec<f64> {
    ascending(cells.iter().map(|cell| lens(cell)))
}

/// `cells` is not empty.
fn chart(results: &Results, cells: &[&Cell], model: &str, group: &str) -> NamedChart {
    let sensor = fixed(cells[0]);
    let (mosaic, without) = (sensor.mosaic.map_or("none", Mosaic::word), ["alpha", "psf_sigma", "mosaic"]);
    let body =
        ChartBody::Panels([Pixels::Normal, Pixels::Modulo].map(|pixels| panel(cells, group, pixels)).into());
    let footer = "Each marker is the simplest choice whose AP50 is at most 1 point below that of the ideal image behind the same \
                  lens. Normal pixels, in this order: one gain, two gains, three captures. Modulo \
                  pixels: the raw image, the recovered one, then deblurred; then those of two gains. The 95 % intervals of AP50 are often wider than a point: \
                  see the other charts.";
    let chip =
        if mosaic == "none" { "all colours at each pixel".to_owned() } else { format!("mosaic {mosaic}") };
    let frames = labels::frames(cells, |cell| Some(cell.frames));
    let title = format!(
        "Which sensor for which scene: {group}, {frames}, {model}, {chip}, {}",
        labels::sensor(&sensor, &without)
    );
    let suffix = labels::suffix(&sensor, &without);
    let name = format!("sensors_{}_{group}_{mosaic}_{suffix}", file_name(model));
    NamedChart::new(file_name(&name), title, results, footer, body)
}

/// Behaviour of the pixels at the peak.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Pixels {
    /// They saturate.
    Normal,
    /// They wrap.
    Modulo,
}

fn panel(cells: &[&Cell], group: &str, pixels: Pixels) -> ChartPanel {
    // Each series with its rank, by which the legend is sorted.
    let mut series: Vec<(u8, Series)> = Vec::new();
    for alpha in labels::alphas(cells) {
        for lens in lenses(cells) {
            let here = |cell: &&Cell| cell.point.sensor.alpha == alpha && self::lens(cell) == lens;
            let scene: Vec<&Cell> = cells.iter().copied().filter(here).collect();
            let Some((rank, name, point)) = marker(&scene, group, pixels) else { continue };
            match series.iter_mut().find(|(_, series)| series.name == name) {
                Some((_, series)) => series.points.push(point),
                None => {
                    series.push((rank, Series { name, points: vec![point], style: SeriesStyle::Markers }))
                }
            }
        }
    }
    series.sort_by_key(|(rank, _)| *rank);
    let words = if pixels == Pixels::Normal { "normal" } else { "modulo" };
    ChartPanel {
        x: Axis::new(Scale::Settings, format!("lens blur, px ({words} pixels)")),
        y: Axis::new(Scale::Settings, labels::ALPHA),
        series: series.into_iter().map(|(_, series)| series).collect(),
    }
}

/// The marker of one lens and saturation factor, with the name of its series and the rank of the choice. `None` if no sensor was
/// measured there.
fn marker(scene: &[&Cell], group: &str, pixels: Pixels) -> Option<(u8, String, DataPoint)> {
    let choices: Vec<(u8, &Cell, f64)> = choices(scene, group, pixels).collect();
    let SensorModel { alpha, psf_sigma, .. } = choices.first()?.1.point.sensor;
    let ideal = ideal(scene, group)?;
    let suffices = choices.into_iter().filter(|(_, _, ap50)| *ap50 >= ideal - LOSS);
    // Of equally simple choices, the most accurate one.
    let simplest = suffices.min_by(|a, b| a.0.cmp(&b.0).then(b.2.total_cmp(&a.2)));
    let (rank, name, accuracy, is_faded) = match simplest {
        Some((rank, cell, ap50)) => {
            // The title has the mosaic.
            let mut point = cell.point.clone();
            point.sensor.mosaic = None;
            (rank, labels::stream(&point), format!(", AP50 {}", percent(ap50)), false)
        }
        None => (u8::MAX, NO_CHOICE.to_owned(), String::new(), true),
    };
    let hover = format!(
        "alpha {alpha}, lens blur {psf_sigma} px: {name}{accuracy}, AP50 of the ideal image {}",
        percent(ideal)
    );
    Some((rank, name, DataPoint { x: psf_sigma, y: alpha, hover, is_faded, ..DataPoint::default() }))
}

fn percent(share: f64) -> String {
    format!("{} %", number(100.0 * share, 1))
}

fn ideal(scene: &[&Cell], group: &str) -> Option<f64> {
    scene.iter().find(|cell| cell.point.is("ideal"))?.ap50_of(group)
}

/// The cells of a scene that a sensor with these pixels can deliver: place in the order of choices, cell, AP50.
fn choices<'a>(scene: &[&'a Cell], group: &str, pixels: Pixels) -> impl Iterator<Item = (u8, &'a Cell, f64)> {
    scene.iter().filter_map(move |&cell| {
        let (of, rank) = rank(cell)?;
        let ap50 = cell.ap50_of(group)?;
        (of == pixels).then_some((rank, cell, ap50))
    })
}

/// The pixels of a cell and its place in the order of the choices. `None` for images that no sensor delivers.
fn rank(cell: &Cell) -> Option<(Pixels, u8)> {
    let point = &cell.point;
    let two_gains = u8::from(point.sensor.gains);
    Some(match point.stream.as_str() {
        "saturated" => (Pixels::Normal, two_gains),
        "multi_exposure" => (Pixels::Normal, 2),
        "modulo" => (Pixels::Modulo, 0),
        "recovered" => (Pixels::Modulo, 1 + 2 * two_gains + u8::from(point.deblur)),
        _ => return None,
    })
}
