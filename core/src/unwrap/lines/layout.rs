//! Rows of interleaved samples in blocks of lanes: a neighbour in the same channel is as
//! many lanes away as there are channels, so that vectors need no pixels of one channel.

use crate::unwrap::Range;
use crate::unwrap::wrapped::Word;

/// Lanes of a block: a multiple of the channels of every image, and of the vectors of every machine.
pub(super) const LANES: usize = 96;

/// Blocks that a counter of 8 bits can count.
pub(super) const COUNTABLE: usize = 255;

/// As many words as there are lanes.
pub(super) type Block<W> = [W; LANES];

/// How an image lies in rows of lanes. A row is filled up with copies of its last pixel:
/// no difference is seen there, and every sum stays what it is.
#[derive(Clone, Copy, Default)]
pub(super) struct RowLayout {
    /// Rows.
    pub height: usize,
    /// Pixels of a row.
    pub width: usize,
    /// CodeRows of a pixel.
    pub channels: usize,
}

impl RowLayout {
    /// CodeRows of a row.
    pub fn samples(self) -> usize {
        self.width * self.channels
    }

    /// Lanes of a row, whole blocks.
    pub fn lanes(self) -> usize {
        self.samples().next_multiple_of(LANES)
    }

    /// Copies of the last pixel.
    pub fn copies(self) -> usize {
        (self.lanes() - self.samples()) / self.channels
    }

    /// The lane of the last pixel's `channel`.
    pub fn last(self, channel: usize) -> usize {
        self.samples() - self.channels + channel
    }
}

/// A block in which every pixel is `pixel`.
pub(super) fn tiled<W: Word>(pixel: [W; 3], channels: usize) -> Block<W> {
    let mut block = [W::default(); LANES];
    block.chunks_exact_mut(channels).for_each(|lanes| lanes.copy_from_slice(&pixel[..channels]));
    block
}

/// Adds up by channel.
pub(super) fn by_channel<W: Word>(counts: &Block<W>, channels: usize, total: &mut [usize; 3]) {
    for lanes in counts.chunks_exact(channels) {
        lanes.iter().zip(&mut *total).for_each(|(&count, total)| *total += usize::from(count.into()));
    }
}

/// Interleaved samples in standard layout.
pub(super) struct CodeRows<'a, S> {
    samples: &'a [S],
    layout: RowLayout,
    bits: u8,
}

impl<'a, S: Copy + Into<u16>> CodeRows<'a, S> {
    /// `samples` are below 2^bits.
    pub fn new(samples: &'a [S], layout: RowLayout, range: Range) -> Self {
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
        let RowLayout { channels, .. } = self.layout;
        let pixel = self.layout.last(0);
        while codes.len() < self.layout.lanes() + channels {
            codes.extend_from_within(pixel..pixel + channels);
        }
    }
}
