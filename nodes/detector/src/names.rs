//! [`ClassNames`]: the names of the classes, from the metadata of a model or from a file beside it.

use std::collections::BTreeMap;
use std::io::ErrorKind;
use std::path::Path;

use modulo_runtime::input::read_text;
use modulo_runtime::warn_once;

/// Size of the largest file with names, bytes.
const MAX_NAMES: u64 = 1 << 20;

/// Largest valid class index; a broken file must not cost gigabytes of memory.
pub const MOST_CLASS: usize = 65_535;

/// Class names by index.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct ClassNames(BTreeMap<usize, String>);

impl ClassNames {
    /// Reads the names from the metadata, or else from `<model>.names` (one name a line) beside the model. There may be no names. Names in
    /// the metadata that cannot be read are warned of where there is no such file.
    pub fn of(model: &Path, metadata: Option<&str>) -> Result<Self, String> {
        let metadata = metadata.map(str::trim).filter(|text| !text.is_empty());
        let names = metadata.and_then(names_in);
        if let Some(names) = names.as_ref().filter(|names| !names.is_empty()) {
            return Ok(Self(names.clone()));
        }
        let file = model.with_extension("names");
        match read_text(&file, MAX_NAMES) {
            Ok(text) => {
                let lines = text.trim_start_matches('\u{feff}').trim_end().lines();
                let names = lines.map(|line| line.trim().to_owned());
                Ok(Self(names.enumerate().take(MOST_CLASS + 1).collect()))
            }
            Err(why) if why.kind() == ErrorKind::NotFound => {
                if let (Some(text), None) = (metadata, names) {
                    let text: String = text.chars().take(40).collect();
                    warn_once(format!(
                        "model '{}': its class names are no list and no dict of texts ({text}) and are not read; write them into {}, \
                         one name a line",
                        model.display(),
                        file.display()
                    ));
                }
                Ok(Self::default())
            }
            Err(why) => Err(format!("{} {why}", file.display())),
        }
    }

    /// Returns the number of classes: one more than the largest index that has a name. 0: there are no names.
    pub fn count(&self) -> usize {
        self.0.last_key_value().map_or(0, |(&last, _)| last + 1)
    }

    /// Returns the name of `class`; its number when the model has no name for it.
    pub fn name(&self, class: usize) -> String {
        match self.0.get(&class) {
            Some(name) if !name.is_empty() => name.clone(),
            _ => class.to_string(),
        }
    }

    /// Returns all names by index, gaps filled with their number.
    pub fn all(&self) -> Vec<String> {
        (0..self.count()).map(|class| self.name(class)).collect()
    }
}

/// Reads a list of names, or a dict of names by their index, as JSON or Python writes it. `None` when it is anything else.
fn names_in(text: &str) -> Option<BTreeMap<usize, String>> {
    let list =
        || serde_json::from_str(text).ok().map(|names: Vec<_>| names.into_iter().enumerate().collect());
    let names = serde_json::from_str(text).ok().or_else(list).or_else(|| python(text))?;
    names.last_key_value().is_none_or(|(&last, _)| last <= MOST_CLASS).then_some(names)
}

/// Reads `{0: 'person', 1: "driver's seat"}` or `['person', "driver's seat"]`, as Python writes a dict or a list.
fn python(text: &str) -> Option<BTreeMap<usize, String>> {
    let inside = |open, close| text.trim().strip_prefix(open)?.strip_suffix(close).map(str::trim);
    let dict = inside('{', '}');
    let mut rest = dict.or_else(|| inside('[', ']')).or_else(|| inside('(', ')'))?;
    let mut names = BTreeMap::new();
    while !rest.is_empty() {
        let (key, item) = match dict {
            Some(_) => rest.split_once(':').and_then(|(key, item)| {
                let key = key.trim().trim_matches(['\'', '"']);
                Some((key.parse().ok()?, item))
            })?,
            None => (names.len(), rest),
        };
        let (name, after) = quoted(item.trim_start())?;
        names.insert(key, name);
        let after = after.trim_start();
        rest = match after.strip_prefix(',') {
            Some(more) => more.trim_start(),
            None if after.is_empty() => after,
            None => return None,
        };
    }
    Some(names)
}

