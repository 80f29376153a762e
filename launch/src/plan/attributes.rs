//! The attributes of an action: known keys, required keys and YAML types, with the lines of mistakes, and their values in a scope.

use std::path::Path;
use std::time::Duration;

use modulo_runtime::yaml::{Content, Item, Key, ScalarType};

use crate::LaunchError;
use crate::plan::scope::Scope;
use crate::substitution::{Piece, Surroundings, pieces};

/// The attributes of one action or of one entry below it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Attributes<'f, 's> {
    /// The launch file.
    pub file: &'f Path,
    /// Where the action stands.
    pub line: usize,
    /// What the attributes belong to: `node`, `param`, ...
    pub of: &'f str,
    pairs: &'f [(Key, Item)],
    /// Where the texts are evaluated. `None` for an action that is only checked, as in a branch that may not be taken: nothing is said of
    /// its values, and its texts stay as they are written.
    pub scope: Option<&'s Scope>,
}

impl<'f, 's> Attributes<'f, 's> {
    /// The attributes in `item`, which must be a mapping with `known` keys only.
    pub fn read(
        (file, scope): (&'f Path, Option<&'s Scope>),
        of: &'f str,
        item: &'f Item,
        known: &[&str],
    ) -> Result<Self, LaunchError> {
        let Content::Map(pairs) = &item.content else {
            let message = format!("{of}: expected a mapping of attributes, found {}", item.described());
            return Err(LaunchError::at(file, item.line, message));
        };
        let line = pairs.first().map_or(item.line, |(key, _)| key.line);
        if let Some((key, _)) = pairs.iter().find(|(key, _)| !known.contains(&key.name.as_str())) {
            let known = known.join(", ");
            let why = format!("{of}: key '{}' is not supported, supported are {known}", key.name);
            return Err(LaunchError::at(file, key.line, why));
        }
        Ok(Self { file, line, of, pairs, scope })
    }

    /// An error at `line`, opened with the action's name.
    pub fn refuse(&self, line: usize, message: impl AsRef<str>) -> LaunchError {
        LaunchError::at(self.file, line, format!("{}: {}", self.of, message.as_ref()))
    }

    /// Returns a value that was made of the text of `key`, or the error with its line. In a check, a text has no value yet.
    pub fn checked<T: Default, E: ToString>(&self, key: &str, value: Result<T, E>) -> Result<T, LaunchError> {
        match value {
            Err(_) if self.scope.is_none() => Ok(T::default()),
            value => value.map_err(|why| LaunchError::at(self.file, self.line_of(key), why.to_string())),
        }
    }

    /// The line of `key`, or of the action where it has none.
    pub fn line_of(&self, key: &str) -> usize {
        self.item(key).map_or(self.line, |item| item.line)
    }

