//! Pixels of luma and chroma (Y, U, V) to red, green and blue, by BT.601 with the limited range (Y from 16 to 235), as OpenCV converts them.
//!
//! Two pixels beside each other, or a square of four, share their chroma. Cameras use these encodings because they need half the data.

use modulo_core::simd::run_widest;

/// The places of Y, U and V in the data.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum YuvLayout {
    /// Two pixels as the bytes U Y V Y.
    Uyvy,
    /// Two pixels as the bytes Y U Y V.
    Yuyv,
    /// A plane of Y, then one of U V for each square of 2 x 2 pixels.
    Nv12,
    /// The same as [`YuvLayout::Nv12`], with V before U.
    Nv21,
    /// A plane of Y, then one of U V for each pixel.
    Nv24,
}

impl YuvLayout {
    /// Returns the number of columns and rows of the pixels that share their chroma.
    pub fn block(self) -> (u32, u32) {
        match self {
            Self::Uyvy | Self::Yuyv => (2, 1),
            Self::Nv12 | Self::Nv21 => (2, 2),
            Self::Nv24 => (1, 1),
        }
    }

    /// Returns the number of bytes of one pixel in the rows that `step` counts: all of them, or those of the plane of Y.
    pub fn pixel(self) -> u64 {
        match self {
            Self::Uyvy | Self::Yuyv => 2,
            Self::Nv12 | Self::Nv21 | Self::Nv24 => 1,
        }
    }

    /// Returns the number of bytes of an image of `rows` bytes of [`YuvLayout::pixel`], the plane of the chroma included. Its
    /// rows have the same `step`, or twice that for a chroma of its own at each pixel.
    pub fn size(self, rows: u64) -> u64 {
        match self {
            Self::Uyvy | Self::Yuyv => rows,
            Self::Nv12 | Self::Nv21 => rows.saturating_add(rows / 2),
            Self::Nv24 => rows.saturating_mul(3),
        }
    }

    /// Returns the pixels of an image as RGB, row by row. Its sides are multiples of [`YuvLayout::block`], `step` is at least
    /// `width` times [`YuvLayout::pixel`], and `data` has [`YuvLayout::size`] bytes or more.
    pub fn to_rgb(self, data: &[u8], height: usize, width: usize, step: usize) -> Vec<u8> {
        let mut rgb = vec![0; height * width * 3];
        let mut parts = [(); 3].map(|()| vec![0; width]);
        let (luma, chroma) = data.split_at(height * step);
        for (row, (luma, into)) in luma.chunks_exact(step).zip(rgb.chunks_exact_mut(3 * width)).enumerate() {
            run_widest(
                #[inline(always)]
                || {
                    self.split(&mut parts, luma, chroma, (row, step));
                    join(&parts, into);
                },
            );
        }
        rgb
    }

    /// Writes Y, U and V of the pixels of the row `luma`. Where there are two planes, `chroma` is the second one.
    #[inline(always)]
    fn split(self, parts: &mut Parts, luma: &[u8], chroma: &[u8], (row, step): (usize, usize)) {
        match self {
            Self::Uyvy => pairs(parts, luma, |&[u, y0, v, y1]| [y0, y1, u, v]),
            Self::Yuyv => pairs(parts, luma, |&[y0, u, y1, v]| [y0, y1, u, v]),
            Self::Nv12 => planes(parts, luma, &chroma[row / 2 * step..], |&[u, v]| [u, v]),
            Self::Nv21 => planes(parts, luma, &chroma[row / 2 * step..], |&[v, u]| [u, v]),
            Self::Nv24 => {
                let [y, u, v] = parts;
                y.copy_from_slice(&luma[..u.len()]);
                let pixels = u.iter_mut().zip(v);
                for ((u, v), &[blue, red]) in pixels.zip(chroma[row * 2 * step..].as_chunks().0) {
                    (*u, *v) = (blue, red);
                }
            }
        }
    }
}

/// Writes a row of pixels as RGB.
#[inline(always)]
fn join([y, u, v]: &Parts, into: &mut [u8]) {
    for (into, ((&y, &u), &v)) in into.as_chunks_mut().0.iter_mut().zip(y.iter().zip(u).zip(v)) {
        *into = rgb_of(y, u, v);
    }
}

/// Y, U and V of each pixel of a row, in vectors of their own: so the compiler finds the same steps for pixels beside each other.
type Parts = [Vec<u8>; 3];

/// Takes a row of four bytes for each two pixels apart; `parts` gives Y of both, U and V.
#[inline(always)]
fn pairs([y, u, v]: &mut Parts, row: &[u8], parts: impl Fn(&[u8; 4]) -> [u8; 4]) {
    let pixels = y.as_chunks_mut().0.iter_mut().zip(u.as_chunks_mut().0).zip(v.as_chunks_mut().0);
    for (((y, u), v), bytes) in pixels.zip(row.as_chunks().0) {
        let [y0, y1, blue, red] = parts(bytes);
        (*y, *u, *v) = ([y0, y1], [blue, blue], [red, red]);
    }
}

/// Takes a row of Y with two bytes of chroma for each two pixels apart; `parts` gives U and V.
#[inline(always)]
fn planes([y, u, v]: &mut Parts, luma: &[u8], chroma: &[u8], parts: impl Fn(&[u8; 2]) -> [u8; 2]) {
    y.copy_from_slice(&luma[..u.len()]);
    let pixels = u.as_chunks_mut().0.iter_mut().zip(v.as_chunks_mut().0);
    for ((u, v), bytes) in pixels.zip(chroma.as_chunks().0) {
        let [blue, red] = parts(bytes);
        (*u, *v) = ([blue, blue], [red, red]);
    }
}

/// Bits behind the point of the factors below.
const SHIFT: i32 = 20;

/// Returns red, green and blue of a pixel by BT.601: 1.164 (Y - 16) and 1.596 V, -0.813 V - 0.391 U or 2.018 U, in steps of 2^-20 as OpenCV has
/// them, so that the results are the same.
#[inline(always)]
fn rgb_of(y: u8, u: u8, v: u8) -> [u8; 3] {
    let (u, v) = (i32::from(u) - 128, i32::from(v) - 128);
    let luma = 1_220_542 * (i32::from(y) - 16).max(0) + (1 << (SHIFT - 1));
    [1_673_527 * v, -852_492 * v - 409_993 * u, 2_116_026 * u]
        .map(|chroma| ((luma + chroma) >> SHIFT).clamp(0, 255) as u8)
}
