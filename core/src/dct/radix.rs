//! Short transforms `X_j = sum_i x_i exp(-2 pi i j / R)` written out.

use super::lanes::{Arithmetic, Complex};

/// cos and sin of pi/3 and of multiples of 2 pi/5.
const SIN_3: f32 = 0.866_025_4;
const COS_5: [f32; 2] = [0.309_017, -0.809_017];
const SIN_5: [f32; 2] = [0.951_056_5, 0.587_785_25];

#[inline(always)]
pub(super) fn two([a, b]: [Complex; 2]) -> [Complex; 2] {
    [a.plus(b), a.minus(b)]
}

#[inline(always)]
pub(super) fn three<A: Arithmetic>([a, b, c]: [Complex; 3]) -> [Complex; 3] {
    let (sum, difference) = (b.plus(c), b.minus(c).scaled(SIN_3));
    let middle = sum.scaled_plus::<A>(-0.5, a);
    [a.plus(sum), middle.minus_i(difference), middle.plus_i(difference)]
}

#[inline(always)]
pub(super) fn four([a, b, c, d]: [Complex; 4]) -> [Complex; 4] {
    let [even, odd] = two([a, c]);
    let [sum, difference] = two([b, d]);
    [even.plus(sum), odd.minus_i(difference), even.minus(sum), odd.plus_i(difference)]
}

#[inline(always)]
pub(super) fn five<A: Arithmetic>([a, b, c, d, e]: [Complex; 5]) -> [Complex; 5] {
    let ([u, v], [t, w]) = (two([b, e]), two([c, d]));
    let near = t.scaled_plus::<A>(COS_5[1], u.scaled_plus::<A>(COS_5[0], a));
    let far = t.scaled_plus::<A>(COS_5[0], u.scaled_plus::<A>(COS_5[1], a));
    let near_odd = w.scaled_plus::<A>(SIN_5[1], v.scaled(SIN_5[0]));
    let far_odd = w.scaled_plus::<A>(-SIN_5[0], v.scaled(SIN_5[1]));
    [
        a.plus(u).plus(t),
        near.minus_i(near_odd),
        far.minus_i(far_odd),
        far.plus_i(far_odd),
        near.plus_i(near_odd),
    ]
}
