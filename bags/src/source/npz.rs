//! [`array`]: an array of bytes in an archive of numpy (`.npz`), which is a ZIP file of `.npy` files.

use std::error::Error;
use std::io::Read;

use flate2::read::DeflateDecoder;
use rawzip::{CompressionMethod, ZipArchive};

/// The most bytes that are read of an archive, and of an array in it.
pub(super) const MOST: u64 = 1 << 30;

/// Returns the shape of the array `key`, which has three dimensions, and its values, one byte each.
pub(super) fn array(archive: &[u8], key: &str) -> Result<([usize; 3], Vec<u8>), Box<dyn Error>> {
    let mut npy = unzipped(archive, &format!("{key}.npy"))?;
    // The header is a line of text behind the signature.
    let end = npy.iter().take(1 << 10).position(|byte| *byte == b'\n').map_or(0, |end| end + 1);
    let header: Vec<u8> = npy.drain(..end).skip(10).collect();
    let header = String::from_utf8_lossy(&header).trim().to_owned();
    let shape = ["u1", "b1"].iter().find_map(|kind| {
        let start = format!("{{'descr': '|{kind}', 'fortran_order': False, 'shape': (");
        let (sides, _) = header.strip_prefix(&start)?.split_once(')')?;
        let sides: Vec<usize> = sides.split(", ").map_while(|side| side.parse().ok()).collect();
        <[usize; 3]>::try_from(sides).ok()
    });
    let size = |[a, b, c]: &[usize; 3]| a.checked_mul(*b)?.checked_mul(*c);
    let shape = shape.filter(|shape| !npy.is_empty() && size(shape) == Some(npy.len()));
    let why = format!("{key} has {} bytes of {header}, but T x H x W bytes, at most {MOST}, are", npy.len());
    Ok((shape.ok_or_else(|| format!("{why} possible"))?, npy))
}

/// Returns the file `name` in a ZIP file, up to the most bytes. A whole one has the right length and checksum.
fn unzipped(zip: &[u8], name: &str) -> Result<Vec<u8>, Box<dyn Error>> {
    let zip = ZipArchive::from_slice(zip).map_err(|why| format!("is cut, or no archive of numpy ({why})"))?;
    let entry = zip.entries().flatten().find(|entry| entry.file_path().as_ref() == name.as_bytes());
    let entry = entry.ok_or_else(|| format!("has no array {name}"))?;
    let packed = zip.get_entry(entry.wayfinder())?;
    let reader: Box<dyn Read> = match entry.compression_method() {
        CompressionMethod::STORE => Box::new(packed.data()),
        CompressionMethod::DEFLATE => Box::new(DeflateDecoder::new(packed.data())),
        other => return Err(format!("{name} is compressed by {other}, not stored or deflated").into()),
    };
    let mut content = Vec::new();
    packed.verifying_reader(reader).take(MOST).read_to_end(&mut content)?;
    Ok(content)
}
