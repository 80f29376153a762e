//! [`Plane`]: the radiance of an image, and which of its counts are proved.

use crate::simd::widest;

/// The image, row-major and interleaved.
#[derive(Default)]
pub(super) struct Plane {
    pub height: usize,
    pub width: usize,
    pub channels: usize,
    /// The radiance in peaks where the count is proved; the code, negative, where it is not; NaN where none is
    /// possible. It is the middle of a code, and never 0.
    pub x: Vec<f32>,
}

/// How an image is looked at: from one of its corners, with its columns as rows or not.
#[derive(Clone, Copy)]
pub(super) struct View {
    pub is_right: bool,
    pub is_lower: bool,
    pub is_turned: bool,
}

impl View {
    /// The image as it is, whose black columns lie to the left.
    pub const PLAIN: Self = Self { is_right: false, is_lower: false, is_turned: false };

    /// Returns all views: first those from the left, then those from the right, and then the turned ones.
    pub fn all() -> [Self; 8] {
        std::array::from_fn(|at| Self { is_lower: at & 1 > 0, is_right: at & 2 > 0, is_turned: at & 4 > 0 })
    }
}

impl Plane {
    /// Reads `codes` (H x W x C, interleaved) of this peak. The counts of the first `seeds` columns are 0.
    pub fn read<T: Copy + Into<f32>>(
        &mut self,
        codes: &[T],
        (height, width, channels): (usize, usize, usize),
        peak: f32,
        seeds: usize,
    ) {
        (self.height, self.width, self.channels) = (height, width, channels);
        let per_peak = peak.recip();
        self.x.clear();
        // One more than the samples, so that three channels are read as four.
        self.x.resize(codes.len() + 1, 0.0);
        widest!(self.x.iter_mut().zip(codes).for_each(|(x, code)| *x = -((*code).into() + 0.5) * per_peak));
        for row in self.x.chunks_exact_mut(width * channels) {
            row[..seeds * channels].iter_mut().for_each(|x| *x = -*x);
        }
    }

    /// Writes the counts to `k` (H x W x C, interleaved).
    pub fn write(&self, k: &mut [u8]) {
        // A float of this size has no fraction: its lowest bits are the count. A conversion by `as` is no vector.
        const WHOLE: f32 = 1.5 * (1 << 23) as f32;
        widest!(k.iter_mut().zip(&self.x).for_each(|(k, x)| *k = (x - 0.5 + WHOLE).to_bits() as u8));
    }

    /// Returns the number of the samples that are neither proved nor left out.
    pub fn unknown(&self) -> usize {
        widest!(self.x.iter().fold(0_u32, |sum, &x| sum + u32::from(x < 0.0))) as usize
    }

    /// Returns whether the count of a sample is proved.
    pub fn is_known(&self, at: usize) -> bool {
        self.x[at] > 0.0
    }

    /// Returns the number of the counts that are proved, of radiance up to `end` peaks.
    pub fn known_up_to(&self, end: f32) -> usize {
        widest!(self.x.iter().fold(0_u32, |sum, &x| sum + u32::from(x > 0.0 && x <= end))) as usize
    }

    /// Returns the number of rows and of columns in a view.
    #[inline(always)]
    pub fn size(&self, view: View) -> (isize, isize) {
        let (height, width) = (self.height.cast_signed(), self.width.cast_signed());
        if view.is_turned { (width, height) } else { (height, width) }
    }

    /// Returns the place of the first channel of a pixel by its row and column in a view. Beyond the border, the image
    /// is mirrored, as the scene is.
    #[inline(always)]
    pub fn place(&self, view: View, row: isize, column: isize) -> usize {
        let (row, column) = if view.is_turned { (column, row) } else { (row, column) };
        let row = from(view.is_lower, row, self.height.cast_signed());
        let column = from(view.is_right, column, self.width.cast_signed());
        (row * self.width.cast_signed() + column).cast_unsigned() * self.channels
    }

    /// Returns the row and the column of the pixel that a sample belongs to, and its channel.
    pub fn pixel(&self, at: usize) -> ([isize; 2], usize) {
        let pixel = at / self.channels;
        ([pixel / self.width, pixel % self.width].map(usize::cast_signed), at % self.channels)
    }
}

/// Returns the index of `at`, seen from the end or the beginning of a line of `size`, beyond which it is mirrored.
#[inline(always)]
fn from(end: bool, at: isize, size: isize) -> isize {
    let at = if at < 0 { -1 - at } else { at };
    let at = if at < size { at } else { 2 * size - 1 - at };
    let at = at.clamp(0, size - 1);
    if end { size - 1 - at } else { at }
}
