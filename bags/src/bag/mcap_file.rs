//! [`McapFile`]: one MCAP file with its index, read in log-time order.

use std::collections::HashMap;
use std::fs::File;
use std::io::{self, Read, Seek};
use std::os::unix::fs::FileExt as _;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use mcap::read::ChannelAccumulator;
use mcap::records::{ChunkIndex, MessageHeader, Record};
use mcap::sans_io::summary_reader::{SummaryReadEvent, SummaryReader, SummaryReaderOptions};
use mcap::{McapError, Summary};

use super::bag_file::{QOS, TYPE_HASH};
use super::chunk::{self, MAX_CHUNK, RECORD_HEAD};
use super::definition::complete;
use super::scan::{MESSAGE_HEAD, Scan, UnchunkedMessage, crc_of, scan};
use super::storage::{Cursor, FileSummary, Item, Merge, MergeInput, Storage};
use super::{BagError, BagTopic, BagWarning, Extra, LeftOut, RawMessage, Selection, TopicCount, unpacked};
use crate::FileError;

/// The length of the footer with the magic bytes behind it: opcode, length, two offsets and the CRC.
const FOOTER: u64 = 9 + 20 + 8;

/// The least length of a record with a message, bytes.
const LEAST_MESSAGE: u64 = RECORD_HEAD + MESSAGE_HEAD;

#[derive(Debug)]
pub(super) struct McapFile {
    path: PathBuf,
    index: Summary,
    loose: Vec<UnchunkedMessage>,
    topics: HashMap<u16, Arc<BagTopic>>,
    summary: FileSummary,
}

impl McapFile {
    /// Takes the file's summary and looks at what lies between the chunks of it, or scans the file when there is no usable summary.
    pub(super) fn open(path: &Path) -> Result<Self, BagError> {
        let io = |e| FileError::new(path, e);
        let mut file = File::open(path).map_err(io)?;
        let size = file.metadata().map_err(io)?.len();
        let index = Index::read(&mut file, size).map_err(io)?;
        let begins = begins_as_mcap(&file, size).map_err(io)?;
        if !begins && index.is_none() {
            let why = "not a bag, its first bytes are not those of MCAP or SQLite".to_owned();
            return Err(BagError::File(path.to_owned(), why));
        }
        let is_contradictory = index.as_ref().is_some_and(|index| !is_possible(&index.summary, size));
        let index = index.filter(|_| !is_contradictory);
        let Scan { summary, loose, extras, mut warnings, .. } = walk(path, &file, size, index.as_ref())?;
        if is_contradictory {
            let why = "the counts in its index contradict each other, the whole file was scanned";
            warnings.push(BagWarning::contradiction(path, why));
        }
        if !begins {
            warnings.insert(0, BagWarning::skipped(path, 0, "it is not that of an MCAP file"));
        }
        let topics = cdr_topics(path, &summary, &mut warnings);
        let summed = sum(&summary, &topics, size, (extras, warnings));
        Ok(Self { path: path.to_owned(), index: summary, loose, topics, summary: summed })
    }

