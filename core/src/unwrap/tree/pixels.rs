//! Pixels of three codes, and how far each may have wrapped.

use super::regions::Triple;
use crate::frame::Frame;
use crate::plane;
use crate::unwrap::{Range, wrapped};

/// Codes of red, green, blue; of a mono image three times the same, so that keys compare.
pub(in crate::unwrap) fn read(y: &Frame, range: Range, pixels: &mut Vec<[u16; 3]>) {
    let (height, width, channels) = y.dim();
    let (mut plane, mut codes) = (Vec::new(), Vec::new());
    pixels.resize(height * width, [0; 3]);
    for lane in 0..3 {
        if lane < channels {
            plane::take_from_frame(y, lane, &mut plane);
            wrapped::codes(&plane, range, &mut codes);
        }
        pixels.iter_mut().zip(&codes).for_each(|(pixel, &code)| pixel[lane] = code);
    }
}

/// The greatest k that `y + k * 2^b < alpha * 2^b` leaves.
#[derive(Clone, Copy)]
pub(in crate::unwrap) struct Bounds {
    most: i16,
    /// Codes from here on have one wrap less.
    room: u32,
}

impl Bounds {
    pub fn new(range: Range) -> Self {
        let most = range.most_wraps();
        let room = range.limit() - f64::from(most) * f64::from(range.peak());
        Self { most: i16::from(most), room: (room.ceil() as u32) << (16 - range.bits()) }
    }

    /// At least 0.
    pub fn highest(self, pixel: [u16; 3]) -> Triple {
        pixel.map(|code| (self.most - i16::from(u32::from(code) >= self.room)).max(0))
    }
}
