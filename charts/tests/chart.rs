//! Charts: any data can be drawn, and what is drawn can be told apart.

use modulo_charts::{Axis, Chart, Direction, Look, Panel, Point, Scale, Series, Tone, Unit};

fn axis(scale: Scale) -> Axis {
    Axis { label: "a < b & c".to_owned(), scale, unit: Unit::Plain, direction: Direction::Up }
}

fn chart(panel: Panel) -> Chart {
    Chart { title: String::new(), subtitle: String::new(), footer: String::new(), panels: vec![panel] }
}

#[test]
fn any_text_and_any_number_can_be_drawn() {
    let values = [f64::NAN, f64::INFINITY, -1.0, 0.0, 1e-300, 1e300, 3.0];
    let point = |&value: &f64| Point {
        x: value,
        y: 2.0,
        label: "\u{10ffff}<".to_owned(),
        hover: "1 < 2 & 3".to_owned(),
        ..Point::default()
    };
    let series = vec![Series {
        name: "all".to_owned(),
        points: values.iter().map(point).collect(),
        look: Look::Joined,
    }];
    for scale in [Scale::Log, Scale::Linear { from: -2.0, to: 5.0 }, Scale::Linear { from: 1.0, to: 1.0 }] {
        let panel = Panel { x: axis(scale), y: axis(Scale::Log), series: series.clone() };
        let chart = chart(panel);
        let svg = chart.svg().unwrap();
        assert!(
            svg.contains("a &lt; b &amp; c") && !svg.contains("NaN") && !svg.contains("inf"),
            "{scale:?}"
        );
        assert_eq!(svg.matches("<title>1 &lt; 2 &amp; 3</title>").count(), 5, "one for each finite point");
        assert!(!chart.png().unwrap().is_empty());
    }
}

#[test]
fn a_look_leaves_out_marks_or_line_and_faded_marks_are_grey() {
    let point = |x, tone| Point { x, y: x, tone, ..Point::default() };
    let drawn = |look, tone| {
        let points = vec![point(1.0, tone), point(2.0, tone)];
        let series = vec![Series { name: "one".to_owned(), points, look }];
        let linear = Scale::Linear { from: 0.0, to: 3.0 };
        let svg = chart(Panel { x: axis(linear), y: axis(linear), series }).svg().unwrap();
        let of = |what: &str, colour: &str| {
            svg.lines().filter(|line| line.starts_with(what) && line.contains(colour)).count()
        };
        (of("<polyline", "#0072b2"), of("<polygon", "#0072b2"), of("<polygon", "#bdbdbd"))
    };
    // Each with the legend's own piece.
    assert_eq!(drawn(Look::Joined, Tone::Full), (2, 3, 0));
    assert_eq!(drawn(Look::Marks, Tone::Full), (0, 3, 0));
    assert_eq!(drawn(Look::Line, Tone::Full), (2, 0, 0));
    assert_eq!(drawn(Look::Marks, Tone::Faded), (0, 1, 2));
}
