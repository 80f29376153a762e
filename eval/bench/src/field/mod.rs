//! Charts and page of a comparison of unwrapping methods of any origin, each measured on the same frames and sensors.
//!
//! The Python package measures and writes `results.json`, whose cells this module reads.

mod page;

use std::collections::BTreeMap;

use modulo_draw::{
    Axis, AxisDirection, Chart, ChartBody, ChartPanel, DataPoint, PageWidth, Scale, Series, SeriesStyle,
    Unit, distinct,
};
use serde::Deserialize;

use crate::BenchError;

/// The part of the results of a comparison that the report shows. The other keys are those of `modulo eval`, for its report.
#[derive(Clone, Debug, Deserialize)]
struct File {
    field: FieldResults,
    /// The definition of each figure.
    definitions: BTreeMap<String, String>,
}

/// The results of a comparison.
#[derive(Clone, Debug, Deserialize)]
pub struct FieldResults {
    /// A cell for each method and sensor, in the order of the methods.
    pub cells: Vec<FieldCell>,
    /// The data, the machine and the settings, one sentence each.
    pub facts: Vec<String>,
}

/// One method with one sensor.
#[derive(Clone, Debug, Deserialize)]
pub struct FieldCell {
    /// Name of the method.
    pub method: String,
    /// Name of the sensor, with the parameters that are not the default.
    pub sensor_name: String,
    /// Saturation factor.
    pub alpha: f64,
    /// Blur of the lens, px.
    pub psf_sigma: f64,
    /// Standard deviation of the read noise, codes.
    pub read_noise: f64,
    /// Number of frames.
    pub frames: usize,
    /// Number of frames by the reason for which the method has no result.
    pub failures: BTreeMap<String, usize>,
    /// Share of the samples with the true wrap count, 0 to 1. A frame without a result has none.
    pub exact_k: f64,
    /// The same share after the best offset for each channel of each frame.
    pub up_to_offset: f64,
    /// PSNR of the radiance, dB. `None` if no frame has a result. The next three figures are `None` without a value as well.
    pub psnr_db: Option<f64>,
    /// Mean SSIM.
    pub ssim: Option<f64>,
    /// Share of the frames that the method trusts.
    pub trusted: Option<f64>,
    /// Number of frames that the method trusts although less than 99.9 % of the counts are exact.
    pub trusted_wrong: Option<usize>,
    /// AP at an intersection over union of 0.5 of each class that has an object.
    pub ap50: BTreeMap<String, Option<f64>>,
    /// Time of a call. `None` if no frame has a result.
    pub frame_ms: Option<FieldTime>,
}

/// Time of a call.
#[derive(Clone, Copy, Debug, Deserialize)]
pub struct FieldTime {
    /// Median wall-clock time, ms.
    pub p50: f64,
    /// Median processor time of all threads and child processes, ms.
    pub cpu_ms: f64,
}

