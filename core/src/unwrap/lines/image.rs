//! The samples of a frame as codes of either word.

use super::lanes::Layout;
use crate::unwrap::Range;
use crate::unwrap::wrapped::Word;

/// Interleaved samples in standard layout.
pub(super) struct Samples<'a, S> {
    samples: &'a [S],
    layout: Layout,
    bits: u8,
}

impl<'a, S: Copy + Into<u16>> Samples<'a, S> {
    /// `samples` are below 2^bits.
    pub fn new(samples: &'a [S], layout: Layout, range: Range) -> Self {
        Self { samples, layout, bits: range.bits() }
    }

    /// Row `i` as it is.
    #[inline(always)]
    pub fn row(&self, i: usize) -> &'a [S] {
        &self.samples[i * self.layout.samples()..][..self.layout.samples()]
    }

    /// As a code.
    #[inline(always)]
    pub fn shifted<W: Word>(&self, sample: S) -> W {
        W::low(sample.into() << (W::BITS - self.bits))
    }

    /// Row `i` as codes, filled up with its last pixel.
    #[inline(always)]
    pub fn read<W: Word>(&self, i: usize, codes: &mut Vec<W>) {
        codes.clear();
        codes.extend(self.row(i).iter().map(|&sample| self.shifted::<W>(sample)));
        let Layout { channels, .. } = self.layout;
        let pixel = self.layout.last(0);
        while codes.len() < self.layout.lanes() + channels {
            codes.extend_from_within(pixel..pixel + channels);
        }
    }
}
