//! Path sums: chooses one candidate for each pixel, so that the costs of the pixels and of the differences between neighbours are small
//! together (semi-global matching, Hirschmueller 2008, *IEEE TPAMI* 30, 328).
//!
//! Candidate m of a pixel stands for green with m wraps, beside red and blue, which are known. Along each of four directions (right,
//! left, down, up) the cost of candidate m at pixel q, behind pixel p, is
//! ```text
//!     L_m(q) = u_m(q) + min_o (L_o(p) + V(o, m)) - min_o L_o(p)
//!     V(o, m) = 160 min(|dr - dg| + |db - dg|, 0.25) + 10 min(|dr + dg + db|, 0.9),   dg = g_m(q) - g_o(p)
//! ```
//! with r, g and b as shares of full scale. The candidate with the least sum of the four L is chosen. Its margin is how much greater the
//! sum of the second best one is. u is given by the caller. dg depends on m - o only, so that 2 A - 1 edge costs serve A^2 pairs.
//!
//! Pixels beside each other are lanes of vectors. Paths along rows run in bands of [`LANES`] rows, and those along columns in strips of
//! [`LANES`] columns, so that each needs only its own part of the image, and a thread takes one after the other.

use crate::simd::widest;
use crate::workers::{Workers, WorkersError};

/// The value of full scale in the colours.
pub(super) const FULL_SCALE: i16 = 4096;

/// The largest value of a colour, with which no difference leaves 16 bits.
pub(super) const LARGEST_COLOUR: i16 = FULL_SCALE / 4 * 5;

/// The value of a cost or a margin of 1.
pub(super) const COST: i16 = 128;

/// The largest cost of a candidate, with which no sum leaves 16 bits.
pub(super) const LARGEST_COST: i16 = 40 * COST;

/// The most candidates of a pixel: the time grows with their square.
pub(super) const MOST_CANDIDATES: usize = 16;

/// The value of a margin of 1 in the margins of the result, which have 8 bits.
pub(super) const MARGIN: u8 = 4;

/// The rows of a band and the columns of a strip.
const LANES: usize = 32;

/// The colours of a pixel.
const COLOURS: usize = 3;

/// One value for each lane.
type Lanes = [i16; LANES];

/// The choice of candidates, with its buffers. `S` is what the caller needs to read a row.
pub(super) struct PathSums<S> {
    workers: Workers,
    shape: Shape,
    bands: Vec<BandWorker<S>>,
    strips: Vec<StripWorker>,
}

/// The size of an image and of its candidates.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Shape {
    pub height: usize,
    pub width: usize,
    /// The number of candidates of each pixel, 1 to [`MOST_CANDIDATES`].
    pub candidates: usize,
}

impl Shape {
    /// Returns the length of a row in memory, which ends with a whole strip.
    pub fn pitch(self) -> usize {
        self.width.next_multiple_of(LANES)
    }

    /// Returns the planes of a row: the colours, and the cost of each candidate.
    fn planes(self) -> usize {
        COLOURS + self.candidates
    }
}

/// The bands of one thread.
struct BandWorker<S> {
    scratch: S,
    paths: Paths,
    bands: Vec<Band>,
}

/// The rows of a band.
#[derive(Default)]
struct Band {
    /// The three colours and the costs of the candidates of each row, plane after plane.
    planes: Vec<i16>,
    /// The sums of both paths along each row, one plane for each candidate.
    sums: Vec<i16>,
}

/// The strips of one thread.
struct StripWorker {
    paths: Paths,
    /// The chosen candidates and their margins, strip after strip, row after row.
    chosen: Vec<[u8; LANES]>,
    margins: Vec<[u8; LANES]>,
}

/// The paths of [`LANES`] lines at once.
#[derive(Default)]
struct Paths {
    /// The colours and the costs of each step.
    steps: Vec<Lanes>,
    /// The sums of both directions, for each candidate of each step.
    sums: Vec<Lanes>,
}

