//! Pedestrians, cyclists and trees, made of rods.
//!
//! Their own axes are (right, up, forward) from the ground between the feet or wheels.

use super::hash::{Random, wave};
use super::light::Rgb;
use super::solid::{PartGroup, Solid};

const SKIN: [Rgb; 3] = [[0.62, 0.44, 0.34], [0.40, 0.26, 0.18], [0.24, 0.15, 0.10]];
const HAIR: [Rgb; 3] = [[0.10, 0.07, 0.05], [0.30, 0.20, 0.10], [0.40, 0.38, 0.36]];
const TOPS: [Rgb; 6] = [
    [0.70, 0.68, 0.64],
    [0.60, 0.14, 0.12],
    [0.20, 0.34, 0.62],
    [0.55, 0.48, 0.22],
    [0.42, 0.24, 0.46],
    [0.34, 0.46, 0.38],
];
const TROUSERS: [Rgb; 4] = [[0.16, 0.20, 0.34], [0.22, 0.21, 0.20], [0.44, 0.38, 0.28], [0.30, 0.32, 0.36]];
const VESTS: [Rgb; 3] = [[0.82, 0.86, 0.12], [0.90, 0.42, 0.06], [0.86, 0.86, 0.84]];
const METAL: Rgb = [0.34, 0.34, 0.36];
const TYRE: Rgb = [0.06, 0.06, 0.065];

/// Makes a pedestrian; `stride` is in periods of two steps.
pub(super) fn pedestrian(random: &mut Random, stride: f32) -> Solid {
    let k = random.between(0.90, 1.08);
    let (skin, hair) = (random.pick(&SKIN), random.pick(&HAIR));
    let (top, legs) = (random.pick(&TOPS), random.pick(&TROUSERS));
    let swing = 0.32 * wave(stride);
    let at = |right: f32, up: f32, forward: f32| [right * k, up * k, forward * k];
    let mut body = PartGroup::default();
    for (side, reach) in [(-1.0, swing), (1.0, -swing)] {
        let knee = at(0.10 * side, 0.48, 0.55 * reach + 0.04);
        body.rod(at(0.09 * side, 0.90, 0.0), knee, 0.095 * k, legs);
        body.rod(knee, at(0.10 * side, 0.07, reach), 0.075 * k, legs);
        body.rod(at(0.10 * side, 0.05, reach), at(0.11 * side, 0.05, reach + 0.12), 0.06 * k, TYRE);
    }
    body.rod(at(-0.25, 1.38, 0.0), at(-0.28, 0.92, swing), 0.065 * k, top);
    body.rod(at(0.25, 1.38, 0.0), at(0.28, 0.92, -swing), 0.065 * k, top);
    body.rod(at(0.0, 0.98, 0.0), at(0.0, 1.32, 0.0), 0.19 * k, top);
    body.rod(at(-0.12, 1.38, 0.0), at(0.12, 1.38, 0.0), 0.11 * k, top);
    body.rod(at(0.0, 1.50, 0.0), at(0.0, 1.58, 0.02), 0.085 * k, skin);
    body.rod(at(0.0, 1.66, 0.01), at(0.0, 1.68, 0.0), 0.115 * k, hair);
    body.rod(at(0.0, 1.60, 0.03), at(0.0, 1.60, 0.04), 0.095 * k, skin);
    Solid(vec![body])
}

/// Makes a person on a bicycle; `stride` is in turns of the pedals.
pub(super) fn cyclist(random: &mut Random, stride: f32) -> Solid {
    let (skin, vest) = (random.pick(&SKIN), random.pick(&VESTS));
    let (legs, helmet) = (random.pick(&TROUSERS), random.pick(&VESTS));
    let mut body = PartGroup::default();
    for hub in [-0.54, 0.54] {
        ring(&mut body, hub, 0.36);
    }
    let (seat, pedals, bar) = ([0.0, 0.92, -0.20], [0.0, 0.32, 0.0], [0.0, 1.06, 0.42]);
    for (a, b) in
        [(seat, pedals), (pedals, bar), (seat, bar), ([0.0, 0.36, 0.54], bar), ([0.0, 0.36, -0.54], pedals)]
    {
        body.rod(a, b, 0.03, METAL);
    }
    body.rod([-0.34, 1.08, 0.40], [0.34, 1.08, 0.40], 0.035, METAL);
    for (side, phase) in [(-0.12, stride), (0.12, stride + 0.5)] {
        let foot = [side * 1.2, 0.32 + 0.15 * wave(phase + 0.25), 0.15 * wave(phase)];
        let knee = [side * 1.5, 0.5 * (foot[1] + 0.96) + 0.05, 0.26];
        body.rod([side, 0.96, -0.18], knee, 0.095, legs);
        body.rod(knee, foot, 0.07, legs);
    }
    body.rod([0.0, 1.06, -0.16], [0.0, 1.40, 0.10], 0.19, vest);
    for side in [-1.0, 1.0] {
        body.rod([0.20 * side, 1.44, 0.14], [0.31 * side, 1.12, 0.38], 0.06, vest);
    }
    body.rod([0.0, 1.60, 0.22], [0.0, 1.62, 0.22], 0.105, skin);
    body.rod([0.0, 1.70, 0.14], [0.0, 1.70, 0.26], 0.115, helmet);
    Solid(vec![body])
}

/// Adds a tyre of ten straight pieces around a hub at `forward`.
fn ring(body: &mut PartGroup, forward: f32, radius: f32) {
    let at = |i: usize| {
        let t = i as f32 / 10.0;
        [0.0, radius * (1.0 + wave(t + 0.25)), forward + radius * wave(t)]
    };
    for i in 0..10 {
        body.rod(at(i), at(i + 1), 0.045, TYRE);
    }
    body.rod([0.0, radius, forward], [0.0, radius, forward], 0.06, METAL);
}

/// Makes a tree beside the road; it is no object of the ground truth, but it can hide one.
pub(super) fn tree(random: &mut Random) -> Solid {
    let (high, wide) = (random.between(2.6, 3.6), random.between(1.0, 1.7));
    let mut body = PartGroup::default();
    body.rod([0.0, 0.0, 0.0], [0.0, high, 0.0], 0.14, [0.16, 0.12, 0.09]);
    for i in 0..14 {
        let shade = random.between(0.5, 1.3) * (0.75 + 0.03 * i as f32);
        let leaf = [0.16 * shade, 0.27 * shade, 0.09 * shade];
        let rise = random.between(-0.5, 1.0) + 0.1 * i as f32;
        let at = [random.between(-wide, wide), high + rise, random.between(-0.6, 0.3)];
        body.rod(at, [at[0] + 0.3, at[1] + 0.1, at[2]], random.between(0.35, 0.8), leaf);
    }
    Solid(vec![body])
}
