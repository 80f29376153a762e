//! Labels of cells in tables and charts, and the time of a frame.

pub use modulo_draw::{below_100, distinct, number};

use modulo_core::Mosaic;

use crate::results::{Cell, Point, Stream};

/// A setting of the sensor, which charts vary or name.
pub struct GridSetting {
    /// Name in titles.
    pub name: &'static str,
    /// Name in the names of files.
    pub file: &'static str,
    /// Label of its axis.
    pub axis: &'static str,
    /// Its value in a cell.
    pub of: fn(&Point) -> f64,
    /// Name and value, such as `lens blur 1.4 px`.
    pub text: fn(f64) -> String,
}

/// The settings of the sensor.
pub const SETTINGS: [GridSetting; 4] = [
    GridSetting {
        name: "alpha",
        file: "alpha",
        axis: "alpha, the saturation factor",
        of: |point| point.alpha,
        text: |value| format!("alpha {value}"),
    },
    GridSetting {
        name: "lens blur",
        file: "psf",
        axis: "standard deviation of the lens blur, px",
        of: |point| point.psf_sigma,
        text: |value| or_no("lens blur", value, " px"),
    },
    GridSetting {
        name: "read noise",
        file: "read",
        axis: "standard deviation of the read noise, code units",
        of: |point| point.read_noise,
        text: |value| or_no("read noise", value, " code units"),
    },
    GridSetting {
        name: "shot noise",
        file: "shot",
        axis: "variance of the shot noise over the signal, code units",
        of: |point| point.shot_noise,
        text: |value| or_no("shot noise", value, " code units"),
    },
];
/// Index of the lens blur in [`SETTINGS`].
const LENS: usize = 1;

/// The values of the [`SETTINGS`] without alpha, which the tables of the paper do not vary.
pub type Conditions = [f64; 3];

/// The stage that simulates the sensor. A real sensor takes no processor time.
pub const SENSE: &str = "sense";

/// The stages of a frame in their order.
pub const STAGES: [&str; 8] = [SENSE, "merge", "unwrap", "tone", "deblur", "pre", "infer", "post"];

/// Label of the image that the detector gets: `recovered (auto, deblurred)`, `saturated`, `row_gains, saturating`,
/// `ideal, sharp`.
pub fn stream(point: &Point) -> String {
    let name = match Mosaic::named(&point.mosaic) {
        None => point.stream.name(),
        Some(mosaic) => format!("{} {}", point.stream.name(), mosaic.word()),
    };
    match &point.method {
        // The style is that of the first known word, and a variant of it by an unknown one.
        Some(method) if point.stream == Stream::Saturated => format!("{method}, saturating"),
        Some(method) if point.deblur => format!("{name} ({method}, deblurred)"),
        Some(method) => format!("{name} ({method})"),
        None if is_sharp_ideal(point) => format!("{name}, sharp"),
        None => name,
    }
}

/// Label of the model and its input size: `yolov10n 640x640`, `yolov10n, input auto`.
pub fn model(point: &Point) -> String {
    // Without the word, the input size `auto` reads as the unwrapping method of this name.
    let word = if point.input == "auto" { ", input" } else { "" };
    format!("{}{word} {}", point.model, point.input)
}

fn or_no(name: &str, value: f64, unit: &str) -> String {
    if value == 0.0 { format!("no {name}") } else { format!("{name} {value}{unit}") }
}

/// The values of the [`SETTINGS`] of a cell.
pub fn settings(point: &Point) -> [f64; SETTINGS.len()] {
    // The sum with 0 removes the sign of a zero.
    SETTINGS.map(|setting| (setting.of)(point) + 0.0)
}

/// Names and values of all settings but `varied`: `lens blur 1.4 px, no read noise, no shot noise`.
pub fn fixed_text(values: &[f64; SETTINGS.len()], varied: usize) -> String {
    let fixed = SETTINGS.iter().zip(values).enumerate().filter(|(index, _)| *index != varied);
    fixed.map(|(_, (setting, value))| (setting.text)(*value)).collect::<Vec<_>>().join(", ")
}

