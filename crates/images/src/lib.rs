//! Image files to pixels and back: PNG, JPEG, TIFF, OpenEXR, Radiance HDR.
//!
//! PNG, JPEG and TIFF give integer codes, OpenEXR and Radiance HDR give linear radiance as floats of any scale. Alpha is
//! dropped, and an image is turned as its EXIF orientation says. Only [`White`] changes values. This crate knows no
//! source, stream or message.
//!
//! Features, both by default: `exr` reads OpenEXR, and `tiff` TIFF.

mod jpeg;
mod knees;
mod radiance;
#[cfg(feature = "tiff")]
mod tiff;
mod unread;
mod white;

use std::fs::File;
use std::io::{self, BufRead, Cursor, Read, Seek};
use std::path::{Path, PathBuf};

#[cfg(feature = "exr")]
use exr::meta::MetaData;
use image::codecs::jpeg::JpegEncoder;
use image::codecs::png::PngEncoder;
use image::error::{LimitError, LimitErrorKind, UnsupportedError, UnsupportedErrorKind};
use image::{
    ColorType, DynamicImage, ExtendedColorType, ImageBuffer, ImageDecoder, ImageEncoder, ImageFormat,
    ImageReader, Limits, Pixel,
};
use modulo_core::{Frame, Samples};
use ndarray::Array3;

pub use knees::Knees;
pub use unread::{RAW_EXTENSIONS, unread};
pub use white::{Coding, WHITE_PERCENTILE, White};

