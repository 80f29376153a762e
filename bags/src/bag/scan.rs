//! [`scan`]: makes the summary of an MCAP file without one from its records, from the start to the last complete one.
//!
//! A chunk counts as a whole or not at all. Nothing that a broken file claims about lengths is allocated before it is
//! compared with the file's size.

use std::fs::File;
use std::io::Read;
use std::path::Path;
use std::sync::Arc;

use mcap::read::ChannelAccumulator;
use mcap::records::{ChunkHeader, ChunkIndex, Record, Statistics, op};
use mcap::sans_io::{LinearReadEvent, LinearReader, LinearReaderOptions};
use mcap::{McapError, Summary, parse_record};

use super::{BagError, BagWarning};
use crate::FileError;

/// No chunk may unpack to more, bytes: recorders write a few MiB.
pub(super) const MAX_CHUNK: usize = 1 << 30;

/// Opcode and length in front of every record.
const RECORD_HEAD: u64 = 9;
/// A chunk's times, size, CRC and lengths in front of its data, without the name of its compression.
const CHUNK_HEAD: u64 = 40;
/// Channel, sequence and two times in front of a message's data.
const MESSAGE_HEAD: u64 = 22;

/// A message outside of any chunk.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct UnchunkedMessage {
    pub(super) channel: u16,
    pub(super) log_time: u64,
    pub(super) publish_time: u64,
    /// Offset of its data in the file.
    pub(super) offset: u64,
    pub(super) length: usize,
}

/// The result of a scan.
pub(super) struct Scan {
    pub(super) summary: Summary,
    /// The messages by log time, then by position in the file.
    pub(super) loose: Vec<UnchunkedMessage>,
    pub(super) warnings: Vec<BagWarning>,
}

/// Walks over `file`, which is `size` bytes long; `path` is for the warnings.
pub(super) fn scan(path: &Path, mut file: File, size: u64) -> Result<Scan, BagError> {
    // No record is longer than its file, so a broken length is found before memory is allocated for it.
    let limit = usize::try_from(size).unwrap_or(usize::MAX);
    let options = LinearReaderOptions::default()
        .with_emit_chunks(true)
        .with_skip_end_magic(true)
        .with_record_length_limit(limit);
    let mut reader = LinearReader::new_with_options(options);
    let mut walk = Walk::new(path);
    let end = loop {
        match reader.next_event() {
            None => break Some("no end of data".to_owned()),
            Some(Err(McapError::BadMagic)) => return Err(BagError::NotBag(path.to_owned())),
            Some(Err(e)) => break Some(e.to_string()),
            Some(Ok(LinearReadEvent::ReadRequest(need))) => {
                let read = file.read(reader.insert(need)).map_err(|e| FileError::new(path, e))?;
                reader.notify_read(read);
            }
            Some(Ok(LinearReadEvent::Record { opcode: op::DATA_END, .. })) => break None,
            // No record has this opcode: blocks of zeros are the trace of a power cut.
            Some(Ok(LinearReadEvent::Record { opcode: 0, .. })) => break Some("zeros".to_owned()),
            Some(Ok(LinearReadEvent::Record { data, opcode })) => walk.record(opcode, data),
        }
    };
    Ok(walk.finish(end))
}

struct Walk<'a> {
    path: &'a Path,
    offset: u64,
    known: ChannelAccumulator<'static>,
    stats: Statistics,
    chunks: Vec<ChunkIndex>,
    channels: Vec<u16>,
    loose: Vec<UnchunkedMessage>,
    warnings: Vec<BagWarning>,
}

impl<'a> Walk<'a> {
    fn new(path: &'a Path) -> Self {
        let stats = Statistics {
            message_count: 0,
            schema_count: 0,
            channel_count: 0,
            attachment_count: 0,
            metadata_count: 0,
            chunk_count: 0,
            // The least time so far, so that any message is earlier.
            message_start_time: u64::MAX,
            message_end_time: 0,
            channel_message_counts: Default::default(),
        };
        Self {
            path,
            offset: mcap::MAGIC.len() as u64,
            known: ChannelAccumulator::default(),
            stats,
            chunks: Vec::new(),
            channels: Vec::new(),
            loose: Vec::new(),
            warnings: Vec::new(),
        }
    }

    fn record(&mut self, opcode: u8, body: &[u8]) {
        let length = RECORD_HEAD + body.len() as u64;
        if let Err(e) = self.take(opcode, body, length) {
            let (path, byte, why) = (self.path.to_owned(), self.offset, e.to_string());
            self.warnings.push(BagWarning::Skipped { path, byte, why });
        }
        // A record that is skipped still has its length, so the scan continues behind it.
        self.offset += length;
    }

