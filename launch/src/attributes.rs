//! The attributes of an action: known keys, required keys and YAML types, with the lines of mistakes.

use std::path::Path;

use modulo_runtime::yaml::{Content, Item, Key, ScalarType};

use crate::substitution::Template;
use crate::{LaunchError, listed};

/// A string of a launch file with its line.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Text {
    /// Line in the file, from 1.
    pub line: usize,
    /// The text as it is written.
    pub source: String,
    pub template: Template,
}

/// The attributes of one action or of one entry below it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Attributes<'a> {
    /// The launch file, for errors.
    pub file: &'a Path,
    /// Where the action stands.
    pub line: usize,
    /// What the attributes belong to, for errors: `node`, `param`, ...
    pub of: &'a str,
    pairs: &'a [(Key, Item)],
}

impl<'a> Attributes<'a> {
    /// The attributes in `item`, which must be a mapping with `known` keys only.
    pub fn read(file: &'a Path, of: &'a str, item: &'a Item, known: &[&str]) -> Result<Self, LaunchError> {
        let Content::Map(pairs) = &item.content else {
            let message = format!("{of}: expected a mapping of attributes, found {}", item.described());
            return Err(LaunchError::at(file, item.line, message));
        };
        let line = pairs.first().map_or(item.line, |(key, _)| key.line);
        if let Some((key, _)) = pairs.iter().find(|(key, _)| !known.contains(&key.name.as_str())) {
            let known = listed(known, "none");
            let why = format!("{of}: key '{}' is not supported, supported are {known}", key.name);
            return Err(LaunchError::at(file, key.line, why));
        }
        Ok(Self { file, line, of, pairs })
    }

    /// An error at `line`, opened with the action's name.
    pub fn refuse(&self, line: usize, message: impl AsRef<str>) -> LaunchError {
        LaunchError::at(self.file, line, format!("{}: {}", self.of, message.as_ref()))
    }

    pub fn item(&self, key: &str) -> Option<&'a Item> {
        self.pairs.iter().find(|(k, _)| k.name == key).map(|(_, item)| item)
    }

    pub fn text(&self, key: &str) -> Result<Option<Text>, LaunchError> {
        self.item(key).map(|item| self.scalar(key, item, &[ScalarType::String])).transpose()
    }

    /// The line and the string of `key`, in which ROS 2 evaluates no substitution.
    pub fn plain(&self, key: &str) -> Result<Option<(usize, String)>, LaunchError> {
        let Some(Text { line, template, .. }) = self.text(key)? else { return Ok(None) };
        let plain = template.as_plain().map(|plain| Some((line, plain.to_owned())));
        plain.ok_or_else(|| self.refuse(line, format!("{key}: ROS 2 evaluates no substitution here")))
    }

    /// The value of `key`, which must be of type `kind` as it is written. ROS 2 does not convert a string here:
    /// it takes any string for true, and it fails on a string in the place of a number.
    pub fn literal(&self, key: &str, kind: ScalarType) -> Result<Option<Text>, LaunchError> {
        match self.item(key) {
            Some(item @ Item { content: Content::Scalar(_, ScalarType::String), .. }) => {
                Err(self.refuse(item.line, mismatch(key, item, &[kind])))
            }
            item => item.map(|item| self.scalar(key, item, &[kind])).transpose(),
        }
    }

    /// The string `key`, which must be there.
    pub fn required(&self, key: &str) -> Result<Text, LaunchError> {
        self.text(key)?.ok_or_else(|| self.missing(key))
    }

    pub fn missing(&self, key: &str) -> LaunchError {
        self.refuse(self.line, format!("key '{key}' is missing"))
    }

    /// The items of the list `key`; none when it is absent.
    pub fn list(&self, key: &str) -> Result<&'a [Item], LaunchError> {
        match self.item(key) {
            None => Ok(&[]),
            Some(Item { content: Content::List(items), .. }) => Ok(items),
            Some(item) => {
                Err(self.refuse(item.line, format!("{key}: expected a list, found {}", item.described())))
            }
        }
    }

    /// The mappings in the list `key`, each with `known` keys only. ROS 2 refuses an empty list.
    pub fn entries(&self, key: &'a str, known: &[&str]) -> Result<Vec<Attributes<'a>>, LaunchError> {
        let items = self.list(key)?;
        if let (Some(item), []) = (self.item(key), items) {
            return Err(self.refuse(item.line, format!("{key}: the list is empty, leave it out")));
        }
        items.iter().map(|item| Attributes::read(self.file, key, item, known)).collect()
    }

    /// The (name, value) pairs of the list `key`, with those two key names.
    pub fn pairs(&self, key: &'a str, names: [&str; 2]) -> Result<Vec<(Text, Text)>, LaunchError> {
        let entries = self.entries(key, &names)?;
        entries.iter().map(|entry| Ok((entry.required(names[0])?, entry.required(names[1])?))).collect()
    }

    /// `item` as a scalar of one of the `allowed` types.
    pub fn scalar(&self, key: &str, item: &Item, allowed: &[ScalarType]) -> Result<Text, LaunchError> {
        match &item.content {
            // Only a string can hold substitutions; whether their value fits is known when they are evaluated.
            Content::Scalar(text, ScalarType::String) => {
                let template =
                    Template::parse(text).map_err(|e| self.refuse(item.line, format!("{key}: {e}")))?;
                Ok(Text { line: item.line, source: text.clone(), template })
            }
            Content::Scalar(text, kind) if allowed.contains(kind) => {
                Ok(Text { line: item.line, source: text.clone(), template: Template::plain(text) })
            }
            _ => Err(self.refuse(item.line, mismatch(key, item, allowed))),
        }
    }
}

fn mismatch(key: &str, item: &Item, allowed: &[ScalarType]) -> String {
    let expected = match allowed.first() {
        Some(ScalarType::Integer) => "a value",
        Some(ScalarType::Float) => "a number",
        _ => "a string",
    };
    let remedy = match (&item.content, expected) {
        (Content::Scalar(text, ScalarType::Integer), "a number") => format!(", write {text}.0"),
        (Content::Scalar(text, kind), "a string") if *kind != ScalarType::Null => {
            format!(", write \"{text}\"")
        }
        (Content::Scalar(text, ScalarType::String), _) if allowed.contains(&ScalarType::of_plain(text)) => {
            format!(", write {text} without quotes")
        }
        _ => String::new(),
    };
    format!("{key}: expected {expected}, found {}{remedy}", item.described())
}