    /// Returns the messages of the `wanted` channels in a chunk, by time; none of them when any of it is damaged.
    fn messages_of(&self, file: &File, chunk: &ChunkIndex, wanted: &Wanted) -> Result<Vec<Item>, McapError> {
        let (record, is_replaced) = chunk::read(file, chunk)?;
        let mut known = ChannelAccumulator::from_summary(&self.index);
        let (mut messages, mut unknown, mut all) = (Vec::new(), 0, 0);
        chunk::unpack(chunk, &record, |record| match record {
            Record::Message { header, data } => {
                all += 1;
                // Two channels may share a name, and only one of them be CDR.
                if let Some(topic) = wanted.topics.get(&header.channel_id) {
                    messages.push((topic, header, data.into_owned()));
                } else if !self.index.channels.contains_key(&header.channel_id) {
                    unknown += 1;
                }
                Ok(())
            }
            record => chunk::define(&mut known, record.into_owned()),
        })?;
        if !chunk::has_crc(&record) && chunk::count(file, chunk, |_| true).is_some_and(|stated| stated != all)
        {
            return Err(chunk::fault("it has no CRC, and not as many messages as its index"));
        }
        if is_replaced {
            let (path, byte) = (self.path.display(), chunk.chunk_start_offset);
            tracing::warn!("{path}: the head of the chunk at byte {byte} is damaged, its messages are whole");
        }
        messages.retain(|(_, header, _)| header.log_time >= wanted.start);
        // The sort is stable, so messages of one time stay in the order of the file.
        messages.sort_by_key(|(_, header, _)| header.log_time);
        let mut items: Vec<_> =
            messages.into_iter().map(|(topic, header, data)| self.message(topic, &header, data)).collect();
        if unknown > 0 {
            let why = chunk::fault("the index does not know their channel");
            let left_out = chunk::left_out(&self.path, chunk.chunk_start_offset, Some(unknown), &why);
            items.push(Err(BagError::LeftOut(left_out)));
        }
        Ok(items)
    }

    fn loose_message(&self, file: &File, wanted: &Wanted, loose: &UnchunkedMessage) -> Item {
        let topic = wanted.topics.get(&loose.header.channel_id).expect("only wanted messages are kept");
        let mut data = vec![0; loose.length];
        file.read_exact_at(&mut data, loose.offset).map_err(|e| FileError::new(&self.path, e))?;
        self.message(topic, &loose.header, data)
    }

    fn message(&self, topic: &Arc<BagTopic>, header: &MessageHeader, data: Vec<u8>) -> Item {
        let data = unpacked(data).map_err(|why| LeftOut::of_topic(&self.path, &topic.name, 1, why))?;
        let MessageHeader { log_time, publish_time, .. } = *header;
        Ok(RawMessage { topic: Arc::clone(topic), log_time, publish_time, data })
    }
}

struct Wanted {
    topics: HashMap<u16, Arc<BagTopic>>,
    /// From this log time on, ns since the epoch.
    start: u64,
}

struct Index {
    summary: Summary,
    /// Whether a CRC shows that it is whole.
    is_checked: bool,
}

impl Index {
    /// Returns the index; `None` when it cannot be read or cannot be right, since the scan then finds the reason.
    fn read(file: &mut File, size: u64) -> io::Result<Option<Self>> {
        let Some(start) = size.checked_sub(FOOTER) else { return Ok(None) };
        let mut footer = [0; FOOTER as usize];
        file.read_exact_at(&mut footer, start)?;
        let number = |at: usize| footer[at..at + 8].try_into().map(u64::from_le_bytes).expect("eight bytes");
        let saved = u32::from_le_bytes(footer[25..29].try_into().expect("four bytes"));
        let summary_start = number(9);
        // The CRC is of all bytes from the start of the summary up to itself; 0 is none.
        let is_damaged = saved != 0 && crc_of(file, summary_start.min(size), start + 25)? != saved;
        let summary = if is_damaged { None } else { read_summary(file, size) };
        let summary = summary.filter(|summary| is_complete(summary, summary_start));
        Ok(summary.map(|summary| Self { summary, is_checked: saved != 0 }))
    }
}

/// Looks at what the index leaves open; all of the file without one, or with one that the file contradicts.
fn walk(path: &Path, file: &File, size: u64, index: Option<&Index>) -> Result<Scan, BagError> {
    let found = scan(path, file, size, index.map(|index| &index.summary))?;
    let Some(index) = index else { return Ok(found) };
    let is_damaged = found.warnings.iter().any(BagWarning::is_loss);
    if !(found.is_index_short || is_damaged && !index.is_checked) {
        return Ok(found);
    }
    let all = scan(path, file, size, None)?;
    let messages = |found: &Scan| found.summary.stats.as_ref().map_or(0, |stats| stats.message_count);
    Ok(if found.is_index_short || messages(&all) >= messages(&found) { all } else { found })
}

