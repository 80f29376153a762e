//! Labels of cells in tables and charts, and the time of a frame.

pub use modulo_charts::distinct;

use crate::results::{Cell, Point, Stream};

/// Standard deviation of the lens blur (px) and of the read noise (code units), which the tables of the paper do not vary.
pub type Conditions = (f64, f64);

/// The stage that simulates the sensor. A real sensor takes no processor time.
pub const SENSE: &str = "sense";

/// The stages of a frame in their order.
pub const STAGES: [&str; 8] = [SENSE, "merge", "unwrap", "tone", "deblur", "pre", "infer", "post"];

/// Label of the image that the detector gets: `recovered (auto, deblurred)`, `saturated`, `ideal, sharp`.
pub fn stream(point: &Point) -> String {
    let name = point.stream.name();
    match &point.method {
        Some(method) if point.deblur => format!("{name} ({method}, deblurred)"),
        Some(method) => format!("{name} ({method})"),
        None if is_sharp_ideal(point) => format!("{name}, sharp"),
        None => name,
    }
}

/// Label of the model and its input size: `yolov10n 640x640`.
pub fn model(point: &Point) -> String {
    format!("{} {}", point.model, point.input)
}

/// Label of the conditions: `lens 1.4 px, noise 0`.
pub fn conditions((psf_sigma, noise): Conditions) -> String {
    format!("lens {psf_sigma} px, noise {noise}")
}

/// The conditions of a cell.
pub fn conditions_of(point: &Point) -> Conditions {
    (point.psf_sigma, point.noise)
}

/// Whether a cell belongs to these conditions. The ideal image without a lens belongs to all lenses.
pub fn belongs(point: &Point, (psf_sigma, noise): Conditions) -> bool {
    point.noise == noise && (point.psf_sigma == psf_sigma || is_sharp_ideal(point))
}

/// All conditions of the cells, in the order of their first appearance. The sharp ideal image is ignored if there are other
/// cells.
pub fn all_conditions(cells: &[Cell]) -> Vec<Conditions> {
    // As a condition of its own, the sharp ideal image would get charts and tables with a single entry.
    let real = cells.iter().filter(|cell| !is_sharp_ideal(&cell.point));
    let found = distinct(real.map(|cell| conditions_of(&cell.point)));
    if found.is_empty() { distinct(cells.iter().map(|cell| conditions_of(&cell.point))) } else { found }
}

fn is_sharp_ideal(point: &Point) -> bool {
    point.stream == Stream::Ideal && point.psf_sigma == 0.0
}

/// Median time from the captured image to the boxes, ms. `None` if it was not measured.
pub fn frame_ms(cell: &Cell) -> Option<f64> {
    cell.frame_ms.as_ref().map(|time| time.p50)
}

/// One line for each detector and pass in which the machine was busy: the medians of its inference, which is the same
/// in all cells, are more than 10 % apart.
pub fn busy(cells: &[Cell]) -> Vec<String> {
    let timed = |cell: &Cell| {
        let infer = cell.latency_ms.get("infer")?.p50;
        Some(((model(&cell.point), cell.frame_ms.as_ref()?.pass.clone()), infer))
    };
    let timed: Vec<_> = cells.iter().filter_map(timed).collect();
    let apart = |detector: &(String, String)| {
        let times = timed.iter().filter(|(other, _)| other == detector).map(|(_, ms)| *ms);
        let (least, most) = times.fold((f64::INFINITY, 0.0f64), |(a, b), ms| (a.min(ms), b.max(ms)));
        (most > 1.1 * least).then(|| {
            format!(
                "measured on a busy machine: the median inference of {} took {least:.1} to {most:.1} ms in the cells of \
                 one pass ({})",
                detector.0, detector.1
            )
        })
    };
    distinct(timed.iter().map(|(detector, _)| detector)).into_iter().filter_map(apart).collect()
}

/// The cells at the alpha nearest to 4, the largest of the paper.
pub fn nearest_to_four<'a>(cells: &[&'a Cell]) -> Vec<&'a Cell> {
    let distance = |cell: &&Cell| (cell.point.alpha - 4.0).abs();
    let least = cells.iter().map(distance).fold(f64::INFINITY, f64::min);
    cells.iter().filter(|cell| distance(cell) == least).copied().collect()
}

/// A fraction as percent with one decimal digit; `-` without a value.
pub fn percent(fraction: Option<f64>) -> String {
    fraction.map_or_else(|| "-".to_owned(), |f| format!("{:.1}", 100.0 * f))
}
