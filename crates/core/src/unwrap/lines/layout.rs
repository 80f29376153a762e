//! Rows of interleaved samples in blocks of lanes. The neighbour in the same channel is as many lanes away as
//! there are channels, so vectors need not separate the channels.

use crate::frame::Frame;
use crate::unwrap::Range;
use crate::unwrap::wrapped::Word;

/// The lanes of a block: a multiple of the channels of every image and of the vectors of every machine.
pub(super) const LANES: usize = 192;

/// The number of blocks that a counter of 8 bits can count.
pub(super) const COUNTABLE: usize = 255;

/// One word for each lane.
pub(super) type Block<W> = [W; LANES];

/// The layout of an image in rows of lanes. A row is filled up with copies of its last pixel, which contain no
/// difference and change no sum.
#[derive(Clone, Copy, Default)]
pub(super) struct RowLayout {
    /// The number of rows.
    pub height: usize,
    /// The number of pixels of a row.
    pub width: usize,
    /// The number of samples of a pixel.
    pub channels: usize,
}

/// Returns `count` over `of`, and 0 if there is nothing to count.
pub(super) fn share(count: usize, of: usize) -> f32 {
    if of == 0 { 0.0 } else { count as f32 / of as f32 }
}

impl RowLayout {
    /// Returns the layout of `y`.
    pub fn of(y: &Frame) -> Self {
        let (height, width, channels) = y.dim();
        Self { height, width, channels }
    }

    /// Returns `count` as a share of the 2 x 2 loops, of which an image of one row or one column has none.
    pub fn share_of_loops(self, count: u64) -> f32 {
        share(count as usize, (self.height - 1) * (self.width - 1) * self.channels)
    }

    /// Returns the number of samples of a row.
    pub fn samples(self) -> usize {
        self.width * self.channels
    }

    /// Returns the number of lanes of a row in whole blocks.
    pub fn lanes(self) -> usize {
        self.samples().next_multiple_of(LANES)
    }

    /// Returns the number of copies of the last pixel.
    pub fn copies(self) -> usize {
        (self.lanes() - self.samples()) / self.channels
    }

    /// Returns the lane of a `channel` of the last pixel.
    pub fn last(self, channel: usize) -> usize {
        self.samples() - self.channels + channel
    }
}

/// Returns a block in which every pixel is `pixel`.
#[inline(always)]
pub(super) fn tiled<W: Word>(pixel: [W; 3], channels: usize) -> Block<W> {
    let mut block = [W::default(); LANES];
    block.as_chunks_mut().0.fill(if channels == 1 { [pixel[0]; 3] } else { pixel });
    block
}

/// Adds the counts of a block to the totals of the channels, and sets them to 0.
#[inline(always)]
pub(super) fn by_channel<W: Word>(counts: &mut Block<W>, channels: usize, total: &mut [usize; 3]) {
    // In most rows nothing is counted.
    if *counts == [W::default(); LANES] {
        return;
    }
    // Sums of lanes that are whole pixels apart leave few lanes to add one by one.
    let mut sums = [0u16; LANES / 4];
    for lanes in counts.as_chunks::<{ LANES / 4 }>().0 {
        sums.iter_mut().zip(lanes).for_each(|(sum, &count)| *sum += count.unsigned());
    }
    let mut pixel = [0; 3];
    for sums in sums.as_chunks().0 {
        pixel.iter_mut().zip::<&[u16; 3]>(sums).for_each(|(pixel, sum)| *pixel += sum);
    }
    // A single channel has every lane.
    for (lane, sum) in pixel.into_iter().enumerate() {
        total[lane % channels] += usize::from(sum);
    }
    *counts = [W::default(); LANES];
}

/// The codes of an image in rows, interleaved, in standard layout.
pub(super) struct CodeRows<'a, S> {
    samples: &'a [S],
    pub layout: RowLayout,
    bits: u8,
}

impl<'a, S: Copy + Into<u16>> CodeRows<'a, S> {
    /// Takes `samples`, which are below 2^bits.
    pub fn new(samples: &'a [S], layout: RowLayout, range: Range) -> Self {
        Self { samples, layout, bits: range.bits() }
    }

    /// Returns the samples of row `i`.
    #[inline(always)]
    pub fn row(&self, i: usize) -> &'a [S] {
        &self.samples[i * self.layout.samples()..][..self.layout.samples()]
    }

    /// Returns the samples of each row from a lane on; others may follow.
    pub fn rows_from(&self, lane: usize) -> impl Iterator<Item = &'a [S]> {
        self.samples[lane..].chunks(self.layout.samples())
    }

    /// Returns the sample as a word.
    #[inline(always)]
    pub fn word<W: Word>(&self, sample: S) -> W {
        W::of_code(sample.into(), self.bits)
    }

    /// Writes row `i` as words, filled up with its last pixel.
    #[inline(always)]
    pub fn read<W: Word>(&self, i: usize, words: &mut Vec<W>) {
        let samples = self.row(i);
        words.resize(samples.len(), W::default());
        let codes = words.iter_mut().zip(samples);
        match self.bits {
            // Without a shift, which codes that fill their words do not need, this is one step.
            bits if bits == W::BITS => {
                codes.for_each(|(word, &code)| *word = W::of_code(code.into(), W::BITS))
            }
            _ => codes.for_each(|(word, &code)| *word = self.word(code)),
        }
        // One pixel more than there are lanes, since lanes read their neighbours.
        let (last, length) = (self.layout.last(0), self.layout.lanes() + self.layout.channels);
        while words.len() < length {
            words.extend_from_within(last..words.len().min(last + length - words.len()));
        }
    }
}