    pub fn item(&self, key: &str) -> Option<&'f Item> {
        self.pairs.iter().find(|(k, _)| k.name == key).map(|(_, item)| item)
    }

    /// The pieces of the string `key`.
    pub fn pieces(&self, key: &str) -> Result<Option<Vec<Piece>>, LaunchError> {
        self.item(key).map(|item| self.scalar(key, item, &[ScalarType::String])).transpose()
    }

    pub fn text(&self, key: &str) -> Result<Option<String>, LaunchError> {
        let Some(item) = self.item(key) else { return Ok(None) };
        let pieces = self.scalar(key, item, &[ScalarType::String])?;
        Ok(Some(self.joined(item, &pieces)))
    }

    /// The text of `item`, whose `pieces` these are.
    pub fn joined(&self, item: &Item, pieces: &[Piece]) -> String {
        match self.scope {
            Some(_) => pieces.iter().map(Piece::as_str).collect(),
            None => item.text().unwrap_or_default().to_owned(),
        }
    }

    /// The string of `key`, in which ROS 2 evaluates no substitution.
    pub fn plain(&self, key: &str) -> Result<Option<String>, LaunchError> {
        match self.pieces(key)? {
            Some(pieces) if !is_plain(&pieces) => {
                Err(self.refuse(self.line_of(key), format!("{key}: ROS 2 evaluates no substitution here")))
            }
            pieces => Ok(pieces.map(|pieces| pieces.iter().map(Piece::as_str).collect())),
        }
    }

    /// The time `key` in seconds, in `[0, 1e9]`: a number with a decimal point. ROS 2 fails on a string in its place.
    pub fn seconds(&self, key: &str) -> Result<Option<Duration>, LaunchError> {
        let Some(item) = self.item(key) else { return Ok(None) };
        let Content::Scalar(text, ScalarType::Float) = &item.content else {
            return Err(self.refuse(item.line, mismatch(key, item, &[ScalarType::Float])));
        };
        // `Duration` refuses negative, infinite and huge numbers with a panic, so they end here.
        let number = text.trim().parse::<f64>().ok().filter(|n| (0.0..=1e9).contains(n));
        let why = || format!("{key} = '{text}' must be a number in 0 to 1e9");
        self.checked(key, number.map(|seconds| Some(Duration::from_secs_f64(seconds))).ok_or_else(why))
    }

    /// The string `key`, which must be there.
    pub fn required(&self, key: &str) -> Result<String, LaunchError> {
        self.text(key)?.ok_or_else(|| self.missing(key))
    }

    pub fn missing(&self, key: &str) -> LaunchError {
        self.refuse(self.line, format!("key '{key}' is missing"))
    }

    /// The items of the list `key`; none when it is absent.
    pub fn list(&self, key: &str) -> Result<&'f [Item], LaunchError> {
        match self.item(key) {
            None => Ok(&[]),
            Some(Item { content: Content::List(items), .. }) => Ok(items),
            Some(item) => {
                Err(self.refuse(item.line, format!("{key}: expected a list, found {}", item.described())))
            }
        }
    }

    /// The mappings in the list `key`, each with `known` keys only. ROS 2 refuses an empty list.
    pub fn entries(&self, key: &'f str, known: &[&str]) -> Result<Vec<Self>, LaunchError> {
        let items = self.list(key)?;
        if let (Some(item), []) = (self.item(key), items) {
            return Err(self.refuse(item.line, format!("{key}: the list is empty, leave it out")));
        }
        items.iter().map(|item| Self::read((self.file, self.scope), key, item, known)).collect()
    }

    /// The (name, value) pairs of the list `key`, with those two key names.
    pub fn pairs(&self, key: &'f str, names: [&str; 2]) -> Result<Vec<(String, String)>, LaunchError> {
        let entries = self.entries(key, &names)?;
        entries.iter().map(|entry| Ok((entry.required(names[0])?, entry.required(names[1])?))).collect()
    }

    /// `item` as a scalar of one of the `allowed` types.
    pub fn scalar(&self, key: &str, item: &Item, allowed: &[ScalarType]) -> Result<Vec<Piece>, LaunchError> {
        match &item.content {
            // Only a string can hold substitutions.
            Content::Scalar(text, ScalarType::String) => {
                pieces(text, None).map_err(|e| self.refuse(item.line, format!("{key}: {e}")))?;
                let around =
                    self.scope.map(|scope| Surroundings { file: self.file, variables: &scope.variables });
                pieces(text, around.as_ref())
                    .map_err(|why| LaunchError::at(self.file, item.line, why.to_string()))
            }
            Content::Scalar(text, kind) if allowed.contains(kind) => Ok(vec![Piece::Text(text.clone())]),
            _ => Err(self.refuse(item.line, mismatch(key, item, allowed))),
        }
    }
}

/// Whether a text has no substitution.
pub(crate) fn is_plain(pieces: &[Piece]) -> bool {
    pieces.iter().all(|piece| matches!(piece, Piece::Text(_)))
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
