//! Tiles of sixteen rows of sixteen samples and their transpose, which pass between the transforms of columns and
//! of rows.

use super::lanes::{COMPLEX_LANES, Complex, LANES, RealVector};

/// The rows of one band, or the columns of one block.
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
/// As many steps as an index of a row has bits exchange row and column. The compiler turns loops like this one
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