impl<S: Default + Send + Sync> PathSums<S> {
    /// Makes the choice with `threads` threads.
    ///
    /// # Errors
    /// [`WorkersError`] when the threads are not available.
    pub fn new(threads: usize) -> Result<Self, WorkersError> {
        let workers = Workers::new(threads)?;
        let band = || BandWorker { scratch: S::default(), paths: Paths::default(), bands: Vec::new() };
        let strip = || StripWorker { paths: Paths::default(), chosen: Vec::new(), margins: Vec::new() };
        let bands = (0..threads).map(|_| band()).collect();
        Ok(Self { workers, shape: Shape::default(), bands, strips: (0..threads).map(|_| strip()).collect() })
    }

    /// Chooses a candidate for each pixel. `fill` gets a row, and writes its three colours and the costs of its candidates, plane after
    /// plane of [`Shape::pitch`] values. Full scale of a colour is [`FULL_SCALE`], `peak` the distance of two candidates in these units; a
    /// cost of 1 is [`COST`].
    pub fn choose(
        &mut self,
        shape: Shape,
        peak: i16,
        fill: impl Fn(usize, &mut S, &mut [i16], &mut [i16]) + Sync,
    ) {
        self.shape = shape;
        let threads = self.bands.len();
        self.workers.each(&mut self.bands, |thread, worker| {
            let rows = (thread * LANES..shape.height).step_by(threads * LANES);
            worker.bands.resize_with(rows.len(), Band::default);
            for (first, band) in rows.zip(&mut worker.bands) {
                let count = LANES.min(shape.height - first);
                band.planes.resize(count * shape.planes() * shape.pitch(), 0);
                band.sums.resize(count * shape.candidates * shape.pitch(), 0);
                for (row, planes) in
                    (first..).zip(band.planes.chunks_exact_mut(shape.planes() * shape.pitch()))
                {
                    let (colours, costs) = planes.split_at_mut(COLOURS * shape.pitch());
                    fill(row, &mut worker.scratch, colours, costs);
                }
                worker.paths.along_rows(shape, peak, band);
            }
        });
        let bands = &self.bands;
        let band = |number: usize| &bands[number % threads].bands[number / threads];
        self.workers.each(&mut self.strips, |thread, worker| {
            let columns = (thread * LANES..shape.pitch()).step_by(threads * LANES);
            for lines in [&mut worker.chosen, &mut worker.margins] {
                lines.resize(columns.len() * shape.height, [0; LANES]);
            }
            for (strip, first) in columns.enumerate() {
                worker.paths.along_columns(shape, peak, first, band);
                let rows = strip * shape.height..(strip + 1) * shape.height;
                let chosen = worker.chosen[rows.clone()].iter_mut().zip(&mut worker.margins[rows]);
                worker.paths.settle(shape, first, band, chosen);
            }
        });
    }

    /// Copies the chosen candidates and their margins (at most 255 / [`MARGIN`]) of a row.
    pub fn copy_row(&self, row: usize, chosen: &mut [u8], margins: &mut [u8]) {
        let threads = self.strips.len();
        let lines = chosen.chunks_mut(LANES).zip(margins.chunks_mut(LANES)).enumerate();
        for (strip, (chosen, margins)) in lines {
            let worker = &self.strips[strip % threads];
            let at = strip / threads * self.shape.height + row;
            chosen.copy_from_slice(&worker.chosen[at][..chosen.len()]);
            margins.copy_from_slice(&worker.margins[at][..margins.len()]);
        }
    }
}

impl Paths {
    /// Sums the paths along the rows of a band, whose rows are the lanes.
    fn along_rows(&mut self, shape: Shape, peak: i16, band: &mut Band) {
        let Shape { width, candidates, .. } = shape;
        let (planes, pitch) = (shape.planes(), shape.pitch());
        self.steps.resize(width * planes, [0; LANES]);
        // Square parts stay in the cache.
        for first in (0..width).step_by(LANES) {
            for (lane, rows) in band.planes.chunks_exact(planes * pitch).enumerate() {
                for (plane, row) in rows.chunks_exact(pitch).enumerate() {
                    let steps = self.steps[first * planes + plane..].iter_mut().step_by(planes);
                    steps
                        .zip(&row[first..width.min(first + LANES)])
                        .for_each(|(step, &value)| step[lane] = value);
                }
            }
        }
        self.run(width, candidates, peak);
        for first in (0..width).step_by(LANES) {
            for (lane, rows) in band.sums.chunks_exact_mut(candidates * pitch).enumerate() {
                for (candidate, row) in rows.chunks_exact_mut(pitch).enumerate() {
                    let sums = self.sums[first * candidates + candidate..].iter().step_by(candidates);
                    let row = &mut row[first..width.min(first + LANES)];
                    row.iter_mut().zip(sums).for_each(|(sum, lanes)| *sum = lanes[lane]);
                }
            }
        }
    }

