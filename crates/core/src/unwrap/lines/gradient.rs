//! Unwraps the horizontal gradient down its columns and measures the quality of y.

use super::layout::{Block, COUNTABLE, LANES, RowLayout};
use crate::unwrap::wrapped::{Word, exceeds, wrap_step};

/// The limit of a mixed difference for [`QualityMetrics::steep`](crate::unwrap::QualityMetrics::steep), in
/// sixteenths of the peak.
pub(super) const SUSPECT: u16 = 6;

/// The codes at the corners of a block of 2 x 2 loops: above on the left and on the right, and below them.
pub(super) type Corners<'a, W> = [&'a Block<W>; 4];

/// The n of `d_x x = g + n * 2^b`, 0 in the first row, with counts for each column.
#[derive(Default)]
pub(super) struct Gradient<W> {
    columns: Vec<Columns<W>>,
    /// The number of rows since the counters of the columns were added to the totals.
    counted: usize,
    /// The number of rows in which n is 0, by lane.
    pub zeros: Vec<u32>,
    /// The number of rows in which g is steep, by lane.
    pub steep: Vec<u32>,
    /// The number of 2 x 2 loops whose mixed difference is above the limit.
    pub suspect: u64,
    /// The number of 2 x 2 loops around which the wrapped differences do not sum to 0.
    pub residues: u64,
}

/// The state of a block of neighbouring columns.
#[derive(Clone)]
struct Columns<W> {
    n: Block<W>,
    zeros: Block<W>,
    /// The number of counted rows that `zeros` knows; n has not changed since.
    known: usize,
    steep: Block<W>,
}

impl<W: Word> Gradient<W> {
    /// Starts an image, before its first row.
    pub fn start(&mut self, layout: RowLayout) {
        let none = [W::default(); LANES];
        // In the first row nothing has wrapped yet, so all n are 0.
        let fresh = Columns { n: none, zeros: none, known: 0, steep: none };
        self.columns.clear();
        self.columns.resize(layout.lanes() / LANES, fresh);
        for counts in [&mut self.zeros, &mut self.steep] {
            counts.clear();
            counts.resize(layout.lanes(), 0);
        }
        (self.counted, self.suspect, self.residues) = (0, 0, 0);
    }

    /// Returns the counters of the rows in which g is steep, by lane of block `at`.
    #[inline(always)]
    pub fn steep(&mut self, at: usize) -> &mut Block<W> {
        &mut self.columns[at].steep
    }

    /// Takes block `at` of the next row of loops; returns whether the difference of neighbouring vertical differences wraps in it. Blocks in
    /// which no difference of differences wraps or is above the limit need not be taken.
    #[inline(always)]
    pub fn follow(&mut self, at: usize, corners: Corners<'_, W>) -> bool {
        let [wraps, suspect, residues] = self.columns[at].follow(corners, self.counted);
        self.suspect += suspect;
        self.residues += residues;
        wraps > 0
    }

    /// Ends a row.
    #[inline(always)]
    pub fn end_row(&mut self) {
        self.counted += 1;
        // Counters have the width of the words, so 8 bits are added up before they overflow.
        if self.counted == COUNTABLE {
            self.settle();
        }
    }

    /// Adds the counters to the totals.
    #[inline(always)]
    pub fn settle(&mut self) {
        let totals = self.zeros.as_chunks_mut::<LANES>().0.iter_mut().zip(self.steep.as_chunks_mut().0);
        for (columns, (zeros, steep)) in self.columns.iter_mut().zip(totals) {
            columns.count_zeros(self.counted);
            columns.known = 0;
            for (counts, totals) in [(&mut columns.zeros, zeros), (&mut columns.steep, steep)] {
                totals
                    .iter_mut()
                    .zip(&*counts)
                    .for_each(|(total, &count)| *total += u32::from(count.unsigned()));
                *counts = [W::default(); LANES];
            }
        }
        self.counted = 0;
    }
}

impl<W: Word> Columns<W> {
    /// Takes the next row after so many counted ones; returns the number of wraps of the difference of vertical differences, of mixed
    /// differences above the limit, and of residues.
    #[inline(always)]
    fn follow(&mut self, [up, up_right, left, right]: Corners<'_, W>, counted: usize) -> [u64; 3] {
        self.count_zeros(counted);
        // A word can count the lanes of a block.
        let mut counts = [W::default(); 3];
        for i in 0..LANES {
            let (above, here) = (up_right[i].minus(up[i]), right[i].minus(left[i]));
            let (before, after) = (left[i].minus(up[i]), right[i].minus(up_right[i]));
            // d_y n follows from the wrapped mixed difference, which is the condition of the method.
            self.n[i] = self.n[i].plus(wrap_step(above, here));
            // Both orders give M_b(d_x d_y y); they differ in whether the difference of differences wraps.
            let is_residue = (here < above) != (after < before);
            let wraps = wrap_step(before, after) != W::default();
            counts[0] = counts[0].plus(W::one_if(wraps));
            counts[1] = counts[1].plus(W::one_if(exceeds(here.minus(above), SUSPECT)));
            counts[2] = counts[2].plus(W::one_if(is_residue));
        }
        counts.map(|count| u64::from(count.unsigned()))
    }

    /// Counts the rows since n has changed.
    #[inline(always)]
    fn count_zeros(&mut self, counted: usize) {
        let rows = W::low((counted - self.known) as u16);
        for i in 0..LANES {
            let more = if self.n[i] == W::default() { rows } else { W::default() };
            self.zeros[i] = self.zeros[i].plus(more);
        }
        self.known = counted;
    }
}
