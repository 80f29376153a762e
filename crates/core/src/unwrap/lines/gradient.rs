//! Unwraps the horizontal gradient down its columns and measures the quality of y.

use super::layout::{Block, COUNTABLE, LANES, RowLayout};
use super::majority::STEEP;
use crate::unwrap::wrapped::{Word, biased, exceeds, wrap_step};

/// The limit of a mixed difference for [`QualityMetrics::steep`](crate::unwrap::QualityMetrics::steep), in
/// eighths of the peak.
const SUSPECT: u16 = 3;

/// The n of `d_x x = g + n * 2^b`, 0 in the first row, with counts for each column.
#[derive(Default)]
pub(super) struct Gradient<W> {
    columns: Vec<Columns<W>>,
    /// The number of rows that the counters of the columns contain.
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
    steep: Block<W>,
    suspect: Block<W>,
    residues: Block<W>,
}

impl<W: Word> Gradient<W> {
    /// Starts an image, before its first row.
    pub fn start(&mut self, layout: RowLayout) {
        let none = [W::default(); LANES];
        // In the first row nothing has wrapped yet, so all n are 0.
        let fresh = Columns { n: none, zeros: none, steep: none, suspect: none, residues: none };
        self.columns.clear();
        self.columns.resize(layout.lanes() / LANES, fresh);
        for counts in [&mut self.zeros, &mut self.steep] {
            counts.clear();
            counts.resize(layout.lanes(), 0);
        }
        (self.counted, self.suspect, self.residues) = (0, 0, 0);
    }

    /// Takes the next row `here` below `up`; the first row is below itself. Both are longer than their lanes by
    /// one pixel. `steps` becomes the change of k to the right, up to a constant for each column.
    #[inline(always)]
    pub fn follow(&mut self, up: &[W], here: &[W], channels: usize, steps: &mut [W]) {
        // Counters have the width of the words, so 8 bits are added up before they overflow.
        if self.counted == COUNTABLE {
            self.settle();
        }
        self.counted += 1;
        for (i, (columns, steps)) in self.columns.iter_mut().zip(steps.as_chunks_mut().0).enumerate() {
            let at = i * LANES;
            let block = |row: &[W], at: usize| -> Option<Block<W>> { row[at..].first_chunk().copied() };
            let pixels =
                (block(up, at), block(up, at + channels), block(here, at), block(here, at + channels));
            if let (Some(up), Some(up_right), Some(left), Some(right)) = pixels {
                columns.follow([&up, &up_right], [&left, &right], steps);
            }
        }
    }

    /// Returns whether a 2 x 2 loop has a mixed difference above the limit.
    pub fn has_steep_loops(&self) -> bool {
        let none = [W::default(); LANES];
        self.suspect > 0 || self.columns.iter().any(|columns| columns.suspect != none)
    }

    /// Adds the counters to the totals.
    pub fn settle(&mut self) {
        self.counted = 0;
        let totals = self.zeros.as_chunks_mut::<LANES>().0.iter_mut().zip(self.steep.as_chunks_mut().0);
        for (columns, (zeros, steep)) in self.columns.iter_mut().zip(totals) {
            add(&mut columns.zeros, zeros);
            add(&mut columns.steep, steep);
            self.suspect += take(&mut columns.suspect);
            self.residues += take(&mut columns.residues);
        }
    }
}

impl<W: Word> Columns<W> {
    #[inline(always)]
    fn follow(
        &mut self,
        [up, up_right]: [&Block<W>; 2],
        [left, right]: [&Block<W>; 2],
        steps: &mut Block<W>,
    ) {
        for i in 0..LANES {
            let (above, here) = (biased(up[i], up_right[i]), biased(left[i], right[i]));
            // d_y n follows from the wrapped mixed difference, which is the condition of the method.
            let n = self.n[i].plus(wrap_step(above, here));
            self.n[i] = n;
            steps[i] = n.plus(wrap_step(left[i], right[i]));
            self.zeros[i] = self.zeros[i].plus(W::one_if(n == W::default()));
            self.steep[i] = self.steep[i].plus(W::one_if(exceeds(here, STEEP)));
            let suspect = exceeds(biased(above, here), SUSPECT);
            self.suspect[i] = self.suspect[i].plus(W::one_if(suspect));
            // Both orders give M_b(d_x d_y y); they differ in whether the difference of differences wraps.
            let differ = (here < above) != (biased(up_right[i], right[i]) < biased(up[i], left[i]));
            self.residues[i] = self.residues[i].plus(W::one_if(differ));
        }
    }
}

fn add<W: Word>(counts: &mut Block<W>, totals: &mut Block<u32>) {
    totals.iter_mut().zip(&*counts).for_each(|(total, &count)| *total += u32::from(count.into()));
    *counts = [W::default(); LANES];
}

fn take<W: Word>(counts: &mut Block<W>) -> u64 {
    let sum = counts.iter().map(|&count| u64::from(count.into())).sum();
    *counts = [W::default(); LANES];
    sum
}
