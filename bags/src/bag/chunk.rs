//! The chunks of an MCAP file: a chunk is checked as a whole, by its CRC, before any message of it is handed out.

use std::fs::File;
use std::io::{self, Read as _};
use std::os::unix::fs::FileExt as _;
use std::path::Path;

use mcap::read::ChannelAccumulator;
use mcap::records::{ChunkIndex, Record, op};
use mcap::sans_io::{LinearReadEvent, LinearReader, LinearReaderOptions};
use mcap::{McapError, parse_record};

use super::LeftOut;

/// No chunk may unpack to more, bytes: recorders write a few MiB.
pub(super) const MAX_CHUNK: usize = 1 << 30;
/// Opcode and length in front of every record.
pub(super) const RECORD_HEAD: u64 = 9;
/// A chunk's times, size, CRC and lengths in front of its data, without the name of its compression.
const CHUNK_HEAD: u64 = 40;
/// Place of the CRC in the record of a chunk.
const CRC: std::ops::Range<usize> = 33..37;

/// Returns the report of the chunk at `byte`, `messages` of which cannot be read.
pub(super) fn left_out(path: &Path, byte: u64, messages: Option<u64>, why: &McapError) -> LeftOut {
    LeftOut { path: path.to_owned(), place: format!("the chunk at byte {byte}"), messages, why: text_of(why) }
}

/// Returns the text of an error, with its cause where the library leaves that out.
pub(super) fn text_of(why: &McapError) -> String {
    match why {
        McapError::Io(why) => why.to_string(),
        McapError::Parse(why) => format!("it cannot be parsed: {}", why.root_cause()),
        why => why.to_string(),
    }
}

pub(super) fn fault(why: &str) -> McapError {
    io::Error::other(why).into()
}

/// Returns the place behind a chunk and its message indexes; it never passes the end of the numbers.
pub(super) fn end_of(chunk: &ChunkIndex) -> u64 {
    chunk.chunk_start_offset.saturating_add(chunk.chunk_length).saturating_add(chunk.message_index_length)
}

pub(super) fn is_consistent(chunk: &ChunkIndex) -> bool {
    let head = RECORD_HEAD + CHUNK_HEAD + chunk.compression.len() as u64;
    head.checked_add(chunk.compressed_size) == Some(chunk.chunk_length)
}

/// Returns the index of the chunk `record`, which begins at `offset` of its file, from what it says of itself.
pub(super) fn index_of(offset: u64, record: &[u8]) -> Result<ChunkIndex, McapError> {
    let Record::Chunk { header, .. } = parse_record(op::CHUNK, &record[RECORD_HEAD as usize..])? else {
        return Err(McapError::BadIndex);
    };
    let chunk = ChunkIndex {
        message_start_time: header.message_start_time,
        message_end_time: header.message_end_time,
        chunk_start_offset: offset,
        chunk_length: record.len() as u64,
        message_index_offsets: Default::default(),
        message_index_length: 0,
        compression: header.compression,
        compressed_size: header.compressed_size,
        uncompressed_size: header.uncompressed_size,
    };
    if is_consistent(&chunk) {
        return Ok(chunk);
    }
    let available =
        chunk.chunk_length.saturating_sub(RECORD_HEAD + CHUNK_HEAD + chunk.compression.len() as u64);
    Err(McapError::BadChunkLength { header: chunk.compressed_size, available })
}

/// Returns whether the chunk `record` has a CRC: 0 stands for none.
pub(super) fn has_crc(record: &[u8]) -> bool {
    record[CRC] != [0; 4]
}

/// Reads a part of a file that is no longer than a chunk may be.
pub(super) fn bytes_at(file: &File, offset: u64, length: u64) -> Result<Vec<u8>, McapError> {
    let most = usize::try_from(length).ok().filter(|&length| length <= MAX_CHUNK);
    let mut bytes = vec![0; most.ok_or(McapError::ChunkTooLarge(length))?];
    file.read_exact_at(&mut bytes, offset)?;
    Ok(bytes)
}

