//! Unwraps the horizontal gradient down its columns and measures the quality of y.

use std::ops::Range;

use super::layout::{Block, COUNTABLE, LANES, RowLayout};
use crate::unwrap::wrapped::{Word, exceeds, wrap_step};

/// The limit of a mixed difference for [`QualityMetrics::steep`](crate::unwrap::QualityMetrics::steep), in
/// sixteenths of the peak.
pub(super) const SUSPECT: u16 = 6;

/// The codes at the corners of a block of 2 x 2 loops: above on the left and on the right, and below them.
pub(super) type Corners<'a, W> = [&'a Block<W>; 4];

/// The n of `d_x x = g + n * 2^b`, 0 in the first row, and counts of its loops.
#[derive(Default)]
pub(super) struct Gradient<W> {
    columns: Vec<Columns<W>>,
    /// The runs of rows of all blocks. Each block begins with the first one, in which all n are 0.
    runs: Vec<Run>,
    /// The n of each run.
    n: Vec<Block<W>>,
    /// The number of rows since the counters of the columns were added to the totals.
    counted: usize,
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
    /// The place of the current row's run among all runs.
    run: usize,
    steep: Block<W>,
}

/// Rows in which the n of a block do not change.
struct Run {
    /// The first row.
    row: usize,
    /// The place of the run above.
    above: usize,
}

impl<W: Word> Gradient<W> {
    /// Starts an image, before its first row.
    pub fn start(&mut self, layout: RowLayout) {
        let none = [W::default(); LANES];
        let blocks = layout.lanes() / LANES;
        self.runs.clear();
        self.n.clear();
        // In the worst frame some n of each block change in each row. Most frames use little of this memory, and never touch the rest.
        self.runs.reserve(layout.height * blocks + 1);
        self.n.reserve(layout.height * blocks + 1);
        // In the first row nothing has wrapped yet.
        self.runs.push(Run { row: 0, above: 0 });
        self.n.push(none);
        self.columns.clear();
        self.columns.resize(blocks, Columns { run: 0, steep: none });
        self.steep.clear();
        self.steep.resize(layout.lanes(), 0);
        (self.counted, self.suspect, self.residues) = (0, 0, 0);
    }

    /// Returns the counters of the rows in which g is steep, by lane of block `at`.
    #[inline(always)]
    pub fn steep(&mut self, at: usize) -> &mut Block<W> {
        &mut self.columns[at].steep
    }

    /// Takes block `at` of the loops above row `i`; returns whether the difference of neighbouring vertical differences wraps in it. Blocks in
    /// which no difference of differences wraps or is above the limit need not be taken.
    #[inline(always)]
    pub fn follow(&mut self, i: usize, at: usize, corners: Corners<'_, W>) -> bool {
        let above = self.columns[at].run;
        self.n.extend_from_within(above..above + 1);
        let n = self.n.last_mut().expect("one was just added");
        let [changes, wraps, suspect, residues] = follow(n, corners);
        if changes > 0 {
            self.columns[at].run = self.runs.len();
            self.runs.push(Run { row: i, above });
        } else {
            self.n.pop();
        }
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
        for (columns, totals) in self.columns.iter_mut().zip(self.steep.as_chunks_mut().0) {
            add_up(&mut columns.steep, totals);
        }
        self.counted = 0;
    }

    /// Returns the runs of block `at` in an image of so many rows, the last run first.
    #[inline(always)]
    pub fn runs(&self, at: usize, height: usize) -> impl Iterator<Item = (Range<usize>, &Block<W>)> {
        let (mut place, mut end) = (self.columns[at].run, height);
        std::iter::from_fn(move || {
            let run = &self.runs[place];
            let found = (end > 0).then_some((run.row..end, &self.n[place]));
            (place, end) = (run.above, run.row);
            found
        })
    }

    /// Returns the number of rows in which n is 0, by lane of block `at`.
    #[inline(always)]
    pub fn zeros(&self, at: usize, height: usize) -> [u32; LANES] {
        let (mut totals, mut counts, mut counted) = ([0; LANES], [W::default(); LANES], 0);
        for (mut rows, n) in self.runs(at, height) {
            while !rows.is_empty() {
                let more = rows.len().min(COUNTABLE - counted);
                let rows_more = W::low(more as u16);
                for l in 0..LANES {
                    counts[l] = counts[l].plus(if n[l] == W::default() { rows_more } else { W::default() });
                }
                (rows.start, counted) = (rows.start + more, counted + more);
                if counted == COUNTABLE {
                    add_up(&mut counts, &mut totals);
                    counted = 0;
                }
            }
        }
        add_up(&mut counts, &mut totals);
        totals
    }
}

/// Adds counts to totals, and sets them to 0.
#[inline(always)]
fn add_up<W: Word>(counts: &mut Block<W>, totals: &mut [u32; LANES]) {
    totals.iter_mut().zip(&*counts).for_each(|(total, &count)| *total += u32::from(count.unsigned()));
    *counts = [W::default(); LANES];
}

/// Turns n of a row into that of the next one; returns the numbers of lanes in which n changes, in which the difference of vertical differences wraps,
/// in which the mixed difference is above the limit, and in which there is a residue.
#[inline(always)]
fn follow<W: Word>(n: &mut Block<W>, [up, up_right, left, right]: Corners<'_, W>) -> [u64; 4] {
    // A word can count the lanes of a block.
    let mut counts = [W::default(); 4];
    for i in 0..LANES {
        let (above, here) = (up_right[i].minus(up[i]), right[i].minus(left[i]));
        let (before, after) = (left[i].minus(up[i]), right[i].minus(up_right[i]));
        // d_y n follows from the wrapped mixed difference, which is the condition of the method.
        let change = wrap_step(above, here);
        n[i] = n[i].plus(change);
        // Both orders give M_b(d_x d_y y); they differ in whether the difference of differences wraps.
        let is_residue = (here < above) != (after < before);
        let wraps = wrap_step(before, after) != W::default();
        let found = [change != W::default(), wraps, exceeds(here.minus(above), SUSPECT), is_residue];
        counts.iter_mut().zip(found).for_each(|(count, is_found)| *count = count.plus(W::one_if(is_found)));
    }
    counts.map(|count| u64::from(count.unsigned()))
}
