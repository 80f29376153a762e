//! Sixteen rows of sixteen samples, and the same turned: what passes between
//! transforms of columns and of rows.

use super::lanes::{Complex, REALS};

/// Rows of one band, or after [`transpose`] columns of one block.
pub(super) type Tile = [Complex; REALS];

/// Rows become columns.
#[inline(always)]
pub(super) fn transpose(tile: &Tile) -> Tile {
    let mut rows: [[f32; REALS]; REALS] = std::array::from_fn(|row| tile[row].reals());
    // Four rounds of exchanges at distance 8, 4, 2, 1, each between pairs of whole rows.
    exchange::<8>(&mut rows);
    exchange::<4>(&mut rows);
    exchange::<2>(&mut rows);
    exchange::<1>(&mut rows);
    std::array::from_fn(|row| Complex::of(rows[row]))
}

/// Swaps the off-diagonal halves of all 2D x 2D squares.
#[inline(always)]
fn exchange<const D: usize>(rows: &mut [[f32; REALS]; REALS]) {
    for top in (0..REALS).filter(|row| row & D == 0) {
        let (a, b) = (rows[top], rows[top + D]);
        for column in 0..REALS {
            rows[top][column] = if column & D == 0 { a[column] } else { b[column ^ D] };
            rows[top + D][column] = if column & D == 0 { a[column ^ D] } else { b[column] };
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_become_columns() {
        let tile: Tile =
            std::array::from_fn(|row| Complex::of(std::array::from_fn(|column| (row * 16 + column) as f32)));
        let turned = transpose(&tile);
        for (row, column) in (0..16).flat_map(|row| (0..16).map(move |column| (row, column))) {
            assert_eq!(turned[column].reals()[row], tile[row].reals()[column]);
        }
    }
}
