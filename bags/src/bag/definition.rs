//! The type of a topic as a file records it, completed and checked: its definition decides on its hash.

use std::path::Path;

use super::{BagTopic, BagWarning, qos};

/// Completes the type of `topic`, which the file at `path` has with a definition, a hash, both or none of them. Humble and
/// the Python package `mcap` record no hash. Readers since ROS 2 Iron find a topic only by the right one.
pub(super) fn complete(path: &Path, mut topic: BagTopic, warnings: &mut Vec<BagWarning>) -> BagTopic {
    // Some writers use the short name of ROS 1.
    if let Some((package, name)) = topic.type_name.split_once('/').filter(|(_, name)| !name.contains('/')) {
        topic.type_name = format!("{package}/msg/{name}");
    }
    let recorded = Some(std::mem::take(&mut topic.type_hash)).filter(|hash| is_hash(hash));
    let known = modulo_msgs::type_hash(&topic.type_name);
    if topic.schema.is_empty() {
        // A recorded hash may be that of another version of the type.
        let ours = BagTopic::new(&topic.name, &topic.type_name, qos::parse(&topic.qos));
        if !ours.schema.is_empty() && recorded.as_ref().is_none_or(|hash| Some(hash) == known.as_ref()) {
            (topic.schema, topic.schema_encoding) = (ours.schema, ours.schema_encoding);
        } else if !topic.type_name.is_empty() {
            let BagTopic { name, type_name, .. } = &topic;
            let why = format!("topic '{name}': the bag does not define {type_name}, nor does this suite");
            warnings.push(BagWarning::Remark(path.to_owned(), why));
        }
    }
    let text = String::from_utf8_lossy(&topic.schema);
    let defined = modulo_msgs::type_hash_of_schema(&topic.type_name, &text).ok();
    let defined = defined.filter(|_| !topic.schema.is_empty());
    if let (Some(defined), Some(recorded)) = (&defined, &recorded)
        && defined != recorded
    {
        let hash = format!("topic '{}': the type hash {recorded} is recorded", topic.name);
        let why = format!("{hash}, but its definition has {defined}, which is used");
        warnings.push(BagWarning::Remark(path.to_owned(), why));
    }
    // A definition of another form, such as IDL, has no hash here; the suite knows the usual types.
    topic.type_hash = defined.or(recorded).or(known).unwrap_or_default();
    topic
}

/// Returns whether `text` is a hash as ROS 2 writes it. A recorder that knows none writes an empty text or zeros.
fn is_hash(text: &str) -> bool {
    let digits = text.strip_prefix("RIHS01_").unwrap_or_default();
    let is_digit = |c: u8| c.is_ascii_digit() || (b'a'..=b'f').contains(&c);
    digits.len() == 64 && digits.bytes().all(is_digit) && digits.bytes().any(|c| c != b'0')
}
