//! The files of the page: as a browser asks for them, and as one file with a recording.

pub(crate) struct PageFile {
    pub path: &'static str,
    pub kind: &'static str,
    pub text: &'static str,
}

macro_rules! files {
    ($($kind:literal: $($name:literal)+;)+) => {
        &[$($(PageFile { path: concat!("/", $name), kind: $kind, text: include_str!(concat!("page/", $name)) },)+)+]
    };
}

/// The document that loads all others.
pub(crate) const DOCUMENT: &str = include_str!("page/index.html");
/// The style sheets and the modules. A module comes after those that it imports.
pub(crate) const FILES: &[PageFile] = files! {
    "text/css; charset=utf-8": "page.css" "stage.css" "panels.css";
    "text/javascript; charset=utf-8":
        "dom.js" "tabs.js" "curve.js" "plates.js" "state.js" "source.js" "marks.js" "tile.js" "stage.js" "display.js" "timeline.js"
        "graph.js" "parameters.js" "replay.js" "keys.js" "main.js";
};

/// A recording has no server: it loads nothing at all, and shows only what is in it.
const POLICY: &str =
    "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; img-src blob: data:";

/// The first bytes of a recording.
pub const RECORDING_BEGIN: &str = "<!doctype html>\n<!-- A recording of modulo view. -->\n";

/// Returns the page as one document that shows `recording`, a JSON text, without a viewer.
pub(crate) fn with_recording(recording: &str) -> String {
    // A tag within a string of the JSON would end the element that holds it.
    let recording = recording.replace('<', "\\u003c");
    let of_kind = |kind: &'static str| FILES.iter().filter(move |file| file.kind.starts_with(kind));
    let styles: String = of_kind("text/css").map(|file| file.text).collect();
    let modules: String = of_kind("text/javascript").map(|file| without_imports(file.text)).collect();
    let charset = "<meta charset=\"utf-8\">";
    let head = format!(
        "{charset}\n<meta http-equiv=\"Content-Security-Policy\" content=\"{POLICY}\">\n<style>\n{styles}</style>"
    );
    let scripts = format!(
        "<script type=\"application/json\" id=\"recording\">{recording}</script>\n<script type=\"module\">\n{modules}</script>"
    );
    let lines = DOCUMENT.lines().filter(|line| !line.starts_with("<link rel=\"stylesheet\""));
    let lines = lines.map(|line| match line {
        "<!doctype html>" => RECORDING_BEGIN.trim_end(),
        line if line == charset => &head,
        line if line.starts_with("<script type=\"module\"") => &scripts,
        line => line,
    });
    lines.flat_map(|line| [line, "\n"]).collect()
}

/// Returns a module as a part of one script that holds all of them.
fn without_imports(module: &str) -> String {
    let lines = module.lines().filter(|line| !line.starts_with("import "));
    lines.map(|line| line.strip_prefix("export ").unwrap_or(line).to_owned() + "\n").collect()
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;

    #[test]
    fn the_document_loads_exactly_the_files() {
        let named = |text: &'static str| {
            let names = text.split(['"', '\'']).map(|name| name.trim_start_matches("./"));
            names.filter(|name| name.ends_with(".css") || name.ends_with(".js")).collect::<BTreeSet<_>>()
        };
        let mut seen = named(DOCUMENT);
        let mut before = BTreeSet::new();
        for file in FILES {
            let imported = if file.path.ends_with(".js") { named(file.text) } else { BTreeSet::new() };
            assert!(imported.is_subset(&before), "{} imports what comes later: {imported:?}", file.path);
            seen.extend(imported);
            before.insert(file.path.trim_start_matches('/'));
        }
        assert_eq!(seen, before, "files that nothing loads, or that are missing");
    }

    /// The modules share their names in one script.
    #[test]
    fn modules_declare_each_name_once() {
        let mut names = BTreeSet::new();
        for file in FILES.iter().filter(|file| file.path.ends_with(".js")) {
            for line in file.text.lines().map(|line| line.strip_prefix("export ").unwrap_or(line)) {
                let declared = ["const ", "let ", "function ", "async function ", "class "];
                let Some(rest) = declared.iter().find_map(|word| line.strip_prefix(word)) else { continue };
                let ends = |letter: char| !(letter.is_alphanumeric() || letter == '_');
                let name = rest.split(ends).next().unwrap_or_default();
                assert!(!name.is_empty(), "{}: a declaration without one name: {line}", file.path);
                assert!(names.insert(name), "{}: {name} is declared twice", file.path);
            }
        }
    }

    #[test]
    fn a_recording_is_one_document_that_loads_nothing() {
        let page = with_recording("[\"</script>\"]");
        assert!(page.contains("[\"\\u003c/script>\"]"));
        assert!(!page.contains("src=\"") && !page.contains("\nimport ") && !page.contains("\nexport "));
        assert!(page.contains("<style>") && page.contains("default-src 'none'"));
    }
}
