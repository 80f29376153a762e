//! YAML as a tree with line numbers and scalars kept as text, so that `4.0`
//! stays `4.0`. Anchors, aliases, tags, several documents and repeated keys are
//! refused: no launch file needs them. No meaning of a launch file is known here.

use std::path::Path;

use saphyr_parser::{Event, Parser, ScalarStyle, Span, StrInput};

use crate::LaunchError;

/// No launch file is nested deeper than this; keeps recursion bounded.
const DEEPEST: usize = 64;

/// A node of the tree.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Item {
    /// Line in the file, from 1.
    pub line: usize,
    /// What it is.
    pub content: Content,
}

/// What a node of the tree is.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Content {
    /// A scalar as it is written, and what YAML takes it for.
    Scalar(String, ScalarType),
    /// A list.
    List(Vec<Item>),
    /// A mapping, in the order of the file.
    Map(Vec<(Key, Item)>),
}

/// A key of a mapping.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Key {
    /// Line in the file, from 1.
    pub line: usize,
    /// Its text.
    pub name: String,
}

/// What YAML takes a scalar for. ROS 2 reads YAML 1.1, in which `yes` is a bool.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum ScalarType {
    /// Quoted, or a word.
    String,
    /// `true`, `no`, ...
    Bool,
    /// An integer.
    Integer,
    /// A number with a decimal point.
    Float,
    /// Nothing, `~` or `null`.
    Null,
}

impl ScalarType {
    /// The type of a scalar without quotes.
    pub fn of_plain(text: &str) -> Self {
        match text.to_ascii_lowercase().as_str() {
            "" | "~" | "null" => Self::Null,
            "true" | "false" | "yes" | "no" | "on" | "off" => Self::Bool,
            lower if is_integer(lower) => Self::Integer,
            lower if is_float(lower) => Self::Float,
            _ => Self::String,
        }
    }
}

fn magnitude(lower: &str) -> &str {
    lower.strip_prefix(['+', '-']).unwrap_or(lower)
}

fn digits(text: &str) -> bool {
    !text.is_empty() && text.chars().all(|c| c.is_ascii_digit())
}

fn is_integer(lower: &str) -> bool {
    let magnitude = magnitude(lower);
    let hexadecimal = magnitude
        .strip_prefix("0x")
        .is_some_and(|rest| !rest.is_empty() && rest.chars().all(|c| c.is_ascii_hexdigit()));
    // A leading zero means octal in YAML 1.1 and nothing in YAML 1.2.
    hexadecimal || (digits(magnitude) && (magnitude == "0" || !magnitude.starts_with('0')))
}

/// With a decimal point, and a signed exponent if it has one.
fn is_float(lower: &str) -> bool {
    let magnitude = magnitude(lower);
    let (mantissa, exponent) = magnitude.split_once('e').unwrap_or((magnitude, "+0"));
    let Some((whole, fraction)) = mantissa.split_once('.') else { return false };
    let plain = (digits(whole) && (fraction.is_empty() || digits(fraction)))
        || (whole.is_empty() && digits(fraction));
    // PyYAML, which ROS 2 uses, takes an exponent without a sign for a part of a word.
    let signed = exponent.strip_prefix(['+', '-']).is_some_and(digits);
    matches!(magnitude, ".inf" | ".nan") || (plain && signed)
}

/// Whether one YAML reader takes the plain scalar `text` for a number or a date
/// and another does not: `010`, `1e5`, `1_000`, `12:30`, `2011-09-26`.
fn is_doubtful(text: &str) -> bool {
    let lower = text.to_ascii_lowercase();
    let magnitude = magnitude(&lower);
    let based = ["0x", "0o", "0b"].iter().filter_map(|prefix| magnitude.strip_prefix(prefix)).next();
    // A text with two points, such as a version, is a word to every reader.
    let decimal = magnitude.trim_start_matches('.').starts_with(|c: char| c.is_ascii_digit())
        && magnitude.matches('.').count() < 2
        && magnitude.chars().all(|c| c.is_ascii_digit() || "_:.+-e".contains(c));
    let numeric = match based {
        Some(digits) => digits.chars().all(|c| c.is_ascii_hexdigit() || c == '_'),
        None => decimal,
    };
    numeric && ScalarType::of_plain(text) == ScalarType::String
}