    /// Sums the paths along the columns of a strip, whose columns are the lanes.
    fn along_columns<'a>(&mut self, shape: Shape, peak: i16, first: usize, band: impl Fn(usize) -> &'a Band) {
        let planes = shape.planes();
        self.steps.resize(shape.height * planes, [0; LANES]);
        for (row, steps) in self.steps.chunks_exact_mut(planes).enumerate() {
            let rows = &band(row / LANES).planes[row % LANES * planes * shape.pitch()..];
            for (step, plane) in steps.iter_mut().zip(rows.chunks_exact(shape.pitch())) {
                step.copy_from_slice(&plane[first..][..LANES]);
            }
        }
        self.run(shape.height, shape.candidates, peak);
    }

    /// Sums the paths of both directions over all steps.
    fn run(&mut self, count: usize, candidates: usize, peak: i16) {
        self.sums.resize(count * candidates, [0; LANES]);
        let planes = COLOURS + candidates;
        let (steps, sums) = (&self.steps[..count * planes], &mut self.sums[..count * candidates]);
        widest!({
            let (last, edges) = ([[0; LANES]; MOST_CANDIDATES], [[0; LANES]; 2 * MOST_CANDIDATES - 1]);
            let mut path = Path { candidates, peak, last, edges };
            let ahead = steps.chunks_exact(planes).zip(sums.chunks_exact_mut(candidates));
            path.follow(ahead, |sum, cost| *sum = cost);
            let back = steps.chunks_exact(planes).rev().zip(sums.chunks_exact_mut(candidates).rev());
            path.follow(back, |sum, cost| *sum += cost);
        });
    }

    /// Adds the sums of the rows to those of the columns of a strip, and writes the best candidate of each pixel and its margin.
    fn settle<'a, 'b>(
        &self,
        shape: Shape,
        first: usize,
        band: impl Fn(usize) -> &'a Band,
        chosen: impl Iterator<Item = (&'b mut [u8; LANES], &'b mut [u8; LANES])>,
    ) {
        let (candidates, pitch) = (shape.candidates, shape.pitch());
        for (row, (columns, (chosen, margins))) in self.sums.chunks_exact(candidates).zip(chosen).enumerate()
        {
            let rows = &band(row / LANES).sums[row % LANES * candidates * pitch..];
            widest!({
                let (mut best, mut second, mut which) = ([u16::MAX; LANES], [u16::MAX; LANES], [0u16; LANES]);
                for (candidate, (column, row)) in (0u16..).zip(columns.iter().zip(rows.chunks_exact(pitch))) {
                    let row = &row[first..][..LANES];
                    for lane in 0..LANES {
                        // Two sums of at most 23,000 each.
                        let sum = column[lane].cast_unsigned() + row[lane].cast_unsigned();
                        let better = sum < best[lane];
                        second[lane] = second[lane].min(if better { best[lane] } else { sum });
                        which[lane] = if better { candidate } else { which[lane] };
                        best[lane] = best[lane].min(sum);
                    }
                }
                for lane in 0..LANES {
                    let margin = (second[lane] - best[lane]) / (COST / i16::from(MARGIN)).cast_unsigned();
                    chosen[lane] = which[lane] as u8;
                    margins[lane] = margin.min(255) as u8;
                }
            });
        }
    }
}

/// One path in each lane.
struct Path {
    candidates: usize,
    peak: i16,
    /// L of the last step.
    last: [Lanes; MOST_CANDIDATES],
    /// V of all differences of candidates, which are `1 - A` to `A - 1`.
    edges: [Lanes; 2 * MOST_CANDIDATES - 1],
}

