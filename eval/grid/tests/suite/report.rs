//! The report of made-up results: its content, and that it needs no other file.

use std::collections::BTreeMap;

use modulo_eval::results::{Cell, Device, Drawn, FrameTime, Input, Point, Results, Setup};
use modulo_eval::{chart, report};
use modulo_runtime::SensorModel;
use modulo_runtime::report::Percentiles;

fn map<T: Clone>(pairs: &[(&str, T)]) -> BTreeMap<String, T> {
    pairs.iter().map(|(name, value)| ((*name).to_owned(), value.clone())).collect()
}

fn times(pairs: &[(&str, f64)]) -> BTreeMap<String, Percentiles> {
    let spread =
        |&(name, p50): &(&str, f64)| (name.to_owned(), Percentiles { p50, p95: 1.2 * p50, p99: 1.5 * p50 });
    pairs.iter().map(spread).collect()
}

/// A cell whose figures are computed from its settings, so that all cells differ.
fn cell(stream: &str, method: Option<&str>, alpha: f64, model: &str, psf_sigma: f64) -> Cell {
    let loss = match (stream, method) {
        ("ideal", _) => 0.001,
        ("recovered", Some("auto")) => 0.004,
        ("recovered", _) => 0.05,
        ("saturated", _) => 0.07,
        _ => 0.1,
    };
    let infer = if model == "demo" { 9.0 } else { 40.0 };
    let ap50 = (if model == "demo" { 0.6 } else { 0.87 }) - loss * alpha;
    let unwrap = if stream == "recovered" { 12.0 + alpha } else { 0.0 };
    let mut latency_ms = times(&[("sense", 9.0), ("pre", 2.0), ("infer", infer), ("post", 0.1)]);
    if unwrap > 0.0 {
        latency_ms.extend(times(&[("unwrap", unwrap), ("tone", 1.5)]));
    }
    Cell {
        point: Point {
            stream: stream.to_owned(),
            method: method.map(str::to_owned),
            sensor: SensorModel { alpha, psf_sigma, ..SensorModel::default() },
            model: model.to_owned(),
            input: "640x192".to_owned(),
            ..Point::default()
        },
        frames: 20,
        ap50: map(&[("vehicle", Some(ap50)), ("person", Some(ap50 - 0.11))]),
        ap50_95: Some(ap50 - 0.3),
        objects: map(&[("vehicle", 93), ("person", 17)]),
        interval95: map(&[
            ("ap50.vehicle", [ap50 - 0.05, ap50 + 0.04]),
            ("ap50.person", [ap50 - 0.16, ap50 - 0.07]),
        ]),
        exact_k: (stream == "recovered").then_some(1.0 - loss),
        psnr_db: Some(20.0 + 1.0 / loss),
        ssim: Some(1.0 - loss),
        latency_ms,
        frame_ms: Some(FrameTime {
            p50: 2.1 + infer + if unwrap > 0.0 { unwrap + 1.5 } else { 0.0 },
            interval95: [infer + unwrap, infer + unwrap + 4.0],
            cpu_ms: 2.0 * infer,
            frames: 20,
            pass: "host 2026-01-01T00:00:00Z".to_owned(),
        }),
        device: Device { processor: "A processor & more".to_owned(), engine: "rten".to_owned(), threads: 2 },
        ..Cell::default()
    }
}

fn made_up() -> Results {
    let mut cells = Vec::new();
    for model in ["yolov10n", "demo"] {
        for alpha in [1.5, 2.0, 3.0, 4.0, 8.0] {
            cells.push(cell("ideal", None, alpha, model, 0.0));
            for psf in [1.4, 0.8] {
                cells.push(cell("ideal", None, alpha, model, psf));
                cells.push(cell("saturated", None, alpha, model, psf));
                cells.push(cell("modulo", None, alpha, model, psf));
                cells.push(cell("recovered", Some("auto"), alpha, model, psf));
                cells.push(cell("recovered", Some("spud"), alpha, model, psf));
            }
        }
    }
    let setup = Setup {
        source: "a <folder> & \"more\"".to_owned(),
        class_map: map(&[("person", "pedestrian".to_owned())]),
        groups: map(&[("car", "vehicle".to_owned())]),
        models: map(&[("yolov10n", "abc".to_owned()), ("demo", "def".to_owned())]),
        grid: cells.iter().map(|cell| cell.point.clone()).collect(),
        ..Setup::default()
    };
    let input = Input { frames: 20, labelled: 20, drives: 3, ..Input::default() };
    let input = Input { drawn: Some(Drawn::Drives(3)), digest: "123".to_owned(), ..input };
    Results { setup, input, definitions: map(&[("ap50", "AP at <0.5>".to_owned())]), cells, verdict: None }
}

