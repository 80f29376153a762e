//! The chart of accuracy against time.

use std::path::{Path, PathBuf};

use modulo_draw::{
    Axis, AxisDirection, Chart, ChartBody, ChartPanel, DataPoint, PageWidth, Series, SeriesStyle, Unit,
    distinct,
};

use crate::benchmark::{BenchmarkRow, META, Meta};
use crate::{BenchError, read_json, write};

/// Draws the chart of a file of results as `frontier.svg` and `frontier.png` beside it. Returns their paths.
///
/// # Errors
/// [`BenchError`] if the file cannot be read or the charts cannot be written.
pub fn draw_frontier(results: &Path) -> Result<[PathBuf; 2], BenchError> {
    let chart = frontier_from(results)?;
    let files = ["frontier.svg", "frontier.png"].map(|name| results.with_file_name(name));
    write(&files[0], chart.svg(PageWidth::Wide)?.as_bytes())?;
    write(&files[1], &chart.png()?)?;
    Ok(files)
}

/// The chart of the file `results` (a list of [`BenchmarkRow`]) and of the file [`META`] beside it, if there is one.
///
/// # Errors
/// [`BenchError`] if a file cannot be read or there is no row.
pub fn frontier_from(results: &Path) -> Result<Chart, BenchError> {
    let rows: Vec<BenchmarkRow> = read_json(results)?;
    crate::need("the list of results", &rows)?;
    let meta = results.with_file_name(META);
    let meta: Option<Meta> = if meta.exists() { Some(read_json(&meta)?) } else { None };
    let exact = series(&rows, |row| row.exact_k);
    let wrong = series(&rows, |row| 1.0 - row.exact_k);
    let frames = frames(&rows);
    let time = || Axis::log(format!("median time of a call, ms, {frames}"));
    // Two panels show the same data: near 100 %, only the logarithm of the errors separates the methods, and where half
    // of the counts are wrong, only the linear axis does. The second axis is reversed, so that up is better in both.
    let downwards = Axis {
        unit: Unit::Percent,
        direction: AxisDirection::Down,
        ..Axis::log(format!("wrong wrap counts, %, {frames}"))
    };
    Ok(Chart {
        title: "Unwrapping: what is exact, and what it costs".to_owned(),
        subtitle: subtitle(&rows, meta.as_ref()),
        footer: footer(&rows, meta.as_ref()),
        body: ChartBody::Panels(vec![
            ChartPanel {
                x: time(),
                y: Axis::percent(format!("exact wrap counts, %, {frames}"), 1.0),
                series: exact,
            },
            ChartPanel { x: time(), y: downwards, series: wrong },
        ]),
    })
}

/// A line over alpha for each method, number of threads and blur.
fn series(rows: &[BenchmarkRow], value: impl Fn(&BenchmarkRow) -> f64) -> Vec<Series> {
    // The line joins the points by alpha. The series keep the order of the file.
    let mut sorted: Vec<&BenchmarkRow> = rows.iter().collect();
    sorted.sort_by(|a, b| a.alpha.total_cmp(&b.alpha));
    let mut series: Vec<Series> = Vec::new();
    for row in rows {
        let name = name(row, rows);
        if series.iter().any(|s| s.name == name) {
            continue;
        }
        let own = sorted.iter().filter(|r| (&r.method, r.threads) == (&row.method, row.threads));
        let own = own.filter(|r| r.psf_sigma == row.psf_sigma);
        let point = |r: &&BenchmarkRow| DataPoint {
            x: r.ms_p50,
            y: value(r),
            label: r.alpha.to_string(),
            hover: format!("{name}, alpha {}: {:.3} ms, {:.4} % exact", r.alpha, r.ms_p50, 100.0 * r.exact_k),
            ..DataPoint::default()
        };
        series.push(Series { points: own.map(point).collect(), style: SeriesStyle::LineAndMarkers, name });
    }
    series
}

/// The name of a line: the method, with threads and blur if they differ between rows.
fn name(row: &BenchmarkRow, rows: &[BenchmarkRow]) -> String {
    let mut name = row.method.clone();
    if distinct(rows.iter().map(|r| r.threads)).len() > 1 {
        name += &format!(", {}", threads(row.threads));
    }
    if distinct(rows.iter().map(|r| r.psf_sigma)).len() > 1 {
        name += &format!(", blur {} px", row.psf_sigma);
    }
    name
}

/// The number of frames, such as `20 frames`.
fn frames(rows: &[BenchmarkRow]) -> String {
    let counts = distinct(rows.iter().map(|row| row.frames.to_string()));
    let unit = if counts == ["1"] { "frame" } else { "frames" };
    format!("{} {unit}", counts.join(" or "))
}

fn subtitle(rows: &[BenchmarkRow], meta: Option<&Meta>) -> String {
    let mut parts = vec![frames(rows)];
    let counts = distinct(rows.iter().map(|row| row.threads.to_string()));
    let blurs = distinct(rows.iter().map(|row| row.psf_sigma.to_string()));
    let lens = format!("lens blur of sigma {} px", blurs.join(", "));
    let used = match rows {
        [row, ..] if counts.len() == 1 => threads(row.threads),
        _ => format!("{} threads", counts.join(", ")),
    };
    match meta {
        None => parts.extend([lens, used]),
        // The file of a peer program may have no description beside it: only the rows are known then.
        Some(meta) => {
            parts[0] += &format!(" of {}", sizes(meta));
            let kernel = if meta.psf == "paper7" { " (the paper's 7 taps)" } else { "" };
            parts.extend([format!("{lens}{kernel}"), format!("{} bits", meta.bits)]);
            parts.extend((meta.read_noise > 0.0).then(|| format!("read noise of sigma {}", meta.read_noise)));
            parts.extend([used, format!("{} ({} processors)", meta.device, meta.processors)]);
        }
    }
    parts.join(" · ")
}

fn sizes(meta: &Meta) -> String {
    let size = |s: &crate::benchmark::Size| format!("{} x {} x {}", s.width, s.height, s.channels);
    match meta.sizes.as_slice() {
        [] => "no size".to_owned(),
        [one] => format!("{} px", size(one)),
        [first, ..] => format!("mostly {} px", size(first)),
    }
}

fn footer(rows: &[BenchmarkRow], meta: Option<&Meta>) -> String {
    let samples = rows.iter().filter_map(|row| row.samples).max();
    let zero = match samples {
        Some(samples) => format!("0 %: not one of {samples} samples"),
        None => "0 %: not one sample".to_owned(),
    };
    let calls = match meta {
        Some(meta) => format!("median over frames and {} calls each after a warm one", meta.repeats),
        None => "median over frames and calls".to_owned(),
    };
    let version = meta.map_or_else(String::new, |meta| format!(" modulo {}.", meta.version));
    format!(
        "Numbers at the points: alpha, the saturation factor. Wrong: another k than the true one, all channels \
         counted, no shift forgiven; {zero}. Time: wall clock of one call, {calls}. Towards the upper left is \
         better.{version}"
    )
}

fn threads(count: usize) -> String {
    if count == 1 { "1 thread".to_owned() } else { format!("{count} threads") }
}
