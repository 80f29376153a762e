//! Pixels of luma and chroma (Y, U, V) to red, green and blue, by BT.601 with the limited range (Y from 16 to 235), as OpenCV converts them.
//!
//! Two pixels beside each other, or a square of four, share their chroma. Cameras use these encodings because they need half the data.

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
        let (first, second) = data.split_at(height * step);
        for (row, (luma, into)) in first.chunks_exact(step).zip(rgb.chunks_exact_mut(3 * width)).enumerate() {
            // Of the two planes, the second one has the chroma.
            let chroma = |row: usize, step: usize| &second[row * step..];
            match self {
                Self::Uyvy => pairs(into, luma, |&[u, y0, v, y1]| [y0, y1, u, v]),
                Self::Yuyv => pairs(into, luma, |&[y0, u, y1, v]| [y0, y1, u, v]),
                Self::Nv12 => planes(into, luma, chroma(row / 2, step), |&[u, v]| [u, v]),
                Self::Nv21 => planes(into, luma, chroma(row / 2, step), |&[v, u]| [u, v]),
                Self::Nv24 => {
                    let pixels = luma.iter().zip(chroma(row, 2 * step).as_chunks().0);
                    for (into, (&y, &[u, v])) in into.as_chunks_mut().0.iter_mut().zip(pixels) {
                        *into = Chroma::new(u, v).rgb(y);
                    }
                }
            }
        }
        rgb
    }
}

/// Writes a row of four bytes for each two pixels; `parts` gives Y of both, U and V.
fn pairs(into: &mut [u8], row: &[u8], parts: impl Fn(&[u8; 4]) -> [u8; 4]) {
    for (into, pair) in into.as_chunks_mut().0.iter_mut().zip(row.as_chunks().0) {
        let [y0, y1, u, v] = parts(pair);
        *into = two([y0, y1], Chroma::new(u, v));
    }
}

/// Writes a row of Y with two bytes of chroma for each two pixels; `parts` gives U and V.
fn planes(into: &mut [u8], luma: &[u8], chroma: &[u8], parts: impl Fn(&[u8; 2]) -> [u8; 2]) {
    let rows = luma.as_chunks().0.iter().zip(chroma.as_chunks().0);
    for (into, (y, chroma)) in into.as_chunks_mut().0.iter_mut().zip(rows) {
        let [u, v] = parts(chroma);
        *into = two(*y, Chroma::new(u, v));
    }
}

fn two([first, second]: [u8; 2], chroma: Chroma) -> [u8; 6] {
    let ([a, b, c], [d, e, f]) = (chroma.rgb(first), chroma.rgb(second));
    [a, b, c, d, e, f]
}

/// Bits behind the point of the factors below.
const SHIFT: i32 = 20;

/// The contribution of U and V to red, green and blue, with half a unit for rounding.
#[derive(Clone, Copy)]
struct Chroma {
    red: i32,
    green: i32,
    blue: i32,
}

impl Chroma {
    /// BT.601: 1.596 V, -0.813 V - 0.391 U and 2.018 U, in steps of 2^-20 as OpenCV has them, so that the results are the same.
    fn new(u: u8, v: u8) -> Self {
        let (u, v) = (i32::from(u) - 128, i32::from(v) - 128);
        let half = 1 << (SHIFT - 1);
        Self {
            red: half + 1_673_527 * v,
            green: half - 852_492 * v - 409_993 * u,
            blue: half + 2_116_026 * u,
        }
    }

    /// Returns red, green and blue of the pixel with the luma `y`.
    fn rgb(self, y: u8) -> [u8; 3] {
        // 1.164 (Y - 16)
        let luma = 1_220_542 * (i32::from(y) - 16).max(0);
        [self.red, self.green, self.blue].map(|chroma| ((luma + chroma) >> SHIFT).clamp(0, 255) as u8)
    }
}
