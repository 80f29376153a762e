//! Sixteen rows of sixteen samples, and the same turned: what passes between
//! transforms of columns and of rows.

use super::lanes::{Complex, LANES, Lanes, REALS};

/// Rows of one band, or after [`transpose`] columns of one block.
pub(super) type Tile = [Complex; REALS];

/// Rows become columns.
#[inline(always)]
pub(super) fn transpose(from: &Tile, to: &mut Tile) {
    for half in 0..2 {
        let upper: [Lanes; LANES] = std::array::from_fn(|row| from[half * LANES + row].re);
        let lower: [Lanes; LANES] = std::array::from_fn(|row| from[half * LANES + row].im);
        for (column, (upper, lower)) in turned(upper).into_iter().zip(turned(lower)).enumerate() {
            if half == 0 {
                (to[column].re, to[LANES + column].re) = (upper, lower);
            } else {
                (to[column].im, to[LANES + column].im) = (upper, lower);
            }
        }
    }
}

/// Eight rows of eight, by exchanges at distance 4, 2 and 1 between pairs of whole rows.
#[inline(always)]
fn turned(rows: [Lanes; LANES]) -> [Lanes; LANES] {
    exchanged::<1>(exchanged::<2>(exchanged::<4>(rows)))
}

/// Swaps the off-diagonal quarters of all 2D x 2D squares.
#[inline(always)]
fn exchanged<const D: usize>(rows: [Lanes; LANES]) -> [Lanes; LANES] {
    std::array::from_fn(
        #[inline(always)]
        |row| {
            let (own, other) = (rows[row].0, rows[row ^ D].0);
            let mut out = own;
            for (column, out) in out.iter_mut().enumerate() {
                if column & D != row & D {
                    *out = other[column ^ D];
                }
            }
            Lanes(out)
        },
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_become_columns() {
        let tile: Tile =
            std::array::from_fn(|row| Complex::of(std::array::from_fn(|column| (row * 16 + column) as f32)));
        let mut turned = Tile::default();
        transpose(&tile, &mut turned);
        for (row, column) in (0..16).flat_map(|row| (0..16).map(move |column| (row, column))) {
            assert_eq!(turned[column].reals()[row], tile[row].reals()[column]);
        }
    }
}
