//! The codes of an image, as planes for vectors and by pixel for random access, and the bounds of each pixel's
//! wrap count.

use crate::simd::widest;
use crate::unwrap::{Integers, Range, of_width, wrapped};

/// One number for each of red, green and blue, and a fourth that is always the same, so that one machine word
/// holds all.
pub(in crate::unwrap) type Quad = [i16; 4];

/// The sign bits of all lanes of a [`Quad`] in one word.
const SIGNS: u64 = 0x8000_8000_8000_8000;

#[inline(always)]
fn word(quad: Quad) -> u64 {
    quad.iter().rev().fold(0, |word, &lane| word << 16 | u64::from(lane.cast_unsigned()))
}

#[inline(always)]
fn quad(word: u64) -> Quad {
    std::array::from_fn(|lane| (word >> (16 * lane)) as i16)
}

/// Returns a + b, wrapped in each lane.
#[inline(always)]
pub(in crate::unwrap) fn add(a: Quad, b: Quad) -> Quad {
    let (a, b) = (word(a), word(b));
    // Of single numbers the compiler makes no vectors. Without the sign bits, no lane carries into the next one.
    quad(((a & !SIGNS) + (b & !SIGNS)) ^ ((a ^ b) & SIGNS))
}

/// Returns a - b, wrapped in each lane.
#[inline(always)]
pub(in crate::unwrap) fn subtract(a: Quad, b: Quad) -> Quad {
    let (a, b) = (word(a), word(b));
    quad(((a | SIGNS) - (b & !SIGNS)) ^ ((a ^ !b) & SIGNS))
}

/// The direction from a pixel to its neighbour.
#[derive(Clone, Copy, Default, PartialEq, Eq)]
pub(in crate::unwrap) enum EdgeDirection {
    #[default]
    Right,
    Down,
}

/// An image in codes of [`wrapped`]. A mono image has three equal channels, so that its keys are comparable.
#[derive(Default)]
pub(in crate::unwrap) struct Pixels {
    width: usize,
    planes: [Vec<u16>; 3],
    quads: Vec<[u16; 4]>,
    limited: Vec<u8>,
    has_colours: bool,
}

impl Pixels {
    /// Reads the samples, all below 2^b, of an image of (width, channels), and returns the bounds of its counts.
    pub fn read(&mut self, y: Integers<'_>, (width, channels): (usize, usize), range: Range) -> Bounds {
        self.width = width;
        self.has_colours = channels == 3;
        let shift = 16 - range.bits();
        of_width!(y, samples => self.take(samples, channels, shift));
        let bounds = match self.clipped() {
            Some(code) => Bounds::new(range).clipped_at(code, range),
            None => Bounds::new(range),
        };
        // Slices of known length before the loop, so that no bound is checked in it.
        let count = self.count();
        self.limited.resize(count, 0);
        let [r, g, b] = &self.planes;
        let (limited, r, g, b) = (&mut self.limited[..count], &r[..count], &g[..count], &b[..count]);
        widest!((0..count).for_each(|i| limited[i] = bounds.limits([r[i], g[i], b[i]])));
        bounds
    }

    /// Returns the code of most 3 x 3 plateaus that are equal in all channels, if it is that of clipped radiance: nearly all
    /// of them have it, and they are neither a few pixels nor most of the image. Plateaus of code 0 are black.
    fn clipped(&self) -> Option<u16> {
        let (width, rows) = (self.width, self.count() / self.width);
        if !self.has_colours || width < 3 {
            return None;
        }
        let is_plateau = |at: usize| {
            let code @ [r, g, b, _] = self.quads[at];
            let row = |at: usize| self.quads[at - 1..=at + 1] == [code; 3];
            r == g && g == b && r > 0 && row(at) && row(at - width) && row(at + width)
        };
        let inner = || {
            (1..rows.max(1) - 1).step_by(SAMPLED_ROWS).flat_map(|row| row * width + 1..(row + 1) * width - 1)
        };
        let plateaus = || inner().filter(|&at| is_plateau(at)).map(|at| self.quads[at][0]);
        // The only code that can have a majority, by the votes for it and against it (Boyer and Moore).
        let (code, _) = plateaus().fold((0, 0), |(code, votes), next| match votes {
            0 => (next, 1),
            _ => (code, if code == next { votes + 1 } else { votes - 1 }),
        });
        let (all, same) =
            plateaus().fold((0, 0), |(all, same), next| (all + 1, same + u32::from(next == code)));
        let share = f64::from(same) / inner().count() as f64;
        (f64::from(same) >= MAJORITY * f64::from(all) && CLIPPED.contains(&share)).then_some(code)
    }

