//! Labels of cells in tables and charts, and the time of a frame.

pub use modulo_draw::{below_100, distinct, number};

use modulo_core::Mosaic;
use modulo_draw::ascending;
use modulo_runtime::{Descriptor, ParameterSet as _, SensorModel, Value};

use crate::results::{Cell, Device, Point};

/// The parameters of the sensor that are named even where they have their default.
const ALWAYS: [&str; 3] = ["alpha", "psf_sigma", "read_noise"];
/// The parameters that the label of a stream names.
const OF_STREAM: [&str; 7] =
    ["gains", "gain_ratio", "mosaic", "metering", "metering_target", "exposure_delay", "exposure_step"];

/// A number among the parameters of the sensor, which charts vary or name.
#[derive(Clone, Copy, PartialEq)]
pub struct GridSetting(pub &'static str);

impl GridSetting {
    pub fn all() -> impl Iterator<Item = Self> {
        let is_number = |p: &Descriptor| matches!(p.default, Value::Double(_) | Value::Integer(_));
        let numbers = SensorModel::descriptors().into_iter().filter(is_number);
        numbers.map(|parameter| Self(parameter.name)).filter(|setting| !OF_STREAM.contains(&setting.0))
    }

    /// Those that tables of `cells` show.
    pub fn columns(cells: &[Cell]) -> Vec<Self> {
        let plain = Point::default();
        let differs = |setting: &Self| cells.iter().any(|cell| setting.of(&cell.point) != setting.of(&plain));
        Self::all().filter(|setting| ALWAYS.contains(&setting.0) || differs(setting)).collect()
    }

    /// Its value in a cell.
    pub fn of(self, point: &Point) -> f64 {
        let value = point.sensor.declared().into_iter().find(|(parameter, _)| parameter.name == self.0);
        match value.map(|(_, value)| value) {
            // The sum with 0 removes the sign of a zero.
            Some(Value::Double(value)) => value + 0.0,
            Some(Value::Integer(value)) => value as f64,
            _ => 0.0,
        }
    }

    /// The other parameters of the sensor, but for those that the label of the stream names.
    pub fn others(self, point: &Point) -> SensorModel {
        point.sensor.reset(&[&OF_STREAM[..], &[self.0]].concat())
    }

    /// Name in titles.
    pub fn name(self) -> String {
        words(self.0).0
    }

    /// Name in the names of files.
    pub fn file(self) -> &'static str {
        // `psf_sigma` is the blur of the lens, whose file is `psf`.
        self.0.split('_').next().unwrap_or(self.0)
    }

    pub fn axis(self) -> String {
        if self.0 == "alpha" { ALPHA.to_owned() } else { self.column() }
    }

    pub fn column(self) -> String {
        let (name, unit) = words(self.0);
        if unit.is_empty() { name } else { format!("{name},{unit}") }
    }

    /// Name and value, such as `lens blur 1.4 px`.
    pub fn text(self, value: f64) -> String {
        text(self.0, &Value::Double(value))
    }
}

/// The name of a parameter in titles, and its unit.
fn words(parameter: &str) -> (String, &'static str) {
    match parameter {
        "psf_sigma" => ("lens blur".to_owned(), " px"),
        noise if noise.ends_with("_noise") => (noise.replace('_', " "), " code units"),
        name => (name.replace('_', " "), ""),
    }
}

/// Name and value of a parameter, such as `lens blur 1.4 px`, `no read noise`, `mosaic rggb`.
fn text(parameter: &str, value: &Value) -> String {
    let (name, unit) = words(parameter);
    match value {
        Value::Double(0.0) => format!("no {name}"),
        value => format!("{name} {}{unit}", value.plain()),
    }
}

/// The label of the axis of alpha.
pub const ALPHA: &str = "alpha, the saturation factor";

/// The stage that simulates the sensor. A real sensor takes no processor time.
pub const SENSE: &str = "sense";

/// The stages of a frame in their order.
pub const STAGES: [&str; 7] = [SENSE, "unwrap", "tone", "deblur", "pre", "infer", "post"];

/// Label of the image that the detector gets: `recovered (auto, deblurred)`, `saturated`, `checkerboard_gains, saturating`,
/// `ideal, sharp`.
pub fn stream(point: &Point) -> String {
    let mosaic = point.sensor.mosaic.map(Mosaic::word);
    let name = [Some(point.stream.as_str()), mosaic].into_iter().flatten().collect::<Vec<_>>().join(" ");
    let deblurred = point.deblur.then(|| "deblurred".to_owned());
    let details: Vec<String> = point
        .method
        .iter()
        .cloned()
        .chain(deblurred)
        .chain(exposure_control(point))
        .chain(more(point))
        .collect();
    match &point.method {
        // The style is that of the first known word, and a variant of it by an unknown one.
        Some(method) if point.is("saturated") => format!("{method}, saturating"),
        None if point.is_sharp_ideal() => format!("{name}, sharp"),
        _ if details.is_empty() => name,
        _ => format!("{name} ({})", details.join(", ")),
    }
}

/// The other parameters that differ from their defaults.
fn more(point: &Point) -> impl Iterator<Item = String> {
    point.more.iter().map(|(name, value)| format!("{name} {value}"))
}

/// The values of the exposure control of a metered image that differ from their defaults.
fn exposure_control(point: &Point) -> Vec<String> {
    if !["metered", "auto_exposed"].contains(&point.stream.as_str()) {
        return Vec::new();
    }
    let SensorModel { metering, metering_target, exposure_delay, exposure_step, .. } = point.sensor;
    let plain = SensorModel::default();
    let control = SensorModel { metering, metering_target, exposure_delay, exposure_step, ..plain };
    named(&control, &ALWAYS, text)
}

