//! Any data can be drawn, and series can be distinguished.

use modulo_draw::{
    Axis, Chart, ChartError, ChartPanel, DataPoint, LabelledBox, PageWidth, Picture, Scale, Series,
    SeriesStyle, number,
};

fn axis(scale: Scale) -> Axis {
    Axis::new(scale, "a < b & c")
}

fn chart(panels: Vec<ChartPanel>) -> Chart {
    Chart { title: String::new(), subtitle: String::new(), footer: String::new(), panels }
}

#[test]
fn any_text_and_any_number_can_be_drawn() {
    let values = [f64::NAN, f64::INFINITY, -1.0, 0.0, 1e-300, 1e300, 3.0];
    let point =
        |&value: &f64| DataPoint { x: value, y: 2.0, hover: "1 < 2 & 3".to_owned(), ..DataPoint::default() };
    let series = vec![Series {
        name: "all".to_owned(),
        points: values.iter().map(point).collect(),
        style: SeriesStyle::LineAndMarkers,
    }];
    for scale in [Scale::Log, Scale::Share] {
        let panel = ChartPanel { x: axis(scale), y: axis(Scale::Log), series: series.clone() };
        let chart = Chart { title: "a \" b".to_owned(), ..chart(vec![panel]) };
        let svg = chart.svg(PageWidth::Wide);
        assert!(
            svg.contains("a &lt; b &amp; c") && !svg.contains("NaN") && !svg.contains("inf"),
            "{scale:?}"
        );
        assert_eq!(svg.matches("<title>1 &lt; 2 &amp; 3</title>").count(), 5, "one for each finite point");
        assert_eq!(svg.matches("class=\"tip\"").count(), 5, "a touch shows what a pointer shows");
        assert!(svg.contains("role=\"img\" aria-label=\"a &quot; b\""), "a chart has a name");
    }
}

#[test]
fn a_look_leaves_out_marks_or_line_and_faded_marks_are_grey() {
    let point = |x, is_faded| DataPoint { x, y: x / 3.0, is_faded, ..DataPoint::default() };
    let drawn = |style, is_faded| {
        let points = vec![point(1.0, is_faded), point(2.0, is_faded)];
        let series = vec![Series { name: "auto".to_owned(), points, style }];
        let panel = ChartPanel { x: axis(Scale::Log), y: axis(Scale::Share), series };
        let svg = chart(vec![panel]).svg(PageWidth::Wide);
        let of = |what: &str, colour: &str| {
            svg.lines().filter(|line| line.starts_with(what) && line.contains(colour)).count()
        };
        (of("<polyline", "#0072b2"), of("<polygon", "#0072b2"), of("<polygon", "#bdbdbd"))
    };
    // Each with the piece of the legend, which is as grey as the points.
    assert_eq!(drawn(SeriesStyle::LineAndMarkers, false), (2, 3, 0));
    assert_eq!(drawn(SeriesStyle::Markers, false), (0, 3, 0));
    assert_eq!(drawn(SeriesStyle::Line, false), (2, 0, 0));
    assert_eq!(drawn(SeriesStyle::Markers, true), (0, 0, 3));
}

/// The SVG of a panel of `series` (name, and y in tenths at the settings 1 and 2) with intervals of +- 1 tenth.
fn over_settings(series: &[(&str, [f64; 2])]) -> String {
    let point = |x, y| DataPoint {
        x,
        y: y / 10.0,
        hover: format!("{y} at {x}"),
        interval: Some([(y - 1.0) / 10.0, (y + 1.0) / 10.0]),
        ..DataPoint::default()
    };
    let series = series.iter().map(|(name, [one, two])| Series {
        name: (*name).to_owned(),
        points: vec![point(1.0, *one), point(2.0, *two)],
        style: SeriesStyle::LineAndMarkers,
    });
    let panel = ChartPanel {
        x: Axis::new(Scale::Settings, "setting"),
        y: axis(Scale::Share),
        series: series.collect(),
    };
    chart(vec![panel]).svg(PageWidth::Wide)
}

/// The lines of `svg` that begin with `element` and hold `part`.
fn lines<'a>(svg: &'a str, element: &'a str, part: &'a str) -> impl Iterator<Item = &'a str> {
    svg.lines().filter(move |line| line.starts_with(element) && line.contains(part))
}

#[test]
fn a_name_has_one_colour_and_marker_in_every_chart() {
    let names =
        ["ideal", "ideal, sharp", "saturated", "modulo", "recovered (auto)", "recovered (auto, deblurred)"];
    // In the legend, the line and the marker of a name come before its text.
    let look = |svg: &str, name: &str| {
        let legend = svg.lines().collect::<Vec<_>>();
        let text = legend.iter().position(|line| line.contains(&format!(">{name}<"))).expect("an entry");
        let (line, marker) = (legend[text - 2], legend[text - 1]);
        let (_, style) = marker.split_once("fill").expect("a marker");
        (line.split_once("fill").expect("a line").1.to_owned(), style.to_owned())
    };
    let all = over_settings(&names.map(|name| (name, [1.0, 2.0])));
    for (index, name) in names.iter().enumerate() {
        let single = over_settings(&[("another series", [1.0, 2.0]), (*name, [3.0, 4.0])]);
        assert_eq!(look(&all, name), look(&single, name), "{name}");
        assert!(names[..index].iter().all(|other| look(&all, other) != look(&all, name)), "{name}");
    }
}