/// Error of a file that cannot be read as an image. The message names the file, the fault and the possible values.
#[derive(Debug, thiserror::Error)]
pub enum ImageError {
    /// The operating system cannot read the file.
    #[error("{file}: {1}", file = .0.display())]
    Io(PathBuf, #[source] std::io::Error),
    /// The content cannot be decoded, or has codes of 16 bits that look like those of a converter of 12 bits or less. The texts are the
    /// name of the image and the reason.
    #[error("{0}: {1}")]
    Undecodable(String, String),
    /// A number of the [`Coding`] is not possible: its name, its value and the reason.
    #[error("{0} = {1}: {2}")]
    Coding(&'static str, f32, &'static str),
}

/// File name extensions of images, in lower case.
pub const EXTENSIONS: [&str; 7] = ["png", "jpg", "jpeg", "tif", "tiff", "exr", "hdr"];

/// Returns whether the name of `path` ends in one of these, which are in lower case, in either case.
pub fn has_extension(path: &Path, extensions: &[&str]) -> bool {
    let extension = path.extension().map(|extension| extension.to_string_lossy().to_ascii_lowercase());
    extension.is_some_and(|extension| extensions.contains(&extension.as_str()))
}

/// Returns whether a file is hidden, such as the `._1.png` that macOS writes beside `1.png`.
pub fn is_hidden(path: &Path) -> bool {
    path.file_name().is_some_and(|name| name.as_encoded_bytes().starts_with(b"."))
}

/// Reads one image file. The format is recognised by the content, not by the name.
///
/// # Errors
/// [`ImageError`] when the file is missing, cut short, of an unknown format, an animation, a TIFF of several images, an OpenEXR image without red,
/// green and blue, or holds NaN or an infinity.
pub fn read_image(path: &Path) -> Result<Frame, ImageError> {
    decode(&content(path)?, &path.display().to_string())
}

/// Reads one image file like [`read_image`], with the number of bits that its format gives a sample; `None` for a format that does not keep
/// the codes of a sensor as they are, which is any but PNG.
///
/// # Errors
/// The errors of [`read_image`].
pub fn read_codes(path: &Path) -> Result<(Frame, Option<u8>), ImageError> {
    let bytes = content(path)?;
    let frame = decode(&bytes, &path.display().to_string())?;
    // Behind the signature and the head of the first chunk: width, height, depth and colour type. A palette has colours of 8 bits.
    let depth = match (bytes.starts_with(b"\x89PNG"), bytes.get(24..26)) {
        (true, Some([_, 3])) => Some(8),
        (true, Some([depth, _])) => Some(*depth),
        _ => None,
    };
    Ok((frame, depth))
}

fn content(path: &Path) -> Result<Vec<u8>, ImageError> {
    if let Some(why) = unread(path, &[]) {
        return Err(ImageError::Undecodable(path.display().to_string(), why));
    }
    let mut bytes = Vec::new();
    let read = open_regular(path).and_then(|mut file| file.read_to_end(&mut bytes));
    read.map_err(|why| ImageError::Io(path.to_owned(), why))?;
    Ok(bytes)
}

/// Opens a regular file for reading. To open a pipe would wait for its writer, and a device may have no end.
///
/// # Errors
/// The error of the system, or one that says what the file is not: no regular file, or a pointer of git LFS.
pub fn open_regular(path: &Path) -> io::Result<File> {
    check_regular(path)?;
    let mut file = File::open(path)?;
    let mut start = Vec::new();
    file.by_ref().take(POINTER.len() as u64).read_to_end(&mut start)?;
    if start == POINTER {
        let remedy = "run 'git lfs pull' in its repository";
        let why = format!("is a pointer of git LFS, not the file itself: {remedy}");
        return Err(io::Error::new(io::ErrorKind::InvalidData, why));
    }
    file.rewind()?;
    Ok(file)
}

/// The first bytes of the text that git has in the place of a large file until git LFS fetches it.
const POINTER: &[u8] = b"version https://git-lfs.github.com/spec/v1";

/// Checks that `path` is a regular file, as [`open_regular`] does, without opening it.
///
/// # Errors
/// The error of the system, or one that says what the file is not.
pub fn check_regular(path: &Path) -> io::Result<()> {
    if std::fs::metadata(path)?.is_file() {
        return Ok(());
    }
    Err(io::Error::other(
        "is not a regular file but a pipe, a device or a folder; copy its content to a file",
    ))
}

/// Returns the bits of the samples that [`decode`] finds in an image: 8 or 16 of codes, 32 of linear radiance. Only the header is read if it is
/// no TIFF. `None` when it is no readable image.
pub fn sample_depth(mut image: impl BufRead + Seek) -> Option<u32> {
    let start = image.fill_buf().ok()?;
    if start.starts_with(radiance::SIGNATURE) {
        return Some(32);
    }
    #[cfg(feature = "tiff")]
    if is_tiff(start) {
        let mut file = Vec::new();
        image.read_to_end(&mut file).ok()?;
        return tiff::Picture::open(&file).ok().map(|picture| picture.depth());
    }
    let decoder = ImageReader::new(image).with_guessed_format().ok()?.into_decoder().ok()?;
    let colour = decoder.color_type();
    Some(8 * u32::from(colour.bytes_per_pixel() / colour.channel_count()))
}

/// Decodes one image; `origin` is its name in errors.
///
/// # Errors
/// The errors of [`read_image`].
pub fn decode(bytes: &[u8], origin: &str) -> Result<Frame, ImageError> {
    let bad = |why: String| ImageError::Undecodable(origin.to_owned(), why);
    if let Some(why) = unread::unread_content(bytes) {
        return Err(bad(why));
    }
    #[cfg(feature = "tiff")]
    if is_tiff(bytes) {
        return tiff::Picture::open(bytes).and_then(tiff::Picture::read).map_err(bad);
    }
    let picture = picture(bytes).map_err(bad)?;
    // The conversions drop alpha, and change nothing else.
    let frame = match picture.color() {
        ColorType::L8 | ColorType::La8 => Frame::from_u8(samples(picture.into_luma8())),
        ColorType::Rgb8 | ColorType::Rgba8 => Frame::from_u8(samples(picture.into_rgb8())),
        ColorType::L16 | ColorType::La16 => Frame::from_u16(samples(picture.into_luma16())),
        ColorType::Rgb16 | ColorType::Rgba16 => Frame::from_u16(samples(picture.into_rgb16())),
        ColorType::Rgb32F | ColorType::Rgba32F => Frame::from_f32(samples(picture.into_rgb32f())),
        other => return Err(bad(format!("colour type {other:?} is not supported"))),
    };
    frame.map_err(|e| bad(e.to_string()))
}

/// Returns whether a file begins as a TIFF or a BigTIFF of either byte order.
#[cfg(feature = "tiff")]
fn is_tiff(bytes: &[u8]) -> bool {
    [b"II*\0", b"MM\0*", b"II+\0", b"MM\0+"].iter().any(|first| bytes.starts_with(*first))
}

/// What is said of a file that is cut.
const TRUNCATED: &str = "is truncated; copy the whole file again";

/// Decodes an image of another format than TIFF. The error is the reason.
fn picture(bytes: &[u8]) -> Result<DynamicImage, String> {
    let why = |error: image::ImageError| match error {
        image::ImageError::IoError(why) if why.kind() == io::ErrorKind::UnexpectedEof => TRUNCATED.to_owned(),
        error => error.to_string(),
    };
    if bytes.starts_with(radiance::SIGNATURE) {
        return radiance::read(bytes).map_err(why);
    }
    let reader = ImageReader::new(Cursor::new(bytes)).with_guessed_format().map_err(|e| e.to_string())?;
    match reader.format() {
        Some(format) => check_container(format, bytes)?,
        None if bytes.is_empty() => return Err("is empty; copy the file again".to_owned()),
        None => {
            return Err(
                "is none of the images that are read, which are PNG, JPEG, TIFF, OpenEXR and Radiance HDR"
                    .to_owned(),
            );
        }
    }
    upright(reader).map_err(why)
}

/// Decodes an image and turns it as its EXIF orientation says.
fn upright(reader: ImageReader<Cursor<&[u8]>>) -> Result<DynamicImage, image::ImageError> {
    let mut decoder = reader.into_decoder()?;
    // A header that claims a huge image must not use up the memory.
    Limits::default().reserve(decoder.total_bytes())?;
    let orientation = decoder.orientation()?;
    let mut image = DynamicImage::from_decoder(decoder)?;
    image.apply_orientation(orientation);
    Ok(image)
}

/// Returns the samples of an image, `H x W x C`.
fn samples<P: Pixel>(image: ImageBuffer<P, Vec<P::Subpixel>>) -> Array3<P::Subpixel> {
    let dim = (image.height() as usize, image.width() as usize, P::CHANNEL_COUNT.into());
    Array3::from_shape_vec(dim, image.into_raw()).expect("an image has all its samples")
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
    let saved = encode(frame, FileFormat::Png).and_then(|file| Ok(std::fs::write(path, file)?));
    saved.map_err(|source| SaveError { path: path.to_owned(), source })
}

/// Writes `radiance` (H x W x C, where C is 1 or 3) to `path` as OpenEXR of 32 bits. Grey becomes three equal colours.
///
/// # Errors
/// [`SaveError`] when the file cannot be written.
#[cfg(feature = "exr")]
pub fn save_exr(path: &Path, radiance: &Array3<f32>) -> Result<(), SaveError> {
    let (height, width, channels) = radiance.dim();
    let value = |x: u32, y: u32, colour: usize| radiance[(y as usize, x as usize, colour.min(channels - 1))];
    let image = image::Rgb32FImage::from_fn(width as u32, height as u32, |x, y| {
        image::Rgb([0, 1, 2].map(|colour| value(x, y, colour)))
    });
    image
        .save_with_format(path, ImageFormat::OpenExr)
        .map_err(|source| SaveError { path: path.to_owned(), source })
}

/// The format of a file that [`encode`] makes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum FileFormat {
    /// Small, with 8 bits a sample, whose values it changes a little.
    #[default]
    Jpeg,
    /// Exact, with 8 or 16 bits a sample.
    Png,
}

