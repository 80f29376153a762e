//! TIFF and BigTIFF files: the one picture of a file, as codes of 8 or 16 bits or as floats.

use std::io::{Cursor, ErrorKind};

use modulo_core::Frame;
use ndarray::{Array3, Axis};
use tiff::decoder::{Decoder, DecodingResult};
use tiff::tags::{SampleFormat, Tag};
use tiff::{ColorType, TiffError, TiffUnsupportedError};

use crate::TRUNCATED;
use crate::unread::{RAW_REMEDY, raw};

/// The remedies for samples that are not read, and for integers that do not fit in 16 bits.
const CONVERT: &str = "convert it, such as by ImageMagick: convert FILE -depth 16 FILE.png";
const FLOATS: &str = "save it as floats of 32 bits, such as by Python: import tifffile; tifffile.imwrite('out.tif', \
                      tifffile.imread('FILE').astype('float32'))";

/// A picture whose samples are not read yet.
pub(crate) struct Picture<'a> {
    decoder: Decoder<Cursor<&'a [u8]>>,
    colour: ColorType,
    format: SampleFormat,
    /// Channels of a pixel without alpha, 1 or 3, and with it.
    channels: [usize; 2],
    /// As EXIF has it, from 1.
    orientation: u16,
    /// Whether the samples of a channel follow each other.
    is_planar: bool,
}

impl<'a> Picture<'a> {
    /// Finds the one picture of a file. The error is the reason why it is not read.
    pub fn open(file: &'a [u8]) -> Result<Self, String> {
        let mut decoder = one_picture(file)?;
        let colour = decoder.colortype().map_err(why)?;
        let mut number = |tag, default| {
            let values = decoder.find_tag_unsigned_vec::<u16>(tag).map_err(why)?;
            Ok::<_, String>(values.and_then(|values| values.first().copied()).unwrap_or(default))
        };
        let format = SampleFormat::from_u16_exhaustive(number(Tag::SampleFormat, 1)?);
        let (orientation, is_planar) =
            (number(Tag::Orientation, 1)?, number(Tag::PlanarConfiguration, 1)? == 2);
        let (bits, stored) = (colour.bit_depth(), number(Tag::SamplesPerPixel, 1)?);
        let is_alpha = matches!(number(Tag::ExtraSamples, 0)?, 1 | 2);
        let channels = channels_of(colour, is_alpha);
        // The decoder knows one order of bits, and adds up differences wrongly where it leaves samples out.
        let is_plain = number(Tag::FillOrder, 1)? == 1
            && (number(Tag::Predictor, 1)? == 1 || stored == colour.num_samples());
        let (what, remedy) = match (channels, format, bits) {
            (None, ..) => (format!("the colours {colour:?}, but grey and RGB are read"), CONVERT),
            (Some(channels), SampleFormat::Uint, 8 | 16)
            | (Some(channels), SampleFormat::IEEEFP, 16 | 32 | 64) => {
                if is_plain {
                    return Ok(Self { decoder, colour, format, channels, orientation, is_planar });
                }
                ("bits in reverse order (FillOrder 2), or a predictor over extra samples".to_owned(), CONVERT)
            }
            (_, SampleFormat::Uint, ..16) => {
                (format!("{bits} bits per sample, but 8 and 16 bits, and floats, are read"), CONVERT)
            }
            _ => {
                let read = "but 8 and 16 bits without a sign, and floats, are read";
                (format!("samples of {bits} bits ({format:?}), {read}"), FLOATS)
            }
        };
        Err(format!("has {what}; {remedy}"))
    }

    /// Returns the bits of its samples, in which all floats are read alike.
    pub fn depth(&self) -> u32 {
        if self.format == SampleFormat::Uint { self.colour.bit_depth().into() } else { 32 }
    }

    /// Reads its samples. The error is the reason and the remedy.
    pub fn read(mut self) -> Result<Frame, String> {
        let mut samples = DecodingResult::U8(Vec::new());
        self.decoder.read_image_to_buffer(&mut samples).map_err(why)?;
        let frame = match samples {
            DecodingResult::U8(codes) => Frame::from_u8(self.upright(codes)?),
            DecodingResult::U16(codes) => Frame::from_u16(self.upright(codes)?),
            DecodingResult::F16(values) => {
                Frame::from_f32(self.upright(values)?.mapv(|value| value.to_f32()))
            }
            DecodingResult::F32(values) => Frame::from_f32(self.upright(values)?),
            DecodingResult::F64(values) => Frame::from_f32(self.upright(values)?.mapv(|value| value as f32)),
            _ => {
                return Err(format!("has {:?} samples of another kind than it says; {CONVERT}", self.colour));
            }
        };
        frame.map_err(|why| why.to_string())
    }

