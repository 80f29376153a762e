//! [`Ros1File`]: a `.bag` file of ROS 1, presented as if ROS 2 had recorded it. Images and camera calibrations are
//! converted; all other topics are reported as left out.

mod message;

use std::collections::{BTreeMap, HashMap, VecDeque};
use std::io::{Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use modulo_images::open_regular;
use modulo_runtime::Qos;
use rosbag::record_types::Connection;
use rosbag::{ChunkRecord, IndexRecord, MessageRecord, RosBag};

use self::message::Convert;
use super::mcap_file::MAX_CHUNK;
use super::storage::{Cursor, FileSummary, Merge, MergeInput, Storage};
use super::{BagError, BagTopic, BagWarning, RawMessage, Selection, TopicCount};
use crate::FileError;

/// The header is padded to this size.
const HEADER: u64 = 8192;

/// The index of one file.
pub(super) struct Ros1File {
    path: PathBuf,
    bag: Arc<RosBag>,
    chunks: Vec<ChunkLocation>,
    connections: BTreeMap<u32, ConvertedConnection>,
    summary: FileSummary,
}

#[derive(Clone, Copy, Debug)]
struct ChunkLocation {
    offset: u64,
    span: (u64, u64),
}

/// A connection whose messages are converted.
#[derive(Clone)]
struct ConvertedConnection {
    topic: Arc<BagTopic>,
    convert: Convert,
    messages: u64,
}

fn broken(path: &Path, why: String) -> BagError {
    BagError::Damaged(path.to_owned(), why, "`rosbag reindex` of ROS 1 may save a bag that was not closed")
}

impl Ros1File {
    /// Takes the bag's index, which must be there.
    pub(super) fn open(path: &Path) -> Result<Self, BagError> {
        let io = |e| FileError::new(path, e);
        let broken = |why| broken(path, why);
        let file = std::fs::File::open(path).map_err(io)?;
        let size = file.metadata().map_err(io)?.len();
        let mut start = Vec::new();
        file.take(HEADER).read_to_end(&mut start).map_err(io)?;
        // Before the library opens the file: it panics on positions beyond the end.
        check_header(&start, size).map_err(broken)?;
        let bag = RosBag::new(path).map_err(io)?;
        let index = read_index(&bag).map_err(|e| broken(e.to_string()))?;
        let (mut connections, mut warnings) = (BTreeMap::new(), Vec::new());
        for (id, (connection, messages)) in index.connections {
            match convert(&connection) {
                Ok((topic, convert)) => {
                    connections.insert(id, ConvertedConnection { topic: Arc::new(topic), convert, messages });
                }
                Err(why) => {
                    let (path, topic) = (path.to_owned(), connection.storage_topic.to_owned());
                    warnings.push(BagWarning::LeftOut { path, topic, messages, why });
                }
            }
        }
        let chunks = index.chunks;
        // The index of a chunk covers all its topics, so the span may be a little too wide.
        let span = chunks.iter().map(|chunk| chunk.span).reduce(|a, b| (a.0.min(b.0), a.1.max(b.1)));
        // Several connections may publish one topic.
        let counted =
            |c: &ConvertedConnection| TopicCount { topic: Arc::clone(&c.topic), messages: c.messages };
        let topics = connections.values().map(counted).collect();
        let summary = FileSummary { id: "rosbag_v2", size, span, topics, warnings };
        Ok(Self { path: path.to_owned(), bag: Arc::new(bag), chunks, connections, summary })
    }
}

struct Ros1Index<'a> {
    chunks: Vec<ChunkLocation>,
    /// The connections, each with the number of its messages.
    connections: BTreeMap<u32, (Connection<'a>, u64)>,
}

fn read_index(bag: &RosBag) -> rosbag::Result<Ros1Index<'_>> {
    let mut index = Ros1Index { chunks: Vec::new(), connections: BTreeMap::new() };
    let mut counts: HashMap<u32, u64> = HashMap::new();
    for record in bag.index_records() {
        match record? {
            IndexRecord::Connection(connection) => {
                index.connections.insert(connection.id, (connection, 0));
            }
            IndexRecord::ChunkInfo(info) => {
                // A damaged index may have them the wrong way round.
                let (start, end) = (info.start_time, info.end_time);
                let span = (start.min(end), start.max(end));
                index.chunks.push(ChunkLocation { offset: info.chunk_pos, span });
                for entry in info.entries() {
                    *counts.entry(entry.conn_id).or_default() += u64::from(entry.count);
                }
            }
            IndexRecord::IndexData(_) => {}
        }
    }
    for (id, (_, messages)) in &mut index.connections {
        *messages = counts.get(id).copied().unwrap_or(0);
    }
    Ok(index)
}