/// Returns whether the file begins with the magic bytes, or ends within them.
fn begins_as_mcap(file: &File, size: u64) -> io::Result<bool> {
    let length = mcap::MAGIC.len().min(usize::try_from(size).unwrap_or(usize::MAX));
    let mut start = vec![0; length];
    file.read_exact_at(&mut start, 0)?;
    Ok(mcap::MAGIC.starts_with(&start))
}

fn sum(
    index: &Summary,
    topics: &HashMap<u16, Arc<BagTopic>>,
    size: u64,
    (extras, warnings): (Vec<Extra>, Vec<BagWarning>),
) -> FileSummary {
    let stats = index.stats.as_ref();
    let span = stats.filter(|stats| stats.message_count > 0);
    let mut topics: Vec<_> = topics.iter().collect();
    // The map has no order, and the same file must always give the same list.
    topics.sort_by_key(|(id, _)| **id);
    let counted = |(&id, topic): (&u16, &Arc<BagTopic>)| TopicCount {
        topic: Arc::clone(topic),
        messages: message_count(index, id),
    };
    FileSummary {
        id: "mcap",
        size,
        span: span.map(|stats| (stats.message_start_time, stats.message_end_time)),
        topics: topics.into_iter().map(counted).collect(),
        extras,
        warnings,
    }
}

/// Returns the number of messages of a channel. A channel without messages has no count.
fn message_count(index: &Summary, channel: u16) -> u64 {
    let counts = index.stats.as_ref().map(|stats| &stats.channel_message_counts);
    counts.and_then(|counts| counts.get(&channel)).copied().unwrap_or(0)
}

impl Storage for McapFile {
    fn summary(&self) -> &FileSummary {
        &self.summary
    }

    fn messages(self: Arc<Self>, selection: &Selection) -> Result<Cursor, BagError> {
        let topics = self.topics.iter().filter(|(_, topic)| selection.has(&topic.name));
        let topics: HashMap<_, _> = topics.map(|(id, topic)| (*id, Arc::clone(topic))).collect();
        if topics.is_empty() {
            return Ok(Box::new(std::iter::empty()));
        }
        let file = Arc::new(File::open(&self.path).map_err(|e| FileError::new(&self.path, e))?);
        let wanted = Arc::new(Wanted { topics, start: selection.start_ns.unwrap_or(0) });
        let is_wanted = |chunk: &&ChunkIndex| {
            // A file may have no message indexes.
            let channels = &chunk.message_index_offsets;
            let is_here = channels.keys().any(|channel| wanted.topics.contains_key(channel));
            chunk.message_end_time >= wanted.start && (is_here || channels.is_empty())
        };
        let chunks = self.index.chunk_indexes.iter().filter(is_wanted).cloned();
        let mut inputs: Vec<_> = chunks.map(|chunk| chunk_input(&self, &file, &wanted, chunk)).collect();
        let is_wanted = |m: &&UnchunkedMessage| {
            m.header.log_time >= wanted.start && wanted.topics.contains_key(&m.header.channel_id)
        };
        let rest: Vec<_> = self.loose.iter().filter(is_wanted).copied().collect();
        if let Some(first) = rest.first() {
            let (index, start) = (Arc::clone(&self), first.header.log_time);
            let messages = rest.into_iter().map(move |loose| index.loose_message(&file, &wanted, &loose));
            inputs.push((start, Box::new(move || Ok(Box::new(messages)))));
        }
        Ok(Box::new(Merge::of(inputs)))
    }
}