impl Path {
    /// Follows the path, and hands each L to `take`.
    #[inline(always)]
    fn follow<'a>(
        &mut self,
        steps: impl Iterator<Item = (&'a [Lanes], &'a mut [Lanes])>,
        take: impl Fn(&mut i16, i16),
    ) {
        let mut before: Option<&[Lanes]> = None;
        for (here, sums) in steps {
            let costs = &here[COLOURS..];
            match before {
                None => self.last[..self.candidates].copy_from_slice(costs),
                Some(before) => self.step(before, here),
            }
            for (sum, cost) in sums.iter_mut().zip(&self.last) {
                sum.iter_mut().zip(cost).for_each(|(sum, &cost)| take(sum, cost));
            }
            before = Some(here);
        }
    }

    /// Takes one step.
    #[inline(always)]
    fn step(&mut self, before: &[Lanes], here: &[Lanes]) {
        let candidates = self.candidates;
        let mut ahead = (1 - candidates as i16) * self.peak;
        for edge in &mut self.edges[..2 * candidates - 1] {
            *edge = edge_costs(before, here, ahead);
            ahead += self.peak;
        }
        let mut least = self.last[0];
        for last in &self.last[1..candidates] {
            least.iter_mut().zip(last).for_each(|(least, &last)| *least = (*least).min(last));
        }
        let mut last = [[0; LANES]; MOST_CANDIDATES];
        last[..candidates].copy_from_slice(&self.last[..candidates]);
        for (candidate, next) in self.last[..candidates].iter_mut().enumerate() {
            let mut sum = [i16::MAX; LANES];
            // The edge from candidate o to m stands at m - o, counted from the first one.
            for (last, edge) in
                last[..candidates].iter().zip(self.edges[candidate..][..candidates].iter().rev())
            {
                for lane in 0..LANES {
                    sum[lane] = sum[lane].min(last[lane] + edge[lane]);
                }
            }
            for lane in 0..LANES {
                next[lane] = here[COLOURS + candidate][lane] + sum[lane] - least[lane];
            }
        }
    }
}