    fn take(&mut self, opcode: u8, body: &[u8], length: u64) -> Result<(), McapError> {
        match opcode {
            op::SCHEMA | op::CHANNEL => self.define(parse_record(opcode, body)?.into_owned()),
            op::MESSAGE => {
                // The opcode tells the record; the pattern only satisfies the type.
                let Record::Message { header, data } = parse_record(opcode, body)? else { return Ok(()) };
                self.count(header.channel_id, header.log_time)?;
                self.loose.push(UnchunkedMessage {
                    channel: header.channel_id,
                    log_time: header.log_time,
                    publish_time: header.publish_time,
                    offset: self.offset + RECORD_HEAD + MESSAGE_HEAD,
                    length: data.len(),
                });
                Ok(())
            }
            op::CHUNK => match parse_record(opcode, body)? {
                Record::Chunk { header, .. } => self.chunk(header, body, length),
                _ => Ok(()),
            },
            // Attachments, metadata and indexes are not needed to read messages.
            _ => Ok(()),
        }
    }

    fn define(&mut self, record: Record<'static>) -> Result<(), McapError> {
        match record {
            Record::Schema { header, data } => self.known.add_schema(header, data),
            Record::Channel(channel) => {
                self.channels.push(channel.id);
                self.known.add_channel(channel)
            }
            _ => Ok(()),
        }
    }

    fn count(&mut self, channel: u16, log_time: u64) -> Result<(), McapError> {
        if self.known.get(channel).is_none() {
            return Err(McapError::UnknownChannel(0, channel));
        }
        self.stats.message_count += 1;
        *self.stats.channel_message_counts.entry(channel).or_default() += 1;
        self.stats.message_start_time = self.stats.message_start_time.min(log_time);
        self.stats.message_end_time = self.stats.message_end_time.max(log_time);
        Ok(())
    }

    /// Reads all of a chunk before any of it counts.
    fn chunk(&mut self, header: ChunkHeader, body: &[u8], length: u64) -> Result<(), McapError> {
        let mut messages = Vec::new();
        unpack(&header, body, |record| match record {
            Record::Message { header, .. } => {
                messages.push((header.channel_id, header.log_time));
                Ok(())
            }
            record => self.define(record.into_owned()),
        })?;
        // Found before anything is counted: half of a chunk must not be in the statistics.
        if let Some(&(unknown, _)) = messages.iter().find(|(id, _)| self.known.get(*id).is_none()) {
            return Err(McapError::UnknownChannel(0, unknown));
        }
        for &(channel, log_time) in &messages {
            self.count(channel, log_time)?;
        }
        self.stats.chunk_count += 1;
        self.chunks.push(ChunkIndex {
            message_start_time: messages.iter().map(|m| m.1).min().unwrap_or_default(),
            message_end_time: messages.iter().map(|m| m.1).max().unwrap_or_default(),
            chunk_start_offset: self.offset,
            chunk_length: length,
            message_index_offsets: Default::default(),
            message_index_length: 0,
            compression: header.compression,
            compressed_size: header.compressed_size,
            uncompressed_size: header.uncompressed_size,
        });
        Ok(())
    }

    fn finish(mut self, end: Option<String>) -> Scan {
        let path = self.path.to_owned();
        let messages = self.stats.message_count;
        self.warnings.push(match end {
            Some(why) => BagWarning::Truncated { path, byte: self.offset, why, messages },
            None => BagWarning::NoIndex(path),
        });
        // The sort is stable, so messages of one time stay in the order of the file.
        self.loose.sort_by_key(|message| message.log_time);
        let channels = self.channels.iter().filter_map(|&id| Some((id, self.known.get(id)?)));
        let mut summary = Summary { chunk_indexes: self.chunks, ..Summary::default() };
        summary.channels = channels.map(|(id, channel)| (id, Arc::clone(&channel))).collect();
        summary.stats = Some(self.stats);
        Scan { summary, loose: self.loose, warnings: self.warnings }
    }
}

/// Hands each record inside a chunk to `take`; `body` is the chunk's record.
///
/// `mcap::read::ChunkReader` is not used because it allocates whatever length a damaged record claims.
fn unpack(
    header: &ChunkHeader,
    body: &[u8],
    mut take: impl FnMut(Record<'_>) -> Result<(), McapError>,
) -> Result<(), McapError> {
    let available = (body.len() as u64).saturating_sub(CHUNK_HEAD + header.compression.len() as u64);
    if header.compressed_size != available {
        return Err(McapError::BadChunkLength { header: header.compressed_size, available });
    }
    // The header may claim any size; the limit holds before the library allocates it.
    let unpacked = usize::try_from(header.uncompressed_size).unwrap_or(usize::MAX);
    if unpacked > MAX_CHUNK {
        return Err(McapError::ChunkTooLarge(header.uncompressed_size));
    }
    let options = LinearReaderOptions::default()
        .with_skip_start_magic(true)
        .with_skip_end_magic(true)
        .with_validate_chunk_crcs(true)
        .with_record_length_limit(unpacked.max(body.len()));
    let mut reader = LinearReader::new_with_options(options);
    let length = (body.len() as u64).to_le_bytes();
    // The reader expects a whole record, whose opcode and length the scan has taken off.
    let mut rest = [op::CHUNK][..].chain(&length[..]).chain(body);
    while let Some(event) = reader.next_event() {
        match event? {
            LinearReadEvent::ReadRequest(need) => {
                let read = rest.read(reader.insert(need))?;
                reader.notify_read(read);
            }
            LinearReadEvent::Record { data, opcode } => take(parse_record(opcode, data)?)?,
        }
    }
    Ok(())
}
