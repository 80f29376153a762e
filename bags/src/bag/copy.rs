//! [`copy`]: a whole MCAP bag out of what can be read of another one, whether it
//! is damaged or of another form.

use std::path::Path;

use super::{BagError, BagReader, BagWriter, Selection, TopicCount, WriteOptions};

/// What was copied.
#[derive(Debug)]
pub struct Copied {
    /// The topics with their counts.
    pub topics: Vec<TopicCount>,
    /// Why `bag` could not be read to its end.
    pub broke: Option<BagError>,
}

/// Writes every message of `bag` that can be read to the new bag `out`, payload
/// bytes and times unchanged. What could not be read is in the warnings of
/// `bag`, and in [`Copied::broke`].
///
/// # Errors
/// [`BagError`] when `out` is there already, or cannot be written.
pub fn copy(bag: &BagReader, out: &Path, options: impl Into<WriteOptions>) -> Result<Copied, BagError> {
    let mut writer = BagWriter::create(out, options)?;
    for counted in bag.topics() {
        writer.topic(&counted.topic)?;
    }
    let mut broke = None;
    for message in bag.messages(&Selection::default()) {
        match message {
            Ok(message) => {
                let id = writer.topic(&message.topic)?;
                writer.write(id, message.log_time, message.publish_time, &message.data)?;
            }
            Err(why) => broke = Some(why),
        }
    }
    Ok(Copied { topics: writer.finish()?, broke })
}