impl FileFormat {
    /// Each format with its name.
    pub const WORDS: [(&'static str, Self); 2] = [("jpeg", Self::Jpeg), ("png", Self::Png)];

    /// Returns its name.
    pub fn word(self) -> &'static str {
        if self == Self::Jpeg { "jpeg" } else { "png" }
    }
}

/// Quality of JPEG files in 1 to 100, the default of ROS's `compressed_image_transport`.
const JPEG_QUALITY: u8 = 95;

/// Returns `frame` as the content of an image file, grey or RGB.
///
/// # Errors
/// The error of the encoder: no format here holds floats, and JPEG holds 8 bits.
pub fn encode(frame: &Frame, format: FileFormat) -> Result<Vec<u8>, image::ImageError> {
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
    let (width, height, mut file) = (side(width)?, side(height)?, Vec::new());
    match format {
        FileFormat::Png => PngEncoder::new(&mut file).write_image(&bytes, width, height, colour),
        FileFormat::Jpeg => {
            JpegEncoder::new_with_quality(&mut file, JPEG_QUALITY).write_image(&bytes, width, height, colour)
        }
    }?;
    Ok(file)
}

/// Checks the container of an image of `format`. The error is the reason and the remedy.
fn check_container(format: ImageFormat, bytes: &[u8]) -> Result<(), String> {
    match format {
        ImageFormat::Jpeg => jpeg::check(bytes),
        ImageFormat::Png => match apng_frames(bytes) {
            Some(frames) if frames > 1 => Err(format!(
                "this PNG is an animation of {frames} frames (APNG), but only single images are read; save each frame \
                 as a file"
            )),
            _ => Ok(()),
        },
        #[cfg(feature = "exr")]
        ImageFormat::OpenExr => exr_channels(bytes),
        _ => Ok(()),
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
#[cfg(feature = "exr")]
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

#[cfg(test)]
mod tests {
    use std::fmt::Write as _;

    use exr::prelude::{SpecificChannels, WritableImage};
    use image::GrayImage;

    use super::*;

    /// An image of 3 x 2 blocks of 8 x 8 px, of which the top left one is bright, with this EXIF orientation.
    fn photograph(format: ImageFormat, orientation: u8) -> Vec<u8> {
        let mut bytes = Vec::new();
        // TIFF, big endian: one entry, tag 0x0112 (orientation), one SHORT.
        let exif =
            [b"MM\0\x2a\0\0\0\x08\0\x01\x01\x12\0\x03\0\0\0\x01\0", &[orientation][..], &[0; 6]].concat();
        // JPEG works on such blocks, so that it keeps their levels.
        let picture = GrayImage::from_fn(24, 16, |x, y| image::Luma([if x < 8 && y < 8 { 200 } else { 40 }]));
        let colour = ExtendedColorType::L8;
        if format == ImageFormat::Jpeg {
            let mut encoder = JpegEncoder::new_with_quality(&mut bytes, 100);
            encoder.set_exif_metadata(exif).expect("JPEG has EXIF");
            encoder.write_image(&picture, 24, 16, colour).expect("encoded");
        } else {
            let mut encoder = PngEncoder::new(&mut bytes);
            encoder.set_exif_metadata(exif).expect("PNG has EXIF");
            encoder.write_image(&picture, 24, 16, colour).expect("encoded");
        }
        bytes
    }

    /// The bright block of an image, as (row, column) of the blocks, and the size in blocks.
    fn bright(frame: &Frame) -> ((usize, usize), (usize, usize)) {
        let levels = frame.to_f32();
        let (height, width, _) = levels.dim();
        let blocks = (0..height / 8).flat_map(|row| (0..width / 8).map(move |column| (row, column)));
        let found = blocks.filter(|(row, column)| levels[(8 * row + 4, 8 * column + 4, 0)] > 100.0);
        let found: Vec<_> = found.collect();
        assert_eq!(found.len(), 1, "one bright block");
        (found[0], (height / 8, width / 8))
    }

    #[test]
    fn images_are_turned_as_their_orientation_says() {
        for format in [ImageFormat::Jpeg, ImageFormat::Png] {
            // The values of EXIF: 1 as it is, 2 mirrored, 3 half a turn, 6 a quarter turn to the right, 8 to the left.
            for (orientation, place, size) in [
                (1, (0, 0), (2, 3)),
                (2, (0, 2), (2, 3)),
                (3, (1, 2), (2, 3)),
                (6, (0, 1), (3, 2)),
                (8, (2, 0), (3, 2)),
            ] {
                let frame = decode(&photograph(format, orientation), "photograph").expect("readable");
                assert_eq!(bright(&frame), (place, size), "{format:?} {orientation}");
            }
        }
    }

    #[test]
    fn a_truncated_jpeg_is_refused_with_its_name() {
        let bytes = photograph(ImageFormat::Jpeg, 1);
        for length in 3..bytes.len() {
            let why = decode(&bytes[..length], "street.jpg").expect_err("truncated").to_string();
            assert!(why.contains("street.jpg") && why.contains("truncated"), "{length}: {why}");
        }
        // Cameras write other data behind the image, and a thumbnail is a whole JPEG within the header.
        decode(&[&bytes[..], &[0; 40]].concat(), "street.jpg").expect("whole");
        let mut with_thumbnail =
            [&[0xff, 0xd8, 0xff, 0xe1][..], &(bytes.len() as u16 + 2).to_be_bytes()].concat();
        with_thumbnail.extend([&bytes[..], &bytes[2..]].concat());
        decode(&with_thumbnail, "street.jpg").expect("whole");
        let cut = with_thumbnail.len() - 2;
        assert!(decode(&with_thumbnail[..cut], "street.jpg").is_err(), "only the thumbnail has an end");
    }

    #[test]
    fn an_animation_is_refused_with_the_number_of_its_frames() {
        let bytes = photograph(ImageFormat::Png, 1);
        // Behind the signature and the header, both of a fixed length.
        let animated = |frames: u8| {
            // The checksum of the control is that of its type and data.
            let control = [b"acTL\0\0\0", &[frames][..], &[0; 4]].concat();
            let sum = crc(&control).to_be_bytes();
            [&bytes[..33], &[0, 0, 0, 8], &control, &sum, &bytes[33..]].concat()
        };
        let why = decode(&animated(3), "loop.png").expect_err("an animation").to_string();
        assert!(why.contains("loop.png") && why.contains("3 frames (APNG)"), "{why}");
        decode(&animated(1), "still.png").expect("one image");
    }

    /// The checksum of a PNG chunk.
    fn crc(data: &[u8]) -> u32 {
        !data.iter().fold(u32::MAX, |crc, byte| {
            (0..8).fold(
                crc ^ u32::from(*byte),
                |crc, _| if crc & 1 == 1 { crc >> 1 ^ 0xedb8_8320 } else { crc >> 1 },
            )
        })
    }

    #[test]
    fn an_exr_of_luminance_and_chroma_is_refused_with_its_channels() {
        let mut bytes = Cursor::new(Vec::new());
        let channels = SpecificChannels::build().with_channel("BY").with_channel("RY").with_channel("Y");
        let channels = channels.with_pixel_fn(|_| (0.0_f32, 0.0_f32, 0.5_f32));
        exr::prelude::Image::from_channels((4, 4), channels)
            .write()
            .to_buffered(&mut bytes)
            .expect("written");
        let why = decode(bytes.get_ref(), "sky.exr").expect_err("no RGB").to_string();
        assert!(why.contains("sky.exr") && why.contains("BY, RY, Y") && why.contains("R, G and B"), "{why}");
        let bytes = bytes.into_inner();
        for length in 0..bytes.len() {
            let why = decode(&bytes[..length], "cut.exr").expect_err("truncated").to_string();
            assert!(why.contains("cut.exr"), "{length}: {why}");
        }
    }

    #[test]
    fn no_cut_or_changed_file_is_a_panic() {
        for bytes in [photograph(ImageFormat::Jpeg, 6), photograph(ImageFormat::Png, 6)] {
            let mut printed = String::new();
            for place in 0..bytes.len() {
                let mut damaged = bytes.clone();
                damaged[place] ^= 0xff;
                if let Err(why) = decode(&damaged, "damaged") {
                    let _ = writeln!(printed, "{why}");
                }
            }
            assert!(printed.lines().all(|line| line.starts_with("damaged: ")), "{printed}");
        }
    }
}
