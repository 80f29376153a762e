//! Pixels to the model's tensor: depth, size, padding, order and range in as few passes as the image allows.

use std::borrow::Cow;

use fast_image_resize::images::{Image, TypedImageRef};
use fast_image_resize::pixels::{U8, U8x3};
use fast_image_resize::{FilterType, PixelTrait, ResizeAlg, ResizeOptions, Resizer};
use modulo_core::{Frame, Letterbox, Samples, tone};
use ndarray::{Array4, ArrayView4};

use crate::input_size::InputSize;

/// Grey of the padding, as the models were trained with.
const GREY: f32 = 114.0 / 255.0;

/// Keeps the tensor from frame to frame, so that only the pixels are written again.
#[derive(Default)]
pub struct Preprocessor {
    tensor: Array4<f32>,
    placed: Option<Letterbox>,
    resizer: Resizer,
}

impl Preprocessor {
    /// Writes `frame` into the tensor, `1 x 3 x H x W`, RGB in `[0, 1]`; mono is repeated to three channels.
    ///
    /// # Errors
    /// A message of one line when the pixels cannot be read.
    pub fn fill(&mut self, frame: &Frame, bits: u8, size: InputSize) -> Result<Letterbox, String> {
        let (height, width, channels) = frame.dim();
        let letterbox = size.place(height, width).map_err(|error| error.to_string())?;
        self.reserve(size.tensor(height, width), letterbox);
        let pixels = eight_bit(frame, bits)?;
        let pixels = if letterbox.inner() == (height, width) {
            pixels
        } else {
            Cow::Owned(self.resized(&pixels, frame.dim(), letterbox.inner())?)
        };
        self.write(&pixels, &letterbox, channels);
        Ok(letterbox)
    }

    /// Returns the tensor as last filled.
    pub fn tensor(&self) -> ArrayView4<'_, f32> {
        self.tensor.view()
    }

    /// Returns (height, width) of the tensor, once there was a frame.
    pub fn size(&self) -> Option<(usize, usize)> {
        let (_, _, height, width) = self.tensor.dim();
        self.placed.map(|_| (height, width))
    }

    /// Grey everywhere, unless the next image covers exactly the last one.
    fn reserve(&mut self, (height, width): (usize, usize), letterbox: Letterbox) {
        if self.placed != Some(letterbox) || self.size() != Some((height, width)) {
            self.tensor = Array4::from_elem((1, 3, height, width), GREY);
            self.placed = Some(letterbox);
        }
    }

    fn resized(
        &mut self,
        pixels: &[u8],
        (height, width, channels): (usize, usize, usize),
        (to_height, to_width): (usize, usize),
    ) -> Result<Vec<u8>, String> {
        let side = |side: usize| u32::try_from(side).map_err(|error| error.to_string());
        let (from, to) = ((side(width)?, side(height)?), (side(to_width)?, side(to_height)?));
        // Calls with a pixel type: for any pixel type, the compiler would generate code for thirteen of them.
        if channels == 3 {
            resize::<U8x3>(&mut self.resizer, pixels, from, to)
        } else {
            resize::<U8>(&mut self.resizer, pixels, from, to)
        }
    }

    fn write(&mut self, pixels: &[u8], letterbox: &Letterbox, channels: usize) {
        let (_, _, height, width) = self.tensor.dim();
        let tensor = self.tensor.as_slice_mut().expect("the tensor was made in standard layout");
        let (red, rest) = tensor.split_at_mut(height * width);
        let (green, blue) = rest.split_at_mut(height * width);
        let ((_, inner_width), (top, left)) = (letterbox.inner(), letterbox.corner());
        for (y, row) in pixels.chunks_exact(inner_width * channels).enumerate() {
            let start = (top + y) * width + left;
            let columns = start..start + inner_width;
            let planes = [&mut red[columns.clone()], &mut green[columns.clone()], &mut blue[columns]];
            if channels == 3 { tone::unit_planes(row, planes) } else { write_mono(row, planes) }
        }
    }
}

/// Resizes an image of `from` = (width, height) px to `to`.
fn resize<P: PixelTrait>(
    resizer: &mut Resizer,
    pixels: &[u8],
    from: (u32, u32),
    to: (u32, u32),
) -> Result<Vec<u8>, String> {
    let from = TypedImageRef::<P>::from_buffer(from.0, from.1, pixels).map_err(|error| error.to_string())?;
    let mut into = Image::new(to.0, to.1, P::pixel_type());
    let mut view = into.typed_image_mut::<P>().expect("the image was made with this pixel type");
    // As OpenCV's INTER_LINEAR, with which the models were trained.
    let options = ResizeOptions::new().resize_alg(ResizeAlg::Interpolation(FilterType::Bilinear));
    resizer.resize_typed(&from, &mut view, &options).map_err(|error| error.to_string())?;
    drop(view);
    Ok(into.into_vec())
}

fn write_mono(row: &[u8], [red, green, blue]: [&mut [f32]; 3]) {
    for (pixel, red) in row.iter().zip(red.iter_mut()) {
        *red = f32::from(*pixel) / 255.0;
    }
    green.copy_from_slice(red);
    blue.copy_from_slice(red);
}