    fn take<T: Copy + Into<u16>>(&mut self, samples: &[T], channels: usize, shift: u8) {
        let count = samples.len() / channels;
        // The size of the last frame is kept, and every value is written below.
        self.planes.iter_mut().for_each(|plane| plane.resize(count, 0));
        self.quads.resize(count, [0; 4]);
        let [r, g, b] = &mut self.planes;
        let (r, g, b, quads) = (&mut r[..count], &mut g[..count], &mut b[..count], &mut self.quads[..count]);
        let code = |sample: T| sample.into() << shift;
        widest!(match channels {
            1 => (0..count)
                .for_each(|i| (r[i], g[i], b[i]) = (code(samples[i]), code(samples[i]), code(samples[i]))),
            _ => {
                for (i, y) in samples.as_chunks::<3>().0.iter().enumerate() {
                    (r[i], g[i], b[i]) = (code(y[0]), code(y[1]), code(y[2]));
                }
            }
        });
        widest!((0..count).for_each(|i| quads[i] = [r[i], g[i], b[i], 0]));
    }

    /// Returns whether the image has more than one channel.
    pub fn has_colours(&self) -> bool {
        self.has_colours
    }

    /// Returns the number of pixels.
    #[inline(always)]
    pub fn count(&self) -> usize {
        self.quads.len()
    }

    /// Returns the number of columns.
    #[inline(always)]
    pub fn width(&self) -> usize {
        self.width
    }

    pub fn planes(&self) -> [&[u16]; 3] {
        [&self.planes[0], &self.planes[1], &self.planes[2]]
    }

    /// Returns 1 for pixels that [`Bounds::limits`], else 0.
    pub fn limited(&self) -> &[u8] {
        &self.limited
    }

    /// Returns the index of the neighbour minus that of the pixel.
    #[inline(always)]
    pub fn stride(&self, direction: EdgeDirection) -> usize {
        match direction {
            EdgeDirection::Right => 1,
            EdgeDirection::Down => self.width,
        }
    }

    /// Returns the codes of the pixel `at`.
    #[inline(always)]
    pub fn code(&self, at: usize) -> [u16; 4] {
        self.quads[at]
    }

    /// Returns M_b of the difference to the pixel `stride` ahead, biased by half a peak.
    #[inline(always)]
    pub fn difference(&self, at: usize, stride: usize) -> [u16; 4] {
        let (from, to) = (self.quads[at], self.quads[at + stride]);
        std::array::from_fn(|lane| wrapped::biased(from[lane], to[lane]))
    }
}

/// Computes [`wrapped::wrap_step`] of all lanes at once.
#[inline(always)]
pub(in crate::unwrap) fn wrap_steps(from: [u16; 4], to: [u16; 4]) -> Quad {
    // The wrapped difference is the plain one cut to 16 bits, so their distance is the step in its upper half.
    let plain: [i32; 4] = std::array::from_fn(|lane| i32::from(to[lane]) - i32::from(from[lane]));
    plain.map(|plain| ((i32::from(plain as i16) - plain) >> 16) as i16)
}

/// One row of so many is looked at for plateaus.
const SAMPLED_ROWS: usize = 4;

/// The least share of the plateaus that have the code of clipped radiance, and the least and greatest share of the pixels that
/// they have.
const MAJORITY: f64 = 0.95;
const CLIPPED: std::ops::Range<f64> = 5e-4..0.5;

/// Clipped radiance lies between these shares of full scale: a scene is exposed for its brightest part, and alpha is known to some
/// percent.
const BRIGHTEST: std::ops::Range<f64> = 0.88..1.02;

/// Half a peak.
const HALF: u32 = 1 << 15;

