//! The required shape of a model, and the names of its classes.
//!
//! No engine is named here: engines bring a [`Signature`], this judges it.

use std::collections::BTreeMap;
use std::fmt;
use std::io::ErrorKind;
use std::path::Path;

use modulo_runtime::input::read_text;

use crate::engine::EngineError;

/// Value of the parameter `model` for the embedded model; a file of that name is `./demo`.
pub const DEMO: &str = "demo";

/// Returns the bytes of `model` if it is the embedded one.
pub fn embedded(model: &Path) -> Option<&'static [u8]> {
    (model == Path::new(DEMO)).then_some(modulo_models::DEMO)
}

const INPUT: &str = "exactly one input [1, 3, H, W] of float32, H and W both fixed or both free";
const NAMES: &str = "a text file with one name a line, or none";
const OUTPUT: &str = "an output [1, N, 6] of float32 (x1, y1, x2, y2, score, class: \
                      an end-to-end export such as YOLOv10's, without non-maximum suppression outside)";

/// The type of the elements of a tensor that is read: 32-bit float.
pub const FLOAT32: &str = "float32";

/// An input or output of a model.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct TensorSpec {
    /// Its name in the graph.
    pub name: String,
    /// Name of the type of its elements, such as [`FLOAT32`].
    pub element: String,
    /// Sides, `None` for a free one; `None` as a whole when the file does not contain the shape.
    pub shape: Option<Vec<Option<usize>>>,
}

impl fmt::Display for TensorSpec {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { name, element, shape } = self;
        let Some(shape) = shape else { return write!(f, "'{name}' of {element} without a shape") };
        let side = |side: &Option<usize>| side.map_or("?".to_owned(), |side| side.to_string());
        let sides: Vec<_> = shape.iter().map(side).collect();
        write!(f, "'{name}' [{}] of {element}", sides.join(", "))
    }
}

/// The inputs, outputs and class names of a model, as an engine reads them.
pub struct Signature {
    /// Inputs without the initialisers.
    pub inputs: Vec<TensorSpec>,
    /// Outputs in the file's order.
    pub outputs: Vec<TensorSpec>,
    /// Metadata property `names`, a Python dict as text.
    pub names: Option<String>,
}

/// Names and sizes of a model that this node can read.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ModelLayout {
    /// Name of the image input.
    pub input: String,
    /// Name of the output with the rows.
    pub output: String,
    /// (height, width) of the input where the model fixes them.
    pub size: Option<(usize, usize)>,
    pub names: ClassNames,
}

impl ModelLayout {
    /// Judges `signature`, and reads the names: from the metadata, else from a file `<model>.names`, else there are no
    /// names.
    pub fn of(model: &Path, signature: &Signature) -> Result<Self, EngineError> {
        let refuse = |found: String, needed| {
            EngineError(format!("model '{}': {found}, needed is {needed}", model.display()))
        };
        let (input, size) = image_input(&signature.inputs)
            .ok_or_else(|| refuse(format!("input is {}", list(&signature.inputs)), INPUT))?;
        let output = signature
            .outputs
            .iter()
            .find(|port| gives_rows(port))
            .ok_or_else(|| refuse(format!("output is {}", list(&signature.outputs)), OUTPUT))?;
        Ok(Self {
            input: input.to_owned(),
            output: output.name.clone(),
            size,
            names: ClassNames::of(model, signature.names.as_deref())
                .map_err(|why| refuse(format!("file of class names {why}"), NAMES))?,
        })
    }
}

/// Returns the name of the only input, and the size that it fixes, if any.
fn image_input(inputs: &[TensorSpec]) -> Option<(&str, Option<(usize, usize)>)> {
    let [TensorSpec { name, element, shape: Some(shape) }] = inputs else { return None };
    match shape[..] {
        _ if element != FLOAT32 => None,
        [Some(1) | None, Some(3) | None, Some(height), Some(width)] if height > 0 && width > 0 => {
            Some((name, Some((height, width))))
        }
        [Some(1) | None, Some(3) | None, None, None] => Some((name, None)),
        _ => None,
    }
}

/// Returns whether the file allows this output to be rows; the warm-up looks at the real shape, which a file may leave
/// open.
fn gives_rows(port: &TensorSpec) -> bool {
    let possible = match port.shape.as_deref() {
        Some([batch, _, columns]) => batch.is_none_or(|n| n == 1) && columns.is_none_or(|n| n == 6),
        Some(_) => false,
        None => true,
    };
    possible && port.element == FLOAT32
}

fn list(ports: &[TensorSpec]) -> String {
    if ports.is_empty() {
        return "missing".to_owned();
    }
    ports.iter().map(TensorSpec::to_string).collect::<Vec<_>>().join(" and ")
}

/// Size of the largest file with names, bytes.
const MAX_NAMES: u64 = 1 << 20;

/// Largest valid class index; a broken file must not cost gigabytes of memory.
const MOST: usize = 65_535;

/// Class names by index.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct ClassNames(BTreeMap<usize, String>);

impl ClassNames {
    /// Reads the names from the metadata, or else from `<model>.names` (one name a line) beside the model. There may be no names.
    pub fn of(model: &Path, metadata: Option<&str>) -> Result<Self, String> {
        if let Some(names) = metadata.and_then(python_dict).filter(|names| !names.is_empty()) {
            return Ok(Self(names));
        }
        let file = model.with_extension("names");
        match read_text(&file, MAX_NAMES) {
            Ok(text) => {
                let lines = text.trim_start_matches('\u{feff}').lines().map(|line| line.trim().to_owned());
                Ok(Self(lines.enumerate().take(MOST + 1).collect()))
            }
            Err(why) if why.kind() == ErrorKind::NotFound => Ok(Self::default()),
            Err(why) => Err(format!("{} {why}", file.display())),
        }
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

    /// A dict as Python writes it.
    fn written(names: &BTreeMap<usize, String>) -> String {
        let escaped = |name: &String| name.replace('\\', "\\\\").replace('\'', "\\'");
        let items: Vec<_> = names.iter().map(|(i, n)| format!("{i}: '{}'", escaped(n))).collect();
        format!("{{{}}}", items.join(", "))
    }

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
            let names: BTreeMap<usize, String> = list.iter().cloned().enumerate().collect();
            prop_assert_eq!(python_dict(&written(&names)).map(|names| ClassNames(names).all()), Some(list));
        }

        /// Only a dict has names, and those have indices that are possible. They are written and read back as the same.
        #[test]
        fn names_come_from_a_whole_dict(
            text in "\\{?([0-9]{1,5} ?: ?'[a-z\\\\\"]{0,4}',? ?){0,3}\\}?|\\{?.{0,40}\\}?",
        ) {
            if let Some(names) = python_dict(&text) {
                prop_assert!(text.trim().starts_with('{') && text.trim().ends_with('}'), "{text}");
                prop_assert!(names.keys().all(|&index| index <= MOST));
                prop_assert_eq!(python_dict(&written(&names)), Some(names));
            }
        }
    }
}
