//! `index.html`: one page without script or network, for screen, phone and paper.

mod scene;
mod table;

use super::case::Family;
use super::report::{Report, Verdict};

const STYLE: &str = include_str!("style.css");

/// The page of `report`; pictures are linked as the trials name them.
pub fn html(report: &Report) -> String {
    let mut page = format!(
        "<!doctype html>\n<html lang=\"en\"><head><meta charset=\"utf-8\">\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\
         <title>Stability of the unwrapping methods</title>\n<style>\n{STYLE}</style></head>\n<body>\n"
    );
    page.push_str(&head(report));
    page.push_str(&table::html(report));
    for family in Family::ALL {
        let (title, sentence) = family.title();
        page.push_str(&format!("<section><h2>{title}</h2>\n<p>{sentence}</p>\n"));
        let scenes = report.scenes.iter().filter(|scene| scene.family == family);
        scenes.for_each(|scene| page.push_str(&scene::html(scene)));
        page.push_str("</section>\n");
    }
    page.push_str(&refusals(report));
    page.push_str("</body></html>\n");
    page
}

fn head(report: &Report) -> String {
    let outcome = &report.outcome;
    let total = outcome.held + outcome.better.len() + outcome.broken.len();
    let mut head = format!(
        "<header><h1>Stability of the unwrapping methods</h1>\n\
         <p>{} scenes, each seen by a modulo sensor and unwrapped by every method. The figure is the share of \
         exact wrap counts k; no offset is forgiven. Failures that are known are part of the expectations.</p>\n\
         <p class=\"sum\"><b>{} of {total}</b> expectations held, <b>{}</b> better than expected, <b>{}</b> broken. \
         Of {} recovered results whose method judges itself, it vouched for {}.</p>\n",
        report.scenes.len(),
        outcome.held,
        outcome.better.len(),
        outcome.broken.len(),
        outcome.could_vouch,
        outcome.vouched,
    );
    for (title, list) in [("Broken", &outcome.broken), ("Better than expected", &outcome.better)] {
        if !list.is_empty() {
            let items: String = list.iter().map(|item| format!("<li>{}</li>", escape(item))).collect();
            head.push_str(&format!("<h3>{title}</h3><ul>{items}</ul>\n"));
        }
    }
    head + "</header>\n"
}

fn refusals(report: &Report) -> String {
    let row = |row: &super::RefusalRow| {
        let mark = if row.held { "refused" } else { "\u{2717} not refused" };
        format!("<tr><td>{}</td><td>{mark}: {}</td></tr>\n", escape(&row.what), escape(&row.said))
    };
    let rows: String = report.refusals.iter().map(row).collect();
    format!(
        "<section><h2>Refused</h2>\n<p>What no sensor delivers is refused, by an error that names the place and \
         the value.</p>\n<div class=\"wide\"><table class=\"refusals\">{rows}</table></div></section>\n"
    )
}

/// How a verdict is marked, besides its colour.
fn mark(verdict: &Verdict) -> &'static str {
    match verdict {
        Verdict::Held => "",
        Verdict::Better => "\u{25b2}",
        Verdict::Broken(_) => "\u{2717}",
    }
}

/// What the method says of its own result.
fn trust(trusted: Option<bool>) -> &'static str {
    match trusted {
        Some(true) => "\u{2713}",
        Some(false) => "?",
        None => "",
    }
}

/// The class of a share: from blue over pale to brown, told apart by every eye and in print.
fn shade(share: f64) -> &'static str {
    match share {
        1.0.. => "s5",
        0.999.. => "s4",
        0.99.. => "s3",
        0.9.. => "s2",
        0.5.. => "s1",
        _ => "s0",
    }
}

fn escape(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_all_has_the_first_shade() {
        assert_eq!([1.0, 0.99999, 0.995, 0.9, 0.5, 0.0].map(shade), ["s5", "s4", "s3", "s2", "s1", "s0"]);
    }

    #[test]
    fn text_stays_text() {
        assert_eq!(escape("a<b> & \"c\""), "a&lt;b&gt; &amp; &quot;c&quot;");
    }
}
