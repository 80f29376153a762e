//! Rows of bytes to pixels, in three steps that each copy only when they must: drop the padding of rows, make samples
//! of bytes, put red first.

use std::borrow::Cow;

use modulo_core::{Frame, FrameError};
use ndarray::Array3;

use super::ImageError;
use super::encoding::{Channels, Depth, Encoding};
use crate::cdr::ByteOrder;
use crate::sensor_msgs::Image;

/// The layout of the pixels in the data of an image. A layout always fits its data.
#[derive(Clone, Copy)]
pub(super) struct PixelLayout {
    encoding: Encoding,
    height: usize,
    width: usize,
    /// Bytes of a row's pixels, at most `step`.
    row: usize,
    step: usize,
    order: ByteOrder,
}

impl PixelLayout {
    pub(super) fn of(image: &Image) -> Result<Self, ImageError> {
        let Image { height, width, step, .. } = *image;
        let encoding =
            Encoding::of(&image.encoding).ok_or_else(|| ImageError::Encoding(image.encoding.clone()))?;
        let (h, w) = (height as usize, width as usize);
        if h == 0 || w == 0 {
            return Err(FrameError::Empty { height: h, width: w }.into());
        }
        let row = u64::from(width) * encoding.pixel();
        if u64::from(step) < row {
            return Err(ImageError::Step { step, row });
        }
        let expected = u64::from(height) * u64::from(step);
        if (image.data.len() as u64) < expected {
            return Err(ImageError::Short { expected, got: image.data.len() });
        }
        let order = if image.is_bigendian == 0 { ByteOrder::Little } else { ByteOrder::Big };
        Ok(Self { encoding, height: h, width: w, row: row as usize, step: step as usize, order })
    }
}

pub(super) fn frame(layout: PixelLayout, data: Cow<'_, [u8]>) -> Result<Frame, ImageError> {
    let packed = without_padding(layout, data);
    let channels = layout.encoding.channels;
    Ok(match layout.encoding.depth {
        Depth::U8 => Frame::from_u8(array(layout, red_first(channels, packed))),
        Depth::U16 => {
            let samples = wide(layout.order, &packed, u16::from_be_bytes, u16::from_le_bytes);
            Frame::from_u16(array(layout, red_first(channels, samples.into())))
        }
        Depth::F32 => {
            let samples = wide(layout.order, &packed, f32::from_be_bytes, f32::from_le_bytes);
            Frame::from_f32(array(layout, red_first(channels, samples.into())))
        }
    }?)
}

fn without_padding(layout: PixelLayout, data: Cow<'_, [u8]>) -> Cow<'_, [u8]> {
    let PixelLayout { height, row, step, .. } = layout;
    if row < step {
        return data.chunks_exact(step).take(height).flat_map(|padded| &padded[..row]).copied().collect();
    }
    match data {
        Cow::Borrowed(bytes) => Cow::Borrowed(&bytes[..height * row]),
        Cow::Owned(mut bytes) => {
            bytes.truncate(height * row);
            Cow::Owned(bytes)
        }
    }
}

/// Samples of `N` bytes each.
fn wide<T, const N: usize>(
    order: ByteOrder,
    bytes: &[u8],
    big: impl Fn([u8; N]) -> T,
    little: impl Fn([u8; N]) -> T,
) -> Vec<T> {
    let (samples, _) = bytes.as_chunks();
    match order {
        ByteOrder::Big => samples.iter().map(|bytes| big(*bytes)).collect(),
        ByteOrder::Little => samples.iter().map(|bytes| little(*bytes)).collect(),
    }
}

fn red_first<T: Copy>(channels: Channels, samples: Cow<'_, [T]>) -> Vec<T> {
    match channels {
        Channels::Mono | Channels::Rgb => samples.into_owned(),
        Channels::Bgr => each_pixel(&samples, |&[b, g, r]| [r, g, b]),
        Channels::Rgba => each_pixel(&samples, |&[r, g, b, _]| [r, g, b]),
        Channels::Bgra => each_pixel(&samples, |&[b, g, r, _]| [r, g, b]),
    }
}

fn each_pixel<T: Copy, const N: usize>(samples: &[T], rgb: impl Fn(&[T; N]) -> [T; 3]) -> Vec<T> {
    samples.as_chunks().0.iter().map(rgb).collect::<Vec<_>>().into_flattened()
}

fn array<T>(layout: PixelLayout, samples: Vec<T>) -> Array3<T> {
    let PixelLayout { height, width, .. } = layout;
    let channels = if let Channels::Mono = layout.encoding.channels { 1 } else { 3 };
    Array3::from_shape_vec((height, width, channels), samples).expect("the layout fits its data")
}