/// The number of points of a grid with the values that they have: `8 cells of ideal, saturated; demo, input auto; alpha 2, 4; ...`.
pub fn grid(points: &[Point]) -> String {
    let list = |of: &dyn Fn(&Point) -> String| distinct(points.iter().map(of)).join(", ");
    let settings = SETTINGS.iter().map(|setting| {
        let mut values = distinct(points.iter().map(setting.of));
        values.sort_by(f64::total_cmp);
        let values: Vec<String> = values.into_iter().map(|value| value.to_string()).collect();
        format!("{} {}", setting.name, values.join(", "))
    });
    let [streams, models, gains] = [list(&stream), list(&model), list(&|point| point.gains.clone())];
    let settings: Vec<String> = settings.collect();
    format!("{} cells of {streams}; {models}; {}; gains {gains}", points.len(), settings.join("; "))
}

/// Names and values of the noises: `no read noise, no shot noise`.
pub fn noises(read_noise: f64, shot_noise: f64) -> String {
    format!("{}, {}", (SETTINGS[2].text)(read_noise), (SETTINGS[3].text)(shot_noise))
}

/// Label of the conditions, as [`fixed_text`] has it.
pub fn conditions([psf_sigma, read_noise, shot_noise]: Conditions) -> String {
    fixed_text(&[0.0, psf_sigma, read_noise, shot_noise], 0)
}

/// The conditions of a cell.
pub fn conditions_of(point: &Point) -> Conditions {
    let [_, psf_sigma, read_noise, shot_noise] = settings(point);
    [psf_sigma, read_noise, shot_noise]
}

/// Whether a cell belongs to these conditions. The ideal image without a lens belongs to all lenses.
pub fn belongs(point: &Point, [psf_sigma, read_noise, shot_noise]: Conditions) -> bool {
    is_at(point, &[0.0, psf_sigma, read_noise, shot_noise], 0)
}

/// Whether a cell has these settings, whatever its value of the setting `varied` is. The ideal image without a lens
/// belongs to all lenses.
pub fn is_at(point: &Point, values: &[f64; SETTINGS.len()], varied: usize) -> bool {
    let own = settings(point);
    let free = |index| index == varied || (index == LENS && is_sharp_ideal(point));
    (0..SETTINGS.len()).all(|index| free(index) || own[index] == values[index])
}

/// All conditions of the cells, in the order of their first appearance.
pub fn all_conditions(cells: &[Cell]) -> Vec<Conditions> {
    distinct(with_lens(cells).iter().map(|cell| conditions_of(&cell.point)))
}

/// The cells without the sharp ideal image, if there are others: as a condition of its own, it would get charts and tables
/// with a single entry.
pub fn with_lens(cells: &[Cell]) -> Vec<&Cell> {
    let found: Vec<&Cell> = cells.iter().filter(|cell| !is_sharp_ideal(&cell.point)).collect();
    if found.is_empty() { cells.iter().collect() } else { found }
}

fn is_sharp_ideal(point: &Point) -> bool {
    point.stream == Stream::Ideal && point.psf_sigma == 0.0
}

/// Label of the accuracy of a group: `AP50 of vehicles, %, 20 frames`.
pub fn ap50(group: &str, frames: &str) -> String {
    let plural = if group.ends_with('s') { "" } else { "s" };
    format!("AP50 of {group}{plural}, %, {frames}")
}

/// The number of frames of cells: `20 frames`, or `10 to 20 frames` if it differs.
pub fn frames(counts: impl Iterator<Item = usize> + Clone) -> String {
    match (counts.clone().min().unwrap_or(0), counts.max().unwrap_or(0)) {
        (1, 1) => "1 frame".to_owned(),
        (least, most) if least == most => format!("{most} frames"),
        (least, most) => format!("{least} to {most} frames"),
    }
}

/// The number of frames on which the times of cells were measured.
pub fn timed_frames(cells: &[&Cell]) -> String {
    frames(cells.iter().filter_map(|cell| cell.frame_ms.as_ref()).map(|time| time.frames))
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
                "measured on a busy machine: the median inference of {} took {} to {} ms in the cells of one pass ({})",
                detector.0,
                number(least, 1),
                number(most, 1),
                detector.1
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

/// A fraction as percent as [`below_100`] has it, with at least one decimal digit; `-` without a value.
pub fn percent(fraction: Option<f64>) -> String {
    fraction.map_or_else(|| "-".to_owned(), |fraction| below_100(fraction, 1))
}
