//! Pixels to rows of bytes: always packed, always little endian.

use modulo_core::Frame;
use ndarray::Array3;

use crate::cdr::{self, CdrError};
use crate::sensor_msgs::Image;
use crate::std_msgs::Header;

impl Image {
    /// `frame` as `rgb8`, `mono8`, `rgb16` or `mono16`, without padding, little
    /// endian.
    pub fn from_frame(header: Header, frame: &Frame) -> Self {
        let mut image = without_pixels(header, frame);
        append(frame, &mut image.data);
        image
    }
}

/// The CDR of [`Image::from_frame`], with one copy of the pixels instead of two.
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

/// Bytes of the samples.
fn size(frame: &Frame) -> usize {
    let (height, width, channels) = frame.dim();
    height * width * channels * usize::from(frame.depth() / 8)
}

fn without_pixels(header: Header, frame: &Frame) -> Image {
    // A side beyond 32 bits means data beyond 32 bits, which CDR refuses.
    let field = |n: usize| u32::try_from(n).unwrap_or(u32::MAX);
    let encoding = match (frame, frame.channels()) {
        (Frame::U8(_), 1) => "mono8",
        (Frame::U8(_), _) => "rgb8",
        (Frame::U16(_), 1) => "mono16",
        (Frame::U16(_), _) => "rgb16",
    };
    Image {
        header,
        height: field(frame.height()),
        width: field(frame.width()),
        encoding: encoding.to_owned(),
        is_bigendian: 0,
        step: field(size(frame).checked_div(frame.height()).unwrap_or(0)),
        data: Vec::new(),
    }
}

fn append(frame: &Frame, out: &mut Vec<u8>) {
    match frame {
        Frame::U8(pixels) => out.extend_from_slice(in_order(pixels).as_slice().unwrap_or_default()),
        Frame::U16(pixels) => {
            let start = out.len();
            out.resize(start + size(frame), 0);
            let (pairs, _) = out[start..].as_chunks_mut();
            for (pair, sample) in pairs.iter_mut().zip(in_order(pixels).as_slice().unwrap_or_default()) {
                *pair = sample.to_le_bytes();
            }
        }
    }
}

/// The pixels row by row; no copy unless somebody built the frame by hand.
fn in_order<T: Clone>(pixels: &Array3<T>) -> ndarray::CowArray<'_, T, ndarray::Ix3> {
    pixels.as_standard_layout()
}