fn page(results: &Results) -> String {
    report::page(results, &chart::all(results), None)
}

/// Checks that every element except `meta` is closed in the right order.
fn well_formed(page: &str) -> Result<(), String> {
    let body = page.strip_prefix("<!DOCTYPE html>").ok_or("no doctype")?;
    let mut open: Vec<&str> = Vec::new();
    for piece in body.split('<').skip(1) {
        let (tag, text) = piece.split_once('>').ok_or_else(|| format!("'{piece}' is not ended"))?;
        let name = tag.split([' ', '/', '\n']).find(|part| !part.is_empty()).unwrap_or_default();
        if tag.starts_with('/') {
            let last = open.pop();
            (last == Some(name)).then_some(()).ok_or_else(|| format!("</{name}> ends {last:?}"))?;
        } else if !tag.ends_with('/') && name != "meta" {
            open.push(name);
        }
        (tag.matches('"').count() % 2 == 0).then_some(()).ok_or_else(|| format!("quotes of <{tag}>"))?;
        for entity in text.split('&').skip(1) {
            let known = ["amp;", "lt;", "gt;", "quot;"].iter().any(|known| entity.starts_with(known));
            (known || open.last() == Some(&"script")).then_some(()).ok_or_else(|| format!("&{entity}"))?;
        }
    }
    if open.is_empty() { Ok(()) } else { Err(format!("never closed: {open:?}")) }
}

/// The rows of the table after a heading.
fn rows<'a>(page: &'a str, heading: &str) -> Vec<&'a str> {
    let (_, rest) = page.split_once(&format!("<h2>{heading}</h2>")).expect("the heading");
    let (table, _) = rest.split_once("</tbody>").expect("a table");
    table.split("<tbody>").nth(1).expect("a body").split("<tr>").skip(1).collect()
}

#[test]
fn intervals_say_what_was_drawn_and_warn_of_few_drives() {
    let message = |drawn, drives| {
        let mut results = made_up();
        (results.input.drawn, results.input.drives) = (drawn, drives);
        page(&results)
    };
    for (drawn, drives, wanted, warned) in [
        (Some(Drawn::Drives(9)), 9, "draws from 9 drives.", Some("come from only 9 drives")),
        (Some(Drawn::Drives(10)), 10, "draws from 10 drives.", None),
        (
            Some(Drawn::Frames(20)),
            1,
            "draws from 20 frames.",
            Some("20 frames, many of them of the same drive"),
        ),
        (Some(Drawn::Frames(20)), 0, "draws from 20 frames.", None),
        (None, 3, "is in brackets.", None),
    ] {
        let page = message(drawn, drives);
        assert!(page.contains(wanted), "{drawn:?}");
        assert_eq!(warned.is_some(), page.contains("at least 10 drives"), "{drawn:?}");
        assert!(warned.is_none_or(|warned| page.contains(warned)), "{drawn:?}");
    }
}

#[test]
fn the_page_is_well_formed_and_needs_no_network() {
    let page = page(&made_up());
    well_formed(&page).expect("well-formed");
    // A namespace is a name, not an address that is asked.
    let addresses = page.replace("http://www.w3.org/2000/svg", "");
    for outside in ["http:", "https:", "src=\"/", "@import", "url(", "<link"] {
        assert!(!addresses.contains(outside), "{outside}");
    }
    assert!(page.contains("a &lt;folder&gt; &amp; &quot;more&quot;") && !page.contains("a <folder>"));
}

