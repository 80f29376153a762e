//! YAML as a tree with line numbers and scalars kept as text, so that `4.0` stays `4.0`. Anchors that are used, tags, several
//! documents and repeated keys are refused: no file that is read here needs them. No meaning of a file is known here.

use saphyr_parser::{Event, Parser, ScalarStyle, Span, StrInput};
use thiserror::Error;

/// No file that is read here is nested deeper than this; keeps recursion bounded.
const DEEPEST: usize = 64;

/// A text that cannot be read.
#[derive(Debug, Error)]
#[error("line {line}: {message}")]
pub struct YamlError {
    /// Line in the text, from 1.
    pub line: usize,
    /// The description of what cannot be read there.
    pub message: String,
}

/// A node of the tree.
#[derive(Clone, Debug, PartialEq)]
pub struct Item {
    /// Line in the file, from 1.
    pub line: usize,
    /// Whether it is a scalar without quotes.
    pub plain: bool,
    /// What it is.
    pub content: Content,
}

/// What a node of the tree is.
#[derive(Clone, Debug, PartialEq)]
pub enum Content {
    /// A scalar as it is written, and what YAML takes it for.
    Scalar(String, ScalarType),
    /// A list.
    List(Vec<Item>),
    /// A mapping, in the order of the file.
    Map(Vec<(Key, Item)>),
}

/// A key of a mapping.
#[derive(Clone, Debug, PartialEq)]
pub struct Key {
    /// Line in the file, from 1.
    pub line: usize,
    /// Its text.
    pub name: String,
}

/// What YAML takes a scalar for. ROS 2 reads YAML 1.1, in which `yes` is a bool.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ScalarType {
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

/// Refuses a scalar without quotes that one YAML reader takes for a number or a date and another does not: `010`, `1e5`,
/// `1_000`, `12:30`, `2011-09-26`. The error says what to write instead.
fn agreed(text: &str) -> Result<(), String> {
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
    if numeric && ScalarType::of_plain(text) == ScalarType::String {
        return Err(format!(
            "YAML readers disagree on {text}; write \"{text}\" for text, or a number such as 10 or 1.0e+5"
        ));
    }
    Ok(())
}

impl Item {
    /// Returns the text of a scalar that has a value.
    pub fn text(&self) -> Option<&str> {
        match &self.content {
            Content::Scalar(text, kind) if *kind != ScalarType::Null => Some(text),
            _ => None,
        }
    }

    /// Returns the value of `key` in a mapping. An entry without a value counts as absent.
    pub fn entry(&self, key: &str) -> Option<&Item> {
        let Content::Map(pairs) = &self.content else { return None };
        let value = pairs.iter().find(|(name, _)| name.name == key).map(|(_, item)| item);
        value.filter(|item| !matches!(item.content, Content::Scalar(_, ScalarType::Null)))
    }

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

/// Reads the one document in `text`; an empty text is a scalar without a value.
///
/// # Errors
/// [`YamlError`] with the line of what is not readable.
pub fn read(text: &str) -> Result<Item, YamlError> {
    read_checked(text, |_| Ok(()))
}

/// Reads the one document in `text` as [`read`] does, and refuses scalars on which YAML readers disagree.
///
/// # Errors
/// [`YamlError`] with the line of what is not readable.
pub fn read_agreed(text: &str) -> Result<Item, YamlError> {
    read_checked(text, agreed)
}

fn read_checked(text: &str, check: fn(&str) -> Result<(), String>) -> Result<Item, YamlError> {
    let mut reader = YamlReader { parser: Parser::new_from_str(text), check, last_line: 1 };
    let mut root = None;
    loop {
        match reader.next()? {
            (Event::StreamEnd, _) => break,
            (Event::StreamStart | Event::DocumentStart(_) | Event::DocumentEnd | Event::Nothing, _) => {}
            (_, line) if root.is_some() => return Err(refuse(line, "a second YAML document")),
            (event, line) => root = Some(reader.item(event, line, 0)?),
        }
    }
    let empty = Item { line: 1, plain: true, content: Content::Scalar(String::new(), ScalarType::Null) };
    Ok(root.unwrap_or(empty))
}

fn refuse(line: usize, what: &str) -> YamlError {
    YamlError { line, message: format!("{what} is not possible here") }
}

struct YamlReader<'a> {
    parser: Parser<'a, StrInput<'a>>,
    check: fn(&str) -> Result<(), String>,
    last_line: usize,
}

