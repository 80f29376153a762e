//! [`McapFile`]: one MCAP file with its index, read in log-time order.

use std::collections::HashMap;
use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use mcap::Summary;
use mcap::sans_io::indexed_reader::{IndexedReadEvent, IndexedReader, IndexedReaderOptions, ReadOrder};
use mcap::sans_io::summary_reader::{SummaryReadEvent, SummaryReader, SummaryReaderOptions};

use super::scan::{MAX_CHUNK, UnchunkedMessage, scan};
use super::storage::{Cursor, FileSummary, IndexUse, Storage};
use super::{BagError, BagTopic, BagWarning, RawMessage, Selection, TopicCount, type_hash};
use crate::FileError;

/// The index of one file.
#[derive(Debug)]
pub(super) struct McapFile {
    path: PathBuf,
    index: Summary,
    loose: Vec<UnchunkedMessage>,
    topics: HashMap<u16, Arc<BagTopic>>,
    summary: FileSummary,
}

impl McapFile {
    /// Takes the file's summary, or scans the file when that is not usable.
    pub(super) fn open(path: &Path, index: IndexUse) -> Result<Self, BagError> {
        let io = |e| FileError::new(path, e);
        let mut file = File::open(path).map_err(io)?;
        let size = file.metadata().map_err(io)?.len();
        let summary = match index {
            IndexUse::Trusted => read_summary(&mut file, size).filter(|summary| is_complete(summary, size)),
            IndexUse::Ignored => None,
        };
        let (summary, loose, mut warnings) = match summary {
            Some(summary) => (summary, Vec::new(), Vec::new()),
            None => {
                // The search for the summary has moved the position.
                file.rewind().map_err(io)?;
                let mut found = scan(path, file, size)?;
                // The caller has not asked for the index.
                found.warnings.retain(|w| index == IndexUse::Trusted || !matches!(w, BagWarning::NoIndex(_)));
                (found.summary, found.loose, found.warnings)
            }
        };
        let topics = cdr_topics(path, &summary, &mut warnings);
        let summed = sum(&summary, &topics, size, warnings);
        Ok(Self { path: path.to_owned(), index: summary, loose, topics, summary: summed })
    }
}

fn sum(
    index: &Summary,
    topics: &HashMap<u16, Arc<BagTopic>>,
    size: u64,
    warnings: Vec<BagWarning>,
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

    fn messages(self: Arc<Self>, selection: &Selection) -> Result<Option<Box<dyn Cursor>>, BagError> {
        let messages = McapMessages::open(self, selection)?;
        Ok(messages.map(|messages| Box::new(messages) as Box<dyn Cursor>))
    }
}

/// Returns the summary at the end of the file; `None` when it cannot be read, since the scan then finds the reason.
fn read_summary(file: &mut File, size: u64) -> Option<Summary> {
    let options = SummaryReaderOptions::default().with_file_size(size);
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
    reader.finish()
}

/// Returns whether the summary is enough to find every message.
fn is_complete(summary: &Summary, size: u64) -> bool {
    let Some(stats) = &summary.stats else { return false };
    let chunks = &summary.chunk_indexes;
    let inside = |start: u64, length: u64| start.checked_add(length).is_some_and(|end| end <= size);
    // An index with fewer chunks than the file counts would hide messages.
    stats.chunk_count as usize == chunks.len()
        // Messages outside of chunks have no index; only a scan finds them.
        && (stats.message_count == 0 || !chunks.is_empty())
        && stats.message_start_time <= stats.message_end_time
        && stats.channel_message_counts.keys().all(|id| summary.channels.contains_key(id))
        && chunks.iter().all(|chunk| inside(chunk.chunk_start_offset, chunk.chunk_length))
}

fn cdr_topics(path: &Path, summary: &Summary, warnings: &mut Vec<BagWarning>) -> HashMap<u16, Arc<BagTopic>> {
    let mut topics = HashMap::new();
    for (&id, channel) in &summary.channels {
        if channel.message_encoding == "cdr" {
            topics.insert(id, Arc::new(topic(channel)));
        } else {
            warnings.push(BagWarning::LeftOut {
                path: path.to_owned(),
                topic: channel.topic.clone(),
                messages: message_count(summary, id),
                why: format!("they are '{}', cdr is needed", channel.message_encoding),
            });
        }
    }
    topics
}

fn topic(channel: &mcap::Channel<'_>) -> BagTopic {
    // A channel may have no schema, and a recorder may leave these entries out: both are empty then.
    let entry = |key: &str| channel.metadata.get(key).map_or("", String::as_str).to_owned();
    let (type_name, schema_encoding, schema) = match channel.schema.as_ref() {
        Some(schema) => (schema.name.clone(), schema.encoding.clone(), schema.data.to_vec()),
        None => (String::new(), String::new(), Vec::new()),
    };
    BagTopic {
        name: channel.topic.clone(),
        type_hash: type_hash(entry("topic_type_hash"), &type_name, &schema),
        type_name,
        qos: entry("offered_qos_profiles"),
        schema_encoding,
        schema,
    }
}

