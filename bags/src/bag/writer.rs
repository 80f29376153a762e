//! [`BagWriter`]: a bag folder as `ros2 bag record` writes it.
//!
//! At least once a second of log time everything so far is a whole chunk on
//! the disk: what a reader finds after a crash or a power cut. No clock is
//! read; a bag is never overwritten.

use std::collections::{BTreeMap, HashMap};
use std::fs::File;
use std::io::BufWriter;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use mcap::records::{MessageHeader, Metadata as MetadataRecord};

use super::metadata::{self, Contents};
use super::{BagError, BagTopic, TopicCount, qos};

/// Chunks are closed at this size, bytes.
const CHUNK: u64 = 4 << 20;
/// Log time between two flushes, ns.
const FLUSH_EVERY: u64 = 1_000_000_000;

/// How chunks are compressed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Compression {
    /// As rosbag2 does by default: fastest.
    #[default]
    None,
    /// Fast, moderately small.
    Lz4,
    /// Slower, smaller.
    Zstd,
}

/// A topic of the [`BagWriter`] that gave it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct TopicId(usize);

/// A bag that is being written.
pub struct BagWriter {
    folder: PathBuf,
    path: PathBuf,
    file_name: String,
    mcap: mcap::Writer<BufWriter<File>>,
    disk: File,
    topics: Vec<TopicCount>,
    channels: Vec<u16>,
    by_name: HashMap<String, TopicId>,
    span: Option<(u64, u64)>,
    flushed: u64,
}

impl BagWriter {
    /// Makes the folder `folder` and `<name>_0.mcap` in it.
    ///
    /// # Errors
    /// [`BagError::Exists`] when `folder` is there, [`BagError`] when it cannot
    /// be made.
    pub fn create(folder: &Path, compression: Compression) -> Result<Self, BagError> {
        let name = folder.file_name().ok_or_else(|| BagError::Name { path: folder.to_owned() })?;
        let file_name = format!("{}_0.mcap", name.to_string_lossy());
        make_folder(folder)?;
        let path = folder.join(&file_name);
        let file = File::create_new(&path).map_err(|e| BagError::io(&path, e))?;
        let disk = file.try_clone().map_err(|e| BagError::io(&path, e))?;
        let mcap = options(compression)
            .create(BufWriter::new(file))
            .map_err(|source| BagError::Write { path: path.clone(), source })?;
        Ok(Self {
            folder: folder.to_owned(),
            path,
            file_name,
            mcap,
            disk,
            topics: Vec::new(),
            channels: Vec::new(),
            by_name: HashMap::new(),
            span: None,
            flushed: 0,
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
            return Err(BagError::TypeConflict { topic, known, given });
        }
        let channel = self.add_channel(topic).map_err(|source| self.failed(source))?;
        let id = TopicId(self.topics.len());
        self.topics.push(TopicCount { topic: Arc::new(topic.clone()), messages: 0 });
        self.channels.push(channel);
        self.by_name.insert(topic.name.clone(), id);
        Ok(id)
    }

    fn add_channel(&mut self, topic: &BagTopic) -> Result<u16, mcap::McapError> {
        let schema = self.mcap.add_schema(&topic.type_name, &topic.schema_encoding, &topic.schema)?;
        let metadata = BTreeMap::from([
            ("offered_qos_profiles".to_owned(), qos::in_words(&topic.qos)),
            ("topic_type_hash".to_owned(), topic.type_hash.clone()),
        ]);
        self.mcap.add_channel(schema, &topic.name, "cdr", &metadata)
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
        let known = self.channels.len();
        let (Some(&channel_id), Some(counted)) = (self.channels.get(id.0), self.topics.get_mut(id.0)) else {
            return Err(BagError::UnknownTopic { number: id.0, known });
        };
        counted.messages += 1;
        let header = MessageHeader { channel_id, sequence: 0, log_time, publish_time };
        let written = self.mcap.write_to_known_channel(&header, data);
        written.map_err(|source| self.failed(source))?;
        let (start, end) = self.span.unwrap_or((log_time, log_time));
        if self.span.is_none() {
            self.flushed = log_time;
        }
        self.span = Some((start.min(log_time), end.max(log_time)));
        if log_time.abs_diff(self.flushed) >= FLUSH_EVERY {
            self.flushed = log_time;
            self.flush()?;
        }
        Ok(())
    }

    /// Closes the chunk and has the disk confirm all that was written so far.
    ///
    /// # Errors
    /// [`BagError`] when the disk does not take it.
    pub fn flush(&mut self) -> Result<(), BagError> {
        self.mcap.flush().map_err(|source| self.failed(source))?;
        self.disk.sync_data().map_err(|e| BagError::io(&self.path, e))
    }

    /// The topics so far with their counts, in the order they were added.
    pub fn topics(&self) -> &[TopicCount] {
        &self.topics
    }

    /// Writes the index and `metadata.yaml`; without this the bag is one that
    /// was cut. Returns the counts.
    ///
    /// # Errors
    /// [`BagError`] when the disk does not take it.
    pub fn finish(mut self) -> Result<Vec<TopicCount>, BagError> {
        let contents = Contents { file: &self.file_name, span: self.span, topics: &self.topics };
        let record = MetadataRecord {
            name: "rosbag2".to_owned(),
            metadata: BTreeMap::from([("serialized_metadata".to_owned(), metadata::mapping(&contents))]),
        };
        let document = metadata::document(&contents);
        let finished = self.mcap.write_metadata(&record).and_then(|()| self.mcap.finish().map(drop));
        finished.map_err(|source| self.failed(source))?;
        self.disk.sync_data().map_err(|e| BagError::io(&self.path, e))?;
        let path = self.folder.join(metadata::FILE_NAME);
        std::fs::write(&path, document).map_err(|e| BagError::io(&path, e))?;
        Ok(self.topics)
    }

    fn failed(&self, source: mcap::McapError) -> BagError {
        BagError::Write { path: self.path.clone(), source }
    }
}

fn make_folder(folder: &Path) -> Result<(), BagError> {
    if let Some(parent) = folder.parent() {
        std::fs::create_dir_all(parent).map_err(|e| BagError::io(parent, e))?;
    }
    std::fs::create_dir(folder).map_err(|e| match e.kind() {
        std::io::ErrorKind::AlreadyExists => BagError::Exists { path: folder.to_owned() },
        _ => BagError::io(folder, e),
    })
}

fn options(compression: Compression) -> mcap::WriteOptions {
    let compression = match compression {
        Compression::None => None,
        Compression::Lz4 => Some(mcap::Compression::Lz4),
        Compression::Zstd => Some(mcap::Compression::Zstd),
    };
    // One thread: the same messages are the same bytes on every machine.
    mcap::WriteOptions::new()
        .profile("ros2")
        .library(concat!("modulo ", env!("CARGO_PKG_VERSION")))
        .compression(compression)
        .compression_threads(0)
        .chunk_size(Some(CHUNK))
}
