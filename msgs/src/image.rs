//! Conversion between [`Image`], which has rows of bytes, and [`Frame`], which has the pixels that the suite computes
//! with.
//!
//! Pixels are never scaled, converted between depths, demosaiced, or guessed: an encoding that is not in the table is refused. Only
//! luma and chroma become red, green and blue (`yuv.rs`). Images are written without padding and in little endian.

use modulo_core::{Frame, FrameError, Mosaic, Samples};
use ndarray::Array3;

use crate::cdr::{self, CdrError};
use crate::sensor_msgs::Image;
use crate::std_msgs::Header;
use crate::yuv::YuvLayout;

/// Error of an [`Image`] that is not a valid [`Frame`].
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum ImageMessageError {
    /// The encoding cannot be read, or the step, the sides, the data or the picture do not fit it.
    #[error("{0}")]
    Layout(String),
    /// The sizes are not those of a frame, or a float sample is not finite.
    #[error(transparent)]
    Frame(#[from] FrameError),
}

/// The channels of one pixel, in order.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Channels {
    Mono,
    Bayer(Mosaic),
    Rgb,
    Bgr,
    Rgba,
    Bgra,
    Yuv(YuvLayout),
}

/// Depth and channels of a pixel.
#[derive(Clone, Copy)]
struct Encoding {
    /// Bits of a sample: 8 or 16, or 32 of a float.
    depth: u8,
    channels: Channels,
}

/// The encodings that can be read.
///
/// Source: `sensor_msgs/image_encodings.hpp`, and `nv12` of V4L2, which it does not have.
const ENCODINGS: [(&str, u8, Channels); 33] = [
    ("rgb8", 8, Channels::Rgb),
    ("bgr8", 8, Channels::Bgr),
    ("mono8", 8, Channels::Mono),
    ("rgba8", 8, Channels::Rgba),
    ("bgra8", 8, Channels::Bgra),
    ("rgb16", 16, Channels::Rgb),
    ("bgr16", 16, Channels::Bgr),
    ("mono16", 16, Channels::Mono),
    ("rgba16", 16, Channels::Rgba),
    ("bgra16", 16, Channels::Bgra),
    ("bayer_rggb8", 8, Channels::Bayer(Mosaic::Rggb)),
    ("bayer_bggr8", 8, Channels::Bayer(Mosaic::Bggr)),
    ("bayer_grbg8", 8, Channels::Bayer(Mosaic::Grbg)),
    ("bayer_gbrg8", 8, Channels::Bayer(Mosaic::Gbrg)),
    ("bayer_rggb16", 16, Channels::Bayer(Mosaic::Rggb)),
    ("bayer_bggr16", 16, Channels::Bayer(Mosaic::Bggr)),
    ("bayer_grbg16", 16, Channels::Bayer(Mosaic::Grbg)),
    ("bayer_gbrg16", 16, Channels::Bayer(Mosaic::Gbrg)),
    // The encodings of OpenCV do not name their channels. OpenCV itself keeps blue first.
    ("8UC1", 8, Channels::Mono),
    ("8UC3", 8, Channels::Bgr),
    ("8UC4", 8, Channels::Bgra),
    ("16UC1", 16, Channels::Mono),
    ("16UC3", 16, Channels::Bgr),
    ("16UC4", 16, Channels::Bgra),
    ("32FC1", 32, Channels::Mono),
    ("32FC3", 32, Channels::Bgr),
    ("uyvy", 8, Channels::Yuv(YuvLayout::Uyvy)),
    ("yuyv", 8, Channels::Yuv(YuvLayout::Yuyv)),
    // The older names of the two.
    ("yuv422", 8, Channels::Yuv(YuvLayout::Uyvy)),
    ("yuv422_yuy2", 8, Channels::Yuv(YuvLayout::Yuyv)),
    ("nv12", 8, Channels::Yuv(YuvLayout::Nv12)),
    ("nv21", 8, Channels::Yuv(YuvLayout::Nv21)),
    ("nv24", 8, Channels::Yuv(YuvLayout::Nv24)),
];

impl Encoding {
    fn of(name: &str) -> Option<Self> {
        let found = ENCODINGS.iter().find(|(known, ..)| *known == name);
        found.map(|&(_, depth, channels)| Self { depth, channels })
    }

    /// Returns the number of bytes of one pixel in the rows that the step counts.
    fn pixel(self) -> u64 {
        let samples = match self.channels {
            Channels::Mono | Channels::Bayer(_) => 1,
            Channels::Rgb | Channels::Bgr => 3,
            Channels::Rgba | Channels::Bgra => 4,
            Channels::Yuv(layout) => layout.pixel(),
        };
        u64::from(self.depth / 8) * samples
    }

