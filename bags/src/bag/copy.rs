//! [`copy`]: makes a complete MCAP bag from the readable messages of another one, which may be damaged or have another form.

use std::collections::BTreeMap;
use std::path::Path;

use super::{BagError, BagReader, BagWarning, BagWriter, Selection, TopicCount, WriteOptions};

/// The result of [`copy`].
#[derive(Debug)]
pub struct Copied {
    /// The topics with their counts.
    pub topics: Vec<TopicCount>,
    /// Single messages that were left out, by topic: those that cannot be read, and those of a topic's second type.
    pub left_out: Vec<BagWarning>,
    /// The error that ended the reading of `bag` early.
    pub broke: Option<BagError>,
}

/// Writes every readable message of `bag` to the new bag `out`, payload bytes and times unchanged. Messages that could not be copied are reported by the warnings of `bag`, by [`Copied::left_out`] and by [`Copied::broke`].
///
/// # Errors
/// [`BagError`] when `out` exists already, or cannot be written.
pub fn copy(bag: &BagReader, out: &Path, options: impl Into<WriteOptions>) -> Result<Copied, BagError> {
    let mut writer = BagWriter::create(out, options)?;
    for counted in bag.topics() {
        match writer.topic(&counted.topic) {
            // Its messages are counted below, if there are any.
            Err(BagError::TypeConflict { .. }) => {}
            added => {
                added?;
            }
        }
    }
    // For each topic: the number of such messages, and the fault of the first one.
    let mut left_out: BTreeMap<String, (u64, String)> = BTreeMap::new();
    let mut leave_out = |topic: String, why| left_out.entry(topic).or_insert((0, why)).0 += 1;
    let mut broke = None;
    for message in bag.messages(&Selection::default()) {
        match message {
            Ok(message) => match writer.topic(&message.topic) {
                Err(why @ BagError::TypeConflict { .. }) => {
                    leave_out(message.topic.name.clone(), why.to_string());
                }
                id => writer.write(id?, message.log_time, message.publish_time, &message.data)?,
            },
            Err(BagError::BadMessage { topic, why, .. }) => leave_out(topic, why),
            Err(why) => broke = Some(why),
        }
    }
    let warning =
        |(topic, (messages, why))| BagWarning::LeftOut { path: bag.path().to_owned(), topic, messages, why };
    Ok(Copied { topics: writer.finish()?, left_out: left_out.into_iter().map(warning).collect(), broke })
}