/// Returns the topic of `connection` in ROS 2; an error describes why it is not converted.
fn convert(connection: &Connection<'_>) -> Result<(BagTopic, Convert), String> {
    let kind = connection.tp;
    let known = message::known(kind).ok_or_else(|| {
        format!("of the types of ROS 1, {} are converted, not {kind}", message::known_names())
    })?;
    let md5: String = connection.md5sum.iter().map(|byte| format!("{byte:02x}")).collect();
    // Another definition of the same name has other fields at the same bytes.
    if md5 != known.md5 {
        return Err(format!("its {kind} has the MD5 sum {md5}, that of ROS 1 {}", known.md5));
    }
    // A latched topic of ROS 1 is a transient local one of ROS 2.
    let qos = if connection.latching { Qos::Latched } else { Qos::Results };
    Ok((BagTopic::new(connection.storage_topic, known.ros2, qos), known.convert))
}

impl std::fmt::Debug for Ros1File {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Ros1File")
            .field("path", &self.path)
            .field("summary", &self.summary)
            .finish_non_exhaustive()
    }
}

impl Storage for Ros1File {
    fn summary(&self) -> &FileSummary {
        &self.summary
    }

    fn messages(self: Arc<Self>, selection: &Selection) -> Result<Option<Box<dyn Cursor>>, BagError> {
        let wanted = self.connections.iter().filter(|(_, c)| selection.has(&c.topic.name));
        let wanted: HashMap<_, _> = wanted.map(|(id, c)| (*id, c.clone())).collect();
        if wanted.is_empty() {
            return Ok(None);
        }
        let from = selection.start_ns.unwrap_or(0);
        let wanted = Arc::new(wanted);
        let chunks = self.chunks.iter().filter(|chunk| chunk.span.1 >= from);
        // Chunks may overlap in time, so each is an input of its own.
        let input = |chunk: &ChunkLocation| {
            let (file, wanted, chunk) = (Arc::clone(&self), Arc::clone(&wanted), *chunk);
            MergeInput {
                start: chunk.span.0,
                open: Box::new(move || {
                    let messages = file.read_chunk(chunk, &wanted, from);
                    let messages = messages.map_err(|why| broken(&file.path, why))?;
                    Ok(Some(Box::new(ChunkMessages(messages))))
                }),
            }
        };
        Ok(Some(Box::new(Merge::of(chunks.map(input).collect()))))
    }
}

impl Ros1File {
    /// Checks that the chunk at `offset` unpacks to the size that its header names. The crate `rosbag` unpacks a chunk
    /// without a limit.
    fn check_chunk(&self, offset: u64) -> Result<(), String> {
        let mut file = open_regular(&self.path).map_err(|e| e.to_string())?;
        file.seek(SeekFrom::Start(offset)).map_err(|e| e.to_string())?;
        let mut start = Vec::new();
        file.by_ref().take(HEADER).read_to_end(&mut start).map_err(|e| e.to_string())?;
        let (header, rest) = block(&start).ok_or("its header is cut")?;
        let size = field(header, b"size").and_then(|size| Some(u32::from_le_bytes(size.try_into().ok()?)));
        let size = size.ok_or("its header has no size")?;
        if size as usize > MAX_CHUNK {
            return Err(format!("it has {size} bytes, more than {MAX_CHUNK}"));
        }
        if field(header, b"compression") != Some(b"lz4") {
            return Ok(());
        }
        let (packed, _) = rest.split_first_chunk::<4>().ok_or("its header is cut")?;
        let data = offset + (8 + header.len()) as u64;
        file.seek(SeekFrom::Start(data)).map_err(|e| e.to_string())?;
        let unpacked = lz4::Decoder::new(file.take(u32::from_le_bytes(*packed).into()));
        let mut unpacked = unpacked.map_err(|e| e.to_string())?.take(u64::from(size) + 1);
        let found = std::io::copy(&mut unpacked, &mut std::io::sink()).map_err(|e| e.to_string())?;
        if found > size.into() {
            Err(format!("it unpacks to more than the {size} bytes of its header"))
        } else {
            Ok(())
        }
    }

