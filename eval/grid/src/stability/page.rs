//! The report of the stability suite, in the form of all reports.

use maud::{Markup, html};

use super::case::{Case, FAMILIES, Family};
use super::expect::Judgement;
use super::{PICTURES, StabilityOutcome, Trial};
use crate::labels::{distinct, percent};
use crate::report::tables::{Td, table};
use crate::score::LEAST_TRUSTED_SHARE;
use crate::{below_100, report};

/// The page of `outcome`, which links the pictures beside it.
pub fn html(outcome: &StabilityOutcome) -> String {
    let StabilityOutcome { trials, held, better, broken, .. } = outcome;
    let body = html! {
        p { strong {
            (held) " of " (trials.len()) " expectations held, " (better.len()) " results are better, " (broken.len()) " are worse."
        } }
        @for (title, list) in [("Worse than expected", broken), ("Better than expected", better)] {
            @if !list.is_empty() { h3 { (title) } ul { @for item in list { li { (item) } } } }
        }
        (methods(trials))
        @for family in &*FAMILIES { (section(family, trials)) }
    };
    report::html("modulo eval stability", body)
}

/// The table of all methods, and the legend of the other tables.
fn methods(trials: &[Trial]) -> Markup {
    let row = |method: String| {
        let own: Vec<&Trial> = trials.iter().filter(|trial| trial.row.method == method).collect();
        let is_recovered = |trial: &&Trial| trial.result().exact_k >= LEAST_TRUSTED_SHARE;
        let count = |is_counted: &dyn Fn(&&Trial) -> bool| {
            let count = own.iter().copied().filter(is_counted).count();
            Td::Number(count.to_string(), Some(count as f64))
        };
        vec![
            Td::Text(method.clone()),
            count(&|_| true),
            count(&is_recovered),
            count(&|trial| is_recovered(trial) && trial.is_trusted()),
            count(&|trial| !is_recovered(trial) && trial.is_trusted()),
        ]
    };
    let head = ["method", "scenes", "recovered", "recovered and trusted", "trusted but wrong"];
    let rows: Vec<_> =
        distinct(trials.iter().map(|trial| trial.row.method.clone())).into_iter().map(row).collect();
    html! {
        h2 { "At a glance" }
        p {
            "A scene is recovered if at least 99.9 % of its samples have the true wrap count; no offset is forgiven. Trust in another result is "
            "wrong, but for scenes whose modulo image is also that of another, smoother scene (\u{2205}), which nobody can tell."
        }
        (table(&head, &rows))
        p {
            "The tables below have the exact samples in percent. \u{2713}: the method trusts its result. ?: it does not. \u{2717}: worse than "
            "expected. \u{25b2}: better than expected. Failures that are known are expected."
        }
    }
}

/// The table and the pictures of a family of scenes.
fn section(family: &Family, trials: &[Trial]) -> Markup {
    let of = |case: &Case| trials.iter().filter(|trial| trial.row.file == case.name).collect::<Vec<_>>();
    let scenes: Vec<(&Case, Vec<&Trial>)> = family.scenes.iter().map(|case| (case, of(case))).collect();
    let methods =
        distinct(scenes.iter().flat_map(|(_, trials)| trials.iter().map(|trial| trial.row.method.clone())));
    let row = |(case, trials): &(&Case, Vec<&Trial>)| {
        let name = if case.is_observable() { case.name.clone() } else { format!("{} \u{2205}", case.name) };
        let of = |method: &String| trials.iter().find(|trial| trial.row.method == *method);
        let figure = |method| of(method).map_or(Td::number(None, 1), |trial| figure(trial));
        let sensor = [Td::setting(case.sensor.bits.into()), Td::setting(case.sensor.alpha)];
        [Td::Text(name)].into_iter().chain(sensor).chain(methods.iter().map(figure)).collect()
    };
    let rows: Vec<Vec<Td>> = scenes.iter().map(row).collect();
    let head: Vec<&str> =
        ["scene", "bits", "alpha"].into_iter().chain(methods.iter().map(String::as_str)).collect();
    html! {
        h2 { (family.title) }
        p { (family.about) }
        (table(&head, &rows))
        details { summary { "Pictures" } @for (case, trials) in &scenes { (pictures(case, trials)) } }
    }
}

/// The exact share of a result with its marks.
fn figure(trial: &Trial) -> Td {
    let trust = trial.row.trusted.map_or("", |trusted| if trusted { " \u{2713}" } else { " ?" });
    let verdict = match &trial.verdict {
        Judgement::Held => "",
        Judgement::Better => " \u{25b2}",
        Judgement::Broken(_) => " \u{2717}",
    };
    Td::Number(
        format!("{}{trust}{verdict}", percent(Some(trial.result().exact_k))),
        Some(trial.result().exact_k),
    )
}

/// A scene: its truth, its modulo image, and the results that are not exact.
fn pictures(case: &Case, trials: &[&Trial]) -> Markup {
    let (exact, others): (Vec<&Trial>, Vec<&Trial>) =
        trials.iter().partition(|trial| trial.result().exact_k == 1.0);
    let exact: String = exact.iter().map(|trial| format!(" = {}", trial.row.method)).collect();
    html! {
        h3 { (case.name) ": " (case.what) }
        @if !case.why.is_empty() { p { "Reason: " (case.why) "." } }
        @if let Some(twin) = &case.twin { p { "The same modulo image, code for code, comes from: " (twin) "." } }
        div.strip {
            (picture(case, "truth", &exact))
            (picture(case, "modulo", ""))
            @for trial in others { (picture(case, &trial.row.method, &caption(trial))) }
        }
    }
}

fn caption(trial: &Trial) -> String {
    let Trial { row, expected, .. } = trial;
    let result = trial.result();
    let [share, of_offset] = [result.exact_k, result.exact_up_to_offset].map(|share| below_100(share, 2));
    let used = if row.method_used == row.method { String::new() } else { format!(" by {}", row.method_used) };
    let offset = if of_offset == share { String::new() } else { format!(", {of_offset} % up to an offset") };
    let reason = row.reason.map_or(String::new(), |reason| format!("; {reason}"));
    format!("{used}: {share} % exact{offset}{reason}; expected: {expected}")
}

fn picture(case: &Case, name: &str, caption: &str) -> Markup {
    html! {
        figure {
            img src={ (PICTURES) "/" (case.name) "_" (name) ".png" } alt="" loading="lazy";
            figcaption { b { (name) } (caption) }
        }
    }
}
