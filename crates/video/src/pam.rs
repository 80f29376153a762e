//! Portable arbitrary maps (PAM), as ffmpeg writes its frames into a pipe: each one tells its size and depth.
//!
//! Source: <https://netpbm.sourceforge.net/doc/pam.html>

use std::io::{self, BufRead};

use modulo_core::{Frame, FrameError};
use ndarray::Array3;

use crate::program::next_line;

/// The most bytes of a frame: 16384 x 8192 px of three colours at 16 bits.
const LARGEST: usize = 16_384 * 8192 * 3 * 2;

/// Reads the next frame; `None` at the end. Codes of 16 bits, which ffmpeg has made of codes of fewer `bits`, become those again. `bits`
/// is called once for each frame that begins; `None` if nothing is said about it.
///
/// # Errors
/// [`io::Error`] of a pipe that ends within a frame, of a frame about which nothing is said, and of anything that is no frame.
pub fn read(input: &mut impl BufRead, bits: impl FnOnce() -> Option<u32>) -> io::Result<Option<Frame>> {
    let bad = |why: String| io::Error::new(io::ErrorKind::InvalidData, why);
    let Some(first) = next_line(input)? else { return Ok(None) };
    if first != "P7" {
        return Err(bad(format!("frame that begins with '{first}', P7 expected")));
    }
    let bits = bits().ok_or_else(|| bad("frame about which ffmpeg says nothing".to_owned()))?.clamp(1, 16);
    let (mut width, mut height, mut depth, mut largest) = (0, 0, 0, 0);
    loop {
        let line = next_line(input)?.ok_or(io::ErrorKind::UnexpectedEof)?;
        let (key, value) = line.split_once(' ').unwrap_or((&line, ""));
        let number = || value.parse::<usize>().map_err(|_| bad(format!("'{line}' in the header of a frame")));
        match key {
            "ENDHDR" => break,
            "WIDTH" => width = number()?,
            "HEIGHT" => height = number()?,
            "DEPTH" => depth = number()?,
            "MAXVAL" => largest = number()?,
            _ => {}
        }
    }
    let bytes: usize = if largest > 255 { 2 } else { 1 };
    let size = [width, height, depth].into_iter().try_fold(bytes, |size, side| size.checked_mul(side));
    let size = size.filter(|size| (1..=LARGEST).contains(size));
    let size = size.ok_or_else(|| bad(format!("frame of {width} x {height} pixels, {depth} channels")))?;
    let mut samples = vec![0; size];
    input.read_exact(&mut samples)?;
    let frame = frame((height, width, depth), samples, (bytes == 2).then_some(bits));
    frame.map(Some).map_err(|why| bad(why.to_string()))
}

/// Returns the frame of `dim` with these samples: codes of `bits` bits that were spread over 16, or codes of 8 bits.
fn frame(dim: (usize, usize, usize), samples: Vec<u8>, bits: Option<u32>) -> Result<Frame, FrameError> {
    let Some(bits) = bits else {
        return Frame::from_u8(Array3::from_shape_vec(dim, samples).expect("as many as were read"));
    };
    let most = (1_u32 << bits) - 1;
    let code = |pair: &[u8; 2]| {
        let code = u32::from(u16::from_be_bytes(*pair));
        ((code * most + 32_767) / 65_535) as u16
    };
    let codes = samples.as_chunks().0.iter().map(code).collect();
    Frame::from_u16(Array3::from_shape_vec(dim, codes).expect("as many as were read"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_frame_tells_its_size_and_depth() {
        let mut eight =
            &b"P7\nWIDTH 2\nHEIGHT 1\nDEPTH 1\nMAXVAL 255\nTUPLTYPE GRAYSCALE\nENDHDR\n\x01\x02P7"[..];
        let frame = read(&mut eight, || Some(8)).expect("a frame").expect("one");
        assert_eq!((frame.dim(), frame.as_u8().expect("8 bits")[(0, 1, 0)]), ((1, 2, 1), 2));
        assert_eq!(eight, b"P7");
        let mut ten = &b"P7\nWIDTH 1\nHEIGHT 1\nDEPTH 3\nMAXVAL 65535\nENDHDR\n\xff\xff\x80\x00\x00\x00"[..];
        let frame = read(&mut ten, || Some(10)).expect("a frame").expect("one");
        assert_eq!(frame.to_f32().into_raw_vec_and_offset().0, [1023.0, 512.0, 0.0]);
        assert!(read(&mut ten, || Some(10)).expect("the end").is_none());
    }

    #[test]
    fn what_is_no_frame_is_an_error() {
        for bytes in [
            "P6\n1 1\n255\nabc",
            "P7\nWIDTH 2\nHEIGHT 1\nDEPTH 1\nMAXVAL 255\nENDHDR\n1",
            "P7\nWIDTH 999999\nHEIGHT 999999\nDEPTH 3\nMAXVAL 255\nENDHDR\n",
            "P7\nWIDTH 99999999999\nHEIGHT 99999999999\nDEPTH 3\nMAXVAL 255\nENDHDR\n",
            "P7\nWIDTH 0\nHEIGHT 1\nDEPTH 1\nMAXVAL 255\nENDHDR\n",
            "P7\nWIDTH x\nENDHDR\n",
            "P7\nWIDTH 1\nHEIGHT 1\nDEPTH 4\nMAXVAL 255\nENDHDR\nabcd",
            "P7\nWIDTH 1\n",
        ] {
            assert!(read(&mut bytes.as_bytes(), || Some(8)).is_err(), "{bytes}");
        }
    }
}
