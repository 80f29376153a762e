//! [`BagWriter`]: a bag folder as `ros2 bag record` writes it, and [`copy`], which writes one from another bag.
//!
//! A recorder calls [`BagWriter::settle`]: then everything up to a second ago is in complete chunks on the disk, and
//! can be read after a crash or a power cut. The writer reads no clock, and never overwrites a bag.

use std::collections::HashMap;
use std::collections::btree_map::{BTreeMap, Entry};
use std::fs::File;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

use modulo_runtime::output::{self, OutputError};

use super::bag_file::{BagFile, Compression};
use super::chunk::text_of;
use super::metadata::{self, CustomData, FileContents};
use super::{BagError, BagReader, BagTopic, BagWarning, LeftOut, Selection, TopicCount};
use crate::FileError;

/// Time between two flushes, ns.
const FLUSH_EVERY: u64 = 1_000_000_000;
/// Bytes of messages between two flushes. The system takes much more at once, but then one flush of it keeps a recorder
/// on a slow disk busy for many seconds, in which it does not end.
const FLUSH_BYTES: u64 = 4 << 20;

/// Options for writing a bag, which is one file by default. A file that has reached a limit is followed by a new one; each has at
/// least one message.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct WriteOptions {
    /// Compression of the chunks.
    pub compression: Compression,
    /// Most bytes of a file's messages on the disk; its index comes on top. A chunk that is not yet compressed counts in full.
    pub max_bytes: Option<u64>,
    /// Longest duration of a file, in log time.
    pub max_duration: Option<Duration>,
}

impl From<Compression> for WriteOptions {
    fn from(compression: Compression) -> Self {
        Self { compression, ..Self::default() }
    }
}

/// A topic of the [`BagWriter`] that gave it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct TopicId(usize);

/// A bag that is being written.
pub struct BagWriter {
    folder: PathBuf,
    name: String,
    options: WriteOptions,
    bag_file: BagFile,
    done: Vec<FileContents>,
    topics: Vec<TopicCount>,
    by_name: HashMap<String, TopicId>,
    custom: CustomData,
    /// Time of the last flush; `None` before the first call of [`BagWriter::settle`].
    flushed: Option<u64>,
}

impl BagWriter {
    /// Makes the folder `folder` and `<name>_0.mcap` in it.
    ///
    /// # Errors
    /// [`BagError::Exists`] when `folder` is there, [`BagError`] when it cannot be made.
    pub fn create(folder: &Path, options: impl Into<WriteOptions>) -> Result<Self, BagError> {
        let name = folder.file_name().ok_or_else(|| BagError::Name(folder.to_owned()))?;
        let (name, options) = (name.to_string_lossy().into_owned(), options.into());
        // Making the folder fails if it exists, which also decides between two recorders of one name.
        make_folder(folder)?;
        let bag_file = BagFile::create(folder, format!("{name}_0.mcap"), options.compression)?;
        Ok(Self {
            folder: folder.to_owned(),
            name,
            options,
            bag_file,
            done: Vec::new(),
            topics: Vec::new(),
            by_name: HashMap::new(),
            custom: CustomData::new(),
            flushed: None,
        })
    }

    /// Adds a topic; the same name and type again is the same topic.
    ///
    /// # Errors
    /// [`BagError::TypeConflict`] when the topic has another type already.
    pub fn topic(&mut self, topic: &BagTopic) -> Result<TopicId, BagError> {
        if let Some(&id) = self.by_name.get(&topic.name) {
            let known = &self.topics[id.0].topic.type_name;
            if *known == topic.type_name {
                return Ok(id);
            }
            let (topic, known, given) = (topic.name.clone(), known.clone(), topic.type_name.clone());
            return Err(BagError::TypeConflict(topic, known, given));
        }
        self.bag_file.add(topic)?;
        let id = TopicId(self.topics.len());
        self.topics.push(TopicCount { topic: Arc::new(topic.clone()), messages: 0 });
        self.by_name.insert(topic.name.clone(), id);
        Ok(id)
    }

