//! [`recover`]: a whole bag out of what can be read of a damaged one.

use std::path::Path;

use super::{BagError, BagReader, BagWriter, Compression, Selection, TopicCount};

/// Writes every message of `bag` that can be read to the new bag `out`, payload
/// bytes and times unchanged, and returns the counts. What could not be read
/// is in the warnings of `bag`.
///
/// # Errors
/// [`BagError`] when `out` is there already, or cannot be written.
pub fn recover(bag: &BagReader, out: &Path, compression: Compression) -> Result<Vec<TopicCount>, BagError> {
    let mut writer = BagWriter::create(out, compression)?;
    for counted in bag.topics() {
        writer.topic(&counted.topic)?;
    }
    for message in bag.messages(&Selection::default()) {
        let message = message?;
        let id = writer.topic(&message.topic)?;
        writer.write(id, message.log_time, message.publish_time, &message.data)?;
    }
    writer.finish()
}
