//! The summary: scenes by methods.

use super::super::case::Family;
use super::super::expect::percent;
use super::super::report::{Report, SceneRow, Trial};
use super::{escape, mark, shade, trust};

pub fn html(report: &Report) -> String {
    let methods = report.scenes.first().map_or(&[][..], |scene| &scene.trials);
    let heads: String = methods
        .iter()
        .map(|trial| format!("<th scope=\"col\">{}</th>", trial.method.replace('_', "<br>")))
        .collect();
    let mut table = format!(
        "{}<div class=\"wide\"><table class=\"summary\"><thead><tr><th>scene</th>{heads}</tr></thead>\n",
        legend()
    );
    for family in Family::ALL {
        let span = methods.len() + 1;
        let rows: String = report.scenes.iter().filter(|scene| scene.family == family).map(row).collect();
        table.push_str(&format!(
            "<tbody><tr class=\"family\"><th colspan=\"{span}\"><span>{}</span></th></tr>\n{rows}</tbody>\n",
            family.title().0
        ));
    }
    table + "</table></div>\n"
}

fn row(scene: &SceneRow) -> String {
    let cells: String = scene.trials.iter().map(cell).collect();
    let twin = if scene.twin.is_some() { " <abbr title=\"unobservable\">\u{2205}</abbr>" } else { "" };
    format!("<tr><th scope=\"row\"><a href=\"#{0}\">{0}</a>{twin}</th>{cells}</tr>\n", scene.name)
}

fn cell(trial: &Trial) -> String {
    format!(
        "<td class=\"{}\" title=\"expected: {}\">{}<sup>{}{}</sup></td>",
        shade(trial.exact),
        escape(&trial.expected),
        percent(trial.exact).trim_end_matches(" %"),
        mark(&trial.verdict),
        trust(trial.trusted),
    )
}

fn legend() -> &'static str {
    "<p class=\"legend\">Share of exact k in per cent: <span class=\"s5\">100</span> <span class=\"s4\">99.9 and more</span> \
     <span class=\"s3\">99 and more</span> <span class=\"s2\">90 and more</span> <span class=\"s1\">50 and more</span> \
     <span class=\"s0\">less</span>. \u{2713} the method vouches for its k, ? it does not; no mark: it makes no \
     claim. \u{2717} worse than expected, \u{25b2} better than expected. \u{2205} unobservable: y is also the \
     image of another, smoother scene.</p>\n"
}
