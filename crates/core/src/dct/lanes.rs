//! Vectors of lanes: the same step of several independent transforms at once, so that no radix needs a shuffle.
//! They are plain loops over arrays, which the compiler turns into the vectors of the machine.

/// The number of independent complex transforms side by side.
pub(super) const COMPLEX_LANES: usize = 8;

/// The number of real sequences side by side: two in each complex transform.
pub(crate) const LANES: usize = 2 * COMPLEX_LANES;

/// One real number of each transform.
// The size of an AVX2 register, so that no load crosses a cache line.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[repr(align(32))]
pub(super) struct RealVector(pub [f32; COMPLEX_LANES]);

/// One complex number of each transform.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[repr(align(64))]
pub(super) struct Complex {
    pub re: RealVector,
    pub im: RealVector,
}

/// A twiddle factor `exp(-i angle)`, possibly scaled.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Twiddle {
    pub cos: f32,
    pub sin: f32,
}

impl Twiddle {
    /// Returns `scale * exp(-i angle)`, rounded from double precision.
    pub fn new(angle: f64, scale: f64) -> Self {
        Self { cos: (scale * angle.cos()) as f32, sin: (scale * angle.sin()) as f32 }
    }
}

/// The rounding of `a * b + c`. Each machine uses only one of the two, so that its results never vary.
pub(super) trait MultiplyAdd {
    fn multiply_add(a: f32, b: f32, c: f32) -> f32;
}

/// Rounds once: for machines that have one instruction for it.
pub(super) struct Fused;

/// Rounds twice: where a fused multiply-add would be a call into the maths library.
pub(super) struct Unfused;

impl MultiplyAdd for Fused {
    #[inline(always)]
    fn multiply_add(a: f32, b: f32, c: f32) -> f32 {
        a.mul_add(b, c)
    }
}

impl MultiplyAdd for Unfused {
    #[inline(always)]
    fn multiply_add(a: f32, b: f32, c: f32) -> f32 {
        a * b + c
    }
}

/// Returns whether this machine uses [`Fused`].
#[inline]
pub(super) fn has_fma() -> bool {
    #[cfg(target_arch = "x86_64")]
    // The same condition as in `run_widest`, since only code that is compiled for FMA may ask for it.
    return is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma");
    #[cfg(not(target_arch = "x86_64"))]
    return cfg!(target_arch = "aarch64");
}

impl RealVector {
    #[inline(always)]
    pub fn map(self, other: Self, with: impl Fn(f32, f32) -> f32) -> Self {
        let mut out = self;
        for (out, other) in out.0.iter_mut().zip(other.0) {
            *out = with(*out, other);
        }
        out
    }

    #[inline(always)]
    pub fn plus(self, other: Self) -> Self {
        self.map(other, |a, b| a + b)
    }

    #[inline(always)]
    pub fn minus(self, other: Self) -> Self {
        self.map(other, |a, b| a - b)
    }

    #[inline(always)]
    pub fn scaled(self, by: f32) -> Self {
        self.map(self, |a, _| a * by)
    }

    /// Returns `self * by + other`.
    #[inline(always)]
    pub fn scaled_plus<A: MultiplyAdd>(self, by: f32, other: Self) -> Self {
        self.map(other, |a, b| A::multiply_add(a, by, b))
    }
}

impl Complex {
    /// Puts the first half of `lanes` into the real parts and the second half into the imaginary parts.
    #[inline(always)]
    pub fn from_lanes(lanes: [f32; LANES]) -> Self {
        let half = |half: Option<&[f32; COMPLEX_LANES]>| {
            RealVector(*half.expect("reals are twice as many as lanes"))
        };
        Self { re: half(lanes.first_chunk()), im: half(lanes.last_chunk()) }
    }

    /// Returns the argument of [`Complex::from_lanes`].
    #[inline(always)]
    pub fn to_lanes(self) -> [f32; LANES] {
        *[self.re.0, self.im.0].as_flattened().first_chunk().expect("reals are twice as many as lanes")
    }

    /// Returns one of the lanes, in the order of [`Complex::from_lanes`].
    #[inline(always)]
    pub fn lane_mut(&mut self, lane: usize) -> &mut f32 {
        if lane < COMPLEX_LANES { &mut self.re.0[lane] } else { &mut self.im.0[lane - COMPLEX_LANES] }
    }