    /// Returns the samples without alpha, `H x W x C`, turned as the orientation says.
    fn upright<T: Clone>(&mut self, samples: Vec<T>) -> Result<Array3<T>, String> {
        let (width, height) = self.decoder.dimensions().map_err(why)?;
        let (height, width, [channels, stored]) = (height as usize, width as usize, self.channels);
        let mut image = if self.is_planar {
            Array3::from_shape_vec((stored, height, width), samples)
                .map(|planes| planes.permuted_axes([1, 2, 0]))
        } else {
            Array3::from_shape_vec((height, width, stored), samples)
        }
        .map_err(|_| TRUNCATED)?;
        image.slice_axis_inplace(Axis(2), (..channels).into());
        if self.orientation > 4 {
            image.swap_axes(0, 1);
        }
        for (axis, turned) in [(0, [3, 4, 7, 8]), (1, [2, 3, 6, 7])] {
            if turned.contains(&self.orientation) {
                image.invert_axis(Axis(axis));
            }
        }
        Ok(image.as_standard_layout().into_owned())
    }
}

/// Returns the channels of a pixel without alpha and with it; `None` for colours that are not read.
fn channels_of(colour: ColorType, is_alpha: bool) -> Option<[usize; 2]> {
    match colour {
        ColorType::Gray(_) => Some([1, 1]),
        ColorType::Multiband { num_samples: 2, .. } if is_alpha => Some([1, 2]),
        ColorType::RGB(_) => Some([3, 3]),
        ColorType::RGBA(_) => Some([3, 4]),
        _ => None,
    }
}

/// Goes to the one picture of a file, beside which it may have small versions and masks. The error is the reason why there is none.
fn one_picture(file: &[u8]) -> Result<Decoder<Cursor<&[u8]>>, String> {
    const DNG_VERSION: Tag = Tag::Unknown(50_706);
    let (mut decoder, mut pictures, mut index) =
        (Decoder::new(Cursor::new(file)).map_err(why)?, Vec::new(), 0);
    loop {
        let mut number = |tag| decoder.find_tag_unsigned_vec::<u32>(tag).map_err(why);
        let first =
            |values: Option<Vec<u32>>| values.and_then(|values| values.first().copied()).unwrap_or_default();
        if number(DNG_VERSION)?.is_some() {
            return Err(raw(" (DNG)"));
        }
        let is_beside =
            first(number(Tag::NewSubfileType)?) & 0b101 != 0 || first(number(Tag::SubfileType)?) == 2;
        pictures.extend((!is_beside).then_some(index));
        if !decoder.more_images() || pictures.len() > 1 {
            break;
        }
        decoder.next_image().map_err(why)?;
        index += 1;
    }
    match pictures[..] {
        [picture] => decoder.seek_to_image(picture).map(|()| decoder).map_err(why),
        [] => Err(format!(
            "holds only a small preview of its picture, as the raw files of cameras do; {RAW_REMEDY}"
        )),
        _ => Err(
            "this TIFF holds several images, but only single images are read; save each of them as a file"
                .to_owned(),
        ),
    }
}

/// Returns the reason and the remedy of an error of the decoder.
fn why(error: TiffError) -> String {
    match error {
        TiffError::IoError(why) if why.kind() == ErrorKind::UnexpectedEof => TRUNCATED.to_owned(),
        TiffError::UnsupportedError(TiffUnsupportedError::UnknownInterpretation) => {
            format!(
                "has samples of an unknown kind, as the raw files of cameras do; {RAW_REMEDY}, or mark a raw mosaic as grey, such as by libtiff: \
                 tiffset -s 262 1 FILE"
            )
        }
        TiffError::UnsupportedError(TiffUnsupportedError::UnsupportedCompressionMethod(method)) => format!(
            "has the compression {method:?}, which is not read; save it without, such as by libtiff: tiffcp -c none FILE OUT.tif"
        ),
        TiffError::UnsupportedError(why) => format!("is a TIFF that is not read ({why}); {CONVERT}"),
        error => error.to_string(),
    }
}