impl Item {
    /// Describes the item for an error.
    pub fn described(&self) -> String {
        match &self.content {
            Content::Scalar(text, ScalarType::String) => format!("the string '{text}'"),
            Content::Scalar(text, ScalarType::Bool) => format!("the bool {text}"),
            Content::Scalar(text, ScalarType::Integer) => format!("the integer {text}"),
            Content::Scalar(text, ScalarType::Float) => format!("the number {text}"),
            Content::Scalar(_, ScalarType::Null) => "nothing".to_owned(),
            Content::List(_) => "a list".to_owned(),
            Content::Map(_) => "a mapping".to_owned(),
        }
    }
}

/// Reads the one document in `text`; `file` is only for errors.
///
/// # Errors
/// [`LaunchError::At`] with the line of what is not readable.
pub(crate) fn read(file: &Path, text: &str) -> Result<Item, LaunchError> {
    let mut reader = YamlReader { file, parser: Parser::new_from_str(text), last_line: 1 };
    let mut root = None;
    loop {
        match reader.next()? {
            (Event::StreamEnd, _) => break,
            (Event::StreamStart | Event::DocumentStart(_) | Event::DocumentEnd | Event::Nothing, _) => {}
            (_, line) if root.is_some() => return Err(reader.refuse(line, "a second YAML document")),
            (event, line) => root = Some(reader.item(event, line, 0)?),
        }
    }
    root.ok_or_else(|| LaunchError::at(file, 1, "is empty, 'launch:' with a list is expected"))
}

struct YamlReader<'a> {
    file: &'a Path,
    parser: Parser<'a, StrInput<'a>>,
    last_line: usize,
}

impl<'a> YamlReader<'a> {
    fn next(&mut self) -> Result<(Event<'a>, usize), LaunchError> {
        match self.parser.next_event() {
            None => Ok((Event::StreamEnd, self.last_line)),
            Some(Ok((event, Span { start, .. }))) => {
                self.last_line = start.line().max(1);
                Ok((event, self.last_line))
            }
            Some(Err(error)) => {
                let line = error.marker().line().max(1);
                Err(LaunchError::at(self.file, line, format!("not YAML: {}", error.info())))
            }
        }
    }

    fn refuse(&self, line: usize, what: &str) -> LaunchError {
        LaunchError::at(self.file, line, format!("{what} is not possible in a launch file"))
    }

    fn item(&mut self, event: Event<'a>, line: usize, depth: usize) -> Result<Item, LaunchError> {
        if depth > DEEPEST {
            return Err(self.refuse(line, &format!("a nesting deeper than {DEEPEST}")));
        }
        let content = match event {
            Event::Scalar(_, _, _, Some(_))
            | Event::SequenceStart(_, Some(_))
            | Event::MappingStart(_, Some(_)) => {
                return Err(self.refuse(line, "a YAML tag"));
            }
            Event::Alias(_) => return Err(self.refuse(line, "a YAML alias")),
            Event::Scalar(text, ScalarStyle::Plain, _, _) if is_doubtful(&text) => {
                let message = format!(
                    "YAML readers disagree on {text}; write \"{text}\" for text, or a number such as 10 or 1.0e+5"
                );
                return Err(LaunchError::at(self.file, line, message));
            }
            Event::Scalar(text, ScalarStyle::Plain, _, _) => {
                let kind = ScalarType::of_plain(&text);
                Content::Scalar(text.into_owned(), kind)
            }
            Event::Scalar(text, _, _, _) => Content::Scalar(text.into_owned(), ScalarType::String),
            Event::SequenceStart(..) => Content::List(self.list(depth)?),
            Event::MappingStart(..) => Content::Map(self.map(depth)?),
            _ => return Err(self.refuse(line, "this YAML")),
        };
        Ok(Item { line, content })
    }

    fn list(&mut self, depth: usize) -> Result<Vec<Item>, LaunchError> {
        let mut items = Vec::new();
        loop {
            match self.next()? {
                (Event::SequenceEnd, _) => return Ok(items),
                (event, line) => items.push(self.item(event, line, depth + 1)?),
            }
        }
    }