#[test]
fn every_cell_is_a_row_with_its_figures() {
    let results = made_up();
    let page = page(&results);
    let rows = rows(&page, "All cells");
    assert_eq!(rows.len(), results.cells.len());
    for (cell, row) in results.cells.iter().zip(rows) {
        let shown = |figure: f64| row.contains(&format!(">{:.1}</td>", 100.0 * figure));
        let vehicle = cell.ap50["vehicle"].expect("a figure");
        assert!(shown(vehicle) && cell.exact_k.is_none_or(shown), "{row}");
        assert!(row.contains(&cell.point.model) && row.contains(">20</td>"), "{row}");
    }
}

#[test]
fn figures_are_there_without_scripts_and_the_script_is_tiny() {
    let page = page(&made_up());
    let (before, script) = page.split_once("<script>").expect("a script");
    assert!(script.len() < 1500, "{} bytes", script.len());
    for expected in ["At a glance", "All cells", "Definitions", "Configuration", "<svg "] {
        assert!(before.contains(expected), "{expected}");
    }
    assert!(!before.contains("onclick"));
}

#[test]
fn a_report_begins_with_its_verdict() {
    let results = Results { verdict: Some("ideal has the highest AP50".to_owned()), ..made_up() };
    let page = page(&results);
    let (before, _) = page.split_once("At a glance").expect("a summary");
    assert!(before.contains("ideal has the highest AP50.<"), "{before}");
}

#[test]
fn charts_name_each_cell_and_grey_what_is_dominated() {
    let svg = svg(&made_up(), "frontier_alpha4_psf1.4_read0");
    let title = "<title>recovered (auto), yolov10n 640x192: 59.6 ms, AP50 of vehicle 85.4 %</title>";
    assert!(svg.contains(title), "{svg}");
    let mark =
        |what: &str| svg.lines().find(|line| line.contains(&format!("<title>{what}"))).expect("a mark");
    let grey = |what: &str| mark(what).contains("#bdbdbd");
    // The saturated image of the demo costs as much as its modulo image, and is better beyond the intervals.
    assert!(grey("modulo, demo") && !grey("saturated, demo"));
    assert!(grey("recovered (spud), yolov10n") && !grey("recovered (auto), yolov10n"));
    assert!(!grey("ideal, yolov10n"), "no choice, and so not dominated");
}

/// The chart of this name as SVG.
fn svg(results: &Results, name: &str) -> String {
    let charts = chart::all(results);
    let names = || charts.iter().map(|named| &named.name).collect::<Vec<_>>();
    let found = charts.iter().find(|named| named.name == name);
    let found = found.unwrap_or_else(|| panic!("{name}: {:?}", names()));
    found.chart.svg(modulo_draw::PageWidth::Wide)
}

/// The fill, edge and text of the entry of a series in the legend of the first chart that has it.
fn entry<'a>(svg: &'a str, name: &str) -> (&'a str, &'a str) {
    let lines: Vec<&str> = svg.lines().collect();
    let text = lines.iter().rposition(|line| line.ends_with(&format!(">{name}</text>"))).expect("an entry");
    let style = |line: &'a str| line.split_once(" fill=").expect("a shape").1;
    (style(lines[text - 2]), style(lines[text - 1]))
}

#[test]
fn a_stream_has_one_colour_in_every_report() {
    let all = made_up();
    let chart = "alpha_yolov10n_640x192_psf1.4_read0";
    let whole = svg(&all, chart);
    let names = ["ideal, sharp", "ideal", "saturated", "modulo", "recovered (auto)", "recovered (spud)"];
    for (index, name) in names.iter().enumerate() {
        let mut part = all.clone();
        let keep = |cell: &Cell| match name.split_once('(') {
            Some((_, method)) => cell.point.method.as_deref() == Some(method.trim_end_matches(')')),
            None => cell.point.stream == name.split(',').next().expect("a stream"),
        };
        part.cells.retain(keep);
        assert_eq!(entry(&whole, name), entry(&svg(&part, chart), name), "{name}");
        let other = if name.contains(',') { chart } else { "psf_yolov10n_640x192_alpha4_read0" };
        assert_eq!(entry(&whole, name), entry(&svg(&all, other), name), "{name}");
        assert!(names[..index].iter().all(|other| entry(&whole, name) != entry(&whole, other)), "{name}");
    }
}