#[cfg(test)]
mod tests {
    use ndarray::Array3;
    use tiff::encoder::colortype::{self, ColorType as Colour};
    use tiff::encoder::{TiffEncoder, TiffKind, TiffValue};

    use super::*;
    use crate::{decode, sample_depth};

    /// The tags of a preview, and of a DNG.
    const PREVIEW: (Tag, u32) = (Tag::NewSubfileType, 1);
    const DNG: (Tag, u32) = (Tag::Unknown(50_706), 1);

    /// Adds an image of 4 x 3 px with these samples and tags.
    fn add<C: Colour, K: TiffKind>(
        file: &mut TiffEncoder<&mut Cursor<Vec<u8>>, K>,
        samples: &[C::Inner],
        tags: &[(Tag, u32)],
    ) where
        [C::Inner]: TiffValue,
    {
        let mut image = file.new_image::<C>(4, 3).expect("an image");
        for (tag, value) in tags {
            image.encoder().write_tag(*tag, *value).expect("a tag");
        }
        image.write_data(samples).expect("samples");
    }

    /// A file of one image.
    fn file<C: Colour>(samples: &[C::Inner], tags: &[(Tag, u32)]) -> Vec<u8>
    where
        [C::Inner]: TiffValue,
    {
        let mut bytes = Cursor::new(Vec::new());
        add::<C, _>(&mut TiffEncoder::new(&mut bytes).expect("a file"), samples, tags);
        bytes.into_inner()
    }

    fn refusal(file: &[u8]) -> String {
        let why = decode(file, "a.tif").expect_err("refused").to_string();
        assert!(why.starts_with("a.tif: ") && sample_depth(Cursor::new(file)).is_none(), "{why}");
        why
    }

    #[test]
    fn codes_and_floats_are_read() {
        let (grey, rgb) = ((3, 4, 1), (3, 4, 3));
        let values = |count: usize| (0..count).map(|at| at as f32 * 0.25 - 1.0).collect::<Vec<_>>();
        let frame = |dim, values: Vec<f32>| {
            Frame::from_f32(Array3::from_shape_vec(dim, values).expect("samples")).expect("a frame")
        };
        let codes: Vec<u16> = (0..36).map(|at| 1800 * at).collect();
        let (bytes, doubles) =
            (codes.iter().map(|code| (code >> 8) as u8), values(12).into_iter().map(f64::from));
        let [bytes, few] = [36, 12].map(|count| bytes.clone().take(count).collect::<Vec<_>>());
        let of_u16 = |dim, codes: &[u16]| {
            Frame::from_u16(Array3::from_shape_vec(dim, codes.to_vec()).expect("samples"))
        };
        let of_u8 =
            |dim, codes: &[u8]| Frame::from_u8(Array3::from_shape_vec(dim, codes.to_vec()).expect("samples"));
        for (file, expected, depth) in [
            (file::<colortype::Gray8>(&few, &[]), of_u8(grey, &few), 8),
            (file::<colortype::RGB8>(&bytes, &[]), of_u8(rgb, &bytes), 8),
            (file::<colortype::Gray16>(&codes[..12], &[]), of_u16(grey, &codes[..12]), 16),
            (file::<colortype::RGB16>(&codes, &[]), of_u16(rgb, &codes), 16),
            (file::<colortype::Gray32Float>(&values(12), &[]), Ok(frame(grey, values(12))), 32),
            (file::<colortype::RGB32Float>(&values(36), &[]), Ok(frame(rgb, values(36))), 32),
            (
                file::<colortype::Gray64Float>(&doubles.collect::<Vec<_>>(), &[]),
                Ok(frame(grey, values(12))),
                32,
            ),
        ] {
            assert_eq!(decode(&file, "a.tif").expect("readable"), expected.expect("a frame"));
            assert_eq!(sample_depth(Cursor::new(&file)), Some(depth));
            for length in 0..file.len() {
                let why = decode(&file[..length], "cut.tif").expect_err("cut").to_string();
                assert!(why.starts_with("cut.tif: "), "{length}: {why}");
            }
        }
    }