/// Reads the record of a chunk, and whether its head had to be replaced by that of the index: then the data decide by their CRC.
pub(super) fn read(file: &File, chunk: &ChunkIndex) -> Result<(Vec<u8>, bool), McapError> {
    let mut record = bytes_at(file, chunk.chunk_start_offset, chunk.chunk_length)?;
    let mut head = vec![op::CHUNK];
    head.extend((chunk.chunk_length - RECORD_HEAD).to_le_bytes());
    for number in [chunk.message_start_time, chunk.message_end_time, chunk.uncompressed_size] {
        head.extend(number.to_le_bytes());
    }
    head.extend(&record[CRC]);
    head.extend((chunk.compression.len() as u32).to_le_bytes());
    head.extend(chunk.compression.as_bytes());
    head.extend(chunk.compressed_size.to_le_bytes());
    let is_checked = has_crc(&record);
    let (own, _) = record.split_at_mut(head.len());
    let is_replaced = own != head;
    if is_replaced && !is_checked {
        return Err(fault("its head is not that of the index, and it has no CRC"));
    }
    own.copy_from_slice(&head);
    Ok((record, is_replaced))
}

/// Hands each record inside the chunk `record` to `take`; an error of the CRC comes at the end.
///
/// `mcap::read::ChunkReader` is not used because it allocates whatever length a damaged record claims.
pub(super) fn unpack(
    chunk: &ChunkIndex,
    mut record: &[u8],
    mut take: impl FnMut(Record<'_>) -> Result<(), McapError>,
) -> Result<(), McapError> {
    // The head may claim any size; the limit holds before the library allocates it.
    let unpacked = usize::try_from(chunk.uncompressed_size).unwrap_or(usize::MAX);
    if unpacked > MAX_CHUNK {
        return Err(McapError::ChunkTooLarge(chunk.uncompressed_size));
    }
    let options = LinearReaderOptions::default()
        .with_skip_start_magic(true)
        .with_skip_end_magic(true)
        .with_validate_chunk_crcs(true)
        .with_record_length_limit(unpacked.max(record.len()));
    let mut reader = LinearReader::new_with_options(options);
    while let Some(event) = reader.next_event() {
        match event? {
            LinearReadEvent::ReadRequest(need) => {
                let read = record.read(reader.insert(need))?;
                reader.notify_read(read);
            }
            LinearReadEvent::Record { data, opcode } => take(parse_record(opcode, data)?)?,
        }
    }
    Ok(())
}

/// Notes a schema or a channel; what contradicts an earlier one is an error. Any other record is passed over.
pub(super) fn define(
    known: &mut ChannelAccumulator<'static>,
    record: Record<'static>,
) -> Result<(), McapError> {
    match record {
        Record::Schema { header, data } => known.add_schema(header, data),
        Record::Channel(channel) => known.add_channel(channel),
        _ => Ok(()),
    }
}

/// Returns how many messages of the `wanted` channels the message indexes behind a chunk count; `None` where they are missing or
/// broken.
pub(super) fn count(file: &File, chunk: &ChunkIndex, wanted: impl Fn(u16) -> bool) -> Option<u64> {
    let mut messages = 0;
    for (&channel, &offset) in chunk.message_index_offsets.iter().filter(|(channel, _)| wanted(**channel)) {
        // Opcode, length, channel and the length of the list, each entry of which has 16 bytes.
        let mut head = [0; 15];
        file.read_exact_at(&mut head, offset).ok()?;
        let own = u16::from_le_bytes([head[9], head[10]]);
        let list = u64::from(u32::from_le_bytes([head[11], head[12], head[13], head[14]]));
        if head[0] != op::MESSAGE_INDEX || own != channel || list % 16 != 0 {
            return None;
        }
        messages += list / 16;
    }
    Some(messages).filter(|_| !chunk.message_index_offsets.is_empty())
}
