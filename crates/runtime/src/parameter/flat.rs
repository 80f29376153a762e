//! A [`ParameterSet`] in JSON, for `#[serde(flatten, with = "...")]`: its parameters by name. A missing one has its default; an
//! unknown name or a value that is not possible is an error with the possible ones.

use std::collections::BTreeMap;

use serde::de::Error as _;
use serde::{Deserialize, Deserializer, Serialize, Serializer};

use super::value::Plain;
use super::{ParameterSet, Parameters, Value};

#[derive(Serialize, Deserialize)]
struct Entry(#[serde(with = "Plain")] Value);

/// Writes the parameters of `set`.
pub fn serialize<T: ParameterSet, S: Serializer>(set: &T, to: S) -> Result<S::Ok, S::Error> {
    to.collect_map(set.declared().into_iter().map(|(declared, value)| (declared.name, Entry(value))))
}

/// Reads a set. An error has the text of a [`ParameterError`](super::ParameterError).
pub fn deserialize<'de, T: ParameterSet, D: Deserializer<'de>>(from: D) -> Result<T, D::Error> {
    let given: Vec<(String, Value)> = BTreeMap::<String, Entry>::deserialize(from)?
        .into_iter()
        .map(|(name, Entry(value))| (name, value))
        .collect();
    let set = Parameters::declare(T::descriptors()).with(&given, false).map_err(D::Error::custom)?;
    Ok(T::from(&set))
}