/// Returns the samples on 8 bits, `H x W x C` interleaved. `bits` of the sensor, 0 (or more than the encoding has) =
/// the encoding's: a code of b bits is shifted so that `2^b` comes to lie at 256; codes beyond `2^b` become white.
///
/// # Errors
/// A message of one line when `bits` is 0 and the samples are floats, which have no range of their own.
pub fn eight_bit(frame: &Frame, bits: u8) -> Result<Cow<'_, [u8]>, String> {
    let bits = if bits == 0 { frame.depth() } else { bits.min(frame.depth()) };
    match frame.samples() {
        Samples::U8(pixels) if bits == 8 => {
            Ok(Cow::Borrowed(pixels.as_slice().expect("a frame is in standard layout")))
        }
        Samples::U8(pixels) => Ok(pixels.iter().map(|&code| shifted(code.into(), bits)).collect()),
        Samples::U16(pixels) => Ok(pixels.iter().map(|&code| shifted(code, bits)).collect()),
        Samples::F32(_) if bits == 32 => {
            Err("image has 32-bit float samples, of which no range is known: set `bits` to the sensor's"
                .into())
        }
        Samples::F32(pixels) => {
            // The conversion with `as` clamps.
            let scale = 256.0 / f32::from(bits).exp2();
            Ok(pixels.iter().map(|&sample| (sample * scale) as u8).collect())
        }
    }
}

fn shifted(code: u16, bits: u8) -> u8 {
    let level = (u32::from(code) << 8) >> bits;
    level.min(255) as u8
}

#[cfg(test)]
mod tests {
    use ndarray::{Array3, Array4};
    use proptest::prelude::*;

    use super::*;

    /// The definition, one sample at a time, for an image that is not resized.
    fn naive(frame: &Frame, bits: u8, size: InputSize) -> Array4<f32> {
        let (height, width, channels) = frame.dim();
        let (rows, columns) = size.tensor(height, width);
        let (top, left) = match size {
            InputSize::Auto => (0, 0),
            InputSize::Fixed { .. } => ((rows - height) / 2, (columns - width) / 2),
        };
        let bits = if bits == 0 || bits > frame.depth() { frame.depth() } else { bits };
        let values = frame.to_f32();
        Array4::from_shape_fn((1, 3, rows, columns), |(_, channel, y, x)| {
            let (Some(y), Some(x)) = (y.checked_sub(top), x.checked_sub(left)) else { return GREY };
            if y >= height || x >= width {
                return GREY;
            }
            let share = values[[y, x, channel.min(channels - 1)]] / f32::from(bits).exp2();
            (share * 256.0).floor().clamp(0.0, 255.0) / 255.0
        })
    }

    fn frames() -> impl Strategy<Value = Frame> {
        let shape = (1usize..40, 1usize..40, prop_oneof![Just(1usize), Just(3)]);
        (shape, any::<u16>(), 0..3).prop_map(|(shape, seed, depth)| {
            let sample = |(y, x, c)| (y * 7919 + x * 104_729 + c * 31 + usize::from(seed)) as u16;
            let wide = Array3::from_shape_fn(shape, sample);
            let frame = match depth {
                0 => Frame::from_u8(wide.mapv(|v| (v >> 3) as u8)),
                1 => Frame::from_u16(wide),
                _ => Frame::from_f32(wide.mapv(|v| f32::from(v) / 4.0 - 9.0)),
            };
            frame.expect("a frame")
        })
    }

    proptest! {
        #[test]
        fn what_is_not_resized_is_as_defined(
            frames in prop::collection::vec(frames(), 1..4),
            bits in 0u8..=16,
            size in prop_oneof![Just(InputSize::Auto), Just(InputSize::Fixed { height: 64, width: 96 })],
        ) {
            let mut pre = Preprocessor::default();
            for frame in &frames {
                if bits == 0 && frame.depth() == 32 {
                    prop_assert!(pre.fill(frame, bits, size).is_err_and(|why| why.contains("`bits`")));
                } else {
                    pre.fill(frame, bits, size).expect("filled");
                    prop_assert_eq!(pre.tensor().to_owned(), naive(frame, bits, size));
                }
            }
        }
    }

    #[test]
    fn a_large_image_is_halved_into_the_middle() {
        let ramp = Array3::from_shape_fn((100, 128, 3), |(_, x, _)| 2 * x as u8);
        let size = InputSize::Fixed { height: 64, width: 64 };
        let mut pre = Preprocessor::default();
        pre.fill(&Frame::from_u8(ramp).expect("a frame"), 0, size).expect("filled");
        let tensor = pre.tensor();
        assert_eq!((tensor[[0, 0, 6, 30]], tensor[[0, 2, 57, 30]]), (GREY, GREY));
        for x in 2..62 {
            let expected = (4 * x + 1) as f32 / 255.0;
            assert!((tensor[[0, 1, 32, x]] - expected).abs() < 1.5 / 255.0, "column {x}");
        }
    }
}