/// Returns the messages of a chunk, which is read when the first of them may be next.
fn chunk_input(
    index: &Arc<McapFile>,
    file: &Arc<File>,
    wanted: &Arc<Wanted>,
    chunk: ChunkIndex,
) -> MergeInput {
    let (index, file, wanted) = (Arc::clone(index), Arc::clone(file), Arc::clone(wanted));
    let start = chunk.message_start_time;
    let open = move || match index.messages_of(&file, &chunk, &wanted) {
        Ok(messages) => Ok(Box::new(messages.into_iter()) as Cursor),
        Err(why) => {
            let messages = chunk::count(&file, &chunk, |channel| wanted.topics.contains_key(&channel));
            Err(chunk::left_out(&index.path, chunk.chunk_start_offset, messages, &why).into())
        }
    };
    (start, Box::new(open))
}

fn read_summary(file: &mut File, size: u64) -> Option<Summary> {
    let options = SummaryReaderOptions::default().with_file_size(size).with_record_length_limit(MAX_CHUNK);
    let mut reader = SummaryReader::new_with_options(options);
    while let Some(event) = reader.next_event() {
        match event.ok()? {
            SummaryReadEvent::ReadRequest(need) => {
                let read = file.read(reader.insert(need)).ok()?;
                reader.notify_read(read);
            }
            SummaryReadEvent::SeekRequest(to) => reader.notify_seeked(file.seek(to).ok()?),
        }
    }
    let mut summary = reader.finish()?;
    summary.chunk_indexes.sort_by_key(|chunk| chunk.chunk_start_offset);
    Some(summary)
}

/// Returns whether the summary, which begins at `start`, is enough to find every message.
fn is_complete(summary: &Summary, start: u64) -> bool {
    let Some(stats) = &summary.stats else { return false };
    let chunks = &summary.chunk_indexes;
    // An index with fewer chunks than the file counts would hide messages, and a writer may leave out the counts of the channels.
    stats.chunk_count as usize == chunks.len()
        && (stats.message_count == 0 || !stats.channel_message_counts.is_empty())
        && stats.message_start_time <= stats.message_end_time
        && stats.channel_message_counts.keys().all(|id| summary.channels.contains_key(id))
        && chunks.iter().all(|chunk| chunk::is_consistent(chunk) && chunk::end_of(chunk) <= start)
        && chunks.is_sorted_by(|a, b| chunk::end_of(a) <= b.chunk_start_offset)
}

/// Returns whether the counts of an index agree, and the chunks and the file of `size` bytes can hold as many messages.
fn is_possible(summary: &Summary, size: u64) -> bool {
    let Some(stats) = &summary.stats else { return true };
    let counts = stats.channel_message_counts.values();
    let unpacked = summary.chunk_indexes.iter().map(|chunk| chunk.uncompressed_size.min(MAX_CHUNK as u64));
    let room = unpacked.fold(size, u64::saturating_add) / LEAST_MESSAGE;
    counts.copied().try_fold(0, u64::checked_add) == Some(stats.message_count) && stats.message_count <= room
}

fn cdr_topics(path: &Path, summary: &Summary, warnings: &mut Vec<BagWarning>) -> HashMap<u16, Arc<BagTopic>> {
    let mut topics = HashMap::new();
    for (&id, channel) in &summary.channels {
        if channel.message_encoding == "cdr" {
            topics.insert(id, Arc::new(complete(path, topic(channel), warnings)));
        } else {
            let why = format!("they are '{}', cdr is needed", channel.message_encoding);
            let messages = message_count(summary, id);
            warnings.push(LeftOut::of_topic(path, &channel.topic, messages, why).into());
        }
    }
    topics
}

fn topic(channel: &mcap::Channel<'_>) -> BagTopic {
    // A channel may have no schema, and a recorder may leave these entries out: both are empty then.
    let mut metadata = channel.metadata.clone();
    let [type_hash, qos] = [TYPE_HASH, QOS].map(|key| metadata.remove(key).unwrap_or_default());
    let schema = channel.schema.as_ref();
    let schema = schema.map(|schema| (schema.name.clone(), schema.encoding.clone(), schema.data.to_vec()));
    let (type_name, schema_encoding, schema) = schema.unwrap_or_default();
    BagTopic { name: channel.topic.clone(), type_name, type_hash, qos, schema_encoding, schema, metadata }
}
