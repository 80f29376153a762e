//! The report of an evaluation of a launch file: the verdict, a picture, and the scores.

use std::collections::BTreeMap;

use maud::{Markup, html};
use modulo_draw::{html_page, number};

use super::{Evaluation, GRID, StreamResult, StreamScore};
use crate::labels;
use crate::report::tables::{Td, table};

/// The whole page of the `results`, beside which [`GRID`] shows the frame `pictured`.
pub fn page(
    evaluation: &Evaluation,
    pictured: Option<u64>,
    results: &BTreeMap<&str, StreamResult>,
    stopped: bool,
) -> String {
    let title = format!("modulo eval: {} frames", evaluation.frames());
    let body = html! {
        h1 { (title) }
        @if stopped { p.warning { "The run was stopped by a signal: these are the results of the frames before it." } }
        @for verdict in evaluation.verdicts(results) { p { strong { (verdict) "." } } }
        @if let Some(number) = pictured {
            figure {
                img src=(GRID) alt="the images of all streams with their boxes";
                figcaption.note { "Frame " (number) ", in which the numbers of the boxes of the streams differ most." }
            }
        }
        (scores(evaluation, results))
    };
    html_page(&title, include_str!("../report/style.css"), body)
}

fn scores(evaluation: &Evaluation, results: &BTreeMap<&str, StreamResult>) -> Markup {
    let head = ["stream", "AP50 %", "95 % interval", "objects", "classes", "notes"];
    let row = |(stream, result): (&&str, &StreamResult)| {
        let mut row = vec![Td::Text((*stream).to_owned())];
        match result.score() {
            Ok(score) => row.extend(scored(score)),
            Err(why) => {
                row.extend([Td::number(None, 1), Td::Text("-".to_owned()), Td::number(None, 0)]);
                row.extend(["-", why].map(|text| Td::Text(text.to_owned())));
            }
        }
        row
    };
    let difficulty = evaluation.difficulty;
    html! {
        h2 { "Scores" }
        p.note {
            "AP50 is the mean over the classes, of " (difficulty) " objects. The interval is that of a bootstrap over the frames, or over the \
            sources where there are several. Boxes are in STREAM.json, and these figures in scores.json, beside this page."
        }
        (table(&head, &results.iter().map(row).collect::<Vec<_>>()))
    }
}

/// The columns of a stream with scores, behind its name.
fn scored(score: &StreamScore) -> Vec<Td> {
    let percent = |figure: f64| number(100.0 * figure, 1);
    let interval = score.interval95.map_or_else(|| "-".to_owned(), labels::bounds);
    let classes = score.classes.iter().map(|(class, (ap, n))| format!("{class} {} ({n})", percent(*ap)));
    vec![
        Td::percent(Some(score.ap50)),
        Td::Text(interval),
        Td::Number(score.objects().to_string(), Some(score.objects() as f64)),
        Td::Text(classes.collect::<Vec<_>>().join(", ")),
        Td::Text(score.notes().join("; ")),
    ]
}