#[test]
fn equal_curves_lie_side_by_side_with_their_intervals() {
    let svg = over_settings(&[("ideal", [5.0, 6.0]), ("auto", [5.0, 6.0]), ("modulo", [5.0, 6.0])]);
    let number = |text: &str| text.split(',').next().and_then(|x| x.parse::<f32>().ok()).expect("a number");
    let leftmost = |line: &str| {
        let corners = line.split('"').nth(1).expect("corners");
        corners.split(' ').map(number).fold(f32::INFINITY, f32::min)
    };
    let mut left: Vec<f32> = lines(&svg, "<polygon", "<title>5 at 1</title>").map(leftmost).collect();
    assert_eq!(left.len(), 3);
    left.sort_by(f32::total_cmp);
    assert!(left.windows(2).all(|pair| pair[1] - pair[0] > 3.0), "{left:?}");
    // For each point a bar and its two caps.
    assert_eq!(lines(&svg, "<polyline", "stroke-width=\"1.1\"").count(), 3 * 2 * 3);
}

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

#[test]
fn no_text_lies_on_another_or_leaves_the_picture() {
    let series = |share: fn(f64) -> f64| {
        let of_method = move |(number, method): (usize, char)| Series {
            name: format!("method_{method}"),
            points: [1.5, 2.0, 3.0, 4.0, 8.0]
                .map(|alpha| DataPoint {
                    x: 20.0 + 3.0 * number as f64 + alpha,
                    y: share(if alpha > 4.0 { 0.1 * number as f64 / 16.0 } else { 0.0 }),
                    ..DataPoint::default()
                })
                .into(),
            style: SeriesStyle::LineAndMarkers,
        };
        ('a'..='p').enumerate().map(of_method).collect()
    };
    let time = || Axis::new(Scale::Log, "median time of a call, ms");
    let panels = vec![
        ChartPanel {
            x: time(),
            y: Axis::new(Scale::Share, "exact wrap counts, %"),
            series: series(|wrong| 1.0 - wrong),
        },
        ChartPanel {
            x: time(),
            y: Axis::new(Scale::Log, "wrong wrap counts"),
            series: series(|wrong| wrong),
        },
    ];
    let named = Chart {
        title: "What is exact, and what it costs".to_owned(),
        subtitle: "20 frames".to_owned(),
        footer: "Towards the upper left is better.".to_owned(),
        panels,
    };
    let svg = named.svg(PageWidth::Wide);
    let found = texts(&svg);
    assert!(found.len() > 2 * 16, "only {} texts", found.len());
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
fn zero_has_no_sign() {
    for (value, digits, text) in [
        (-0.0, 1, "0.0"),
        (-0.04, 1, "0.0"),
        (-0.06, 1, "-0.1"),
        (-0.4, 0, "0"),
        (-1.0, 0, "-1"),
        (0.5, 1, "0.5"),
    ] {
        assert_eq!(number(value, digits), text);
    }
    assert!(number(f64::NEG_INFINITY, 1).starts_with('-'));
}

#[test]
fn a_narrow_page_puts_panels_below_each_other() {
    let panel = || ChartPanel { x: axis(Scale::Log), y: axis(Scale::Log), series: vec![] };
    let chart = chart(vec![panel(), panel()]);
    let height = |page| {
        let svg = chart.svg(page);
        let (_, rest) = svg.split_once(" height=\"").expect("a height");
        rest.split('"').next().unwrap().parse::<f32>().unwrap()
    };
    assert!(height(PageWidth::Narrow) > 1.8 * height(PageWidth::Wide), "{} px", height(PageWidth::Narrow));
}

#[test]
fn pictures_have_their_boxes_and_wrong_sizes_are_refused() {
    assert!(matches!(Picture::new(2, 2, vec![0; 11], vec![]), Err(ChartError::Picture(2, 2, 11))));
    let boxed = LabelledBox { corners: [5.0, 5.0, 20.0, 15.0], colour: [1, 250, 3], label: String::new() };
    let picture = Picture::new(40, 20, [200, 30, 30].repeat(800), vec![boxed]).unwrap();
    let drawn = picture.annotated().unwrap();
    let count = |colour| drawn.pixels().filter(|pixel| pixel.0 == colour).count();
    assert_eq!((count([1, 250, 3]), count([200, 30, 30])), (15 * 10 - 11 * 6, 800 - 17 * 12 + 11 * 6));
    assert!(picture.embedded().unwrap().starts_with("data:image/jpeg;base64,"));
}
