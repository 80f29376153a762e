//! `index.html`: one page for screen, phone and paper, without script or network.

use maud::{Markup, html};
use modulo_draw::html_page;

use super::case::FAMILIES;
use super::expect::{Judgement, percent};
use super::report::{SceneRow, StabilityReport, Trial};

/// Rows, columns, channels.
type PictureShape = (usize, usize, usize);

const TITLE: &str = "Stability of the unwrapping methods";
/// Pictures narrower than this many pixels are shown as squares.
const TINY: usize = 100;

/// The page of `report`. Pictures are linked by the paths in the trials.
pub fn html(report: &StabilityReport) -> String {
    let body = html! {
        (head(report))
        (legend())
        (summary(report))
        @for family in &*FAMILIES {
            section {
                h2 { (family.title) }
                p { (family.about) }
                details {
                    summary { "Pictures" }
                    @for row in report.scenes.iter().filter(|row| row.scene.is_of(family)) { (article(row)) }
                }
            }
        }
    };
    html_page(TITLE, include_str!("page.css"), body)
}

fn head(report: &StabilityReport) -> Markup {
    let outcome = &report.outcome;
    let total = outcome.held + outcome.better.len() + outcome.broken.len();
    html! {
        header {
            h1 { (TITLE) }
            p {
                (report.scenes.len()) " scenes, each seen by a modulo sensor and unwrapped by every method. The figure is "
                "the share of exact wrap counts k; no offset is forgiven. Failures that are known are part of the "
                "expectations."
            }
            p.sum {
                b { (outcome.held) " of " (total) } " expectations held, " b { (outcome.better.len()) }
                " better than expected, " b { (outcome.broken.len()) } " broken. Of " (outcome.judged)
                " recovered results whose method judges itself, it trusted " (outcome.trusted) "."
            }
            @for (title, list) in [("Broken", &outcome.broken), ("Better than expected", &outcome.better)] {
                @if !list.is_empty() { h3 { (title) } ul { @for item in list { li { (item) } } } }
            }
        }
    }
}

fn legend() -> Markup {
    html! {
        p.legend {
            "Share of exact k in per cent: " span.s5 { "100" } " " span.s4 { "99.9 and more" } " "
            span.s3 { "99 and more" } " " span.s2 { "90 and more" } " " span.s1 { "50 and more" } " "
            span.s0 { "less" } ". \u{2713} the method trusts its k, ? it does not; no mark: it makes no claim. "
            "\u{2717} worse than expected, \u{25b2} better than expected. \u{2205} unobservable: y is also the image of "
            "another, smoother scene."
        }
    }
}

fn summary(report: &StabilityReport) -> Markup {
    let methods = report.scenes.first().map_or(&[][..], |scene| &scene.trials);
    let words = |trial: &Trial| trial.method.split('_').enumerate();
    html! {
        div.wide {
            table.summary {
                thead {
                    tr {
                        th { "scene" }
                        @for trial in methods {
                            th scope="col" { @for (index, word) in words(trial) { @if index > 0 { br; } (word) } }
                        }
                    }
                }
                @for family in &*FAMILIES {
                    tbody {
                        tr.family { th colspan=(methods.len() + 1) { span { (family.title) } } }
                        @for scene in report.scenes.iter().filter(|row| row.scene.is_of(family)) {
                            (row(scene, methods.len()))
                        }
                    }
                }
            }
        }
    }
}

/// A scene with `columns` methods. The only method of a sensor with two gains takes the whole row.
fn row(SceneRow { scene, trials, .. }: &SceneRow, columns: usize) -> Markup {
    let span = columns / trials.len().max(1);
    html! {
        tr {
            th scope="row" {
                a href={ "#" (scene.name) } { (scene.name) }
                @if scene.twin.is_some() { " " abbr title="unobservable" { "\u{2205}" } }
            }
            @for trial in trials {
                td class=(shade(trial.exact)) colspan=[(span > 1).then_some(span)]
                    title={ "expected: " (trial.expected) } {
                    @if span > 1 { (trial.method) " " }
                    (percent(trial.exact).trim_end_matches(" %"))
                    sup { (mark(&trial.verdict)) (trust(trial.trusted)) }
                }
            }
        }
    }
}

fn article(row: &SceneRow) -> Markup {
    let SceneRow { scene, shape, trials } = row;
    let (height, width, channels) = *shape;
    html! {
        article id=(scene.name) {
            h3 { (scene.name) }
            p { b { (capital(&scene.what)) "." } @if !scene.why.is_empty() { " " (capital(&scene.why)) "." } }
            p.note {
                (width) " x " (height) ", " @if channels == 1 { "mono" } @else { "colour" }
                ", b = " (scene.bits) ", alpha = " (scene.alpha)
            }
            @if let Some(twin) = &scene.twin {
                p.twin {
                    "\u{2205} Unobservable. The same y, code for code, comes from: " (twin) ". Nowhere is that scene "
                    "steeper or sharper, so nothing in y speaks for the true one."
                }
            }
            div.strip {
                @for label in ["truth", "modulo"] {
                    (figure(&format!("pictures/{}-{label}.png", scene.name), *shape, html! { b { (label) } }, ""))
                }
                @for trial in trials { (tile(*shape, trial)) }
            }
        }
    }
}

fn tile(shape: PictureShape, trial: &Trial) -> Markup {
    let psnr = trial.psnr_db.map_or("no error".to_owned(), |psnr| format!("{psnr:.1} dB"));
    let caption = html! {
        b { (trial.method) } " " span class=(shade(trial.exact)) { (percent(trial.exact)) } " " (psnr)
        @if trial.up_to_offset > trial.exact { br; (percent(trial.up_to_offset)) " up to an offset" }
        @if let Some(trusted) = trial.trusted {
            br; "by " (trial.method_used) ", " @if !trusted { "not " } "trusted " (trust(trial.trusted))
        }
        br; i { "expected: " (trial.expected) @if let Some(why) = trial.reason { ": " (why) } }
        @match &trial.verdict {
            Judgement::Held => {}
            Judgement::Better => { br; b { (mark(&trial.verdict)) " better than expected" } }
            Judgement::Broken(how) => { br; b { (mark(&trial.verdict)) " broken: " (how) } }
        }
    };
    let class = match &trial.verdict {
        Judgement::Held => "",
        Judgement::Better => "better",
        Judgement::Broken(_) => "broken",
    };
    figure(&trial.picture, shape, caption, class)
}

fn figure(path: &str, (height, width, _): PictureShape, caption: Markup, class: &str) -> Markup {
    html! {
        figure class=(class) {
            img.tiny[width < TINY] src=(path) width=(width) height=(height) alt="";
            figcaption { (caption) }
        }
    }
}

/// The mark of a verdict, in addition to its colour.
fn mark(verdict: &Judgement) -> &'static str {
    match verdict {
        Judgement::Held => "",
        Judgement::Better => "\u{25b2}",
        Judgement::Broken(_) => "\u{2717}",
    }
}

fn trust(trusted: Option<bool>) -> &'static str {
    match trusted {
        Some(true) => "\u{2713}",
        Some(false) => "?",
        None => "",
    }
}

/// The CSS class of a share: from blue over pale to brown, which colour-blind readers and print can distinguish.
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

/// The text with a capital first letter.
fn capital(text: &str) -> String {
    let mut letters = text.chars();
    letters.next().map_or(String::new(), |first| first.to_uppercase().chain(letters).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_all_has_the_first_shade() {
        assert_eq!([1.0, 0.99999, 0.995, 0.9, 0.5, 0.0].map(shade), ["s5", "s4", "s3", "s2", "s1", "s0"]);
    }
}
