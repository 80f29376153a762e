//! Image files to pixels: PNG and JPEG codes, OpenEXR and Radiance linear values.
//!
//! Alpha is dropped. Values are never changed here.

use std::fs::File;
use std::io::{BufRead, BufReader, Seek};
use std::path::Path;

use image::{DynamicImage, ImageBuffer, ImageReader, Luma, LumaA, Rgb, Rgba};
use modulo_core::Frame;
use ndarray::Array3;

use crate::error::ImageError;

/// Extensions that are taken for images, in lower case.
pub const EXTENSIONS: [&str; 5] = ["png", "jpg", "jpeg", "exr", "hdr"];

/// Decoded samples, `H x W x C` with `C` = 1 or 3.
#[derive(Clone, Debug, PartialEq)]
pub enum Pixels {
    /// Integer codes of 8 or 16 bits.
    Codes(Frame),
    /// Linear radiance, finite, any scale.
    Linear(Array3<f32>),
}

/// Reads one image file; its content, not its name, tells the format.
///
/// # Errors
/// [`ImageError`] when the file is missing, cut short, of an unknown format,
/// or holds NaN or an infinity.
pub fn read_image(path: &Path) -> Result<Pixels, ImageError> {
    let file = File::open(path).map_err(|e| ImageError::Io { path: path.to_owned(), source: e })?;
    decode(BufReader::new(file), &path.display().to_string())
}

/// Decodes one image; `origin` is what errors call it.
///
/// # Errors
/// As [`read_image`].
pub fn decode(data: impl BufRead + Seek, origin: &str) -> Result<Pixels, ImageError> {
    let bad = |why: String| ImageError::Undecodable { origin: origin.to_owned(), why };
    let reader = ImageReader::new(data).with_guessed_format().map_err(|e| bad(e.to_string()))?;
    let image = reader.decode().map_err(|e| bad(e.to_string()))?;
    let pixels = match image {
        DynamicImage::ImageLuma8(i) => codes8(samples(&i, |p: &Luma<u8>| p.0)),
        DynamicImage::ImageLumaA8(i) => codes8(samples(&i, |p: &LumaA<u8>| [p.0[0]])),
        DynamicImage::ImageRgb8(i) => codes8(samples(&i, |p: &Rgb<u8>| p.0)),
        DynamicImage::ImageRgba8(i) => codes8(samples(&i, |p: &Rgba<u8>| [p.0[0], p.0[1], p.0[2]])),
        DynamicImage::ImageLuma16(i) => codes16(samples(&i, |p: &Luma<u16>| p.0)),
        DynamicImage::ImageLumaA16(i) => codes16(samples(&i, |p: &LumaA<u16>| [p.0[0]])),
        DynamicImage::ImageRgb16(i) => codes16(samples(&i, |p: &Rgb<u16>| p.0)),
        DynamicImage::ImageRgba16(i) => codes16(samples(&i, |p: &Rgba<u16>| [p.0[0], p.0[1], p.0[2]])),
        DynamicImage::ImageRgb32F(i) => return finite(samples(&i, |p: &Rgb<f32>| p.0), origin),
        DynamicImage::ImageRgba32F(i) => {
            return finite(samples(&i, |p: &Rgba<f32>| [p.0[0], p.0[1], p.0[2]]), origin);
        }
        other => Err(format!("colour type {:?} is not supported", other.color())),
    };
    pixels.map_err(bad)
}

fn codes8(pixels: Array3<u8>) -> Result<Pixels, String> {
    Frame::from_u8(pixels).map(Pixels::Codes).map_err(|e| e.to_string())
}

fn codes16(pixels: Array3<u16>) -> Result<Pixels, String> {
    Frame::from_u16(pixels).map(Pixels::Codes).map_err(|e| e.to_string())
}

/// The first `N` channels of every pixel, `H x W x N`.
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

fn finite(linear: Array3<f32>, origin: &str) -> Result<Pixels, ImageError> {
    match linear.indexed_iter().find(|(_, v)| !v.is_finite()) {
        Some(((y, x, channel), &value)) => {
            Err(ImageError::NotFinite { origin: origin.to_owned(), x, y, channel, value })
        }
        None => Ok(Pixels::Linear(linear)),
    }
}