    /// Returns the wanted messages of one chunk, by log time.
    fn read_chunk(
        &self,
        ChunkLocation { offset, span }: ChunkLocation,
        wanted: &HashMap<u32, ConvertedConnection>,
        from: u64,
    ) -> Result<VecDeque<Result<RawMessage, BagError>>, String> {
        let at = |why: String| format!("chunk at byte {offset}: {why}");
        self.check_chunk(offset).map_err(at)?;
        let mut records = self.bag.chunk_records();
        records.seek(offset).map_err(|e| at(e.to_string()))?;
        let Some(Ok(ChunkRecord::Chunk(chunk))) = records.next() else {
            return Err(at("not a chunk, or a broken one".to_owned()));
        };
        let mut messages = Vec::new();
        for record in chunk.messages() {
            let MessageRecord::MessageData(record) = record.map_err(|e| at(e.to_string()))? else { continue };
            // Chunks are read in the order of their start times. A wrong one would bring messages out of their order.
            if record.time < span.0 || record.time > span.1 {
                let why = format!(
                    "a message of {} ns is outside {} to {} ns, as the index has it",
                    record.time, span.0, span.1
                );
                return Err(at(why));
            }
            let Some(converted) = wanted.get(&record.conn_id).filter(|_| record.time >= from) else {
                continue;
            };
            let (topic, log_time) = (&converted.topic, record.time);
            let message = match (converted.convert)(record.data) {
                Ok(data) => Ok(RawMessage { topic: topic.clone(), log_time, publish_time: log_time, data }),
                Err(why) => {
                    let (path, topic) = (self.path.clone(), topic.name.clone());
                    Err(BagError::BadMessage { path, topic, log_time, why })
                }
            };
            messages.push((log_time, message));
        }
        // A chunk holds messages in the order of their arrival. The sort is stable, so equal times keep it.
        messages.sort_by_key(|(log_time, _)| *log_time);
        Ok(messages.into_iter().map(|(_, message)| message).collect())
    }
}

struct ChunkMessages(VecDeque<Result<RawMessage, BagError>>);

impl Cursor for ChunkMessages {
    fn next(&mut self) -> Result<Option<RawMessage>, BagError> {
        self.0.pop_front().transpose()
    }
}

/// `#ROSBAG V2.0` and a line feed.
const MAGIC: &[u8] = b"#ROSBAG V2.0\n";

/// Checks that the bag of `size` bytes that begins with `start` was closed, and that its header names positions inside
/// of it. The crate `rosbag` takes that for granted, and panics where a position is beyond the file.
fn check_header(start: &[u8], size: u64) -> Result<(), String> {
    let rest = start.strip_prefix(MAGIC).ok_or("only version 2.0 of ROS 1's bags is read")?;
    let (header, rest) = block(rest).ok_or("its header is cut")?;
    let (padding, _) = rest.split_first_chunk::<4>().ok_or("its header is cut")?;
    let chunks = (MAGIC.len() + 8 + header.len()) as u64 + u64::from(u32::from_le_bytes(*padding));
    let index =
        field(header, b"index_pos").and_then(|value| Some(u64::from_le_bytes(value.try_into().ok()?)));
    match index {
        None => Err("its header has no index_pos".to_owned()),
        Some(0) => Err("it was never closed: it has no index".to_owned()),
        Some(index) if chunks <= index && index <= size => Ok(()),
        Some(index) => {
            Err(format!("its index is at byte {index}, not between {chunks} and its end at {size}"))
        }
    }
}

/// Splits `bytes` into a block, which follows its length of 4 bytes, and the rest.
fn block(bytes: &[u8]) -> Option<(&[u8], &[u8])> {
    let (length, rest) = bytes.split_first_chunk::<4>()?;
    rest.split_at_checked(usize::try_from(u32::from_le_bytes(*length)).ok()?)
}

/// Returns the value of a `name=value` in a header.
fn field<'a>(mut header: &'a [u8], name: &[u8]) -> Option<&'a [u8]> {
    while let Some((entry, rest)) = block(header) {
        if let Some(value) = entry.strip_prefix(name).and_then(|value| value.strip_prefix(b"=")) {
            return Some(value);
        }
        header = rest;
    }
    None
}