/// Returns V where the candidates of green differ by `ahead`.
#[inline(always)]
fn edge_costs(before: &[Lanes], here: &[Lanes], ahead: i16) -> Lanes {
    /// 160 and 10 in units of [`COST`], times [`SHIFT`], over full scale; and the limits of both differences.
    const COLOUR: i16 = (160 * COST as i32 / FULL_SCALE as i32) as i16;
    const BRIGHTNESS: i16 = (10 * 16 * COST as i32 / FULL_SCALE as i32) as i16;
    const SHIFT: u32 = 4;
    const MOST_COLOUR: i16 = FULL_SCALE / 4;
    const MOST_BRIGHTNESS: i16 = (9 * FULL_SCALE as i32 / 10) as i16;
    let mut costs = [0; LANES];
    for lane in 0..LANES {
        let [r, g, b] = [0, 1, 2].map(|colour| here[colour][lane] - before[colour][lane]);
        let g = g + ahead;
        let colour = ((r - g).abs() + (b - g).abs()).min(MOST_COLOUR);
        let brightness = (r + g + b).abs().min(MOST_BRIGHTNESS);
        costs[lane] = COLOUR * colour + ((BRIGHTNESS * brightness) >> SHIFT);
    }
    costs
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// The sums of a small image by their definition, one pixel and one path after the other.
    struct Definition {
        shape: Shape,
        peak: f64,
        /// Three colours as shares of full scale, then the costs of the candidates, of each pixel.
        pixels: Vec<Vec<f64>>,
    }

    impl Definition {
        fn edge(&self, p: &[f64], q: &[f64], ahead: f64) -> f64 {
            let [dr, dg, db] = [0, 1, 2].map(|colour| q[colour] - p[colour]);
            let dg = dg + ahead * self.peak;
            160.0 * ((dr - dg).abs() + (db - dg).abs()).min(0.25) + 10.0 * (dr + dg + db).abs().min(0.9)
        }

        /// The sums of each pixel over the four directions.
        fn sums(&self) -> Vec<Vec<f64>> {
            let Shape { height, width, candidates } = self.shape;
            let mut sums = vec![vec![0.0; candidates]; height * width];
            for (down, right) in [(0, 1), (0, -1), (1, 0), (-1, 0)] {
                let mut path = vec![vec![0.0; candidates]; height * width];
                for at in 0..height * width {
                    // The order of the pixels is that of the direction.
                    let at = if down + right > 0 { at } else { height * width - 1 - at };
                    let (i, j) = ((at / width) as isize - down, (at % width) as isize - right);
                    let q = &self.pixels[at];
                    let is_inside = (0..height as isize).contains(&i) && (0..width as isize).contains(&j);
                    for m in 0..candidates {
                        path[at][m] = q[3 + m];
                        if is_inside {
                            let before = i as usize * width + j as usize;
                            let ahead = |o: usize| {
                                path[before][o] + self.edge(&self.pixels[before], q, m as f64 - o as f64)
                            };
                            let least = path[before].iter().copied().fold(f64::MAX, f64::min);
                            path[at][m] += (0..candidates).map(ahead).fold(f64::MAX, f64::min) - least;
                        }
                        sums[at][m] += path[at][m];
                    }
                }
            }
            sums
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(60))]
        #[test]
        fn the_least_sum_of_the_definition_is_chosen(
            (height, width) in (1usize..70, 1usize..40), candidates in 1usize..=6, threads in 1usize..4, seed in any::<u64>(),
        ) {
            let shape = Shape { height, width, candidates };
            let mut random = seed | 1;
            let mut next = |most: i16| {
                random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
                ((random >> 40) % (most as u64 + 1)) as i16
            };
            let pixels: Vec<Vec<i16>> = (0..height * width)
                .map(|_| {
                    // Mostly near to each other, as colours of a picture are.
                    let spread = if next(4) > 0 { FULL_SCALE / 16 } else { LARGEST_COLOUR };
                    let mut pixel = vec![next(spread), next(FULL_SCALE / candidates as i16), next(spread)];
                    pixel.extend((0..candidates).map(|_| next(20 * COST)));
                    pixel
                })
                .collect();
            let peak = FULL_SCALE / candidates as i16;
            let fill = |row: usize, (): &mut (), colours: &mut [i16], costs: &mut [i16]| {
                for (column, pixel) in pixels[row * width..][..width].iter().enumerate() {
                    for (plane, value) in pixel.iter().enumerate() {
                        match plane.checked_sub(COLOURS) {
                            None => colours[plane * shape.pitch() + column] = *value,
                            Some(candidate) => costs[candidate * shape.pitch() + column] = *value,
                        }
                    }
                }
            };
            let mut paths = PathSums::<()>::new(threads).unwrap();
            // The buffers are those of an image of another size at first.
            paths.choose(Shape { height: 3, width: 50, candidates: 2 }, peak, |_, (), _, _| ());
            paths.choose(shape, peak, fill);
            let units = |(plane, value): (usize, &i16)| f64::from(*value) / f64::from(if plane < COLOURS { FULL_SCALE } else { COST });
            let pixels = pixels.iter().map(|pixel| pixel.iter().enumerate().map(units).collect()).collect();
            let sums = Definition { shape, peak: f64::from(peak) / f64::from(FULL_SCALE), pixels }.sums();
            let (mut chosen, mut margins) = (vec![0; width], vec![0; width]);
            for (row, sums) in sums.chunks_exact(width).enumerate() {
                paths.copy_row(row, &mut chosen, &mut margins);
                for (column, sums) in sums.iter().enumerate() {
                    let own = sums[usize::from(chosen[column])];
                    let others = (0..candidates).filter(|m| *m != usize::from(chosen[column])).map(|m| sums[m]);
                    let margin = others.fold(f64::MAX, f64::min) - own;
                    let margin = margin.clamp(0.0, 255.0 / f64::from(MARGIN));
                    prop_assert!(sums.iter().all(|sum| own <= sum + 0.2), "({}, {}): {:?} {}", row, column, sums, chosen[column]);
                    let told = f64::from(margins[column]) / f64::from(MARGIN);
                    prop_assert!((told - margin).abs() < 0.5 || candidates == 1, "({}, {}): {} {}", row, column, told, margin);
                }
            }
        }
    }
}