    fn map(&mut self, depth: usize) -> Result<Vec<(Key, Item)>, LaunchError> {
        let mut pairs: Vec<(Key, Item)> = Vec::new();
        loop {
            let (event, line) = self.next()?;
            let name = match event {
                Event::MappingEnd => return Ok(pairs),
                Event::Scalar(text, _, _, None) => text.into_owned(),
                _ => return Err(self.refuse(line, "a key that is not a word")),
            };
            // Most YAML readers keep the last one without a word.
            if pairs.iter().any(|(key, _)| key.name == name) {
                return Err(LaunchError::at(self.file, line, format!("key '{name}' is given twice")));
            }
            let (event, value_line) = self.next()?;
            pairs.push((Key { line, name }, self.item(event, value_line, depth + 1)?));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn parse(text: &str) -> Result<Item, String> {
        read(Path::new("f.yaml"), text).map_err(|e| e.to_string())
    }

    /// The lines of a node, its keys and all below it, in the order of the file.
    fn lines_of(item: &Item) -> Vec<usize> {
        let below: Vec<usize> = match &item.content {
            Content::Scalar(..) => Vec::new(),
            Content::List(items) => items.iter().flat_map(lines_of).collect(),
            Content::Map(pairs) => {
                pairs.iter().flat_map(|(key, value)| [vec![key.line], lines_of(value)].concat()).collect()
            }
        };
        [vec![item.line], below].concat()
    }

    #[test]
    fn text_is_kept_and_lines_count() {
        let root = parse("a: 4.0\nb:\n  - 'x'\n  - yes\n").expect("valid");
        let Content::Map(pairs) = root.content else { panic!("a mapping") };
        assert_eq!(pairs[0].1.content, Content::Scalar("4.0".into(), ScalarType::Float));
        let Content::List(items) = &pairs[1].1.content else { panic!("a list") };
        assert_eq!((items[0].line, items[1].line), (3, 4));
        assert_eq!(items[1].content, Content::Scalar("yes".into(), ScalarType::Bool));
    }

    #[test]
    fn plain_scalars_have_the_types_of_yaml() {
        for (text, kind) in [
            ("4", ScalarType::Integer),
            ("-1.5e+3", ScalarType::Float),
            ("0x1f", ScalarType::Integer),
            (".5", ScalarType::Float),
            ("4.", ScalarType::Float),
            (".inf", ScalarType::Float),
            ("Off", ScalarType::Bool),
            ("~", ScalarType::Null),
            ("inf", ScalarType::String),
            ("nan", ScalarType::String),
            ("1.2.3", ScalarType::String),
            ("0xzz", ScalarType::String),
        ] {
            assert_eq!(ScalarType::of_plain(text), kind, "{text}");
        }
    }

    #[test]
    fn what_no_launch_file_needs_is_refused_with_its_line() {
        for (text, message) in [
            ("a: 1\na: 2\n", "f.yaml:2: key 'a' is given twice"),
            ("a: &x 1\nb: *x\n", "f.yaml:2: a YAML alias"),
            ("a: !!str 1\n", "f.yaml:1: a YAML tag"),
            ("a: 1\n---\nb: 1\n", "f.yaml:3: a second YAML document"),
            ("a: 010\n", "f.yaml:1: YAML readers disagree on 010; write \"010\" for text"),
            ("a: [1e5]\n", "f.yaml:1: YAML readers disagree on 1e5;"),
            ("a: 2011_09_26\n", "f.yaml:1: YAML readers disagree on 2011_09_26;"),
            ("a: 2011-09-26\n", "f.yaml:1: YAML readers disagree on 2011-09-26;"),
            ("a: 12:30\n", "f.yaml:1: YAML readers disagree on 12:30;"),
            ("a: 0b11\n", "f.yaml:1: YAML readers disagree on 0b11;"),
            ("? [a]\n: 1\n", "f.yaml:1: a key that is not a word"),
            ("a: [1\nb: 2\n", "f.yaml:"),
            ("", "f.yaml:1: is empty"),
        ] {
            let error = parse(text).expect_err(text);
            assert!(error.starts_with(message), "{error}");
        }
        assert!(parse(&"- ".repeat(100)).expect_err("too deep").contains("deeper than 64"));
        assert!(parse(&"[".repeat(100_000)).is_err());
    }

    proptest! {
        #[test]
        fn any_text_is_read_with_its_lines_or_refused_with_one(
            text in "[-a:\\[\\]{}, \n'\"#&*!|>%@?0-9]{0,60}|(a[a-c]?: ?('.'|[a-d]|\\[a, b\\])?\n| ?- [a-d]\n){0,6}",
        ) {
            // The parser puts the end of a text without a last line break on a line of its own.
            let lines = 1..=text.matches('\n').count() + 2;
            match parse(&text) {
                Ok(root) => {
                    let found = lines_of(&root);
                    prop_assert!(found.iter().all(|line| lines.contains(line)), "{found:?}");
                    prop_assert!(found.is_sorted(), "{found:?}");
                }
                Err(why) => {
                    let line = why.strip_prefix("f.yaml:").and_then(|rest| rest.split_once(": "));
                    let line = line.and_then(|(line, _)| line.parse().ok());
                    prop_assert!(line.is_some_and(|line| lines.contains(&line)), "{why}");
                }
            }
        }
    }
}