    #[test]
    fn other_samples_are_refused_with_a_remedy() {
        let signed = refusal(&file::<colortype::GrayI16>(&[-1; 12], &[]));
        assert!(signed.contains("16 bits (Int)") && signed.contains("tifffile"), "{signed}");
        let wide = refusal(&file::<colortype::Gray32>(&[70_000; 12], &[]));
        assert!(wide.contains("32 bits") && wide.contains("astype('float32')"), "{wide}");
        let cmyk = refusal(&file::<colortype::CMYK8>(&[0; 48], &[]));
        assert!(cmyk.contains("CMYK") && cmyk.contains("convert FILE -depth 16"), "{cmyk}");
        let order = refusal(&file::<colortype::Gray8>(&[1; 12], &[(Tag::FillOrder, 2)]));
        assert!(order.contains("FillOrder 2"), "{order}");
        // The encoder packs no codes, but a file only has to say that it does.
        let mut packed = file::<colortype::Gray16>(&[1; 12], &[]);
        let bits = packed.windows(4).position(|tag| tag == [2, 1, 3, 0]).expect("BitsPerSample");
        packed[bits + 8] = 12;
        let packed = refusal(&packed);
        assert!(
            packed.contains("12 bits per sample, but 8 and 16") && packed.contains("convert FILE"),
            "{packed}"
        );
    }

    #[test]
    fn a_preview_is_not_taken_for_the_picture() {
        let codes: Vec<u16> = (0..12).collect();
        let picture = decode(&file::<colortype::Gray16>(&codes, &[]), "a.tif").expect("readable");
        let of = |images: &[&[(Tag, u32)]], is_big| {
            let mut bytes = Cursor::new(Vec::new());
            if is_big {
                let mut file = TiffEncoder::new_big(&mut bytes).expect("a file");
                images.iter().for_each(|tags| add::<colortype::Gray16, _>(&mut file, &codes, tags));
            } else {
                let mut file = TiffEncoder::new(&mut bytes).expect("a file");
                for tags in images {
                    let is_preview = tags.contains(&PREVIEW);
                    if is_preview {
                        add::<colortype::Gray8, _>(&mut file, &[9; 12], tags)
                    } else {
                        add::<colortype::Gray16, _>(&mut file, &codes, tags)
                    }
                }
            }
            bytes.into_inner()
        };
        for images in
            [&[&[][..]][..], &[&[PREVIEW][..], &[]], &[&[], &[PREVIEW]], &[&[PREVIEW], &[], &[PREVIEW]]]
        {
            for is_big in [false, true] {
                assert_eq!(
                    decode(&of(images, is_big), "a.tif").expect("readable"),
                    picture,
                    "{images:?} {is_big}"
                );
            }
        }
        for (images, expected) in [
            (&[&[][..], &[]][..], "several images"),
            (
                &[&[PREVIEW]],
                "only a small preview of its picture, as the raw files of cameras do; write its raw codes as TIFF",
            ),
            (&[&[PREVIEW, DNG]], "is the raw file of a camera (DNG), which is not read"),
            (&[&[DNG]], "dcraw -D -4 -T FILE"),
        ] {
            let why = refusal(&of(images, false));
            assert!(why.contains(expected), "{why}");
        }
        let mut raw = of(&[&[]], false);
        let kind = raw.windows(4).position(|tag| tag == [6, 1, 3, 0]).expect("PhotometricInterpretation");
        raw[kind + 8..kind + 10].copy_from_slice(&32_803_u16.to_le_bytes());
        let why = refusal(&raw);
        assert!(why.contains("raw files") && why.contains("tiffset -s 262 1 FILE"), "{why}");
    }

    #[test]
    fn a_picture_is_turned_as_its_orientation_says() {
        let codes: Vec<u8> = (0..12).collect();
        let corner = |orientation: u32| {
            let frame =
                decode(&file::<colortype::Gray8>(&codes, &[(Tag::Orientation, orientation)]), "a.tif");
            let frame = frame.expect("readable");
            let pixels = frame.as_u8().expect("8 bits").clone();
            let first = pixels.iter().position(|code| *code == 0).expect("the first code");
            (pixels.dim().0, first / pixels.dim().1, first % pixels.dim().1)
        };
        // The number of rows, and where the first pixel is.
        let expected =
            [(3, 0, 0), (3, 0, 3), (3, 2, 3), (3, 2, 0), (4, 0, 0), (4, 0, 2), (4, 3, 2), (4, 3, 0)];
        assert_eq!([1, 2, 3, 4, 5, 6, 7, 8].map(corner), expected);
    }
}
