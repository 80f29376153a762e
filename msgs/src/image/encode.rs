//! Pixels to rows of bytes: always packed, always little endian.

use modulo_core::{Frame, Samples};
use ndarray::Array3;

use crate::cdr::{self, CdrError};
use crate::sensor_msgs::Image;
use crate::std_msgs::Header;

impl Image {
    /// `frame` as `rgb8`, `mono8`, `rgb16`, `mono16`, `32FC3` (blue first, as OpenCV has it) or `32FC1`, without
    /// padding, little endian.
    pub fn from_frame(header: Header, frame: &Frame) -> Self {
        let mut image = without_pixels(header, frame);
        append(frame, &mut image.data);
        image
    }
}

/// Returns the CDR of [`Image::from_frame`], with one copy of the pixels instead of two.
///
/// # Errors
/// [`CdrError`] when the frame has 4 GiB or more.
pub fn encode_frame(header: &Header, frame: &Frame) -> Result<Vec<u8>, CdrError> {
    // The data come last: their length, 0 here, is the last thing written.
    let mut out = cdr::to_vec(&without_pixels(header.clone(), frame))?;
    out.truncate(out.len() - size_of::<u32>());
    let got = size(frame);
    let length = u32::try_from(got).map_err(|_| CdrError::Long { offset: out.len(), got })?;
    out.reserve_exact(size_of::<u32>() + got);
    out.extend_from_slice(&length.to_le_bytes());
    append(frame, &mut out);
    Ok(out)
}

/// Returns the number of bytes of the samples.
fn size(frame: &Frame) -> usize {
    let (height, width, channels) = frame.dim();
    height * width * channels * usize::from(frame.depth() / 8)
}

fn without_pixels(header: Header, frame: &Frame) -> Image {
    // A side beyond 32 bits means data beyond 32 bits, which CDR refuses.
    let field = |n: usize| u32::try_from(n).unwrap_or(u32::MAX);
    let encoding = match (frame.samples(), frame.channels()) {
        (Samples::U8(_), 1) => "mono8",
        (Samples::U8(_), _) => "rgb8",
        (Samples::U16(_), 1) => "mono16",
        (Samples::U16(_), _) => "rgb16",
        (Samples::F32(_), 1) => "32FC1",
        (Samples::F32(_), _) => "32FC3",
    };
    Image {
        header,
        height: field(frame.height()),
        width: field(frame.width()),
        encoding: encoding.to_owned(),
        is_bigendian: 0,
        step: field(size(frame) / frame.height()),
        data: Vec::new(),
    }
}

fn append(frame: &Frame, out: &mut Vec<u8>) {
    match frame.samples() {
        Samples::U8(pixels) => out.extend_from_slice(in_order(pixels)),
        Samples::U16(pixels) => {
            let start = out.len();
            out.resize(start + size(frame), 0);
            let (pairs, _) = out[start..].as_chunks_mut();
            for (pair, sample) in pairs.iter_mut().zip(in_order(pixels)) {
                *pair = sample.to_le_bytes();
            }
        }
        Samples::F32(pixels) => {
            let pixels = in_order(pixels).chunks_exact(frame.channels());
            out.extend(pixels.flat_map(|pixel| pixel.iter().rev()).flat_map(|sample| sample.to_le_bytes()));
        }
    }
}

/// Returns the samples row by row.
fn in_order<T>(pixels: &Array3<T>) -> &[T] {
    pixels.as_slice().expect("a frame is in standard layout")
}