impl<'a> YamlReader<'a> {
    fn next(&mut self) -> Result<(Event<'a>, usize), YamlError> {
        match self.parser.next_event() {
            None => Ok((Event::StreamEnd, self.last_line)),
            Some(Ok((event, Span { start, .. }))) => {
                self.last_line = start.line().max(1);
                Ok((event, self.last_line))
            }
            Some(Err(error)) => {
                let line = error.marker().line().max(1);
                Err(YamlError { line, message: format!("not YAML: {}", error.info()) })
            }
        }
    }

    fn item(&mut self, event: Event<'a>, line: usize, depth: usize) -> Result<Item, YamlError> {
        if depth > DEEPEST {
            return Err(refuse(line, &format!("a nesting deeper than {DEEPEST}")));
        }
        let plain = matches!(event, Event::Scalar(_, ScalarStyle::Plain, ..));
        let content = match event {
            Event::Scalar(_, _, _, Some(_))
            | Event::SequenceStart(_, Some(_))
            | Event::MappingStart(_, Some(_)) => {
                return Err(refuse(line, "a YAML tag"));
            }
            Event::Alias(_) => return Err(refuse(line, "a YAML alias")),
            Event::Scalar(text, ..) if plain => {
                (self.check)(&text).map_err(|message| YamlError { line, message })?;
                let kind = ScalarType::of_plain(&text);
                Content::Scalar(text.into_owned(), kind)
            }
            Event::Scalar(text, ..) => Content::Scalar(text.into_owned(), ScalarType::String),
            Event::SequenceStart(..) => Content::List(self.list(depth)?),
            Event::MappingStart(..) => Content::Map(self.map(depth)?),
            _ => return Err(refuse(line, "this YAML")),
        };
        Ok(Item { line, plain, content })
    }

    fn list(&mut self, depth: usize) -> Result<Vec<Item>, YamlError> {
        let mut items = Vec::new();
        loop {
            match self.next()? {
                (Event::SequenceEnd, _) => return Ok(items),
                (event, line) => items.push(self.item(event, line, depth + 1)?),
            }
        }
    }

    fn map(&mut self, depth: usize) -> Result<Vec<(Key, Item)>, YamlError> {
        let mut pairs: Vec<(Key, Item)> = Vec::new();
        loop {
            let (event, line) = self.next()?;
            let name = match event {
                Event::MappingEnd => return Ok(pairs),
                Event::Scalar(text, _, _, None) => text.into_owned(),
                _ => return Err(refuse(line, "a key that is not a word")),
            };
            // Most YAML readers keep the last one without a word.
            if pairs.iter().any(|(key, _)| key.name == name) {
                return Err(YamlError { line, message: format!("key '{name}' is given twice") });
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
        read_agreed(text).map_err(|e| e.to_string())
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
    fn what_no_file_needs_is_refused_with_its_line() {
        for (text, message) in [
            ("a: 1\na: 2\n", "line 2: key 'a' is given twice"),
            ("a: &x 1\nb: *x\n", "line 2: a YAML alias"),
            ("a: !!str 1\n", "line 1: a YAML tag"),
            ("a: 1\n---\nb: 1\n", "line 3: a second YAML document"),
            ("a: 010\n", "line 1: YAML readers disagree on 010; write \"010\" for text"),
            ("a: [1e5]\n", "line 1: YAML readers disagree on 1e5;"),
            ("a: 2011_09_26\n", "line 1: YAML readers disagree on 2011_09_26;"),
            ("a: 2011-09-26\n", "line 1: YAML readers disagree on 2011-09-26;"),
            ("a: 12:30\n", "line 1: YAML readers disagree on 12:30;"),
            ("a: 0b11\n", "line 1: YAML readers disagree on 0b11;"),
            ("? [a]\n: 1\n", "line 1: a key that is not a word"),
            ("a: [1\nb: 2\n", "line "),
        ] {
            let error = parse(text).expect_err(text);
            assert!(error.starts_with(message), "{error}");
        }
        assert!(parse("").expect("a scalar").text().is_none());
        assert!(parse(&"- ".repeat(100)).expect_err("too deep").contains("deeper than 64"));
        // The parser itself has a limit for brackets.
        for brackets in ["[", "{a: "] {
            assert!(parse(&brackets.repeat(100_000)).is_err());
        }
        assert!(parse(&format!("{}{}", "[".repeat(64), "]".repeat(64))).is_ok());
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
                    let line = why.strip_prefix("line ").and_then(|rest| rest.split_once(": "));
                    let line = line.and_then(|(line, _)| line.parse().ok());
                    prop_assert!(line.is_some_and(|line| lines.contains(&line)), "{why}");
                }
            }
        }
    }
}