/// Returns a quoted string and the text after it. A backslash takes the next character literally; the code of a character, such as `\x07`,
/// is not read.
fn quoted(text: &str) -> Option<(String, &str)> {
    let quote = text.chars().next().filter(|quote| matches!(quote, '\'' | '"'))?;
    let mut name = String::new();
    let mut letters = text.char_indices().skip(1);
    while let Some((at, letter)) = letters.next() {
        match letter {
            '\\' => {
                name.push(letters.next().map(|(_, next)| next).filter(|next| !next.is_ascii_alphanumeric())?)
            }
            letter if letter == quote => return Some((name, &text[at + quote.len_utf8()..])),
            letter => name.push(letter),
        }
    }
    None
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// A dict as Python writes it.
    fn written(names: &BTreeMap<usize, String>) -> String {
        let escaped = |name: &String| name.replace('\\', "\\\\").replace('\'', "\\'");
        let items: Vec<_> = names.iter().map(|(i, n)| format!("{i}: '{}'", escaped(n))).collect();
        format!("{{{}}}", items.join(", "))
    }

    #[test]
    fn reads_what_python_and_json_write() {
        let dict = r#"{0: 'person', 2: "driver's seat", 3: 'a\'b', 4: 'x: y, z'}"#;
        let names = ClassNames(names_in(dict).expect("a dict"));
        assert_eq!(
            (names.all(), names.count()),
            (["person", "1", "driver's seat", "a'b", "x: y, z"].map(String::from).to_vec(), 5)
        );
        assert_eq!(names.name(99), "99");
        for same in [
            "{0: 'person', 1: 'voiture à \"2\"'}",
            "['person', 'voiture à \"2\"']",
            " ( 'person' , 'voiture à \"2\"' , ) ",
            r#"{"0": "person", "1": "voiture \u00e0 \"2\""}"#,
            r#"["person", "voiture \u00e0 \"2\""]"#,
            "[\n  \"person\",\n  \"voiture à \\\"2\\\"\"\n]",
        ] {
            let names = ClassNames(names_in(same).expect(same));
            assert_eq!(names.all(), ["person", "voiture à \"2\""], "{same}");
        }
        assert_eq!((names_in("{}"), names_in("[]")), (Some(BTreeMap::new()), Some(BTreeMap::new())));
        for bad in [
            "",
            "{",
            "['a'",
            "['a'}",
            "{0 'a'}",
            "{0: a}",
            "{0: 'a' 1: 'b'}",
            "{0: 'a}",
            "{99999999: 'a'}",
            "{'a', 'b'}",
            "['a' 'b']",
            "person, car",
            "[0, 1]",
            r"['\x07']",
            r#"{"0": 1}"#,
            r#"{"-1": "a"}"#,
            "[['a']]",
        ] {
            assert_eq!(names_in(bad), None, "{bad}");
        }
    }

    #[test]
    fn a_file_beside_the_model_ends_with_its_last_name() {
        let folder = tempfile::tempdir().expect("a folder");
        let model = folder.path().join("mine.onnx");
        std::fs::write(folder.path().join("mine.names"), "\u{feff}walker\r\n\r\nauto\r\n\r\n\n")
            .expect("written");
        let names = |metadata| ClassNames::of(&model, metadata).expect("readable").all();
        assert_eq!(names(None), ["walker", "1", "auto"]);
        assert_eq!(names(Some("{}")), ["walker", "1", "auto"]);
        assert_eq!(
            names(Some("walker, auto")),
            ["walker", "1", "auto"],
            "the remedy for names that are not readable"
        );
        assert_eq!(names(Some("['car']")), ["car"]);
    }

    proptest! {
        #[test]
        fn any_list_written_as_python_does_is_read_back(list in prop::collection::vec("[^\\x00]{1,8}", 0..9)) {
            let names: BTreeMap<usize, String> = list.iter().cloned().enumerate().collect();
            prop_assert_eq!(python(&written(&names)).map(|names| ClassNames(names).all()), Some(list.clone()));
            let json = serde_json::to_string(&list).expect("a list of texts");
            prop_assert_eq!(names_in(&json).map(|names| ClassNames(names).all()), Some(list));
        }

        /// Only a dict or list has names, and those have indices that are possible. They are written and read back as the same.
        #[test]
        fn names_come_from_a_whole_dict_or_list(
            text in "[\\[{]?([0-9]{1,5} ?: ?'[a-z\\\\\"]{0,4}',? ?){0,3}[\\]}]?|[\\[{]?.{0,40}[\\]}]?",
        ) {
            if let Some(names) = names_in(&text) {
                prop_assert!(text.trim().starts_with(['{', '[', '(']) && text.trim().ends_with(['}', ']', ')']), "{text}");
                prop_assert!(names.keys().all(|&index| index <= MOST_CLASS));
                prop_assert_eq!(python(&written(&names)), Some(names));
            }
        }
    }
}
