//! `lines` against its definition, written out pixel by pixel on planes of integers.

use modulo_core::unwrap::{Options, QualityMetrics, by_name};
use modulo_core::{Frame, Range, Recovered};
use ndarray::{Array3, Axis};
use proptest::prelude::*;

/// One channel, and the arithmetic on it.
struct Plane {
    y: Vec<Vec<i64>>,
    peak: i64,
    most: i64,
    /// Counts are kept modulo this number.
    word: i64,
}

/// Counts for the quality metrics.
struct Seen {
    residues: usize,
    steep: usize,
    clamped: usize,
}

fn centered(value: i64, period: i64) -> i64 {
    (value + period / 2).rem_euclid(period) - period / 2
}

/// Returns the most frequent value, of equal ones that which reached the count first, and its frequency.
fn mode(values: &[i64]) -> (i64, usize) {
    let count = |upto: usize| values[..=upto].iter().filter(|&&v| v == values[upto]).count();
    let mut best = (0, 0);
    for (i, &value) in values.iter().enumerate() {
        if count(i) > best.1 {
            best = (value, count(i));
        }
    }
    best
}

/// Whether each line in turn follows its majority.
#[derive(Default)]
struct MajorityCheck {
    lasted: i64,
    departed: bool,
    steep_before: bool,
}

impl MajorityCheck {
    fn needs_second_vote(&mut self, agree: usize, steep: usize, length: usize) -> bool {
        let before = std::mem::replace(&mut self.steep_before, 4 * steep > length);
        5 * agree < 4 * length || before || self.steep_before || self.departed
    }

    fn record(&mut self, departs: bool, most: i64) {
        self.lasted = if departs { self.lasted + 1 } else { 0 };
        self.departed = departs && self.lasted <= 2 * most + 2;
    }
}

impl Plane {
    fn m(&self, value: i64) -> i64 {
        centered(value, self.peak)
    }

    fn count(&self, value: i64) -> i64 {
        centered(value, self.word)
    }

    /// Returns the n of `M_b(change) = change + n 2^b`.
    fn wrap_step(&self, change: i64) -> i64 {
        (self.m(change) - change) / self.peak
    }

    /// Returns M_b of the difference from pixel (i, j) to (i + di, j + dj).
    fn d(&self, (i, j): (usize, usize), (di, dj): (usize, usize)) -> i64 {
        self.m(self.y[i + di][j + dj] - self.y[i][j])
    }

    fn steep(&self, difference: i64) -> bool {
        8 * difference.abs() > 2 * self.peak
    }

    fn unwrap(&self, seen: &mut Seen) -> Vec<Vec<i64>> {
        let (height, width) = (self.y.len(), self.y[0].len());
        let mut n = vec![vec![0; width - 1]; height];
        for (i, j) in (1..height).flat_map(|i| (0..width - 1).map(move |j| (i, j))) {
            let mixed = self.d((i, j), (0, 1)) - self.d((i - 1, j), (0, 1));
            n[i][j] = self.count(n[i - 1][j] + self.wrap_step(mixed));
            // The sum of the wrapped differences around the loop.
            let round = mixed + self.d((i - 1, j), (1, 0)) - self.d((i - 1, j + 1), (1, 0));
            seen.residues += usize::from(round != 0);
            seen.steep += usize::from(8 * self.m(mixed).abs() > 3 * self.peak);
        }
        self.subtract_constants(&mut n);
        let mut k = vec![vec![0; width]; height];
        for (i, j) in (0..height).flat_map(|i| (1..width).map(move |j| (i, j))) {
            k[i][j] = self.count(k[i][j - 1] + self.wrap_step(self.y[i][j] - self.y[i][j - 1]) + n[i][j - 1]);
        }
        self.join(&mut k);
        self.place(k, seen)
    }