    /// Writes one message: CDR with its encapsulation, times in ns since the epoch.
    ///
    /// # Errors
    /// [`BagError`] when the disk does not take it.
    pub fn write(
        &mut self,
        id: TopicId,
        log_time: u64,
        publish_time: u64,
        data: &[u8],
    ) -> Result<(), BagError> {
        // Checked before the message, because a file must not exceed its limit by it.
        if self.is_full(log_time, data.len()) {
            self.next_file()?;
        }
        self.bag_file.write(id.0, log_time, publish_time, data)?;
        self.topics[id.0].messages += 1;
        Ok(())
    }

    /// Writes one message as a recorder does: adds `topic` if it is new, and flushes when that is due.
    ///
    /// # Errors
    /// [`BagError`] for a topic with two types, and when the disk does not take the message.
    pub fn record(
        &mut self,
        topic: &BagTopic,
        log_time: u64,
        publish_time: u64,
        data: &[u8],
    ) -> Result<(), BagError> {
        let id = self.topic(topic)?;
        self.write(id, log_time, publish_time, data)?;
        // The log time is the clock here, so that a recorder has no second one.
        self.settle(log_time)
    }

    /// Flushes when the last flush was a second before `now`, ns since the epoch, or 4 MiB of messages ago. A recorder
    /// calls this after each message and in pauses; a copy, which can be made again after a crash, has no need of it.
    ///
    /// # Errors
    /// [`BagError`] when the disk does not take it.
    pub fn settle(&mut self, now: u64) -> Result<(), BagError> {
        let flushed = *self.flushed.get_or_insert(now);
        // The clock of the machine may also be set back.
        if now.abs_diff(flushed) < FLUSH_EVERY && self.bag_file.unflushed < FLUSH_BYTES {
            return Ok(());
        }
        self.flushed = Some(now);
        self.bag_file.flush()
    }

    /// Returns whether a message of `length` bytes at `log_time` belongs into a new file.
    fn is_full(&self, log_time: u64, length: usize) -> bool {
        // A file without messages takes one, however large it is, or an empty file would stay behind.
        let Some((start, _)) = self.bag_file.contents.span else { return false };
        let WriteOptions { max_bytes, max_duration, .. } = self.options;
        let lasts = Duration::from_nanos(log_time.saturating_sub(start));
        max_duration.is_some_and(|max| lasts > max)
            || max_bytes.is_some_and(|max| self.bag_file.size_with(length) > max)
    }

    fn next_file(&mut self) -> Result<(), BagError> {
        let name = format!("{}_{}.mcap", self.name, self.done.len() + 1);
        let mut bag_file = BagFile::create(&self.folder, name, self.options.compression)?;
        // Each file declares all topics in the same order, so that a `TopicId` holds for every file.
        for counted in &self.topics {
            bag_file.add(&counted.topic)?;
        }
        // The old file is finished only when the new one exists: a full disk then leaves at least a bag that
        // can be read.
        let full = std::mem::replace(&mut self.bag_file, bag_file);
        self.done.push(full.finish(&self.topics, &self.custom)?);
        Ok(())
    }

    /// Returns the topics so far with their counts, in the order they were added.
    pub fn topics(&self) -> &[TopicCount] {
        &self.topics
    }

    /// Writes the index and `metadata.yaml`; without this the bag is one that was cut. Returns the counts.
    ///
    /// # Errors
    /// [`BagError`] when the disk does not take it.
    pub fn finish(mut self) -> Result<Vec<TopicCount>, BagError> {
        self.done.push(self.bag_file.finish(&self.topics, &self.custom)?);
        // Written last: a folder with this file is a complete bag.
        let document = metadata::document(&self.done, &self.topics, &self.custom);
        let path = self.folder.join(metadata::FILE_NAME);
        output::replace(&path, document.as_bytes()).map_err(|e| FileError::new(&path, e))?;
        Ok(self.topics)
    }
}

