//! [`ClassNames`]: the names of the classes of a model.

use std::collections::BTreeMap;
use std::path::Path;

/// Largest valid class index; a broken file must not cost gigabytes of memory.
const MOST: usize = 65_535;

/// Class names by index.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct ClassNames(BTreeMap<usize, String>);

impl ClassNames {
    /// Reads the names from the metadata, or else from `<model>.names` (one name a line) beside the model. There may be no names.
    pub fn of(model: &Path, metadata: Option<&str>) -> Self {
        let from_metadata = metadata.and_then(python_dict).filter(|names| !names.is_empty());
        let names = from_metadata.or_else(|| {
            let text = std::fs::read_to_string(model.with_extension("names")).ok()?;
            Some(text.lines().map(|line| line.trim().to_owned()).enumerate().take(MOST + 1).collect())
        });
        Self(names.unwrap_or_default())
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
        let count = self.0.last_key_value().map_or(0, |(&last, _)| last + 1);
        (0..count).map(|class| self.name(class)).collect()
    }
}

/// Reads `{0: 'person', 1: "driver's seat"}`, as Python writes a dict, or the same as JSON (`{"0": "person"}`). `None`
/// when it is anything else.
fn python_dict(text: &str) -> Option<BTreeMap<usize, String>> {
    let mut rest = text.trim().strip_prefix('{')?.strip_suffix('}')?.trim();
    let mut names = BTreeMap::new();
    while !rest.is_empty() {
        let (key, after) = rest.split_once(':')?;
        let key: usize = key.trim().trim_matches(['\'', '"']).parse().ok().filter(|&key| key <= MOST)?;
        let (name, after) = quoted(after.trim_start())?;
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

/// Returns a quoted string and the text after it. A backslash takes the next character literally.
fn quoted(text: &str) -> Option<(String, &str)> {
    let quote = text.chars().next().filter(|quote| matches!(quote, '\'' | '"'))?;
    let mut name = String::new();
    let mut letters = text.char_indices().skip(1);
    while let Some((at, letter)) = letters.next() {
        match letter {
            '\\' => name.push(letters.next()?.1),
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

    #[test]
    fn reads_what_python_writes() {
        let names = python_dict(r#"{0: 'person', 2: "driver's seat", 3: 'a\'b', 4: 'x: y, z'}"#);
        let names = ClassNames(names.expect("a dict"));
        assert_eq!(names.all(), ["person", "1", "driver's seat", "a'b", "x: y, z"]);
        assert_eq!(names.name(99), "99");
        assert_eq!(python_dict("{}"), Some(BTreeMap::new()));
        for bad in ["", "{", "['a']", "{0 'a'}", "{0: a}", "{0: 'a' 1: 'b'}", "{0: 'a}", "{99999999: 'a'}"] {
            assert_eq!(python_dict(bad), None, "{bad}");
        }
    }

    proptest! {
        #[test]
        fn any_list_written_as_python_does_is_read_back(list in prop::collection::vec("[^\\x00]{1,8}", 0..9)) {
            let escaped = |name: &String| name.replace('\\', "\\\\").replace('\'', "\\'");
            let items: Vec<_> = list.iter().enumerate().map(|(i, n)| format!("{i}: '{}'", escaped(n))).collect();
            let read = python_dict(&format!("{{{}}}", items.join(", "))).map(ClassNames);
            prop_assert_eq!(read.map(|names| names.all()), Some(list));
        }

        #[test]
        fn no_text_panics(text in "\\{?.{0,40}\\}?") {
            let _ = python_dict(&text);
        }
    }
}
