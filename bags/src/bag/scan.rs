//! [`scan`]: walks over the records of an MCAP file, from the start to the last complete one. With an index, the chunks that it
//! knows are passed over, so that only what lies between them is read.
//!
//! A chunk counts as a whole or not at all. Nothing that a broken file claims about lengths is allocated before it is
//! compared with the file's size.

use std::fs::File;
use std::io;
use std::os::unix::fs::FileExt as _;
use std::path::Path;

use mcap::read::ChannelAccumulator;
use mcap::records::{MessageHeader, Record, Statistics, op};
use mcap::{McapError, Summary, parse_record};

use super::chunk::{self, RECORD_HEAD};
use super::extra::Extra;
use super::{BagError, BagWarning};
use crate::FileError;

/// Channel, sequence and two times in front of a message's data.
pub(super) const MESSAGE_HEAD: u64 = 22;

#[derive(Clone, Copy, Debug)]
pub(super) struct UnchunkedMessage {
    pub(super) header: MessageHeader,
    /// Offset of its data in the file.
    pub(super) offset: u64,
    pub(super) length: usize,
}

#[derive(Default)]
pub(super) struct Scan {
    pub(super) summary: Summary,
    /// The messages by log time, then by position in the file.
    pub(super) loose: Vec<UnchunkedMessage>,
    pub(super) extras: Vec<Extra>,
    pub(super) warnings: Vec<BagWarning>,
    /// Whether there is a chunk that the index does not know.
    pub(super) is_index_short: bool,
}

/// Walks over `file`, which is `size` bytes long; `path` is for the warnings.
pub(super) fn scan(path: &Path, file: &File, size: u64, index: Option<&Summary>) -> Result<Scan, BagError> {
    let io = |why| FileError::new(path, why);
    let mut walk = Walk {
        path,
        file,
        size,
        index,
        offset: mcap::MAGIC.len() as u64,
        known: index.map(ChannelAccumulator::from_summary).unwrap_or_default(),
        // The least time so far, so that any message is earlier.
        stats: Statistics { message_start_time: u64::MAX, ..Statistics::default() },
        passed_unknown: false,
        found: Scan::default(),
    };
    let end = walk.walk().map_err(io)?;
    let offset = walk.offset.min(size);
    // The CRC of the data needs the whole file. Chunks have CRCs of their own, and where damage is known it says nothing new.
    let is_read = index.is_none() || !walk.found.loose.is_empty() || walk.passed_unknown;
    let mut scan = walk.finish(offset, end.err());
    if let Ok(saved) = end
        && saved != 0
        && is_read
        && !scan.warnings.iter().any(BagWarning::is_loss)
        && crc_of(file, 0, offset).map_err(io)? != saved
    {
        scan.warnings.push(BagWarning::contradiction(path, "the CRC of its data is wrong"));
    }
    Ok(scan)
}

pub(super) fn crc_of(file: &File, start: u64, end: u64) -> io::Result<u32> {
    let (mut hasher, mut bytes, mut at) = (crc32fast::Hasher::new(), vec![0; 1 << 16], start);
    while at < end {
        let most = usize::try_from(end - at).unwrap_or(usize::MAX).min(bytes.len());
        file.read_exact_at(&mut bytes[..most], at)?;
        hasher.update(&bytes[..most]);
        at += most as u64;
    }
    Ok(hasher.finalize())
}

/// The CRC of the data, at their end, or why a walk cannot go on before it.
type WalkEnd = Result<u32, &'static str>;

/// A record, or what stands in place of one.
enum Step {
    Record { opcode: u8, length: u64 },
    End(WalkEnd),
}

struct Walk<'a> {
    path: &'a Path,
    file: &'a File,
    size: u64,
    index: Option<&'a Summary>,
    offset: u64,
    known: ChannelAccumulator<'static>,
    stats: Statistics,
    /// Whether records that no version of MCAP defines were passed over.
    passed_unknown: bool,
    found: Scan,
}