    #[inline(always)]
    pub fn plus(self, other: Self) -> Self {
        Self { re: self.re.plus(other.re), im: self.im.plus(other.im) }
    }

    #[inline(always)]
    pub fn minus(self, other: Self) -> Self {
        Self { re: self.re.minus(other.re), im: self.im.minus(other.im) }
    }

    #[inline(always)]
    pub fn scaled(self, by: f32) -> Self {
        Self { re: self.re.scaled(by), im: self.im.scaled(by) }
    }

    #[inline(always)]
    pub fn scaled_plus<A: MultiplyAdd>(self, by: f32, other: Self) -> Self {
        Self { re: self.re.scaled_plus::<A>(by, other.re), im: self.im.scaled_plus::<A>(by, other.im) }
    }

    /// Returns `self * (cos - i sin)`.
    #[inline(always)]
    pub fn rotated<A: MultiplyAdd>(self, Twiddle { cos, sin }: Twiddle) -> Self {
        Self {
            re: self.im.scaled_plus::<A>(sin, self.re.scaled(cos)),
            im: self.re.scaled_plus::<A>(-sin, self.im.scaled(cos)),
        }
    }

    /// Returns `self - i other`.
    #[inline(always)]
    pub fn minus_i(self, other: Self) -> Self {
        Self { re: self.re.plus(other.im), im: self.im.minus(other.re) }
    }

    /// Returns `self + i other`.
    #[inline(always)]
    pub fn plus_i(self, other: Self) -> Self {
        Self { re: self.re.minus(other.im), im: self.im.plus(other.re) }
    }

    /// Swaps real and imaginary parts, which turns a forward transform into an inverse one.
    #[inline(always)]
    pub fn swapped(self) -> Self {
        Self { re: self.im, im: self.re }
    }
}

/// A tile of sixteen rows of sixteen samples, which passes between the transforms of columns and of rows: the rows
/// of one band, or the columns of one block.
pub(super) type Tile = [Complex; LANES];

/// Sixteen rows of sixteen numbers, in halves.
type Square = [[f32; COMPLEX_LANES]; 2 * LANES];

/// Transposes: `take` gives the rows, `put` receives the columns.
#[inline(always)]
pub(super) fn transpose(take: impl Fn(usize) -> Complex, mut put: impl FnMut(usize, Complex)) {
    let (mut square, mut other) = (Square::default(), Square::default());
    for (row, to) in square.as_chunks_mut().0.iter_mut().enumerate() {
        let Complex { re, im } = take(row);
        *to = [re.0, im.0];
    }
    // Two steps an iteration, from one square to the other and back.
    for _ in 0..LANES.ilog2() / 2 {
        interleave_halves(&square, &mut other);
        interleave_halves(&other, &mut square);
    }
    for (column, &[re, im]) in square.as_chunks().0.iter().enumerate() {
        put(column, Complex { re: RealVector(re), im: RealVector(im) });
    }
}

/// Interleaves the two halves, as a perfect shuffle of cards: the uppermost bit of each index becomes its lowest.
/// One such step for each bit of the index of a row exchanges rows and columns. The compiler turns loops like this one
/// into shuffles of whole vectors, but not lists of elements.
#[inline(always)]
fn interleave_halves(from: &Square, to: &mut Square) {
    let (first, second) = from.split_at(LANES);
    let (first, second) = (first.as_flattened(), second.as_flattened());
    for ((pair, &a), &b) in to.as_flattened_mut().as_chunks_mut().0.iter_mut().zip(first).zip(second) {
        *pair = [a, b];
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_become_columns() {
        let tile: Tile = std::array::from_fn(|row| {
            Complex::from_lanes(std::array::from_fn(|column| (row * 16 + column) as f32))
        });
        let mut turned = Tile::default();
        transpose(|row| tile[row], |column, lanes| turned[column] = lanes);
        for (row, column) in (0..16).flat_map(|row| (0..16).map(move |column| (row, column))) {
            assert_eq!(turned[column].to_lanes()[row], tile[row].to_lanes()[column]);
        }
    }
}
