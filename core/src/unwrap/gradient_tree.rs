//! Gradient tree: the tree over each gradient image first, then over the image.
//!
//! With g = M_b(d y) and d x = g + n 2^b, a spanning tree over the pixels of g finds n as
//! `tree` finds k, along edges in the order of `M_b(d g)`: exact where *second* differences
//! stay below half a peak. Most gradients are small; they are the sea, one node with n = 0, to
//! which each other gradient has an edge as long as the steepest one nearby, too.
//! The range bounds n as it bounds k. Then `tree` takes the edges in the order of `g + n 2^b`.
//!
//! Slower than `lines`, but an error stays where it is: it bears noise, and edges that end within
//! the image. It fails on edges of a sharp lens and on lines one pixel wide, where second
//! differences wrap as well.

use super::tree::{
    Bounds, Direction, Forest, Ground, Image, MOST, Pixels, Quad, SEA, add, first, of_difference, place,
    second, subtract, turns,
};
use super::{Range, Recovered, Unwrap, UnwrapError, WorkersError, check_frame};
use crate::frame::Frame;
use crate::workers::Workers;

/// Second differences up to this key, 80 of 256 codes, are flat.
const FLAT: u16 = 80 << 6;

/// Gradients are sea where no key nearby is larger: 160 of 256 codes.
const SEA_LEVEL: u16 = 160 << 6;

/// How many pixels along the gradient are nearby.
const NEARBY: usize = 2;

/// The method with its buffers.
pub struct GradientTree {
    workers: Workers,
    pixels: Pixels,
    mixed: Vec<u16>,
    slopes: [Slope; 2],
    forest: Forest,
}

impl Default for GradientTree {
    /// On the caller's own thread.
    fn default() -> Self {
        Self::on(Workers::own())
    }
}

impl GradientTree {
    /// On `threads` threads; the result does not depend on it.
    ///
    /// # Errors
    /// [`WorkersError`] when they cannot be had.
    pub fn new(threads: usize) -> Result<Self, WorkersError> {
        Ok(Self::on(Workers::new(threads)?))
    }

    fn on(workers: Workers) -> Self {
        Self {
            workers,
            pixels: Pixels::default(),
            mixed: Vec::new(),
            slopes: [Direction::Right, Direction::Down].map(Slope::new),
            forest: Forest::default(),
        }
    }
}

impl Unwrap for GradientTree {
    fn name(&self) -> &'static str {
        "gradient_tree"
    }

    fn unwrap(&mut self, y: &Frame, range: Range, out: &mut Recovered) -> Result<(), UnwrapError> {
        check_frame(y, range)?;
        out.prepare(y.dim(), self.name());
        self.pixels.read(y, range);
        let (pixels, mixed, bounds) = (&self.pixels, &mut self.mixed, Bounds::new(range));
        second(pixels.planes(), (1, y.width()), mixed);
        let mixed = &*mixed;
        self.workers.each(&mut self.slopes, |_, slope| slope.unwrap(pixels, mixed, bounds));
        let [right, down] = &self.slopes;
        let (keys, n) = ([&right.keys[..], &down.keys], [&right.n[..], &down.n]);
        let image = Image { pixels, bounds, keys, n };
        self.forest.grow(&image);
        place(&mut self.forest, pixels, range, out);
        Ok(())
    }
}

/// The gradient in one direction. Everything is as large as the image: at pixel p is the
/// difference to p's neighbour.
struct Slope {
    direction: Direction,
    /// Of the gradient.
    keys: Vec<u16>,
    /// Of the gradient's change in its own direction.
    bends: Vec<u16>,
    /// The greatest key nearby.
    steepest: Vec<u16>,
    forest: Forest,
    n: Vec<Quad>,
    /// The pixels at which n is not 0.
    changed: Vec<u32>,
}

impl Slope {
    fn new(direction: Direction) -> Self {
        let (keys, bends, steepest) = (Vec::new(), Vec::new(), Vec::new());
        Self {
            direction,
            keys,
            bends,
            steepest,
            forest: Forest::default(),
            n: Vec::new(),
            changed: Vec::new(),
        }
    }