    fn subtract_constants(&self, n: &mut [Vec<i64>]) {
        let (height, mut check) = (n.len(), MajorityCheck::default());
        for j in 0..n[0].len() {
            let line: Vec<_> = n.iter().map(|n| n[j]).collect();
            let (mut constant, agree) = mode(&line);
            let steep = (0..height).filter(|&i| self.steep(self.d((i, j), (0, 1)))).count();
            if check.needs_second_vote(agree, steep, height) && j > 0 {
                let second = |i: usize| {
                    let change = self.d((i, j), (0, 1)) - self.d((i, j - 1), (0, 1));
                    self.count(line[i] - n[i][j - 1] - self.wrap_step(change))
                };
                let (second_vote, _) = mode(&(0..height).map(second).collect::<Vec<_>>());
                check.record(second_vote != constant, self.most);
                constant = second_vote;
            }
            n.iter_mut().for_each(|n| n[j] = self.count(n[j] - constant));
        }
    }

    fn join(&self, k: &mut [Vec<i64>]) {
        let (width, mut check) = (k[0].len(), MajorityCheck::default());
        for i in 1..k.len() {
            let wrap_step = |i: usize, j: usize| self.wrap_step(self.y[i][j] - self.y[i - 1][j]);
            let first: Vec<_> =
                (0..width).map(|j| self.count(wrap_step(i, j) + k[i - 1][j] - k[i][j])).collect();
            let (mut join, agree) = mode(&first);
            let steep = (0..width).filter(|&j| self.steep(self.d((i - 1, j), (1, 0)))).count();
            if check.needs_second_vote(agree, steep, width) && i > 1 {
                let second = |j: usize| {
                    let change = self.d((i - 1, j), (1, 0)) - self.d((i - 2, j), (1, 0));
                    let n_up = k[i - 1][j] - k[i - 2][j] - wrap_step(i - 1, j);
                    self.count(first[j] + n_up + self.wrap_step(change))
                };
                let (second_vote, count) = mode(&(0..width).map(second).collect::<Vec<_>>());
                // The second vote is taken even with slightly fewer columns, as noise blurs second differences more.
                let departs = 10 * count > 9 * agree && second_vote != join;
                if 10 * count > 9 * agree {
                    join = second_vote;
                }
                check.record(departs, self.most);
            }
            k[i].iter_mut().for_each(|k| *k = self.count(*k + join));
        }
    }

    /// Makes the highest level that holds nearly as many pixels as the best one the level 0.
    fn place(&self, mut k: Vec<Vec<i64>>, seen: &mut Seen) -> Vec<Vec<i64>> {
        let all: Vec<_> = k.iter().flatten().copied().collect();
        let (low, high) = (*all.iter().min().unwrap(), *all.iter().max().unwrap());
        let mut levels = vec![0usize; (high - low + 1) as usize];
        all.iter().for_each(|k| levels[(k - low) as usize] += 1);
        let share = |zero: i64| -> usize {
            levels[(zero - low) as usize..].iter().take(self.most as usize + 1).sum()
        };
        let best = (low..=high).map(share).max().unwrap();
        let near = |&zero: &i64| share(zero) as f64 >= best as f64 - 0.02 * all.len() as f64;
        let zero = (low..=high).rev().find(near).unwrap();
        seen.clamped += all.len() - share(zero);
        k.iter_mut().flatten().for_each(|k| *k = self.count(*k - zero).clamp(0, self.most));
        k
    }
}

fn reference(y: &Array3<u16>, range: Range, word: i64) -> (Array3<u8>, QualityMetrics) {
    let (height, width, channels) = y.dim();
    let (mut k, mut seen) = (Array3::zeros(y.dim()), Seen { residues: 0, steep: 0, clamped: 0 });
    for c in 0..channels {
        let row = |i: usize| (0..width).map(|j| i64::from(y[[i, j, c]])).collect();
        let y = (0..height).map(row).collect();
        let plane = Plane { y, peak: range.peak() as i64, most: range.max_wraps().into(), word };
        for (i, row) in plane.unwrap(&mut seen).into_iter().enumerate() {
            row.into_iter().enumerate().for_each(|(j, found)| k[[i, j, c]] = found as u8);
        }
    }
    let share = |count: usize, of: usize| if of == 0 { 0.0 } else { count as f32 / of as f32 };
    let loops = (height - 1) * (width - 1) * channels;
    let Seen { residues, steep, clamped } = seen;
    let (residues, steep) = (share(residues, loops), share(steep, loops));
    let x = y.mapv(f32::from) + k.mapv(f32::from) * range.peak();
    (
        k,
        QualityMetrics {
            residues,
            steep,
            clamped: share(clamped, y.len()),
            jumps: share(jumps(&x, range), y.len()),
            defects: 0.0,
        },
    )
}

