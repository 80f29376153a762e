//! [`BagFile`]: one MCAP file of a bag that is being written.
//!
//! A chunk is closed at 4 MiB and handed to the system at once, so that the file is readable up to the last chunk after
//! a crash.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::BufWriter;
use std::path::{Path, PathBuf};

use mcap::McapError;
use mcap::records::{MessageHeader, Metadata as MetadataRecord};

use super::chunk::text_of;
use super::metadata::{self, CustomData, FileContents};
use super::{BagError, BagTopic, Extra, TopicCount, qos};
use crate::FileError;

/// The compression of chunks.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Compression {
    /// No compression, as rosbag2 writes by default: fastest.
    #[default]
    None,
    /// LZ4: fast, moderately small.
    Lz4,
    /// Zstandard: slower, smaller.
    Zstd,
}

impl Compression {
    /// Each compression with its word on the command line.
    pub const WORDS: [(&'static str, Self); 3] =
        [("none", Self::None), ("lz4", Self::Lz4), ("zstd", Self::Zstd)];
}

/// Keys of a channel for what rosbag2 notes of its topic.
pub(super) const QOS: &str = "offered_qos_profiles";
pub(super) const TYPE_HASH: &str = "topic_type_hash";

/// Chunks are closed at this size, bytes.
const CHUNK: u64 = 4 << 20;
/// Bytes of a message record beside its data: opcode, length, channel, sequence and two times.
const MESSAGE_HEAD: u64 = 31;

pub(super) struct BagFile {
    path: PathBuf,
    mcap: mcap::Writer<BufWriter<File>>,
    disk: File,
    channels: Vec<u16>,
    counts: Vec<u64>,
    pub(super) contents: FileContents,
    /// The file's size without its open chunk, bytes.
    closed: u64,
    /// Bytes of messages in the open chunk, before compression.
    pending: u64,
    /// Bytes of messages since the last flush, before compression.
    pub(super) unflushed: u64,
}

impl BagFile {
    pub(super) fn create(folder: &Path, name: String, compression: Compression) -> Result<Self, BagError> {
        let path = folder.join(&name);
        let io = |e| FileError::new(&path, e);
        let file = File::create_new(&path).map_err(io)?;
        // A second handle: the writer of the library keeps the first, but only the file can be flushed to the disk.
        let disk = file.try_clone().map_err(io)?;
        // A file whose folder is not on the disk is not there after a power cut.
        File::open(folder).and_then(|folder| folder.sync_all()).map_err(io)?;
        let mcap = options(compression)
            .create(BufWriter::new(file))
            .map_err(|why| BagError::File(path.clone(), text_of(&why)))?;
        let contents = FileContents { name, span: None, messages: 0 };
        let (channels, counts) = (Vec::new(), Vec::new());
        Ok(Self { path, mcap, disk, channels, counts, contents, closed: 0, pending: 0, unflushed: 0 })
    }

    pub(super) fn add(&mut self, topic: &BagTopic) -> Result<(), BagError> {
        // Version 9 of rosbag2 reads the policies as words, whatever the source bag had.
        let own = [(QOS, qos::in_words(&topic.qos)), (TYPE_HASH, topic.type_hash.clone())];
        let own = own.map(|(key, value)| (key.to_owned(), value));
        let metadata = topic.metadata.clone().into_iter().chain(own).collect();
        let schema = self.mcap.add_schema(&topic.type_name, &topic.schema_encoding, &topic.schema);
        let channel = schema.and_then(|schema| self.mcap.add_channel(schema, &topic.name, "cdr", &metadata));
        self.channels.push(channel.map_err(|source| self.failed(source))?);
        self.counts.push(0);
        Ok(())
    }

    /// Copies a record of the file `from`.
    pub(super) fn add_extra(&mut self, from: &File, extra: &Extra) -> Result<(), BagError> {
        extra.copy(from, &mut self.mcap).map_err(|source| self.failed(source))?;
        self.close_chunk()
    }

    pub(super) fn write(
        &mut self,
        topic: usize,
        log_time: u64,
        publish_time: u64,
        data: &[u8],
    ) -> Result<(), BagError> {
        let channel_id = *self.channels.get(topic).expect("a `TopicId` belongs to the bag that gave it");
        // Closed before the next message and not after the last one, so that no file ends with an empty chunk.
        if self.pending > CHUNK {
            self.close_chunk()?;
        }
        let header = MessageHeader { channel_id, sequence: 0, log_time, publish_time };
        let written = self.mcap.write_to_known_channel(&header, data);
        written.map_err(|source| self.failed(source))?;
        self.counts[topic] += 1;
        self.pending += MESSAGE_HEAD + data.len() as u64;
        self.unflushed += MESSAGE_HEAD + data.len() as u64;
        let (start, end) = self.contents.span.unwrap_or((log_time, log_time));
        self.contents.span = Some((start.min(log_time), end.max(log_time)));
        self.contents.messages += 1;
        Ok(())
    }

    /// Returns the file's size with a message of `more` bytes; at most, since the open chunk may become smaller when it
    /// is compressed.
    pub(super) fn size_with(&self, more: usize) -> u64 {
        self.closed + self.pending + MESSAGE_HEAD + more as u64
    }

    fn close_chunk(&mut self) -> Result<(), BagError> {
        self.mcap.flush().map_err(|source| self.failed(source))?;
        // Only the system knows the size of a compressed chunk.
        self.closed = self.disk.metadata().map_err(|e| FileError::new(&self.path, e))?.len();
        self.pending = 0;
        Ok(())
    }

    /// Has the disk confirm all that was written so far.
    pub(super) fn flush(&mut self) -> Result<(), BagError> {
        if self.unflushed == 0 {
            return Ok(());
        }
        self.close_chunk()?;
        self.unflushed = 0;
        Ok(self.disk.sync_data().map_err(|e| FileError::new(&self.path, e))?)
    }

    /// Writes the index, and the metadata of this file in the form of rosbag2.
    pub(super) fn finish(
        mut self,
        topics: &[TopicCount],
        custom: &CustomData,
    ) -> Result<FileContents, BagError> {
        // The record describes this file only, so the counts are its own and not those of the bag.
        let here = |(counted, &messages): (&TopicCount, _)| TopicCount { messages, ..counted.clone() };
        let topics: Vec<_> = topics.iter().zip(&self.counts).map(here).collect();
        let text = metadata::mapping(std::slice::from_ref(&self.contents), &topics, custom);
        // rosbag2 reads this record where `metadata.yaml` is lost.
        let record = MetadataRecord {
            name: "rosbag2".to_owned(),
            metadata: BTreeMap::from([("serialized_metadata".to_owned(), text)]),
        };
        let finished = self.mcap.write_metadata(&record).and_then(|()| self.mcap.finish().map(drop));
        finished.map_err(|source| self.failed(source))?;
        self.disk.sync_data().map_err(|e| FileError::new(&self.path, e))?;
        Ok(self.contents)
    }

    fn failed(&self, why: McapError) -> BagError {
        BagError::File(self.path.clone(), text_of(&why))
    }
}

fn options(compression: Compression) -> mcap::WriteOptions {
    let compression = match compression {
        Compression::None => None,
        Compression::Lz4 => Some(mcap::Compression::Lz4),
        Compression::Zstd => Some(mcap::Compression::Zstd),
    };
    // One thread: the same messages are the same bytes on every machine. Chunks are closed here, not by the library,
    // which would leave their end in memory.
    mcap::WriteOptions::new()
        .profile("ros2")
        .library(concat!("modulo ", env!("CARGO_PKG_VERSION")))
        .compression(compression)
        .compression_threads(0)
        .chunk_size(None)
}