/// Label of the model and its input size: `yolov10n 640x640`, `yolov10n, input auto`.
pub fn model(point: &Point) -> String {
    // Without the word, the input size `auto` reads as the unwrapping method of this name.
    let word = if point.input == "auto" { ", input" } else { "" };
    format!("{}{word} {}", point.model, point.input)
}

/// Names and values of the parameters that `with` takes, without those that have their default and need not be named.
fn named(sensor: &SensorModel, without: &[&str], with: fn(&'static str, &Value) -> String) -> Vec<String> {
    let named = sensor.declared().into_iter().filter(|(parameter, value)| {
        let differs = ALWAYS.contains(&parameter.name) || *value != parameter.default;
        differs && !without.contains(&parameter.name)
    });
    named.map(|(parameter, value)| with(parameter.name, &value)).collect()
}

/// Names and values of the parameters of a sensor but those of `without`: `lens blur 1.4 px, no read noise`.
pub fn sensor(sensor: &SensorModel, without: &[&str]) -> String {
    named(sensor, without, text).join(", ")
}

/// The same as part of a file name: `psf1.4_read0`.
pub fn suffix(sensor: &SensorModel, without: &[&str]) -> String {
    named(sensor, without, |parameter, value| format!("{}{}", GridSetting(parameter).file(), value.plain()))
        .join("_")
}

pub fn conditions(conditions: &SensorModel) -> String {
    sensor(conditions, &["alpha"])
}

/// The conditions of a cell: its sensor without alpha, which the tables of the paper do not vary, and without the gains and the
/// mosaic, which the label of the stream names.
pub fn conditions_of(point: &Point) -> SensorModel {
    GridSetting("alpha").others(point)
}

pub fn belongs(point: &Point, conditions: &SensorModel) -> bool {
    is_at(point, conditions_of(point), conditions)
}

/// Whether `own`, parameters of the sensor of a cell, are `wanted`. The ideal image without a lens belongs to all lenses.
pub fn is_at(point: &Point, own: SensorModel, wanted: &SensorModel) -> bool {
    let psf_sigma = if point.is_sharp_ideal() { wanted.psf_sigma } else { own.psf_sigma };
    SensorModel { psf_sigma, ..own } == *wanted
}

/// All conditions of the cells, in the order of their first appearance.
pub fn all_conditions(cells: &[Cell]) -> Vec<SensorModel> {
    distinct(with_lens(cells).iter().map(|cell| conditions_of(&cell.point)))
}

/// The cells without the sharp ideal image, if there are others: as a condition of its own, it would get charts and tables
/// with a single entry.
pub fn with_lens(cells: &[Cell]) -> Vec<&Cell> {
    let found: Vec<&Cell> = cells.iter().filter(|cell| !cell.point.is_sharp_ideal()).collect();
    if found.is_empty() { cells.iter().collect() } else { found }
}

/// Label of the accuracy of a group in cells: `AP50 of vehicles, %, 20 frames`.
pub fn ap50(group: &str, cells: &[&Cell]) -> String {
    let plural = if group.ends_with('s') { "" } else { "s" };
    format!("AP50 of {group}{plural}, %, {}", frames(cells, |cell| Some(cell.frames)))
}

/// The bounds of an interval of fractions, in percent: `12.3 to 45.6`.
pub fn bounds(interval: [f64; 2]) -> String {
    interval.map(|bound| number(100.0 * bound, 1)).join(" to ")
}

/// The number of frames of cells, as `count` gives it: `20 frames`, or `10 to 20 frames` if it differs.
pub fn frames(cells: &[&Cell], count: impl Fn(&Cell) -> Option<usize>) -> String {
    let counts = || cells.iter().filter_map(|cell| count(cell));
    match (counts().min().unwrap_or(0), counts().max().unwrap_or(0)) {
        (1, 1) => "1 frame".to_owned(),
        (least, most) if least == most => format!("{most} frames"),
        (least, most) => format!("{least} to {most} frames"),
    }
}

/// The engines and machines with which times were measured: `ort on Xeon, 4 threads an inference`.
pub fn devices(cells: &[Cell]) -> Vec<String> {
    let timed = cells.iter().filter(|cell| cell.frame_ms.is_some());
    distinct(timed.map(|Cell { device: Device { engine, processor, threads }, .. }| {
        let plural = if *threads == 1 { "" } else { "s" };
        format!("{engine} on {processor}, {threads} thread{plural} an inference")
    }))
}

/// Median time from the captured image to the boxes, ms. `None` if it was not measured.
pub fn frame_ms(cell: &Cell) -> Option<f64> {
    cell.frame_ms.as_ref().map(|time| time.p50)
}

/// One line for each detector and pass in which the machine was busy: the medians of its inference, which is the same
/// in all cells, are more than 10 % apart.
pub fn busy(cells: &[Cell]) -> Vec<String> {
    let detector = |point: &Point| {
        let own = more(point).filter(|setting| setting.starts_with("detector."));
        std::iter::once(model(point)).chain(own).collect::<Vec<_>>().join(", ")
    };
    let timed = |cell: &Cell| {
        let infer = cell.latency_ms.get("infer")?.p50;
        Some(((detector(&cell.point), cell.frame_ms.as_ref()?.pass.clone()), infer))
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

/// The saturation factors of cells, in ascending order.
pub fn alphas(cells: &[&Cell]) -> Vec<f64> {
    ascending(cells.iter().map(|cell| cell.point.sensor.alpha))
}

/// A fraction as percent as [`below_100`] has it, with at least one decimal digit; `-` without a value.
pub fn percent(fraction: Option<f64>) -> String {
    fraction.map_or_else(|| "-".to_owned(), |fraction| below_100(fraction, 1))
}
