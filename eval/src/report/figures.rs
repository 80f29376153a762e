//! The charts, each for a desk and for a phone; of every kind the first is open.

use super::html::escape;
use crate::chart::Drawn;

/// All charts.
pub fn section(charts: &[Drawn]) -> String {
    let mut out =
        String::from("<h2>Charts</h2>\n<p class=\"note\">A pointer on a mark shows its cell.</p>\n");
    for (index, Drawn { name, title, wide, narrow }) in charts.iter().enumerate() {
        let figure = format!(
            "<figure id=\"{}\"><div class=\"broad\">{wide}</div><div class=\"narrow\">{narrow}</div></figure>\n",
            escape(name),
        );
        if charts[..index].iter().all(|other| kind(&other.name) != kind(name)) {
            out += &figure;
        } else {
            out += &format!("<details><summary>{}</summary>\n{figure}</details>\n", escape(title));
        }
    }
    out
}

/// What stands before the first `_`.
fn kind(name: &str) -> &str {
    name.split('_').next().unwrap_or(name)
}