/// The greatest k for which `y + k * 2^b < alpha * 2^b`.
#[derive(Clone, Copy)]
pub(in crate::unwrap) struct Bounds {
    most: i16,
    /// The first code whose greatest k is one less.
    room: u32,
    /// The code of plateaus of clipped radiance, and their k.
    top: u16,
    top_count: i16,
    /// Whether the sensor has 8 bits or more.
    fine: bool,
}

impl Bounds {
    pub fn new(range: Range) -> Self {
        let most = range.max_wraps();
        // At the highest count only the codes below this one stay under the limit.
        let room = |range: Range| {
            let room = range.limit() - f64::from(most) * f64::from(range.peak());
            (room.min(f64::from(range.peak())).ceil() as u32) << (16 - range.bits())
        };
        let given = room(range);
        // The sensor clamps radiance to just below the limit, so full scale is the last code below it.
        let top = (given - (1 << (16 - range.bits()))) as u16;
        Self {
            most: i16::from(most),
            // The true alpha may be a little larger. Where the highest count has few codes, more of them would admit it for what is dark.
            room: if given >= HALF { room(range.widened()) } else { given },
            top,
            top_count: i16::from(most),
            fine: range.bits() >= 8,
        }
    }

    /// Returns the bounds for an image whose clipped radiance has this code, if that can be near full scale at one count only.
    fn clipped_at(self, code: u16, range: Range) -> Self {
        let code_units = f64::from(code >> (16 - range.bits()));
        let at = |k: &i16| (code_units + f64::from(*k) * f64::from(range.peak())) / range.limit();
        let mut counts = (0..=self.most).filter(|k| BRIGHTEST.contains(&at(k)));
        match (counts.next(), counts.next()) {
            (Some(top_count), None) => Self { top: code, top_count, ..self },
            _ => self,
        }
    }

    /// Returns [`highest`](Self::highest) of a pixel that nothing limits.
    pub fn widest(self) -> Quad {
        [self.most; 4]
    }

    /// Returns 1 if the greatest k is less than the maximum or the least is more than 0, else 0.
    #[inline(always)]
    fn limits(self, [r, g, b]: [u16; 3]) -> u8 {
        let plateau = (r == self.top) & (g == self.top) & (b == self.top);
        let last = (self.room - 1) as u16;
        u8::from(plateau | (r > last) | (g > last) | (b > last))
    }

    /// Returns the greatest k of a pixel, at least 0.
    #[inline(always)]
    pub fn highest(self, pixel: [u16; 4]) -> Quad {
        pixel.map(|code| (self.most - i16::from(u32::from(code) >= self.room)).max(0))
    }

    /// Returns k of a pixel of a plateau of clipped radiance, if it has its code in every channel; `None` for other pixels, and
    /// for all pixels of a sensor of few bits, where plateaus are everywhere.
    #[inline(always)]
    pub fn of_clipped(self, pixel: [u16; 4]) -> Option<Quad> {
        (self.fine && pixel[..3] == [self.top; 3]).then_some([self.top_count; 4])
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn lanes_wrap_on_their_own(a: [i16; 4], b: [i16; 4]) {
            prop_assert_eq!(add(a, b), std::array::from_fn(|lane| a[lane].wrapping_add(b[lane])));
            prop_assert_eq!(subtract(a, b), std::array::from_fn(|lane| a[lane].wrapping_sub(b[lane])));
        }

        #[test]
        fn turns_of_all_lanes_are_those_of_each(from: [u16; 4], to: [u16; 4]) {
            prop_assert_eq!(wrap_steps(from, to), std::array::from_fn(|lane| {
                let [from, to] = [from, to].map(|codes| wrapped::Word::of_code(codes[lane], 16));
                wrapped::wrap_step::<i16>(from, to)
            }));
        }
    }

    #[test]
    fn full_scale_is_the_last_code_of_the_last_wrap() {
        for (alpha, top) in [(4.0, 255), (1.5, 127), (1.0, 255), (2.25, 63)] {
            let range = Range::new(8, alpha).unwrap();
            let most = i16::from(range.max_wraps());
            let code = |value: u16| [value << 8, value << 8, value << 8, 0];
            assert_eq!(Bounds::new(range).of_clipped(code(top)), Some([most; 4]), "alpha {alpha}");
            assert_eq!(Bounds::new(range).of_clipped(code(top - 1)), None);
        }
    }
}
