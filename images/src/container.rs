//! [`check`]: refuses files that the decoders would read as less than they hold, or would refuse without naming the reason.

use std::io::Cursor;

use exr::meta::MetaData;
use image::ImageFormat;

/// Checks the container of an image of `format`. The error is the reason and the remedy.
pub fn check(format: Option<ImageFormat>, bytes: &[u8]) -> Result<(), String> {
    match format {
        Some(ImageFormat::Jpeg) if jpeg_end(bytes).is_none() => {
            Err(String::from("this JPEG is truncated: its end marker is missing; copy the whole file again"))
        }
        Some(ImageFormat::Png) => match apng_frames(bytes) {
            Some(frames) if frames > 1 => Err(format!(
                "this PNG is an animation of {frames} frames (APNG), but only single images are read; save each frame \
                 as a file"
            )),
            _ => Ok(()),
        },
        Some(ImageFormat::OpenExr) => exr_channels(bytes),
        _ => Ok(()),
    }
}

/// Follows the markers of a JPEG to its end marker. `None` if the file ends first.
fn jpeg_end(bytes: &[u8]) -> Option<usize> {
    // The decoder fills what is missing at the end of a file with grey. The last bytes alone decide nothing: a thumbnail
    // within the file has an end marker of its own, and cameras write other data behind the image.
    let mut place = 2;
    loop {
        // In compressed data, FF 00 is a byte FF, and FF D0 to FF D7 are restart markers. FF FF is padding.
        let is_marker = |pair: &[u8]| pair[0] == 0xff && !matches!(pair[1], 0x00 | 0xd0..=0xd7 | 0xff);
        place += bytes.get(place..)?.windows(2).position(is_marker)?;
        match bytes[place + 1] {
            0xd9 => return Some(place),
            // These markers have no segment.
            0x01 | 0xd8 => place += 2,
            _ => place += 2 + usize::from(u16::from_be_bytes(*bytes.get(place + 2..)?.first_chunk()?)),
        }
    }
}

/// The number of frames that the animation control of a PNG gives. `None` for a PNG without it.
fn apng_frames(bytes: &[u8]) -> Option<u32> {
    // A chunk is its length, its type, its data and a checksum; the control comes before the image data.
    let mut rest = bytes.get(8..)?;
    loop {
        let length = u32::from_be_bytes(*rest.first_chunk()?) as usize;
        match rest.get(4..8)? {
            b"acTL" => return Some(u32::from_be_bytes(*rest.get(8..)?.first_chunk()?)),
            b"IDAT" => return None,
            _ => rest = rest.get(length.checked_add(12)?..)?,
        }
    }
}

/// Refuses an OpenEXR file without a layer of red, green and blue, such as one of luminance and chroma (Y, RY, BY).
fn exr_channels(bytes: &[u8]) -> Result<(), String> {
    let meta = MetaData::read_from_buffered(Cursor::new(bytes), false).map_err(|why| why.to_string())?;
    let layers = meta.headers.iter().map(|header| {
        header.channels.list.iter().map(|channel| channel.name.to_string()).collect::<Vec<_>>()
    });
    let layers: Vec<_> = layers.collect();
    if layers.iter().any(|names| ["R", "G", "B"].iter().all(|rgb| names.iter().any(|name| name == rgb))) {
        return Ok(());
    }
    Err(format!(
        "this OpenEXR image has the channels {}, but must have R, G and B; save it as RGB",
        layers.concat().join(", ")
    ))
}