fn make_folder(folder: &Path) -> Result<(), BagError> {
    if let Some(parent) = folder.parent() {
        std::fs::create_dir_all(parent).map_err(|e| OutputError::new(folder, e))?;
    }
    std::fs::create_dir(folder).map_err(|e| match e.kind() {
        std::io::ErrorKind::AlreadyExists => BagError::Exists(folder.to_owned()),
        _ => OutputError::new(folder, e).into(),
    })
}

/// The result of [`copy`].
#[derive(Debug)]
pub struct Copied {
    /// The topics with their counts.
    pub topics: Vec<TopicCount>,
    /// What was left out: messages that cannot be read, and those of a topic's second type, by topic or part of the file; and records
    /// beside the messages.
    pub left_out: Vec<BagWarning>,
    /// The error that ended the reading of `bag` early.
    pub broke: Option<BagError>,
}

/// Writes every readable message of `bag`, which may be damaged or have another form, to the new MCAP bag `out`, and into its first file the
/// [`Extra`](super::Extra)s. Payload bytes and times stay unchanged. Messages that could not be copied are reported by the warnings of `bag`, by
/// [`Copied::left_out`] and by [`Copied::broke`].
///
/// # Errors
/// [`BagError`] when `out` exists already, or cannot be written.
pub fn copy(bag: &BagReader, out: &Path, options: impl Into<WriteOptions>) -> Result<Copied, BagError> {
    let mut writer = BagWriter::create(out, options)?;
    for counted in bag.topics() {
        // The messages of a second type are counted below, if there are any.
        if let Err(why) = writer.topic(&counted.topic)
            && !matches!(why, BagError::TypeConflict(..))
        {
            return Err(why);
        }
    }
    let lost = copy_extras(bag, &mut writer)?;
    // For each place: the number of such messages, and the fault of the first one.
    let mut left_out: BTreeMap<String, LeftOut> = BTreeMap::new();
    let mut leave_out = |one: LeftOut| match left_out.entry(one.place.clone()) {
        Entry::Vacant(entry) => drop(entry.insert(one)),
        Entry::Occupied(mut entry) => {
            let messages = &mut entry.get_mut().messages;
            *messages = messages.zip(one.messages).map(|(all, more)| all + more);
        }
    };
    let mut broke = None;
    for message in bag.messages(&Selection::default()) {
        match message {
            Ok(message) => match writer.topic(&message.topic) {
                Err(why @ BagError::TypeConflict(..)) => {
                    leave_out(LeftOut::of_topic(bag.path(), &message.topic.name, 1, why.to_string()));
                }
                id => writer.write(id?, message.log_time, message.publish_time, &message.data)?,
            },
            // The messages behind it can be read, so the copy goes on.
            Err(BagError::LeftOut(one)) => leave_out(one),
            Err(why) => broke = Some(why),
        }
    }
    let left_out = left_out.into_values().map(BagWarning::LeftOut).chain(lost).collect();
    Ok(Copied { topics: writer.finish()?, left_out, broke })
}

/// Copies what the files of `bag` hold beside their messages. Returns what is left out.
fn copy_extras(bag: &BagReader, writer: &mut BagWriter) -> Result<Vec<BagWarning>, BagError> {
    writer.custom.clone_from(&bag.metadata.custom_data);
    let mut left_out = Vec::new();
    for (path, extra) in bag.extras() {
        let file = File::open(path).map_err(|e| FileError::new(path, e))?;
        match extra.check(&file) {
            Ok(()) => writer.bag_file.add_extra(&file, extra)?,
            Err(why) => {
                let why = format!("{extra} is left out: {}", text_of(&why));
                left_out.push(BagWarning::Damage(path.to_owned(), why));
            }
        }
    }
    Ok(left_out)
}