    /// Finds n and the keys of `g + n 2^b`; n is 0 for the sea and for what could not be joined to it.
    fn unwrap(&mut self, pixels: &Pixels, mixed: &[u16], bounds: Bounds) {
        let stride = pixels.stride(self.direction);
        first(pixels.planes(), stride, &mut self.keys);
        if self.direction == Direction::Right {
            // There the difference is across the edge of the image.
            self.keys.chunks_exact_mut(pixels.width()).for_each(|row| row[row.len() - 1] = 0);
        }
        second(pixels.planes(), (stride, stride), &mut self.bends);
        self.find_steepest(stride);
        let keys = match self.direction {
            Direction::Right => [&self.bends[..], mixed],
            Direction::Down => [mixed, &self.bends],
        };
        let ground = Gradient { pixels, bounds, direction: self.direction, steepest: &self.steepest, keys };
        self.forest.grow(&ground);
        self.read_off(pixels);
    }

    /// Beside an edge of the image nearby reaches round into the next row, which only makes more land.
    fn find_steepest(&mut self, stride: usize) {
        let count = self.keys.len();
        self.steepest.clear();
        self.steepest.extend_from_slice(&self.keys);
        for reach in (1..=NEARBY).map(|n| n * stride).filter(|&reach| reach < count) {
            let (all, keys) = (&mut self.steepest, &self.keys);
            all[reach..].iter_mut().zip(keys).for_each(|(most, &key)| *most = key.max(*most));
            all.iter_mut().zip(&keys[reach..]).for_each(|(most, &key)| *most = key.max(*most));
        }
    }

    fn read_off(&mut self, pixels: &Pixels) {
        if self.n.len() == pixels.count() {
            self.changed.iter().for_each(|&at| self.n[at as usize] = [0; 4]);
        } else {
            self.n.clear();
            self.n.resize(pixels.count(), [0; 4]);
        }
        self.changed.clear();
        self.forest.regions.flatten();
        let (rows, columns) = extent(pixels, self.direction);
        for start in (0..rows).map(|row| row * pixels.width()) {
            (start..start + columns).for_each(|at| self.read_off_at(at, pixels));
        }
    }

    #[inline(always)]
    fn read_off_at(&mut self, at: usize, pixels: &Pixels) {
        let (regions, run) = (&self.forest.regions, self.forest.run_of[at]);
        if run == SEA || regions.root(run) != regions.root(SEA) {
            return;
        }
        let above_root = add(self.forest.offset[at], regions.above_root(run));
        let n = subtract(above_root, regions.above_root(SEA));
        if n != [0; 4] {
            let stride = pixels.stride(self.direction);
            self.n[at] = n;
            self.changed.push(at as u32);
            self.keys[at] = of_difference(pixels.code(at), pixels.code(at + stride), n);
        }
    }
}

/// Rows and columns that have a neighbour in that direction.
fn extent(pixels: &Pixels, direction: Direction) -> (usize, usize) {
    let (rows, columns) = (pixels.count() / pixels.width(), pixels.width());
    match direction {
        Direction::Right => (rows, columns - 1),
        Direction::Down => (rows - 1, columns),
    }
}

/// The gradient image as a ground: its counts are n.
struct Gradient<'a> {
    pixels: &'a Pixels,
    bounds: Bounds,
    direction: Direction,
    steepest: &'a [u16],
    keys: [&'a [u16]; 2],
}

impl Ground for Gradient<'_> {
    #[inline(always)]
    fn width(&self) -> usize {
        self.pixels.width()
    }

    #[inline(always)]
    fn extent(&self) -> (usize, usize) {
        extent(self.pixels, self.direction)
    }

    #[inline(always)]
    fn flat(&self) -> u16 {
        FLAT
    }

    fn has_sea(&self) -> bool {
        true
    }

    /// Twice the steepest gradient nearby is how unlikely n = 0 is.
    #[inline(always)]
    fn tie(&self, at: usize) -> Option<u16> {
        let steepest = self.steepest[at];
        (steepest > SEA_LEVEL).then(|| steepest.saturating_mul(2).min(MOST))
    }

    /// With k at both ends in 0 to `highest`, n = k_to - k_from - turns has its least and greatest value.
    #[inline(always)]
    fn interval(&self, at: usize) -> (Quad, Quad) {
        let ends = [at, at + self.pixels.stride(self.direction)].map(|at| self.pixels.code(at));
        let [below, above] = ends.map(|code| self.bounds.highest(code));
        let turns = turns(ends[0], ends[1]);
        (subtract(subtract([0; 4], below), turns), subtract(above, turns))
    }

    #[inline(always)]
    fn key(&self, to: Direction, at: usize) -> u16 {
        self.keys[to as usize][at]
    }

    #[inline(always)]
    fn step(&self, to: Direction, at: usize) -> Quad {
        let stride = self.pixels.stride(self.direction);
        turns(self.pixels.difference(at, stride), self.pixels.difference(at + self.pixels.stride(to), stride))
    }
}