    /// Refuses an image in which a pixel would have no chroma.
    fn check_sides(
        self,
        &Image { height, width, ref encoding, .. }: &Image,
    ) -> Result<(), ImageMessageError> {
        let Channels::Yuv(layout) = self.channels else { return Ok(()) };
        let (columns, rows) = layout.block();
        if width.is_multiple_of(columns) && height.is_multiple_of(rows) {
            return Ok(());
        }
        Err(ImageMessageError::Layout(format!(
            "image of {width} x {height} px has the encoding '{encoding}', whose sides must be multiples of {columns} and {rows} px"
        )))
    }
}

fn names() -> String {
    ENCODINGS.map(|(name, ..)| name).join(", ")
}

impl Image {
    /// Returns the pixels, red first.
    ///
    /// Reads `rgb8 bgr8 mono8 rgba8 bgra8 rgb16 bgr16 mono16 rgba16 bgra16 8UC{1,3,4} 16UC{1,3,4} 32FC{1,3}`, the colour mosaics
    /// `bayer_{rggb,bggr,grbg,gbrg}{8,16}`, and `uyvy yuyv yuv422 yuv422_yuy2 nv12 nv21 nv24` as `rgb8`, in either byte order with any
    /// `step` of at least one row. Alpha is dropped. `8UC3` and its like do not define the order of their channels and are read
    /// as those of OpenCV, blue first. The step of the last three encodings is that of their plane of luma. The buffer of `rgb8` and
    /// `mono8` without padding is kept instead of copied.
    ///
    /// # Errors
    /// [`ImageMessageError`] for another encoding, a side of 0, a mosaic with a side of 1, pixels that share their chroma with none, a
    /// `step` below one row, too few bytes, and floats that are NaN or infinite.
    pub fn into_frame(self) -> Result<Frame, ImageMessageError> {
        decode(PixelLayout::of(&self)?, self.data)
    }
}

/// The layout of the pixels in the data of an image. A layout always fits its data.
#[derive(Clone, Copy)]
struct PixelLayout {
    encoding: Encoding,
    height: usize,
    width: usize,
    /// Bytes of a row's pixels, at most `step`.
    row: usize,
    step: usize,
    big_endian: bool,
}

impl PixelLayout {
    fn of(image: &Image) -> Result<Self, ImageMessageError> {
        let refuse = |why: String| ImageMessageError::Layout(format!("image {why}"));
        let Image { height, width, step, .. } = *image;
        let encoding = Encoding::of(&image.encoding).ok_or_else(|| {
            refuse(format!("encoding '{}' cannot be read, possible are {}", image.encoding, names()))
        })?;
        let (h, w) = (height as usize, width as usize);
        if h == 0 || w == 0 {
            return Err(FrameError::Empty(h, w).into());
        }
        encoding.check_sides(image)?;
        // Height, width and step come from the network. Their products fit in 64 bits, but not in 32 bits.
        let row = u64::from(width) * encoding.pixel();
        if u64::from(step) < row {
            return Err(refuse(format!("step is {step} bytes, a row needs at least {row}")));
        }
        let rows = u64::from(height) * u64::from(step);
        let expected = if let Channels::Yuv(layout) = encoding.channels { layout.size(rows) } else { rows };
        if (image.data.len() as u64) < expected {
            let got = image.data.len();
            let why = format!("data has {got} bytes, {expected} expected of its height, step and encoding");
            return Err(refuse(why));
        }
        // More bytes than these are no error, because the pixels are known all the same.
        let big_endian = image.is_bigendian != 0;
        Ok(Self { encoding, height: h, width: w, row: row as usize, step: step as usize, big_endian })
    }
}

/// Makes pixels of the bytes in three steps: drop the padding of the rows, make samples of bytes, put red first. Each step
/// copies only if it changes something. Luma and chroma are converted in a single step.
fn decode(layout: PixelLayout, data: Vec<u8>) -> Result<Frame, ImageMessageError> {
    let channels = layout.encoding.channels;
    if let Channels::Yuv(yuv) = channels {
        let PixelLayout { height, width, step, .. } = layout;
        return Ok(Frame::from_u8(array(layout, yuv.to_rgb(&data, height, width, step)))?);
    }
    let packed = without_padding(layout, data);
    let frame = match layout.encoding.depth {
        8 => Frame::from_u8(array(layout, red_first(channels, packed))),
        16 => {
            let samples = wide(layout.big_endian, &packed, u16::from_be_bytes, u16::from_le_bytes);
            Frame::from_u16(array(layout, red_first(channels, samples)))
        }
        _ => {
            let samples = wide(layout.big_endian, &packed, f32::from_be_bytes, f32::from_le_bytes);
            Frame::from_f32(array(layout, red_first(channels, samples)))
        }
    }?;
    Ok(match channels {
        Channels::Bayer(mosaic) => frame.with_mosaic(mosaic)?,
        _ => frame,
    })
}

fn without_padding(PixelLayout { height, row, step, .. }: PixelLayout, mut data: Vec<u8>) -> Vec<u8> {
    if row < step {
        return data.chunks_exact(step).take(height).flat_map(|padded| &padded[..row]).copied().collect();
    }
    // Shortened in place, so that it becomes the buffer of the frame.
    data.truncate(height * row);
    data
}

