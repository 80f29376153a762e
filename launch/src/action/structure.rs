//! Reading the actions that hold, place or prepare others: `group`, `include`,
//! `timer`, `push_ros_namespace`, `set_parameter`, `set_remap`, `log`.

use super::{Kind, read_all};
use crate::attributes::{Attributes, Text};
use crate::error::Mistakes;
use crate::yaml::ScalarType;

/// Another launch file, with values for its arguments.
#[derive(Clone, Debug)]
pub(crate) struct Include {
    /// Its path; a relative one starts at the including file.
    pub file: Text,
    /// (name, value) of its arguments.
    pub arguments: Vec<(Text, Text)>,
}

pub(super) fn group(attributes: &Attributes<'_>) -> Result<Kind, Mistakes> {
    let children = read_all(attributes.file, attributes.list("children")?)?;
    Ok(Kind::Group { scoped: attributes.literal("scoped", ScalarType::Bool)?, children })
}

pub(super) fn push_namespace(attributes: &Attributes<'_>) -> Result<Kind, Mistakes> {
    Ok(Kind::PushNamespace(attributes.required("namespace")?))
}

pub(super) fn include(attributes: &Attributes<'_>) -> Result<Kind, Mistakes> {
    let file = attributes.required("file")?;
    Ok(Kind::Include(Include { file, arguments: attributes.pairs("arg", ["name", "value"])? }))
}

pub(super) fn timer(attributes: &Attributes<'_>) -> Result<Kind, Mistakes> {
    let period = attributes.number("period")?.ok_or_else(|| attributes.missing("period"))?;
    Ok(Kind::Timer { period, children: read_all(attributes.file, attributes.list("children")?)? })
}

pub(super) fn log(attributes: &Attributes<'_>) -> Result<Kind, Mistakes> {
    Ok(Kind::Log(attributes.required("message")?))
}

pub(super) fn set_parameter(attributes: &Attributes<'_>) -> Result<Kind, Mistakes> {
    Ok(Kind::SetParameter { name: attributes.required("name")?, value: attributes.required("value")? })
}

pub(super) fn set_remap(attributes: &Attributes<'_>) -> Result<Kind, Mistakes> {
    Ok(Kind::SetRemap { from: attributes.required("from")?, to: attributes.required("to")? })
}
