//! [`Extra`]: what an MCAP file holds beside its messages, such as a calibration. It is found by a look at the heads of the records, and copied
//! without ever being in memory as a whole.

use std::fmt;
use std::fs::File;
use std::io::BufWriter;
use std::os::unix::fs::FileExt as _;

use mcap::records::{AttachmentHeader, Record, op};
use mcap::{McapError, McapResult, parse_record};

use super::chunk::{bytes_at, fault};
use super::scan::crc_of;

/// No name or media type is longer, bytes.
const LONGEST_HEAD: u64 = 1 << 16;
/// Bytes that are copied at once.
const PIECE: u64 = 1 << 20;
/// Name of the record in which rosbag2 describes the file that it stands in, which is written anew for each file.
const OF_FILE: &str = "rosbag2";

/// A record beside the messages of an MCAP file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Extra {
    /// What it is.
    pub kind: ExtraKind,
    /// Its place in the file, without opcode and length.
    offset: u64,
    length: u64,
}

/// The kinds of records beside the messages.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum ExtraKind {
    /// A file, such as a calibration.
    Attachment {
        /// Its name.
        name: String,
        /// Its media type, such as `application/yaml`.
        media_type: String,
        /// Its size, bytes.
        size: u64,
    },
    /// Names with values, such as a description of the drive.
    Metadata {
        /// The name of the record.
        name: String,
    },
    /// A record of an application with this opcode.
    Private(u8),
}

impl Extra {
    /// Returns the record of `length` bytes at `offset`, behind its opcode and length; `None` for one that only describes its file.
    pub(super) fn find(file: &File, opcode: u8, offset: u64, length: u64) -> Result<Option<Self>, McapError> {
        let mut head = vec![0; length.min(LONGEST_HEAD) as usize];
        file.read_exact_at(&mut head, offset)?;
        let kind = match opcode {
            op::ATTACHMENT => attachment(&head, length),
            op::METADATA => text(&mut &head[..]).map(|name| ExtraKind::Metadata { name }),
            opcode => Some(ExtraKind::Private(opcode)),
        };
        let kind = kind.ok_or_else(|| fault("its lengths are wrong, or its name is not UTF-8"))?;
        let is_of_file = matches!(&kind, ExtraKind::Metadata { name } if name == OF_FILE);
        Ok((!is_of_file).then_some(Self { kind, offset, length }))
    }

    /// Checks the record as far as its bytes tell.
    ///
    /// # Errors
    /// The fault of a record that cannot be copied.
    pub(super) fn check(&self, file: &File) -> Result<(), McapError> {
        let ExtraKind::Attachment { .. } = self.kind else {
            return self.read(file).map(drop);
        };
        let (mut saved, end) = ([0; 4], self.offset + self.length - 4);
        file.read_exact_at(&mut saved, end)?;
        // 0 stands for no CRC.
        match u32::from_le_bytes(saved) {
            0 => Ok(()),
            saved if saved == crc_of(file, self.offset, end)? => Ok(()),
            _ => Err(fault("its CRC is wrong")),
        }
    }

    /// Writes the record, which [`Extra::check`] has checked, into another file.
    pub(super) fn copy(&self, file: &File, out: &mut mcap::Writer<BufWriter<File>>) -> McapResult<()> {
        match &self.kind {
            ExtraKind::Attachment { name, media_type, size } => {
                let mut times = [0; 16];
                file.read_exact_at(&mut times, self.offset)?;
                let time =
                    |at: usize| times[at..at + 8].try_into().map(u64::from_le_bytes).expect("eight bytes");
                let (name, media_type) = (name.clone(), media_type.clone());
                let header = AttachmentHeader { log_time: time(0), create_time: time(8), name, media_type };
                out.start_attachment(*size, header)?;
                let end = self.offset + self.length - 4;
                let mut at = end - size;
                while at < end {
                    let mut piece = vec![0; PIECE.min(end - at) as usize];
                    file.read_exact_at(&mut piece, at)?;
                    out.put_attachment_bytes(&piece)?;
                    at += piece.len() as u64;
                }
                out.finish_attachment()
            }
            _ => match self.read(file)? {
                Record::Metadata(record) => out.write_metadata(&record),
                Record::Unknown { opcode, data } => {
                    out.write_private_record(opcode, &data, Default::default())
                }
                _ => unreachable!("the opcode tells the record"),
            },
        }
    }

    /// Reads a record that is no attachment.
    fn read(&self, file: &File) -> Result<Record<'static>, McapError> {
        let bytes = bytes_at(file, self.offset, self.length)?;
        let opcode = if let ExtraKind::Private(opcode) = self.kind { opcode } else { op::METADATA };
        Ok(parse_record(opcode, &bytes)?.into_owned())
    }
}

/// Reads the head of an attachment whose record has `length` bytes.
fn attachment(head: &[u8], length: u64) -> Option<ExtraKind> {
    // Behind its two times.
    let mut rest = head.get(16..)?;
    let (name, media_type) = (text(&mut rest)?, text(&mut rest)?);
    let size = u64::from_le_bytes(*rest.first_chunk()?);
    // The length of the data, and the CRC behind them.
    let before = (head.len() - rest.len() + 8) as u64;
    let is_right = before.checked_add(size).and_then(|end| end.checked_add(4)) == Some(length);
    is_right.then_some(ExtraKind::Attachment { name, media_type, size })
}

/// Takes a text with its length off the front of `bytes`.
fn text(bytes: &mut &[u8]) -> Option<String> {
    let (length, rest) = bytes.split_first_chunk()?;
    let (text, rest) = rest.split_at_checked(u32::from_le_bytes(*length) as usize)?;
    *bytes = rest;
    String::from_utf8(text.to_owned()).ok()
}

impl fmt::Display for Extra {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match &self.kind {
            ExtraKind::Attachment { name, .. } => write!(f, "attachment '{name}'"),
            ExtraKind::Metadata { name } => write!(f, "metadata record '{name}'"),
            ExtraKind::Private(opcode) => write!(f, "private record {opcode:#04x}"),
        }
    }
}
