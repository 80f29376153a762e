//! Pixels to the model's tensor: depth, size, padding, order and range in as few passes as the image allows.

use std::borrow::Cow;

use fast_image_resize::images::{Image, TypedImageRef};
use fast_image_resize::pixels::{U8, U8x3};
use fast_image_resize::{FilterType, PixelTrait, ResizeAlg, ResizeOptions, Resizer};
use modulo_core::{Frame, Letterbox, tone};
use ndarray::{Array4, ArrayView4};

use crate::input_size::InputSize;

/// Grey of the padding, as the models were trained with.
const GREY: f32 = 114.0 / 255.0;

/// The most tensors that are kept: cameras of more sizes share them by turns.
const KEPT: usize = 8;

/// Keeps the tensors of the sizes in use from frame to frame, so that only the pixels are written again.
#[derive(Default)]
pub struct Preprocessor {
    /// Each with the place of its image, grey around it; the one of the last frame first.
    tensors: Vec<(Letterbox, Array4<f32>)>,
    resizer: Resizer,
}

impl Preprocessor {
    /// Writes `frame`, whose largest sample is `most`, into a tensor, `1 x 3 x H x W`, RGB in `[0, 1]`; mono is repeated to three channels.
    pub fn fill(&mut self, frame: &Frame, most: f64, size: InputSize) -> Result<Letterbox, String> {
        let (height, width, channels) = frame.dim();
        let letterbox = size.place(height, width).map_err(|error| error.to_string())?;
        self.reserve(size.tensor(height, width), letterbox);
        let frame = tone::eight_bits(frame, most as f32);
        let pixels = frame.as_u8().and_then(|pixels| pixels.as_slice()).expect("8 bits in standard layout");
        let pixels = if letterbox.inner() == (height, width) {
            Cow::Borrowed(pixels)
        } else {
            Cow::Owned(self.resized(pixels, frame.dim(), letterbox.inner())?)
        };
        self.write(&pixels, &letterbox, channels);
        Ok(letterbox)
    }

    /// Returns the tensor as last filled, once there was a frame.
    pub fn tensor(&self) -> Option<ArrayView4<'_, f32>> {
        self.tensors.first().map(|(_, tensor)| tensor.view())
    }

    /// Returns (height, width) of the tensor, once there was a frame.
    pub fn size(&self) -> Option<(usize, usize)> {
        self.tensor().map(|tensor| (tensor.dim().2, tensor.dim().3))
    }

    /// Takes the tensor in which the next image covers exactly an earlier one, or makes one that is grey everywhere.
    fn reserve(&mut self, (height, width): (usize, usize), letterbox: Letterbox) {
        let dim = (1, 3, height, width);
        let fits = |(placed, tensor): &(Letterbox, Array4<f32>)| *placed == letterbox && tensor.dim() == dim;
        let kept = self.tensors.iter().position(fits).map(|at| self.tensors.remove(at));
        self.tensors.truncate(KEPT - 1);
        self.tensors.insert(0, kept.unwrap_or_else(|| (letterbox, Array4::from_elem(dim, GREY))));
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
        let (_, tensor) = self.tensors.first_mut().expect("one was reserved");
        let (_, _, height, width) = tensor.dim();
        let tensor = tensor.as_slice_mut().expect("the tensor was made in standard layout");
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

#[cfg(test)]
mod tests {
    use ndarray::{Array3, Array4};
    use proptest::prelude::*;

    use super::*;
    use crate::input_size::STRIDE;

    const AUTO: InputSize = InputSize::Auto(STRIDE);

    /// The definition, one sample at a time, for an image that is not resized.
    fn naive(frame: &Frame, most: f32, size: InputSize) -> Array4<f32> {
        let (height, width, channels) = frame.dim();
        let (rows, columns) = size.tensor(height, width);
        let (top, left) = match size {
            InputSize::Auto(_) => (0, 0),
            InputSize::Fixed(..) => ((rows - height) / 2, (columns - width) / 2),
        };
        let values = frame.to_f32();
        Array4::from_shape_fn((1, 3, rows, columns), |(_, channel, y, x)| {
            let (Some(y), Some(x)) = (y.checked_sub(top), x.checked_sub(left)) else { return GREY };
            if y >= height || x >= width {
                return GREY;
            }
            let sample = values[[y, x, channel.min(channels - 1)]];
            (255.0 / most * sample).round_ties_even().clamp(0.0, 255.0) / 255.0
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
            bits in 1u8..=16,
            size in prop_oneof![Just(AUTO), Just(InputSize::Fixed(64, 96))],
        ) {
            let mut pre = Preprocessor::default();
            let most = (1u32 << bits) - 1;
            // By turns, as those of several cameras come.
            for frame in frames.iter().chain(&frames) {
                pre.fill(frame, most.into(), size).expect("filled");
                prop_assert_eq!(pre.tensor().expect("a frame").to_owned(), naive(frame, most as f32, size));
            }
        }
    }

    #[test]
    fn a_large_image_is_halved_into_the_middle() {
        let ramp = Array3::from_shape_fn((100, 128, 3), |(_, x, _)| 2 * x as u8);
        let size = InputSize::Fixed(64, 64);
        let mut pre = Preprocessor::default();
        pre.fill(&Frame::from_u8(ramp).expect("a frame"), 255.0, size).expect("filled");
        let tensor = pre.tensor().expect("a frame");
        assert_eq!((tensor[[0, 0, 6, 30]], tensor[[0, 2, 57, 30]]), (GREY, GREY));
        for x in 2..62 {
            let expected = (4 * x + 1) as f32 / 255.0;
            assert!((tensor[[0, 1, 32, x]] - expected).abs() < 1.5 / 255.0, "column {x}");
        }
    }

    #[test]
    fn cameras_of_other_sizes_keep_their_tensors() {
        let mut pre = Preprocessor::default();
        let mut tensors = std::collections::BTreeSet::new();
        for round in 0..4 * KEPT {
            let frame = Frame::from_u8(Array3::zeros((9 + 32 * (round % KEPT), 40, 1))).expect("a frame");
            pre.fill(&frame, 255.0, AUTO).expect("filled");
            tensors.insert(pre.tensor().expect("a frame").as_ptr());
        }
        assert_eq!((tensors.len(), pre.tensors.len()), (KEPT, KEPT));
        pre.fill(&Frame::from_u8(Array3::zeros((7, 900, 1))).expect("a frame"), 255.0, AUTO).expect("filled");
        assert_eq!(
            pre.tensors.len(),
            KEPT,
            "a ninth size takes the place of the one that was used longest ago"
        );
    }
}
