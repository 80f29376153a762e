//! Radiance HDR files: red, green, blue and a common exponent, as linear radiance.
//!
//! Source: Ward, The RADIANCE Picture File Format, in: Larson, Shakespeare, Rendering with Radiance, 1998.

use std::io::{self, Read as _};

use image::codecs::hdr::HdrDecoder;
use image::{DynamicImage, ImageDecoder as _, Limits};

/// The first bytes of a file, before the name of its program, such as `RADIANCE` or `RGBE`.
pub(crate) const SIGNATURE: &[u8] = b"#?";

/// Decodes a file whose values are divided by the exposures and colour corrections that its header gives.
///
/// # Errors
/// The error of the decoder, such as one for another orientation, for a file that is cut or has bytes left over, and for an exposure that is no factor.
pub(crate) fn read(file: &[u8]) -> Result<DynamicImage, image::ImageError> {
    let other = |why: String| image::ImageError::IoError(io::Error::other(why));
    let first = file.iter().position(|byte| *byte == b'\n').unwrap_or(file.len());
    // The decoder knows one name of a program.
    let mut rest = (&b"#?RADIANCE"[..]).chain(&file[first..]);
    let decoder = HdrDecoder::new(&mut rest)?;
    // A header that claims a huge image must not use up the memory.
    Limits::default().reserve(decoder.total_bytes())?;
    let header = decoder.metadata();
    let (red, green, blue) = header.color_correction.unwrap_or((1.0, 1.0, 1.0));
    let factors = [red, green, blue].map(|colour| colour * header.exposure.unwrap_or(1.0));
    if !factors.iter().all(|factor| factor.is_finite() && *factor > 0.0) {
        return Err(other(format!(
            "its header has the factors {factors:?} of EXPOSURE and COLORCORR, which must be above 0; correct its header"
        )));
    }
    let mut image = DynamicImage::from_decoder(decoder)?;
    let left = rest.read_to_end(&mut Vec::new())?;
    if left > 0 {
        return Err(other(format!(
            "is damaged: {left} bytes are left behind its last row; copy the file again"
        )));
    }
    if let DynamicImage::ImageRgb32F(pixels) = &mut image {
        for pixel in pixels.pixels_mut() {
            pixel.0.iter_mut().zip(factors).for_each(|(value, factor)| *value /= factor);
        }
    }
    Ok(image)
}

#[cfg(test)]
mod tests {
    /// A picture of 2 x 1 px, of 0.25 and 0.5, in a file with this signature, these lines in its header and this size.
    fn file(signature: &str, lines: &str, size: &str) -> Vec<u8> {
        let head = format!("{signature}\nFORMAT=32-bit_rle_rgbe\n{lines}\n{size}\n");
        [head.as_bytes(), &[64, 64, 64, 128, 128, 128, 128, 128]].concat()
    }

    fn values(file: &[u8]) -> Result<Vec<f32>, String> {
        let frame = crate::decode(file, "sky.hdr").map_err(|why| why.to_string())?;
        Ok(frame.to_f32().into_iter().collect())
    }

    #[test]
    fn values_are_divided_by_the_factors_of_the_header() {
        for (signature, lines, expected) in [
            ("#?RADIANCE", "", [0.25, 0.25, 0.25, 0.5, 0.5, 0.5]),
            ("#?RGBE", "", [0.25, 0.25, 0.25, 0.5, 0.5, 0.5]),
            ("#?RGBE", "EXPOSURE=2\nEXPOSURE= 0.25\n", [0.5, 0.5, 0.5, 1.0, 1.0, 1.0]),
            ("#?RADIANCE", "COLORCORR=0.5 1 2\nEXPOSURE=0.5\n", [1.0, 0.5, 0.25, 2.0, 1.0, 0.5]),
        ] {
            assert_eq!(
                values(&file(signature, lines, "-Y 1 +X 2")),
                Ok(expected.to_vec()),
                "{signature} {lines}"
            );
        }
    }

    #[test]
    fn what_cannot_be_read_is_named() {
        for (lines, size, wanted) in [
            ("EXPOSURE=0\n", "-Y 1 +X 2", "EXPOSURE and COLORCORR, which must be above 0"),
            ("EXPOSURE=bright\n", "-Y 1 +X 2", "EXPOSURE"),
            ("COLORCORR=1 -1 1\n", "-Y 1 +X 2", "above 0"),
            ("", "+Y 1 +X 2", "Orientation +Y +X"),
            ("", "+X 2 -Y 1", "Orientation +X -Y"),
            ("", "-Y 1 +X 1", "4 bytes are left"),
            ("", "-Y 9999999 +X 9999999", "limit"),
        ] {
            let why = values(&file("#?RGBE", lines, size)).expect_err(wanted).to_lowercase();
            assert!(why.starts_with("sky.hdr: ") && why.contains(&wanted.to_lowercase()), "{why}");
        }
        let whole = file("#?RADIANCE", "", "-Y 1 +X 2");
        for length in 0..whole.len() {
            let why = values(&whole[..length]).expect_err("cut");
            assert!(why.contains("sky.hdr"), "{length}: {why}");
        }
    }
}