/// The selected messages of one file.
struct McapMessages {
    index: Arc<McapFile>,
    file: File,
    wanted: HashMap<u16, Arc<BagTopic>>,
    chunked: IndexedReader,
    /// Selected messages outside of chunks that are still to come, the next one last.
    loose: Vec<UnchunkedMessage>,
    /// The next message of the chunks, read to compare its time.
    ahead: Option<RawMessage>,
}

impl McapMessages {
    fn open(index: Arc<McapFile>, selection: &Selection) -> Result<Option<Self>, BagError> {
        let wanted: HashMap<_, _> = index
            .topics
            .iter()
            .filter(|(_, topic)| selection.has(&topic.name))
            .map(|(id, topic)| (*id, Arc::clone(topic)))
            .collect();
        // The MCAP reader takes an empty list of topics for all topics.
        if wanted.is_empty() {
            return Ok(None);
        }
        let start = selection.start_ns.unwrap_or(0);
        let options = IndexedReaderOptions::new()
            .with_order(ReadOrder::LogTime)
            .include_topics(wanted.values().map(|topic| topic.name.clone()))
            .starting_at(start)
            // A broken length must not decide how much memory is allocated.
            .with_record_length_limit(MAX_CHUNK);
        let chunked = IndexedReader::new_with_options(&index.index, options)
            .map_err(|e| BagError::damaged(&index.path, e))?;
        let is_wanted = |m: &&UnchunkedMessage| m.log_time >= start && wanted.contains_key(&m.channel);
        let loose = index.loose.iter().filter(is_wanted).rev().copied().collect();
        let file = File::open(&index.path).map_err(|e| FileError::new(&index.path, e))?;
        Ok(Some(Self { index, file, wanted, chunked, loose, ahead: None }))
    }

    fn next_chunked(&mut self) -> Result<Option<RawMessage>, BagError> {
        let path = &self.index.path;
        while let Some(event) = self.chunked.next_event() {
            match event.map_err(|e| BagError::damaged(path, e))? {
                IndexedReadEvent::ReadChunkRequest { offset, length } => {
                    let bytes = read_at(&mut self.file, &self.index, offset, length)?;
                    let taken = self.chunked.insert_chunk_record_data(offset, &bytes);
                    taken.map_err(|e| BagError::damaged(path, e))?;
                }
                IndexedReadEvent::Message { header, data } => {
                    // Two channels may share a name, and only one of them be CDR.
                    let Some(topic) = self.wanted.get(&header.channel_id) else { continue };
                    return Ok(Some(RawMessage {
                        topic: Arc::clone(topic),
                        log_time: header.log_time,
                        publish_time: header.publish_time,
                        data: data.to_vec(),
                    }));
                }
            }
        }
        Ok(None)
    }

    fn next_loose(&mut self) -> Result<Option<RawMessage>, BagError> {
        let Some(loose) = self.loose.pop() else { return Ok(None) };
        let Some(topic) = self.wanted.get(&loose.channel) else { return Ok(None) };
        let data = read_at(&mut self.file, &self.index, loose.offset, loose.length)?;
        let (log_time, publish_time) = (loose.log_time, loose.publish_time);
        Ok(Some(RawMessage { topic: Arc::clone(topic), log_time, publish_time, data }))
    }
}

impl Cursor for McapMessages {
    fn next(&mut self) -> Result<Option<RawMessage>, BagError> {
        if self.ahead.is_none() {
            self.ahead = self.next_chunked()?;
        }
        match (&self.ahead, self.loose.last()) {
            (Some(ahead), Some(loose)) if loose.log_time < ahead.log_time => self.next_loose(),
            (None, Some(_)) => self.next_loose(),
            _ => Ok(self.ahead.take()),
        }
    }
}

/// Reads `length` bytes at `offset` of the file; a length beyond its end is refused before it is allocated.
fn read_at(file: &mut File, index: &McapFile, offset: u64, length: usize) -> Result<Vec<u8>, BagError> {
    let end = offset.checked_add(length as u64).filter(|&end| end <= index.summary.size);
    if end.is_none() {
        let why = format!("{length} bytes at {offset} are beyond its end at {}", index.summary.size);
        return Err(BagError::damaged(&index.path, why));
    }
    let io = |e| FileError::new(&index.path, e);
    let mut bytes = vec![0; length];
    file.seek(SeekFrom::Start(offset)).map_err(io)?;
    file.read_exact(&mut bytes).map_err(io)?;
    Ok(bytes)
}