impl Walk<'_> {
    fn walk(&mut self) -> io::Result<WalkEnd> {
        let mut chunks = self.index.map_or(&[][..], |index| &index.chunk_indexes).iter().peekable();
        loop {
            if let Some(chunk) = chunks.next_if(|chunk| chunk.chunk_start_offset == self.offset) {
                self.offset = chunk::end_of(chunk);
                continue;
            }
            let next = chunks.peek().map(|chunk| chunk.chunk_start_offset);
            match (self.step(next.unwrap_or(self.size))?, next) {
                (Step::Record { opcode, length }, _) => self.record(opcode, length),
                (Step::End(end), None) => return Ok(end),
                // The index knows where the next chunk begins, whatever is broken before it.
                (Step::End(end), Some(next)) => {
                    self.skip(end.err().unwrap_or("an end of the data before their end"));
                    self.offset = next;
                }
            }
        }
    }

    /// Looks at the record at the present offset, which has to end before `limit`.
    fn step(&self, limit: u64) -> io::Result<Step> {
        let broken = |why| Ok(Step::End(Err(why)));
        let Some(left) = limit.checked_sub(self.offset + RECORD_HEAD) else {
            return broken(match self.size {
                0 => "the file is empty: its recorder has written nothing",
                size if self.offset >= size => "no end of data",
                _ => "it ends within a record",
            });
        };
        let mut head = [0; RECORD_HEAD as usize];
        self.file.read_exact_at(&mut head, self.offset)?;
        let [opcode, length @ ..] = head;
        let length = u64::from_le_bytes(length);
        match opcode {
            // No record has this opcode: blocks of zeros are the trace of a power cut.
            0 => broken("zeros"),
            _ if length > left => broken("a record is longer than what is left"),
            op::DATA_END if length >= 4 => {
                let mut crc = [0; 4];
                self.file.read_exact_at(&mut crc, self.offset + RECORD_HEAD)?;
                Ok(Step::End(Ok(u32::from_le_bytes(crc))))
            }
            op::DATA_END | op::FOOTER => broken("no end of data"),
            _ => Ok(Step::Record { opcode, length }),
        }
    }

    fn skip(&mut self, why: &str) {
        self.found.warnings.push(BagWarning::skipped(self.path, self.offset, why));
    }

    fn record(&mut self, opcode: u8, length: u64) {
        match self.take(opcode, length) {
            Ok(()) => {}
            Err(why) if opcode == op::CHUNK => {
                let left_out = chunk::left_out(self.path, self.offset, None, &why);
                self.found.warnings.push(BagWarning::LeftOut(left_out));
            }
            Err(why) => self.skip(&chunk::text_of(&why)),
        }
        // A record that is skipped still has its length, so the scan continues behind it.
        self.offset += RECORD_HEAD + length;
    }

    fn take(&mut self, opcode: u8, length: u64) -> Result<(), McapError> {
        match opcode {
            op::SCHEMA | op::CHANNEL => {
                let record = chunk::bytes_at(self.file, self.offset + RECORD_HEAD, length)?;
                self.define(parse_record(opcode, &record)?.into_owned())
            }
            op::MESSAGE => self.message(length),
            op::CHUNK if self.index.is_some() => {
                self.found.is_index_short = true;
                Ok(())
            }
            op::CHUNK => self.chunk(length),
            // Later versions of MCAP, or a broken opcode.
            0x10..0x80 => Err(chunk::fault(&format!("its opcode {opcode:#04x} is unknown"))),
            op::ATTACHMENT | op::METADATA | 0x80.. => {
                self.passed_unknown |= opcode >= 0x80;
                self.found.extras.extend(Extra::find(self.file, opcode, self.offset + RECORD_HEAD, length)?);
                Ok(())
            }
            // Indexes are not needed to read messages.
            _ => Ok(()),
        }
    }

    fn define(&mut self, record: Record<'static>) -> Result<(), McapError> {
        let id = if let Record::Channel(channel) = &record { Some(channel.id) } else { None };
        chunk::define(&mut self.known, record)?;
        let added = id.filter(|_| self.index.is_none()).and_then(|id| Some((id, self.known.get(id)?)));
        self.found.summary.channels.extend(added);
        Ok(())
    }

    fn message(&mut self, length: u64) -> Result<(), McapError> {
        let data = length.checked_sub(MESSAGE_HEAD).ok_or(McapError::UnexpectedEof)?;
        let mut head = [0; MESSAGE_HEAD as usize];
        self.file.read_exact_at(&mut head, self.offset + RECORD_HEAD)?;
        // The opcode tells the record; the pattern only satisfies the type.
        let Record::Message { header, .. } = parse_record(op::MESSAGE, &head)? else { return Ok(()) };
        self.count(header.channel_id, header.log_time)?;
        self.found.loose.push(UnchunkedMessage {
            header,
            offset: self.offset + RECORD_HEAD + MESSAGE_HEAD,
            length: usize::try_from(data).map_err(|_| McapError::ChunkTooLarge(data))?,
        });
        Ok(())
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
    fn chunk(&mut self, length: u64) -> Result<(), McapError> {
        let record = chunk::bytes_at(self.file, self.offset, RECORD_HEAD + length)?;
        let mut found = chunk::index_of(self.offset, &record)?;
        let mut messages = Vec::new();
        chunk::unpack(&found, &record, |record| match record {
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
        // The times of its head have no CRC.
        found.message_start_time = messages.iter().map(|m| m.1).min().unwrap_or_default();
        found.message_end_time = messages.iter().map(|m| m.1).max().unwrap_or_default();
        self.found.summary.chunk_indexes.push(found);
        Ok(())
    }

    /// Returns what was found up to `offset`, where the walk has ended; before the end of the data because of `why`.
    fn finish(self, offset: u64, why: Option<&str>) -> Scan {
        let (path, messages, mut found) = (self.path, self.stats.message_count, self.found);
        // The sort is stable, so messages of one time stay in the order of the file.
        found.loose.sort_by_key(|message| message.header.log_time);
        if let Some(index) = self.index {
            found.warnings.extend(why.map(|why| BagWarning::skipped(path, offset, why)));
            found.summary = index.clone();
            return found;
        }
        let scanned = "no index that is whole, the whole file was scanned".to_owned();
        found.warnings.push(match why {
            Some(why) => BagWarning::truncated(path, offset, why, messages),
            None => BagWarning::Remark(path.to_owned(), scanned),
        });
        found.summary.stats = Some(self.stats);
        found
    }
}
