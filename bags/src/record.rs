//! [`Recorder`]: messages into a bag as they come.
//!
//! The caller subscribes, stamps and decides when it is over; nothing is
//! dropped or reordered here.

use std::path::Path;

use crate::bag::{BagError, BagTopic, BagWriter, TopicCount, WriteOptions};

/// A recording that goes on until [`Recorder::finish`].
pub struct Recorder {
    bag: BagWriter,
}

impl Recorder {
    /// Starts a recording in the new bag folder `folder`.
    ///
    /// # Errors
    /// [`BagError`] when the folder is there already, or cannot be made.
    pub fn create(folder: &Path, options: impl Into<WriteOptions>) -> Result<Self, BagError> {
        Ok(Self { bag: BagWriter::create(folder, options)? })
    }

    /// Adds `topic` before its first message, so that it is in the bag even if
    /// none comes.
    ///
    /// # Errors
    /// [`BagError::TypeConflict`] when it has another type already.
    pub fn announce(&mut self, topic: &BagTopic) -> Result<(), BagError> {
        self.bag.topic(topic).map(drop)
    }

    /// Writes one message: CDR with its encapsulation, received at `log_time`
    /// and sent at `publish_time`, ns since the epoch.
    ///
    /// # Errors
    /// [`BagError`] for a topic of two types, and when the disk does not take it.
    pub fn record(
        &mut self,
        topic: &BagTopic,
        log_time: u64,
        publish_time: u64,
        payload: &[u8],
    ) -> Result<(), BagError> {
        let id = self.bag.topic(topic)?;
        self.bag.write(id, log_time, publish_time, payload)?;
        self.bag.settle(log_time)
    }

    /// Once a second of `now`, ns since the epoch, has the disk confirm what
    /// came so far; for pauses, since messages do that by themselves.
    ///
    /// # Errors
    /// [`BagError`] when the disk does not take it.
    pub fn settle(&mut self, now: u64) -> Result<(), BagError> {
        self.bag.settle(now)
    }

    /// Completes the bag and returns the counts.
    ///
    /// # Errors
    /// [`BagError`] when the disk does not take it.
    pub fn finish(self) -> Result<Vec<TopicCount>, BagError> {
        self.bag.finish()
    }
}
