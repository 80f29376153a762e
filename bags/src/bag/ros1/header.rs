//! The header of a ROS 1 bag: where its chunks begin and end. The crate `rosbag`
//! takes these for granted, and panics where they are beyond the file.

/// `#ROSBAG V2.0` and a line feed.
const MAGIC: &[u8] = b"#ROSBAG V2.0\n";

/// Checks that the bag of `size` bytes that begins with `start` was closed and
/// is as long as its header says.
pub(super) fn check(start: &[u8], size: u64) -> Result<(), String> {
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

/// A length of 4 bytes and so many bytes, and what is behind.
fn block(bytes: &[u8]) -> Option<(&[u8], &[u8])> {
    let (length, rest) = bytes.split_first_chunk::<4>()?;
    rest.split_at_checked(usize::try_from(u32::from_le_bytes(*length)).ok()?)
}

/// The value of a `name=value` in a header.
fn field<'a>(mut header: &'a [u8], name: &[u8]) -> Option<&'a [u8]> {
    while let Some((entry, rest)) = block(header) {
        if let Some(value) = entry.strip_prefix(name).and_then(|value| value.strip_prefix(b"=")) {
            return Some(value);
        }
        header = rest;
    }
    None
}
