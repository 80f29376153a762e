//! Image files to frames: integer codes from PNG and JPEG, linear radiance as floats of any scale from OpenEXR and
//! Radiance HDR.
//!
//! Alpha is dropped. Values are never changed here.

use std::fs::File;
use std::io::{BufRead, BufReader, Seek};
use std::path::Path;

use image::{DynamicImage, ImageBuffer, ImageReader, Luma, LumaA, Rgb, Rgba};
use modulo_core::Frame;
use ndarray::Array3;

use crate::ImageError;

/// Extensions that are taken for images, in lower case.
pub const EXTENSIONS: [&str; 5] = ["png", "jpg", "jpeg", "exr", "hdr"];

/// Reads one image file. The format is recognised by the content, not by the name.
///
/// # Errors
/// [`ImageError`] when the file is missing, cut short, of an unknown format, or holds NaN or an infinity.
pub fn read_image(path: &Path) -> Result<Frame, ImageError> {
    let file = File::open(path).map_err(|e| ImageError::Io(path.to_owned(), e))?;
    decode(BufReader::new(file), &path.display().to_string())
}

/// Decodes one image; `origin` is its name in errors.
///
/// # Errors
/// As [`read_image`].
pub fn decode(data: impl BufRead + Seek, origin: &str) -> Result<Frame, ImageError> {
    let bad = |why: String| ImageError::Undecodable(origin.to_owned(), why);
    let reader = ImageReader::new(data).with_guessed_format().map_err(|e| bad(e.to_string()))?;
    let image = reader.decode().map_err(|e| bad(e.to_string()))?;
    let frame = match image {
        DynamicImage::ImageLuma8(i) => Frame::from_u8(samples(&i, |p: &Luma<u8>| p.0)),
        DynamicImage::ImageLumaA8(i) => Frame::from_u8(samples(&i, |p: &LumaA<u8>| [p.0[0]])),
        DynamicImage::ImageRgb8(i) => Frame::from_u8(samples(&i, |p: &Rgb<u8>| p.0)),
        DynamicImage::ImageRgba8(i) => Frame::from_u8(samples(&i, |p: &Rgba<u8>| [p.0[0], p.0[1], p.0[2]])),
        DynamicImage::ImageLuma16(i) => Frame::from_u16(samples(&i, |p: &Luma<u16>| p.0)),
        DynamicImage::ImageLumaA16(i) => Frame::from_u16(samples(&i, |p: &LumaA<u16>| [p.0[0]])),
        DynamicImage::ImageRgb16(i) => Frame::from_u16(samples(&i, |p: &Rgb<u16>| p.0)),
        DynamicImage::ImageRgba16(i) => {
            Frame::from_u16(samples(&i, |p: &Rgba<u16>| [p.0[0], p.0[1], p.0[2]]))
        }
        DynamicImage::ImageRgb32F(i) => Frame::from_f32(samples(&i, |p: &Rgb<f32>| p.0)),
        DynamicImage::ImageRgba32F(i) => {
            Frame::from_f32(samples(&i, |p: &Rgba<f32>| [p.0[0], p.0[1], p.0[2]]))
        }
        other => return Err(bad(format!("colour type {:?} is not supported", other.color()))),
    };
    frame.map_err(|e| bad(e.to_string()))
}

/// Returns the first `N` channels of every pixel, `H x W x N`.
fn samples<P, T, const N: usize>(image: &ImageBuffer<P, Vec<T>>, pick: impl Fn(&P) -> [T; N]) -> Array3<T>
where
    P: image::Pixel<Subpixel = T>,
    T: image::Primitive,
{
    let shape = (image.height() as usize, image.width() as usize, N);
    let mut pixels = Array3::from_elem(shape, T::zero());
    for (to, from) in pixels.iter_mut().zip(image.pixels().flat_map(pick)) {
        *to = from;
    }
    pixels
}
