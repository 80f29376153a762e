//! Sums the differences directly, row by row, where every loop of them is consistent: all trees then give the
//! same counts, and no tree is needed.
//!
//! Sums go down the columns. A row is consistent when its k changes along it by the differences there. All k must
//! also be possible together, because a tree would otherwise refuse an edge. The sums are then exactly the counts
//! of the tree.

use super::forest::EdgeSource;
use super::image_edges::ImageEdges;
use super::pixels::{EdgeDirection, Quad};
use super::regions::Region;
use super::segments::each_set;
use crate::simd::widest;
use crate::unwrap::wrapped::{Word as _, wrap_step};
use crate::unwrap::{Integers, Range, Recovered, Trust, congruence};

/// The number of pixels that counters of 16 bits can count.
const COUNTABLE: usize = 1 << 15;

/// The k by channel and pixel, relative to the first pixel, with buffers.
#[derive(Default)]
pub(in crate::unwrap) struct DirectSums {
    k: [Vec<i16>; 3],
    /// The changes of k along a row, or to the next one, by channel.
    steps: [Vec<i16>; 3],
    levels: Vec<usize>,
}

impl DirectSums {
    /// Sums the differences of `image` as long as they are consistent, and returns whether all are.
    pub fn agree(&mut self, image: &ImageEdges<'_>) -> bool {
        let (rows, width) = image.extent();
        self.k.iter_mut().for_each(|k| k.resize(rows * width, 0));
        self.steps.iter_mut().for_each(|steps| steps.resize(width, 0));
        let [mut right, mut down] = image.changed;
        for row in 0..rows {
            if row > 0 {
                let start = (row - 1) * width;
                // Changed pixels ascend, so each row takes its own from the front.
                self.follow(image, EdgeDirection::Down, start, split_below(&mut down, start + width));
                self.descend(row * width);
            }
            let start = row * width;
            self.follow(image, EdgeDirection::Right, start, split_below(&mut right, start + width));
            if row == 0 {
                self.start();
            }
            // On the first inconsistent loop, a tree is needed, which decides the edge to leave out.
            if !self.row_agrees(start) {
                return false;
            }
        }
        self.is_possible(image)
    }

    /// Writes to `steps` the changes from the row at `start`; `changed` are its pixels with an n.
    fn follow(&mut self, image: &ImageEdges<'_>, to: EdgeDirection, start: usize, changed: &[u32]) {
        let stride = image.pixels.stride(to);
        for (channel, steps) in self.steps.iter_mut().enumerate() {
            let codes = &image.pixels.planes()[channel][start..];
            let ahead = &codes[stride..];
            widest!({
                for ((step, &from), &to) in steps.iter_mut().zip(codes).zip(ahead) {
                    *step = wrap_step(i16::of_code(from, 16), i16::of_code(to, 16));
                }
            });
            for &at in changed {
                let step = &mut steps[at as usize - start];
                // Only the pixels with an n are visited; a frame has few of them.
                *step = step.wrapping_add(image.n[to as usize][at as usize][channel]);
            }
        }
    }

    /// Computes k of the first row.
    fn start(&mut self) {
        for (k, steps) in self.k.iter_mut().zip(&self.steps) {
            let mut sum = 0i16;
            for (k, step) in k.iter_mut().zip(steps) {
                *k = sum;
                sum = sum.wrapping_add(*step);
            }
        }
    }

    /// Computes k of the row at `start` from the row above.
    fn descend(&mut self, start: usize) {
        for (k, steps) in self.k.iter_mut().zip(&self.steps) {
            let (above, here) = k.split_at_mut(start);
            let above = &above[start - steps.len()..];
            widest!({
                for ((k, &above), &step) in here.iter_mut().zip(above).zip(steps) {
                    *k = above.wrapping_add(step);
                }
            });
        }
    }

    fn row_agrees(&self, start: usize) -> bool {
        self.k.iter().zip(&self.steps).all(|(k, steps)| {
            let k = &k[start..start + steps.len()];
            // Differences are collected without an early end, so that the loop runs in vectors.
            let differ = widest!({
                let pairs = k.iter().zip(&k[1..]).zip(steps);
                pairs.fold(0, |differ, ((&from, &to), &step)| differ | (to.wrapping_sub(from) ^ step))
            });
            differ == 0
        })
    }

    /// Returns whether at some level every pixel has a k that is possible for it.
    fn is_possible(&self, image: &ImageEdges<'_>) -> bool {
        let (mut low, mut high) = ([0i16; 4], image.bounds.widest());
        for (lane, k) in self.k.iter().enumerate() {
            // The base level must keep the least and the greatest k of every channel in range.
            let (least, most) = extent(k);
            (low[lane], high[lane]) = (low[lane].saturating_sub(least), high[lane].saturating_sub(most));
        }
        let mut region = Some(Region { low, high, size: 1 }).filter(|region| !region.is_empty());
        // Only pixels with a narrower interval than the range can make it impossible.
        each_set(image.pixels.limited(), |at| {
            region = region.and_then(|region| region.intersect(&image.interval(at..at + 1), self.at(at)));
        });
        region.is_some()
    }

    fn at(&self, at: usize) -> Quad {
        let [r, g, b] = &self.k;
        [r[at], g[at], b[at], 0]
    }