#[test]
fn nothing_that_is_not_whole_reads_as_whole_and_each_figure_has_a_column() {
    let mut results = made_up();
    for cell in results.cells.iter_mut().filter(|cell| cell.exact_k.is_some()) {
        cell.exact_k = Some(1.0 - 3.0 / 1_397_250.0);
        (cell.exact_frames, cell.trusted, cell.trusted_wrong) = (Some(0.95), Some(1.0), Some(1));
        cell.psnr_db = Some(f64::INFINITY);
    }
    let page = page(&results);
    well_formed(&page).expect("well formed");
    for column in ["exact samples", "wholly exact frames", "trusted frames", "trusted but wrong frames"] {
        assert!(page.contains(&format!(">{column}</th>")), "{column}");
    }
    let recovered =
        rows(&page, "All cells").into_iter().find(|row| row.contains("recovered (auto)")).expect("a row");
    for figure in [">99.9998<", ">95.0<", ">100.0<", ">1<"] {
        assert!(recovered.contains(figure), "{figure}: {recovered}");
    }
    let cells = rows(&page, "All cells").concat();
    assert!(cells.contains(">inf<") && cells.contains(r#"data-v="Infinity""#), "{cells}");
    assert!(cells.contains(">99.9998<"), "{cells}");
}

#[test]
fn other_times_of_other_engines_do_not_mean_that_the_machine_was_busy() {
    let page_of = |are_engines: bool| {
        let mut results = made_up();
        for cell in results.cells.iter_mut().step_by(2) {
            cell.latency_ms.get_mut("infer").expect("a time").p50 *= 2.0;
            if are_engines {
                cell.point.more.insert("detector.engine".to_owned(), "openvino".to_owned());
            }
        }
        page(&results)
    };
    assert!(page_of(false).contains("measured on a busy machine"));
    assert!(!page_of(true).contains("measured on a busy machine"));
}

#[test]
fn the_input_size_auto_does_not_read_as_a_method() {
    let mut results = made_up();
    results.cells.iter_mut().for_each(|cell| cell.point.input = "auto".to_owned());
    let page = page(&results);
    assert!(page.contains("yolov10n, input auto") && !page.contains("yolov10n auto"));
    let charts = chart::all(&results);
    assert!(charts.iter().any(|named| named.name == "alpha_yolov10n_input_auto_psf1.4_read0"));
}

/// An infinite PSNR, and a parameter of the sensor that the file does not have, are read; a name or a word that is misspelt is not.
#[test]
fn results_are_read_and_what_is_misspelt_is_named() {
    let folder = tempfile::tempdir().expect("a folder");
    let mut results = made_up();
    results.cells.truncate(2);
    results.cells[0].psnr_db = Some(f64::INFINITY);
    results.cells[0].point.sensor.read_noise = 2.5;
    modulo_eval::store::save(folder.path(), &results).expect("written");
    let file = folder.path().join("results.json");
    let loaded = || modulo_eval::store::read::<Results>(&file);
    assert_eq!(loaded().expect("readable").expect("there").cells, results.cells);
    let text = std::fs::read_to_string(&file).expect("text");
    assert!(text.contains(r#""psnr_db": "inf""#) && text.contains(r#""read_noise": 2.5"#), "{text}");
    std::fs::write(&file, text.replace("\"prnu\": 0.0,", "")).expect("written");
    assert_eq!(loaded().expect("readable").expect("there").cells, results.cells);
    for (word, misspelt, named) in [
        (
            r#""gains": "none""#,
            r#""gains": "chekerboard""#,
            ["'gains' = 'chekerboard'", "none, checkerboard"],
        ),
        (r#""mosaic": "none""#, r#""mosaic": "rgbb""#, ["'mosaic' = 'rgbb'", "rggb"]),
        (r#""read_noise": 2.5"#, r#""read_noise": -1"#, ["'read_noise' = -1", "0 to 65536"]),
        (r#""read_noise""#, r#""raed_noise""#, ["unknown parameter", "did you mean 'read_noise'?"]),
    ] {
        std::fs::write(&file, text.replace(word, misspelt)).expect("written");
        let why = loaded().expect_err(misspelt).to_string();
        assert!(why.contains("results.json") && named.iter().all(|text| why.contains(text)), "{why}");
    }
}

#[test]
fn charts_have_words_units_counts_and_intervals() {
    let mut results = made_up();
    let noisy = results.cells.iter().find(|cell| cell.point.sensor.psf_sigma == 1.4).cloned();
    for read_noise in [0.0, 1.0, 2.0] {
        let mut cell = noisy.clone().expect("a cell");
        (cell.point.sensor.read_noise, cell.point.sensor.shot_noise) = (read_noise, 0.5);
        results.cells.push(cell);
    }
    for (name, texts) in [
        (
            "alpha_yolov10n_640x192_psf1.4_read0",
            &[
                "AP50 of vehicles, %, 20 frames",
                "AP50 of persons, %, 20 frames",
                "alpha, the saturation factor",
                ">1.5</text>",
            ][..],
        ),
        ("psf_yolov10n_640x192_alpha4_read0", &["lens blur, px", ">0.8</text>"]),
        (
            "read_yolov10n_640x192_alpha1.5_psf1.4_shot0.5",
            &["read noise, code units", "lens blur 1.4 px, shot noise 0.5 code units"],
        ),
    ] {
        let svg = svg(&results, name);
        assert!(texts.iter().all(|text| svg.contains(text)), "{texts:?}: {svg}");
    }
    // Two panels, six streams, five alphas, and a bar with two caps for each.
    let alpha = svg(&results, "alpha_yolov10n_640x192_psf1.4_read0");
    assert_eq!(alpha.matches("stroke-width=\"1.1\"").count(), 2 * 6 * 5 * 3);
    let single = "shot_yolov10n_640x192_alpha1.5_psf1.4_read2";
    assert!(!chart::all(&results).iter().any(|named| named.name.starts_with(single)));
}

#[test]
fn a_series_without_a_choice_is_grey_in_the_legend() {
    let mut results = made_up();
    results.cells.retain(|cell| cell.point.model == "yolov10n");
    let svg = svg(&results, "frontier_alpha4_psf1.4_read0");
    assert!(entry(&svg, "recovered (spud)").1.contains("#bdbdbd"), "dominated");
    assert!(!entry(&svg, "recovered (auto)").1.contains("#bdbdbd"));
}

#[test]
fn zero_has_no_sign_anywhere() {
    let mut results = made_up();
    for cell in &mut results.cells {
        (cell.ap50_95, cell.psnr_db, cell.exact_k) = (Some(-0.0), Some(-0.0), Some(-0.0));
        (cell.ap50_95, cell.point.sensor.read_noise) = (Some(-0.0), -0.0);
        cell.ap50.values_mut().for_each(|ap50| *ap50 = Some(-0.0));
        cell.interval95.values_mut().for_each(|bounds| *bounds = [-0.0, -0.0001]);
        cell.latency_ms.values_mut().for_each(|time| time.p50 = -0.0);
    }
    let text = page(&results);
    let signed = [">-0.0", " -0.0", "(-0.0", ">-0<", "\"-0\""].map(|zero| text.find(zero));
    let shown = signed.iter().flatten().map(|at| &text[at.saturating_sub(60)..at + 20]).collect::<Vec<_>>();
    assert!(shown.is_empty(), "{shown:?}");
}

#[test]
fn a_part_of_a_grid_says_so_and_an_empty_one_is_still_a_page() {
    let mut results = made_up();
    results.cells.truncate(7);
    assert!(page(&results).contains("7 of 110 cells are here"));
    results.cells.iter_mut().for_each(|cell| (cell.frame_ms, cell.device) = Default::default());
    assert!(!page(&results).contains("0 threads"), "nothing was timed");
    results.cells.clear();
    well_formed(&page(&results)).expect("well-formed");
}
