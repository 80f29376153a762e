//! Sixteen rows of sixteen samples, and the same turned: what passes between
//! transforms of columns and of rows.

use super::lanes::{Complex, LANES, Lanes, REALS};

/// Rows of one band, or columns of one block.
pub(super) type Tile = [Complex; REALS];

/// Rows that `take` gives become columns that `put` receives.
#[inline(always)]
pub(super) fn transpose(take: impl Fn(usize) -> Complex, mut put: impl FnMut(usize, Complex)) {
    // One half of all rows after the other: sixteen of them are as many as there are registers.
    let upper = turned(eight(
        #[inline(always)]
        |row| take(row).re,
    ));
    let lower = turned(eight(
        #[inline(always)]
        |row| take(LANES + row).re,
    ));
    for column in 0..LANES {
        put(column, Complex { re: upper[column], im: lower[column] });
    }
    let upper = turned(eight(
        #[inline(always)]
        |row| take(row).im,
    ));
    let lower = turned(eight(
        #[inline(always)]
        |row| take(LANES + row).im,
    ));
    for column in 0..LANES {
        put(LANES + column, Complex { re: upper[column], im: lower[column] });
    }
}

#[inline(always)]
fn eight(of: impl Fn(usize) -> Lanes) -> [Lanes; LANES] {
    [of(0), of(1), of(2), of(3), of(4), of(5), of(6), of(7)]
}

/// Eight rows of eight, by the interleavings that vector machines have: of numbers, of pairs, of halves.
#[inline(always)]
fn turned([a, b, c, d, e, f, g, h]: [Lanes; LANES]) -> [Lanes; LANES] {
    let ([a, b], [c, d]) = (ones(a, b), ones(c, d));
    let ([e, f], [g, h]) = (ones(e, f), ones(g, h));
    let ([a, b], [c, d]) = (twos(a, c), twos(b, d));
    let ([e, f], [g, h]) = (twos(e, g), twos(f, h));
    let ([a, e], [b, f]) = (fours(a, e), fours(b, f));
    let ([c, g], [d, h]) = (fours(c, g), fours(d, h));
    [a, b, c, d, e, f, g, h]
}

#[inline(always)]
fn ones(Lanes(a): Lanes, Lanes(b): Lanes) -> [Lanes; 2] {
    [
        Lanes([a[0], b[0], a[1], b[1], a[4], b[4], a[5], b[5]]),
        Lanes([a[2], b[2], a[3], b[3], a[6], b[6], a[7], b[7]]),
    ]
}

#[inline(always)]
fn twos(Lanes(a): Lanes, Lanes(b): Lanes) -> [Lanes; 2] {
    [
        Lanes([a[0], a[1], b[0], b[1], a[4], a[5], b[4], b[5]]),
        Lanes([a[2], a[3], b[2], b[3], a[6], a[7], b[6], b[7]]),
    ]
}

#[inline(always)]
fn fours(Lanes(a): Lanes, Lanes(b): Lanes) -> [Lanes; 2] {
    [
        Lanes([a[0], a[1], a[2], a[3], b[0], b[1], b[2], b[3]]),
        Lanes([a[4], a[5], a[6], a[7], b[4], b[5], b[6], b[7]]),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_become_columns() {
        let tile: Tile =
            std::array::from_fn(|row| Complex::of(std::array::from_fn(|column| (row * 16 + column) as f32)));
        let mut turned = Tile::default();
        transpose(|row| tile[row], |column, lanes| turned[column] = lanes);
        for (row, column) in (0..16).flat_map(|row| (0..16).map(move |column| (row, column))) {
            assert_eq!(turned[column].reals()[row], tile[row].reals()[column]);
        }
    }
}
