//! The chart of accuracy against time: its content, and that all labels are readable.

use std::path::Path;

use modulo_bench::BenchError;
use modulo_bench::benchmark::Row;
use modulo_bench::frontier::{draw_frontier, frontier_from};
use modulo_charts::PageWidth;
use modulo_images::decode;

/// Text and left, top, right, bottom of each horizontal text of an SVG.
fn texts(svg: &str) -> Vec<(String, [f64; 4])> {
    let attribute = |line: &str, name: &str| -> String {
        let (_, rest) = line.split_once(&format!(" {name}=\"")).unwrap_or_else(|| panic!("{name}: {line}"));
        rest.split('"').next().unwrap_or_default().to_owned()
    };
    let number = |line: &str, name: &str| attribute(line, name).parse::<f64>().expect("a number");
    let level = |line: &&str| line.starts_with("<text") && !line.contains("rotate");
    let area = |line: &str| {
        let (x, y, size) = (number(line, "x"), number(line, "y"), number(line, "font-size"));
        let width = number(line, "textLength");
        let left = match attribute(line, "text-anchor").as_str() {
            "start" => x,
            "middle" => x - width / 2.0,
            _ => x - width,
        };
        // Capitals and digits of the font are 0.73 of its size high.
        let text = line.split('>').nth(1).and_then(|rest| rest.split('<').next()).unwrap_or_default();
        (text.to_owned(), [left, y - 0.73 * size, left + width, y])
    };
    svg.lines().filter(level).map(area).collect()
}

/// Rows of many methods with equal times and accuracies, which are hard to label.
fn crowded() -> Vec<Row> {
    let mut rows = Vec::new();
    for (number, method) in ('a'..='p').enumerate() {
        for alpha in [1.5, 2.0, 3.0, 4.0, 8.0] {
            let wrong = if alpha > 4.0 { 0.1 * number as f64 / 16.0 } else { 0.0 };
            rows.push(Row {
                method: format!("method_{method}"),
                alpha,
                psf_sigma: 1.4,
                threads: 1,
                ms_p50: 20.0 + 3.0 * number as f64 + alpha,
                ms_p5: None,
                ms_p95: None,
                exact_k: 1.0 - wrong,
                psnr_db: None,
                frames: 20,
                samples: None,
            });
        }
    }
    rows
}

fn store(folder: &Path, rows: &[Row]) -> std::path::PathBuf {
    let path = folder.join("results.json");
    std::fs::write(&path, serde_json::to_vec(rows).expect("rows are JSON")).expect("a writable folder");
    path
}

#[test]
fn no_text_lies_on_another_or_leaves_the_picture() {
    let folder = tempfile::tempdir().unwrap();
    let svg = frontier_from(&store(folder.path(), &crowded())).unwrap().svg(PageWidth::Wide).unwrap();
    let found = texts(&svg);
    assert!(found.len() > 16 + 16 * 2, "only {} texts", found.len());
    for (i, (text, a)) in found.iter().enumerate() {
        assert!(a[0] >= 0.0 && a[1] >= 0.0 && a[2] <= 1200.0, "{text} at {a:?}");
        for (other, b) in &found[..i] {
            let apart = a[0] >= b[2] || b[0] >= a[2] || a[1] >= b[3] || b[1] >= a[3];
            assert!(apart, "{text:?} at {a:?} lies on {other:?} at {b:?}");
        }
    }
    for letter in 'a'..='p' {
        assert_eq!(svg.matches(&format!(">method_{letter}<")).count(), 1);
    }
}

#[test]
fn both_pictures_are_written_and_the_same_each_time() {
    let folder = tempfile::tempdir().unwrap();
    let results = store(folder.path(), &crowded());
    let [svg, png] = draw_frontier(&results).unwrap();
    let first = (std::fs::read(&svg).unwrap(), std::fs::read(&png).unwrap());
    draw_frontier(&results).unwrap();
    assert!(first == (std::fs::read(&svg).unwrap(), std::fs::read(&png).unwrap()));
    let picture = decode(std::io::Cursor::new(first.1), "frontier").unwrap();
    assert_eq!((picture.width(), picture.channels()), (2400, 3));
    let inked = picture.to_f32().iter().filter(|value| **value < 128.0).count();
    assert!(inked > 20_000, "{inked} dark samples");
}

#[test]
fn results_that_are_none_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("results.json");
    assert!(matches!(frontier_from(&path), Err(BenchError::Io { .. })));
    std::fs::write(&path, "[{\"method\": \"x\"}]").unwrap();
    let why = frontier_from(&path).unwrap_err().to_string();
    assert!(why.contains("results.json") && why.contains("alpha"), "{why}");
    std::fs::write(&path, "[]").unwrap();
    assert!(matches!(frontier_from(&path), Err(BenchError::Empty { .. })));
}