/// The page and the charts of a comparison.
pub struct FieldReport {
    /// The page, which needs no other file.
    pub page: String,
    /// Name, SVG and PNG of each chart.
    pub charts: Vec<(&'static str, String, Vec<u8>)>,
}

/// Draws the charts and the page of `results`, the text of a `results.json`.
///
/// # Errors
/// [`BenchError`] for another text, without any cell, or if a chart cannot be drawn.
pub fn report(results: &str) -> Result<FieldReport, BenchError> {
    let File { field: results, definitions } = serde_json::from_str(results)
        .map_err(|why| BenchError::Option(format!("the results of the comparison cannot be read: {why}")))?;
    crate::need("the list of cells", &results.cells)?;
    let mut charts = Vec::new();
    let mut drawings = Vec::new();
    for (name, chart) in all(&results) {
        let wide = chart.svg(PageWidth::Wide)?;
        drawings.push([wide.clone(), chart.svg(PageWidth::Narrow)?]);
        charts.push((name, wide, chart.png()?));
    }
    Ok(FieldReport { page: page::html(&results, &definitions, &drawings), charts })
}

/// A share of exact counts of a cell.
type Share = fn(&FieldCell) -> f64;

/// The quantity that a chart varies: its axis, its name, and its value in a cell.
type Setting = (&'static str, &'static str, fn(&FieldCell) -> f64);

const SETTINGS: [Setting; 3] = [
    ("alpha, the saturation factor", "alpha", |cell| cell.alpha),
    ("lens blur, px", "lens", |cell| cell.psf_sigma),
    ("read noise, codes", "noise", |cell| cell.read_noise),
];

/// All charts with the names of their files.
fn all(results: &FieldResults) -> Vec<(&'static str, Chart)> {
    let mut charts = vec![("frontier", frontier(results))];
    let exact: Share = |cell| cell.exact_k;
    charts.extend(over_settings(results, exact, "no offset is forgiven").map(|chart| ("settings", chart)));
    let forgiven = "one offset for each channel of each frame is forgiven";
    let up_to_offset: Share = |cell| cell.up_to_offset;
    charts
        .extend(over_settings(results, up_to_offset, forgiven).map(|chart| ("settings_up_to_offset", chart)));
    charts
}

/// Accuracy against time, with a point for each alpha.
fn frontier(results: &FieldResults) -> Chart {
    let timed: Vec<&FieldCell> = results.cells.iter().filter(|cell| cell.frame_ms.is_some()).collect();
    let time = |cell: &FieldCell| cell.frame_ms.map_or(f64::NAN, |time| time.p50);
    let points = |height: fn(f64) -> f64| {
        let of = |own: &[&FieldCell], alpha: f64| {
            let (ms, exact) =
                (mean(own.iter().map(|cell| time(cell))), mean(own.iter().map(|cell| cell.exact_k)));
            let hover = format!("{}, alpha {alpha}: {ms:.3} ms, {:.4} % exact", own[0].method, 100.0 * exact);
            DataPoint { x: ms, y: height(exact), label: alpha.to_string(), hover, ..DataPoint::default() }
        };
        series(&timed, |cell| cell.alpha, of)
    };
    let axis = || Axis::log("mean of the median times of a call, ms");
    let downwards =
        Axis { unit: Unit::Percent, direction: AxisDirection::Down, ..Axis::log("wrong wrap counts, %") };
    Chart {
        title: "Accuracy against time".to_owned(),
        subtitle: subtitle(results),
        footer: "Numbers at the points: alpha; each point is the mean over the lenses and the noise. Wrong: another k than the true one, \
                 no offset is forgiven, and a frame without a result counts as wrong. Towards the upper left is better."
            .to_owned(),
        body: ChartBody::Panels(vec![
            ChartPanel { x: axis(), y: Axis::percent("exact wrap counts, %", 1.0), series: points(|exact| exact) },
            ChartPanel { x: axis(), y: downwards, series: points(|exact| 1.0 - exact) },
        ]),
    }
}

/// A share over each setting that has several values. `None` if no setting has.
fn over_settings(results: &FieldResults, share: Share, forgiven: &str) -> Option<Chart> {
    // A method without any result would be a line at 0, and many of them would cover each other.
    let has_result = |cell: &&FieldCell| cell.frame_ms.is_some();
    let answering = methods(results.cells.iter().filter(has_result));
    let cells: Vec<&FieldCell> =
        results.cells.iter().filter(|cell| answering.contains(&cell.method)).collect();
    let varied =
        SETTINGS.iter().filter(|(_, _, value)| distinct(cells.iter().map(|cell| value(cell))).len() > 1);
    let mut panels: Vec<ChartPanel> = varied
        .map(|(label, name, value)| {
            let of = |own: &[&FieldCell], at: f64| {
                let exact = mean(own.iter().map(|cell| share(cell)));
                let hover = format!("{}, {name} {at}: {:.4} % exact", own[0].method, 100.0 * exact);
                DataPoint { x: at, y: exact, hover, ..DataPoint::default() }
            };
            let y = Axis::percent("exact wrap counts, %", 1.0);
            ChartPanel { x: Axis::settings(*label), y, series: series(&cells, value, of) }
        })
        .collect();
    // All panels have the same axis, which begins at a multiple of 20 % below the lowest point.
    let points = panels.iter().flat_map(|panel| &panel.series).flat_map(|series| &series.points);
    let from = points.map(|point| (5.0 * point.y).floor() / 5.0).fold(0.8, f64::min);
    panels.iter_mut().for_each(|panel| panel.y.scale = Scale::Linear { from, to: 1.0 });
    (!panels.is_empty()).then(|| Chart {
        title: format!("Exactness over alpha, lens and noise; {forgiven}"),
        subtitle: subtitle(results),
        footer:
            "Each point is the mean over the other two settings. A frame without a result counts as wrong."
                .to_owned(),
        body: ChartBody::Panels(panels),
    })
}

/// A line for each method, with a point for each value of a setting.
fn series(
    cells: &[&FieldCell],
    value: impl Fn(&FieldCell) -> f64,
    point: impl Fn(&[&FieldCell], f64) -> DataPoint,
) -> Vec<Series> {
    let mut values = distinct(cells.iter().map(|cell| value(cell)));
    values.sort_by(f64::total_cmp);
    let of_method = |method: String| {
        let at = |at: &f64| -> Vec<&FieldCell> {
            cells.iter().filter(|cell| cell.method == method && value(cell) == *at).copied().collect()
        };
        let points = values.iter().map(|v| (at(v), *v)).filter(|(own, _)| !own.is_empty());
        let points = points.map(|(own, at)| point(&own, at)).collect();
        Series { name: method, points, style: SeriesStyle::LineAndMarkers }
    };
    methods(cells.iter().copied()).into_iter().map(of_method).collect()
}

/// The methods in their order.
fn methods<'a>(cells: impl Iterator<Item = &'a FieldCell>) -> Vec<String> {
    distinct(cells.map(|cell| cell.method.clone()))
}