/// Samples of `N` bytes each.
fn wide<T, const N: usize>(
    big_endian: bool,
    bytes: &[u8],
    big: impl Fn([u8; N]) -> T,
    little: impl Fn([u8; N]) -> T,
) -> Vec<T> {
    let (samples, _) = bytes.as_chunks();
    if big_endian {
        samples.iter().map(|bytes| big(*bytes)).collect()
    } else {
        samples.iter().map(|bytes| little(*bytes)).collect()
    }
}

fn red_first<T: Copy>(channels: Channels, samples: Vec<T>) -> Vec<T> {
    match channels {
        // Luma and chroma have become red, green and blue before.
        Channels::Mono | Channels::Bayer(_) | Channels::Rgb | Channels::Yuv(_) => samples,
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
    let channels = if let Channels::Mono | Channels::Bayer(_) = layout.encoding.channels { 1 } else { 3 };
    Array3::from_shape_vec((height, width, channels), samples).expect("the layout fits its data")
}

/// Returns the CDR of an [`Image`] with this `header` and the pixels of `frame`, as `rgb8`, `mono8`, `bayer_*8`, `rgb16`, `mono16`,
/// `bayer_*16`, `32FC3` (blue first, as OpenCV has it) or `32FC1`, without padding, little endian.
///
/// # Errors
/// [`CdrError`] when the frame has 4 GiB or more.
pub fn encode_frame(header: &Header, frame: &Frame) -> Result<Vec<u8>, CdrError> {
    // The pixels are the last field of the message. Without pixels, the last four bytes are their length, 0. They are
    // replaced by the true length and the pixels, which saves a copy of the pixels in a message.
    let mut out = cdr::to_vec(&without_pixels(header.clone(), frame))?;
    out.truncate(out.len() - size_of::<u32>());
    let got = size(frame);
    let length = u32::try_from(got).map_err(|_| CdrError::Long(got))?;
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

/// Returns the encoding that [`encode_frame`] gives the frame.
pub fn encoding_of(frame: &Frame) -> &'static str {
    let channels = match (frame.mosaic(), frame.channels(), frame.depth()) {
        (Some(mosaic), ..) => Channels::Bayer(mosaic),
        (None, 1, _) => Channels::Mono,
        // Only OpenCV has names for floats.
        (None, _, 32) => Channels::Bgr,
        (None, ..) => Channels::Rgb,
    };
    let named = ENCODINGS.iter().find(|(_, depth, known)| (*depth, *known) == (frame.depth(), channels));
    named.expect("every frame has an encoding: a mosaic has integers").0
}

/// Returns the image that was compressed to `picture`. `format` is that of the message, as `compressed_image_transport` writes it: the
/// encoding of the image, `;`, the format of the file and the order of its channels. A file does not tell that its grey pixels are a
/// colour mosaic.
///
/// # Errors
/// [`ImageMessageError::Layout`] when the picture is not that of the encoding, such as one of 8 bits for `mono16`, whose codes were lost.
pub fn restore(picture: Frame, format: &str) -> Result<Frame, ImageMessageError> {
    let (encoding, file) = format.split_once(';').unwrap_or((format, ""));
    let Some(encoding) = Encoding::of(encoding.trim()) else { return Ok(picture) };
    let is_same = picture.channels() == 1 && picture.depth() == encoding.depth;
    match encoding.channels {
        Channels::Mono | Channels::Bayer(_) if file.contains("bgr") || file.contains("rgb") => Ok(picture),
        Channels::Mono if is_same => Ok(picture),
        Channels::Bayer(mosaic) if is_same => Ok(picture.with_mosaic(mosaic)?),
        Channels::Mono | Channels::Bayer(_) => {
            let (depth, channels) = (picture.depth(), picture.channels());
            Err(ImageMessageError::Layout(format!(
                "picture of {depth} bits and {channels} channels in a compressed image whose format is '{format}'; publish it as \
                 png, or with the format of its picture"
            )))
        }
        _ => Ok(picture),
    }
}

fn without_pixels(header: Header, frame: &Frame) -> Image {
    // A side beyond 32 bits means data beyond 32 bits, which CDR refuses.
    let field = |n: usize| u32::try_from(n).unwrap_or(u32::MAX);
    Image {
        header,
        height: field(frame.height()),
        width: field(frame.width()),
        encoding: encoding_of(frame).to_owned(),
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
            // 32FC3 has blue first, but a frame has red first: the samples of each pixel are reversed.
            let pixels = in_order(pixels).chunks_exact(frame.channels());
            out.extend(pixels.flat_map(|pixel| pixel.iter().rev()).flat_map(|sample| sample.to_le_bytes()));
        }
    }
}

/// Returns the samples row by row.
fn in_order<T>(pixels: &Array3<T>) -> &[T] {
    pixels.as_slice().expect("a frame is in standard layout")
}
