//! Rows in segments: neighbours with a flat change and the same count are one from the start.

use std::ops::Range;

/// Neighbours in a row that share one node and one count, by index of the pixel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::unwrap) struct Segment {
    pub start: u32,
    pub end: u32,
    pub node: u32,
}

impl Segment {
    pub fn pixels(&self) -> Range<usize> {
        self.start as usize..self.end as usize
    }
}

/// Visits the index of each byte that is 1; all others are 0.
#[inline(always)]
pub(super) fn each_set(bytes: &[u8], mut visit: impl FnMut(usize)) {
    let (words, rest) = bytes.as_chunks::<8>();
    for (index, word) in words.iter().enumerate() {
        let mut word = u64::from_le_bytes(*word);
        // Eight bytes at a time, as most of them are 0.
        while word != 0 {
            visit(8 * index + word.trailing_zeros() as usize / 8);
            // Bytes are 0 or 1, so this clears the byte that was just visited.
            word &= word - 1;
        }
    }
    let done = bytes.len() - rest.len();
    rest.iter().enumerate().filter(|(_, byte)| **byte != 0).for_each(|(index, _)| visit(done + index));
}

/// Visits each pair of segments of neighbouring rows that touch, and the pixels of the upper one where they do.
#[inline(always)]
pub(super) fn each_contact(
    above: &[Segment],
    below: &[Segment],
    width: usize,
    mut visit: impl FnMut(&Segment, &Segment, Range<usize>),
) {
    let (mut above, mut below) = (above.iter(), below.iter());
    let (mut a, mut b) = (above.next(), below.next());
    while let (Some(upper), Some(lower)) = (a, b) {
        let lower_start = lower.start - width as u32;
        let lower_end = lower.end - width as u32;
        let end = upper.end.min(lower_end);
        visit(upper, lower, upper.start.max(lower_start) as usize..end as usize);
        // A segment that ends here touches nothing further; where both end together, both advance.
        if upper.end == end {
            a = above.next();
        }
        if lower_end == end {
            b = below.next();
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// Returns the segments of a row that starts at `start` with a cut after each set byte.
    fn cut(start: u32, cuts: &[u8]) -> Vec<Segment> {
        let mut segments = Vec::new();
        let mut from = start;
        each_set(cuts, |at| {
            segments.push(Segment { start: from, end: start + at as u32 + 1, node: 0 });
            from = start + at as u32 + 1;
        });
        segments.push(Segment { start: from, end: start + cuts.len() as u32 + 1, node: 0 });
        segments
    }

    proptest! {
        #[test]
        fn set_bytes_are_visited_in_order(bytes in proptest::collection::vec(0u8..2, 0..40)) {
            let mut seen = Vec::new();
            each_set(&bytes, |at| seen.push(at));
            let want: Vec<_> = (0..bytes.len()).filter(|&at| bytes[at] == 1).collect();
            prop_assert_eq!(seen, want);
        }

        #[test]
        fn every_pixel_is_in_one_contact(cuts in proptest::collection::vec((0u8..2, 0u8..2), 0..40)) {
            let (first, second): (Vec<_>, Vec<_>) = cuts.into_iter().unzip();
            let width = first.len() + 3;
            let (above, below) = (cut(5, &first), cut(5 + width as u32, &second));
            let mut next = 5;
            each_contact(&above, &below, width, |upper, lower, pixels| {
                assert_eq!(pixels.start, next, "pixels in order, none left out");
                assert!(pixels.end > pixels.start);
                let inside = |range: Range<usize>, at: usize| range.start <= at && at < range.end;
                for at in pixels.clone() {
                    assert!(inside(upper.pixels(), at) && inside(lower.pixels(), at + width));
                }
                next = pixels.end;
            });
            prop_assert_eq!(next, 5 + first.len() + 1);
        }
    }
}