fn subtitle(results: &FieldResults) -> String {
    results.facts.first().cloned().unwrap_or_default()
}

/// The mean; NaN without a value.
fn mean(values: impl Iterator<Item = f64>) -> f64 {
    let (sum, count) = values.fold((0.0, 0.0), |(sum, count), value| (sum + value, count + 1.0));
    sum / count
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cell(method: &str, alpha: f64, exact: f64) -> String {
        format!(
            r#"{{"method": "{method}", "sensor_name": "alpha {alpha}", "alpha": {alpha}, "psf_sigma": 0.0, "read_noise": 0.0,
            "frames": 2, "failures": {{"raised ValueError: <no>": 1}}, "exact_k": {exact}, "up_to_offset": 1.0, "psnr_db": null,
            "ssim": 0.5, "trusted": null, "trusted_wrong": null, "ap50": {{}}, "frame_ms": {{"p50": 3.0, "cpu_ms": 2.0}}}}"#
        )
    }

    #[test]
    fn page_and_charts_name_each_method_and_failure() {
        let cells =
            [cell("mine & more", 2.0, 1.0), cell("mine & more", 4.0, 0.25), cell("auto", 2.0, 0.5)].join(",");
        let text = format!(
            r#"{{"field": {{"cells": [{cells}], "facts": ["2 frames."]}}, "definitions": {{"ssim": "of images"}}}}"#
        );
        let FieldReport { page, charts } = report(&text).expect("results");
        for message in
            ["mine &amp; more", "raised ValueError: &lt;no&gt;", "62.5", "of images", "2 frames.", "<svg"]
        {
            assert!(page.contains(message), "{message}");
        }
        // Only alpha has several values.
        assert_eq!(
            charts.iter().map(|(name, ..)| *name).collect::<Vec<_>>(),
            ["frontier", "settings", "settings_up_to_offset"]
        );
        assert!(charts[1].1.contains("alpha") && !charts[1].1.contains("read noise, codes"));
    }

    #[test]
    fn what_is_no_result_is_refused() {
        let empty = r#"{"field": {"cells": [], "facts": []}, "definitions": {}}"#;
        for (text, message) in
            [("{}", "cannot be read: missing field `field`"), (empty, "the list of cells is empty")]
        {
            assert!(report(text).err().expect("an error").to_string().contains(message), "{text}");
        }
    }
}