    /// Writes `out`, as [`place`](super::place) does.
    pub fn place(&mut self, y: Integers<'_>, range: Range, outliers: f64, out: &mut Recovered) {
        let mut outside = 0;
        let zero: [i16; 3] = std::array::from_fn(|channel| {
            let (low, _) = extent(&self.k[channel]);
            self.count(channel);
            let index = congruence::base_level_index(&self.levels, range, outliers);
            // `is_possible` has found all levels within one range, so only those below the base level are outside.
            outside += self.levels[..index].iter().sum::<usize>();
            low + index as i16
        });
        let channels = out.k.dim().2;
        let counts = out.buffers().1;
        let most = i16::from(range.max_wraps());
        let count = |k: i16, zero: i16| k.wrapping_sub(zero).max(0).min(most) as u8;
        let [r, g, b] = &self.k;
        widest!(match channels {
            1 => counts.iter_mut().zip(r).for_each(|(out, &k)| *out = count(k, zero[0])),
            _ => {
                let planes = r.iter().zip(g).zip(b);
                for (out, ((&r, &g), &b)) in counts.as_chunks_mut::<3>().0.iter_mut().zip(planes) {
                    *out = [count(r, zero[0]), count(g, zero[1]), count(b, zero[2])];
                }
            }
        });
        if outside > 0 {
            out.report.trust = Trust::Untrusted;
        }
        y.write_radiance(range, out);
    }

    /// Counts in `levels` the pixels at each k from the least on; there are few levels, see
    /// [`DirectSums::is_possible`].
    fn count(&mut self, channel: usize) {
        let Self { k, levels, .. } = self;
        let (low, high) = extent(&k[channel]);
        levels.clear();
        levels.reserve(1 << u8::BITS);
        levels.extend((low..=high).map(|level| {
            let of = |pixels: &[i16]| pixels.iter().map(|&k| u16::from(k == level)).sum::<u16>();
            widest!(k[channel].chunks(COUNTABLE).map(|pixels| usize::from(of(pixels))).sum::<usize>())
        }));
    }
}

/// Returns the least and the greatest of `k`, which is not empty.
fn extent(k: &[i16]) -> (i16, i16) {
    widest!(k.iter().fold((i16::MAX, i16::MIN), |(low, high), &k| (low.min(k), high.max(k))))
}

/// Takes the pixels below `end` off the front of `changed`, which ascends.
fn split_below<'a>(changed: &mut &'a [u32], end: usize) -> &'a [u32] {
    let count = changed.iter().take_while(|&&at| (at as usize) < end).count();
    let (below, rest) = changed.split_at(count);
    *changed = rest;
    below
}

#[cfg(test)]
mod tests {
    use ndarray::Array3;
    use proptest::prelude::*;

    use super::super::{Edges, FLAT, Forest, Pixels, first_difference_keys, place};
    use super::*;
    use crate::frame::Frame;

    /// Returns the results of the sums and of a tree; the first is `None` where the sums are not consistent.
    fn both(y: &Frame, range: Range) -> (Option<Recovered>, Recovered) {
        let mut pixels = Pixels::default();
        let samples = Integers::checked(y, range).unwrap();
        let bounds = pixels.read(samples, (y.width(), y.channels()), range);
        let [right, down] = [1, y.width()].map(|stride| {
            let (mut keys, mut breaks) = (Vec::new(), Vec::new());
            first_difference_keys(pixels.planes(), stride, FLAT, &mut keys, &mut breaks);
            (keys, breaks)
        });
        let image = ImageEdges {
            pixels: &pixels,
            bounds,
            edges: Edges { keys: [&right.0, &down.0], breaks: [&right.1, &down.1] },
            n: [&[], &[]],
            changed: [&[], &[]],
        };
        let (mut sums, mut forest, mut summed, mut grown) =
            (DirectSums::default(), Forest::default(), Recovered::default(), Recovered::default());
        summed.prepare(y.dim(), "tree");
        grown.prepare(y.dim(), "tree");
        let agree = sums.agree(&image);
        if agree {
            sums.place(samples, range, congruence::OUTLIERS, &mut summed);
        }
        forest.grow(&image);
        place(&mut forest, samples, range, congruence::OUTLIERS, &mut grown);
        (agree.then_some(summed), grown)
    }

    fn frame(x: &Array3<u32>) -> Frame {
        Frame::from_u8(x.mapv(|x| x as u8)).unwrap()
    }

    proptest! {
        #[test]
        fn what_agrees_is_what_the_tree_gives(
            (rows, columns) in (1usize..20, 1usize..20),
            colours: bool,
            (across, along) in (0u32..40, 0u32..40),
            (edge, height) in (0usize..30, 0u32..200),
            alpha in 1.0f64..6.0,
        ) {
            let channels = if colours { 3 } else { 1 };
            let x = Array3::from_shape_fn((rows, columns, channels), |(i, j, c)| {
                across * j as u32 + along * i as u32 + 31 * c as u32 + if i + j > edge { height } else { 0 }
            });
            let (summed, grown) = both(&frame(&x), Range::new(8, alpha).unwrap());
            if let Some(summed) = summed {
                prop_assert_eq!(summed, grown);
            }
        }
    }

    #[test]
    fn slopes_agree_and_ends_of_edges_do_not() {
        let range = Range::new(8, 4.0).unwrap();
        let slope = |i: usize, j: usize| (20 * i + 25 * j) as u32;
        let x = Array3::from_shape_fn((20, 24, 3), |(i, j, _)| slope(i, j));
        // A slope is consistent everywhere, so the sums must be the counts of the tree.
        let (summed, grown) = both(&frame(&x), range);
        assert_eq!(summed.as_ref(), Some(&grown));
        assert_eq!(grown.k, x.mapv(|x| (x >> 8) as u8));
        let x = Array3::from_shape_fn((20, 24, 3), |(i, j, _)| {
            slope(i, j) / 8 + if i > 9 { 12 * j as u32 } else { 0 }
        });
        assert_eq!(both(&frame(&x), range).0, None, "the edge grows from nothing to above half a peak");
        let x = Array3::from_shape_fn((20, 24, 3), |(i, j, _)| slope(i, 2 * j));
        assert_eq!(both(&frame(&x), range).0, None, "more than the range has");
    }
}
