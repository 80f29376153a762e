//! Image files to pixels and back: PNG, JPEG, OpenEXR, Radiance HDR.
//!
//! PNG and JPEG give integer codes, OpenEXR and Radiance HDR give linear radiance as floats of any scale. Alpha is
//! dropped. Only [`White`] changes values. This crate knows no source, stream or message.

mod white;

use std::fs::File;
use std::io::{BufRead, BufReader, Seek};
use std::path::{Path, PathBuf};

use image::error::{LimitError, LimitErrorKind, UnsupportedError, UnsupportedErrorKind};
use image::{DynamicImage, ExtendedColorType, ImageBuffer, ImageFormat, ImageReader, Luma, LumaA, Rgb, Rgba};
use modulo_core::{Frame, Samples};
use ndarray::Array3;

pub use white::White;

/// Error of a file that cannot be read as an image. The message names the file, the fault and the possible values.
#[derive(Debug, thiserror::Error)]
pub enum ImageError {
    /// The operating system cannot read the file.
    #[error("{file}: {1}", file = .0.display())]
    Io(PathBuf, #[source] std::io::Error),
    /// The content cannot be decoded. The texts are the name of the image and the reason.
    #[error("{0}: {1}")]
    Undecodable(String, String),
    /// The white point is not a radiance.
    #[error("white = {0}: must be a finite number, 0 (automatic) or above")]
    White(f32),
}

/// File name extensions of images, in lower case.
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

/// Error of a frame that could not be written.
#[derive(Debug, thiserror::Error)]
#[error("{}: {source}", path.display())]
pub struct SaveError {
    /// Path of the file.
    pub path: PathBuf,
    /// The error of the encoder or the system.
    pub source: image::ImageError,
}

/// Writes `frame` to `path` as PNG, grey or RGB, 8 or 16 bits a sample.
///
/// # Errors
/// [`SaveError`] when the file cannot be written, and for a frame of floats, which PNG cannot hold.
pub fn save_png(path: &Path, frame: &Frame) -> Result<(), SaveError> {
    write(path, frame).map_err(|source| SaveError { path: path.to_owned(), source })
}

fn write(path: &Path, frame: &Frame) -> Result<(), image::ImageError> {
    let (height, width, channels) = frame.dim();
    let colour = |grey, rgb| if channels == 1 { grey } else { rgb };
    let (bytes, colour) = match frame.samples() {
        Samples::U8(codes) => {
            (codes.iter().copied().collect(), colour(ExtendedColorType::L8, ExtendedColorType::Rgb8))
        }
        Samples::U16(codes) => (
            // The encoder takes samples in the byte order of the machine and swaps them for PNG itself.
            codes.iter().flat_map(|code| code.to_ne_bytes()).collect::<Vec<u8>>(),
            colour(ExtendedColorType::L16, ExtendedColorType::Rgb16),
        ),
        Samples::F32(_) => {
            let kind = UnsupportedErrorKind::Color(ExtendedColorType::Rgb32F);
            let error = UnsupportedError::from_format_and_kind(ImageFormat::Png.into(), kind);
            return Err(image::ImageError::Unsupported(error));
        }
    };
    let too_long = |_| image::ImageError::Limits(LimitError::from_kind(LimitErrorKind::DimensionError));
    let side = |n: usize| u32::try_from(n).map_err(too_long);
    image::save_buffer_with_format(path, &bytes, side(width)?, side(height)?, colour, ImageFormat::Png)
}
