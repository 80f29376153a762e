//! One scene: what it is, why it is there, and its pictures.

use super::super::expect::percent;
use super::super::report::{SceneRow, Trial, Verdict};
use super::{escape, mark, shade, trust};

/// Pictures narrower than this many pixels are shown as squares.
const TINY: usize = 100;

pub fn html(scene: &SceneRow) -> String {
    let (height, width, channels) = scene.shape;
    let mut article = format!(
        "<article id=\"{0}\"><h3>{0}</h3>\n<p><b>{1}.</b> {2}</p>\n<p class=\"note\">{width} x {height}, {3}, \
         b = {4}, alpha = {5}</p>\n",
        scene.name,
        escape(&capital(&scene.what)),
        escape(&sentence(scene.why)),
        if channels == 1 { "mono" } else { "colour" },
        scene.bits,
        scene.alpha,
    );
    if let Some(twin) = scene.twin {
        article.push_str(&format!(
            "<p class=\"twin\">\u{2205} Unobservable. The same y, code for code, comes from: {}. Nowhere is that \
             scene steeper or sharper, so nothing in y speaks for the true one.</p>\n",
            escape(twin)
        ));
    }
    article.push_str("<div class=\"strip\">\n");
    for label in ["truth", "modulo"] {
        let path = format!("pictures/{}-{label}.png", scene.name);
        article.push_str(&figure(&path, scene, &format!("<b>{label}</b>"), ""));
    }
    scene.trials.iter().for_each(|trial| article.push_str(&tile(scene, trial)));
    article + "</div></article>\n"
}

fn tile(scene: &SceneRow, trial: &Trial) -> String {
    let psnr = trial.psnr_db.map_or("no error".to_owned(), |psnr| format!("{psnr:.1} dB"));
    let mut lines = vec![format!(
        "<b>{}</b> <span class=\"{}\">{}</span> {psnr}",
        trial.method,
        shade(trial.exact),
        percent(trial.exact)
    )];
    if trial.up_to_offset > trial.exact {
        lines.push(format!("{} up to an offset", percent(trial.up_to_offset)));
    }
    if let Some(trusted) = trial.trusted {
        let word = if trusted { "trusted" } else { "not trusted" };
        lines.push(format!("by {}, {word} {}", trial.rung, trust(trial.trusted)));
    }
    let why = trial.reason.map_or(String::new(), |why| format!(": {}", escape(why)));
    lines.push(format!("<i>expected: {}{why}</i>", trial.expected));
    let class = match &trial.verdict {
        Verdict::Held => "",
        Verdict::Better => {
            lines.push(format!("<b>{} better than expected</b>", mark(&trial.verdict)));
            "better"
        }
        Verdict::Broken(how) => {
            lines.push(format!("<b>{} broken: {}</b>", mark(&trial.verdict), escape(how)));
            "broken"
        }
    };
    figure(trial.picture.as_deref().unwrap_or_default(), scene, &lines.join("<br>"), class)
}

fn figure(path: &str, scene: &SceneRow, caption: &str, class: &str) -> String {
    let (height, width, _) = scene.shape;
    let size = if width < TINY { "tiny" } else { "" };
    format!(
        "<figure class=\"{class}\"><img class=\"{size}\" src=\"{path}\" width=\"{width}\" height=\"{height}\" alt=\"\">\
         <figcaption>{caption}</figcaption></figure>\n"
    )
}

/// With a capital in front.
fn capital(text: &str) -> String {
    let mut letters = text.chars();
    letters.next().map_or(String::new(), |first| first.to_uppercase().chain(letters).collect())
}

fn sentence(text: &str) -> String {
    if text.is_empty() { String::new() } else { format!("{}.", capital(text)) }
}