/// Returns the number of second differences along rows and columns above one peak.
fn jumps(x: &Array3<f32>, range: Range) -> usize {
    let bends = |axis: usize| {
        let windows = x.lanes(Axis(axis)).into_iter().flat_map(|lane| {
            lane.windows(3).into_iter().map(|w| (w[0] + w[2] - 2.0 * w[1]).abs()).collect::<Vec<_>>()
        });
        windows.filter(|bend| *bend > range.peak()).count()
    };
    bends(0) + bends(1)
}

fn lines(y: &Frame, range: Range) -> Recovered {
    let mut out = Recovered::default();
    by_name("lines", &Options::default()).unwrap().unwrap(y, &range.into(), &mut out).unwrap();
    out
}

/// Checks `y` in both depths, if it fits both.
fn assert_is_the_definition(y: &Array3<u16>, range: Range) {
    let check = |frame: Frame, word: i64| {
        let (k, quality) = reference(y, range, word);
        let out = lines(&frame, range);
        assert_eq!(out.x, y.mapv(f32::from) + k.mapv(f32::from) * range.peak(), "word {word}, {range:?}");
        assert_eq!((out.k, out.report.quality), (k, Some(quality)), "word {word}, {range:?}");
    };
    if range.bits() <= 8 {
        // The method takes words of 8 bits where they hold all counts.
        let word = if range.alpha() <= 64.0 { 1 << 8 } else { 1 << 16 };
        check(Frame::from_u8(y.mapv(|y| y as u8)).unwrap(), word);
    }
    check(Frame::from_u16(y.clone()).unwrap(), 1 << 16);
}

/// Returns slopes of any steepness with noise of any strength, in units of the peak.
fn image(
    dim: (usize, usize, usize),
    bits: u8,
    slope: (f64, f64),
    bend: f64,
    noise: f64,
    seed: u32,
) -> Array3<u16> {
    let peak = f64::from(1u32 << bits);
    let mut state = seed | 1;
    Array3::from_shape_fn(dim, |(i, j, c)| {
        // A linear congruential generator, so that each seed gives the same image on every machine.
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        let random = f64::from(state >> 8) / f64::from(1u32 << 24) - 0.5;
        let (i, j) = (i as f64 / 40.0, j as f64 / 40.0);
        let x = slope.0 * i + slope.1 * j + bend * (i * j + c as f64 * i * i) + noise * random;
        ((x * peak).rem_euclid(peak) as u32 % (1 << bits)) as u16
    })
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 400, ..ProptestConfig::default() })]

    #[test]
    fn is_what_its_definition_says(
        dim in (1usize..=40, 1usize..=40, prop_oneof![Just(1usize), Just(3)]),
        bits in 4u8..=16,
        alpha in prop_oneof![4 => 1f64..=20.0, 1 => 20f64..=256.0],
        slope in (-30f64..30.0, -30f64..30.0),
        bend in prop_oneof![Just(0.0), -8f64..8.0],
        noise in prop_oneof![Just(0.0), 0f64..0.5, Just(4.0)],
        seed: u32,
    ) {
        let y = image(dim, bits, slope, bend, noise, seed);
        assert_is_the_definition(&y, Range::new(bits, alpha).unwrap());
    }
}

/// Counters of 8 bits overflow neither in long rows nor in long columns.
#[test]
fn long_lines_are_counted() {
    let range = Range::new(8, 4.0).unwrap();
    for (dim, noise) in [((3, 8200, 1), 0.0), ((3, 8200, 3), 0.3), ((600, 3, 3), 0.3), ((600, 33, 1), 0.0)] {
        assert_is_the_definition(&image(dim, 8, (1.0, 1.5), 0.0, noise, 7), range);
    }
}
