//! The solids of the traffic: cars, vans and trucks, which are painted blocks with windows, lamps and wheels, and
//! pedestrians, cyclists and trees, which are made of rods.
//!
//! Their own axes are (right, up, forward) from the ground below the middle, or between the feet or wheels.

use super::hash::{Random, wave};
use super::layer::Shape;
use super::light::{Rgb, scaled};
use super::solid::{Block, Halo, PartGroup, Quadrilateral, ScenePart, Solid};

const GLASS: Rgb = [0.10, 0.12, 0.15];
const TYRE: Rgb = [0.05, 0.05, 0.055];
const HUB: Rgb = [0.42, 0.42, 0.44];
const CHASSIS: Rgb = [0.09, 0.09, 0.095];
const DARK: Rgb = [0.0; 3];
const PAINTS: [Rgb; 8] = [
    [0.80, 0.80, 0.80],
    [0.55, 0.57, 0.60],
    [0.62, 0.08, 0.07],
    [0.10, 0.20, 0.55],
    [0.20, 0.21, 0.23],
    [0.75, 0.55, 0.10],
    [0.14, 0.38, 0.22],
    [0.50, 0.42, 0.34],
];
const CARGO: [Rgb; 4] = [[0.88, 0.88, 0.86], [0.15, 0.35, 0.62], [0.72, 0.32, 0.10], [0.35, 0.55, 0.30]];

/// The panels of a block in the order rear, right, front, left, roof.
const REAR: usize = 0;
const RIGHT: usize = 1;
const FRONT: usize = 2;
const LEFT: usize = 3;

/// Makes a saloon or hatchback, about 4.3 m long and 1.5 m high.
pub(super) fn car(random: &mut Random, lamps: bool) -> Solid {
    let paint = random.pick(&PAINTS);
    let (long, half) = (random.between(1.95, 2.25), random.between(0.84, 0.92));
    let tail = random.between(-0.97, -0.80) * long;
    let roof = random.between(1.40, 1.52);
    let body = Block {
        height: [0.24, 0.86],
        rear: [-long, -0.97 * long],
        front: [long, 0.94 * long],
        half: [half, half * 0.96],
    };
    let cabin = Block {
        height: [0.86, roof],
        rear: [tail, tail + 0.45],
        front: [0.42 * long, 0.08 * long],
        half: [half * 0.93, half * 0.74],
    };
    let axles = [-0.62 * long, 0.62 * long];
    let mut all = PartGroup::default();
    on_wheels(&mut all, &body, paint, (half, &axles, 0.33));
    for end in [REAR, FRONT] {
        fittings(&mut all, &body.panels()[end], end, [0.50, 0.90], lamps);
    }
    shell(&mut all, &cabin, paint);
    let sides = cabin.panels();
    for side in [REAR, FRONT, LEFT, RIGHT] {
        all.parts.push(sides[side].patch([0.07, 0.10, 0.93, 0.88], GLASS, DARK));
    }
    for side in [LEFT, RIGHT] {
        all.parts.push(sides[side].patch([0.47, 0.05, 0.52, 0.9], paint, DARK));
    }
    Solid(vec![all])
}

/// Makes a tall panel van, about 5.2 m long and 2.4 m high, with a split rear door.
pub(super) fn van(random: &mut Random, lamps: bool) -> Solid {
    let paint = random.pick(&[PAINTS[0], PAINTS[1], PAINTS[5], PAINTS[3]]);
    let (long, half) = (random.between(2.45, 2.75), random.between(0.96, 1.02));
    let roof = random.between(2.25, 2.50);
    let hull = Block {
        height: [0.30, roof],
        rear: [-long, -long],
        front: [0.72 * long, 0.45 * long],
        half: [half, half * 0.90],
    };
    let nose = Block {
        height: [0.30, 1.15],
        rear: [0.5 * long, 0.5 * long],
        front: [long, 0.95 * long],
        half: [half * 0.99, half * 0.95],
    };
    // Two groups, since no single order holds: from ahead the nose hides the hull, from behind the hull hides it.
    let (mut back, mut front) = (PartGroup::default(), PartGroup::default());
    on_wheels(&mut back, &hull, paint, (half, &[-0.60 * long], 0.36));
    van_hull(&mut back, &hull, paint);
    let rear = Block { height: [0.30, 1.15], ..hull };
    fittings(&mut back, &rear.panels()[REAR], REAR, [0.35, 0.95], lamps);
    on_wheels(&mut front, &nose, paint, (half, &[0.66 * long], 0.36));
    fittings(&mut front, &nose.panels()[FRONT], FRONT, [0.45, 0.85], lamps);
    Solid(vec![back, front])
}

/// Adds the windows, the split door and the side rails of a van.
fn van_hull(body: &mut PartGroup, hull: &Block, paint: Rgb) {
    let sides = hull.panels();
    let mut patch =
        |side: usize, at: [f32; 4], albedo: Rgb| body.parts.push(sides[side].patch(at, albedo, DARK));
    patch(REAR, [0.10, 0.56, 0.47, 0.84], GLASS);
    patch(REAR, [0.53, 0.56, 0.90, 0.84], GLASS);
    patch(REAR, [0.49, 0.05, 0.51, 0.95], scaled(paint, 0.35));
    patch(FRONT, [0.05, 0.44, 0.95, 0.88], GLASS);
    patch(RIGHT, [0.74, 0.46, 0.96, 0.80], GLASS);
    patch(LEFT, [0.04, 0.46, 0.26, 0.80], GLASS);
    for side in [LEFT, RIGHT] {
        patch(side, [0.06, 0.30, 0.94, 0.34], scaled(paint, 0.4));
    }
}

/// Makes a lorry with a box body, about 8 m long and 3.5 m high.
pub(super) fn truck(random: &mut Random, lamps: bool) -> Solid {
    let (paint, load) = (random.pick(&PAINTS), random.pick(&CARGO));
    let high = random.between(3.3, 3.8);
    let cargo = Block { height: [1.00, high], rear: [-4.2; 2], front: [1.9; 2], half: [1.25, 1.25] };
    let cab = Block { height: [0.45, 2.75], rear: [2.2; 2], front: [4.0, 3.75], half: [1.18, 1.12] };
    // The frame ends where the cab begins, so that no gap shows below the cargo.
    let frame = Block { height: [0.50, 1.00], rear: [-4.1; 2], front: [2.2; 2], half: [1.05, 1.05] };
    let (mut back, mut front) = (PartGroup::default(), PartGroup::default());
    on_wheels(&mut back, &frame, CHASSIS, (1.18, &[-3.2, -2.0], 0.50));
    fittings(&mut back, &frame.panels()[REAR], REAR, [0.1, 0.8], lamps);
    shell(&mut back, &cargo, load);
    boxed(&mut back, &cargo, load);
    on_wheels(&mut front, &cab, paint, (1.18, &[2.9], 0.50));
    cabin(&mut front, &cab);
    let bumper = Block { height: [0.45, 1.05], ..cab };
    fittings(&mut front, &bumper.panels()[FRONT], FRONT, [0.25, 0.85], lamps);
    Solid(vec![back, front])
}

/// Adds the windows and the grille of a lorry's cab.
fn cabin(body: &mut PartGroup, cab: &Block) {
    let sides = cab.panels();
    body.parts.push(sides[FRONT].patch([0.06, 0.50, 0.94, 0.90], GLASS, DARK));
    body.parts.push(sides[FRONT].patch([0.15, 0.28, 0.85, 0.42], CHASSIS, DARK));
    for side in [LEFT, RIGHT] {
        body.parts.push(sides[side].patch([0.25, 0.50, 0.80, 0.86], GLASS, DARK));
    }
}

/// Adds the doors, stripes and edges of a box body.
fn boxed(body: &mut PartGroup, cargo: &Block, load: Rgb) {
    let dim = scaled(load, 0.40);
    let sides = cargo.panels();
    for [u1, v1, u2, v2] in [[0.485, 0.03, 0.515, 0.97], [0.0, 0.0, 0.05, 1.0], [0.95, 0.0, 1.0, 1.0]] {
        body.parts.push(sides[REAR].patch([u1, v1, u2, v2], dim, DARK));
    }
    body.parts.push(sides[REAR].patch([0.0, 0.94, 1.0, 1.0], dim, DARK));
    let stripe = [1.0 - load[0], 1.0 - load[1], 1.0 - load[2]].map(|c| 0.15 + 0.6 * c);
    for side in [REAR, LEFT, RIGHT] {
        body.parts.push(sides[side].patch([0.05, 0.12, 0.95, 0.26], stripe, DARK));
    }
}

/// Adds the painted outside of a block.
fn shell(body: &mut PartGroup, block: &Block, paint: Rgb) {
    for panel in block.panels() {
        body.parts.push(panel.patch([0.0, 0.0, 1.0, 1.0], paint, DARK));
    }
}

/// Adds the lamps, bumper and number plate of one end, [`REAR`] or [`FRONT`]; `band` is the height of the lamps
/// on the panel, 0 to 1.
fn fittings(body: &mut PartGroup, panel: &Quadrilateral, end: usize, band: [f32; 2], lamps: bool) {
    let (albedo, glow) = if end == REAR {
        ([0.50, 0.04, 0.03], [0.30, 0.025, 0.015])
    } else {
        ([0.85, 0.85, 0.80], [0.42, 0.41, 0.37])
    };
    let glow = if lamps { glow } else { DARK };
    // Bumper and number plate come first, since the lamps overlap the bumper.
    body.parts.push(panel.patch([0.0, 0.0, 1.0, 0.22], CHASSIS, DARK));
    body.parts.push(panel.patch([0.36, 0.24, 0.64, 0.42], [0.75; 3], DARK));
    let towards = if end == REAR { [0.0, 0.0, -1.0] } else { [0.0, 0.0, 1.0] };
    for [u1, u2] in [[0.02, 0.17], [0.83, 0.98]] {
        body.parts.push(panel.patch([u1, band[0], u2, band[1]], albedo, scaled(glow, 0.4)));
        // A lamp that is off has no halo, but keeps its coloured glass.
        if glow != DARK {
            let at = panel.at(0.5 * (u1 + u2), 0.5 * (band[0] + band[1]));
            body.halos.push(Halo { at, towards, radius: 0.26, glow });
        }
    }
}

/// Adds the painted outside of a block on wheels of this radius in m at these axles, `half` m left and right of the middle.
fn on_wheels(body: &mut PartGroup, block: &Block, paint: Rgb, (half, axles, radius): (f32, &[f32], f32)) {
    // Painter's order: the tyres below the body, the body over them, and the sides of the wheels over both.
    for &axle in axles {
        for middle in [-half + 0.12, half - 0.12] {
            let tyre = Block {
                height: [0.0, radius * 1.6],
                rear: [axle - 0.6 * radius, axle - radius],
                front: [axle + 0.6 * radius, axle + radius],
                half: [0.11; 2],
            };
            for panel in tyre.panels() {
                let moved = Quadrilateral(panel.0.map(|p| [p[0] + middle, p[1], p[2]]));
                body.parts.push(moved.patch([0.0, 0.0, 1.0, 1.0], TYRE, DARK));
            }
        }
    }
    shell(body, block, paint);
    for &axle in axles {
        for side in [-half - 0.01, half + 0.01] {
            body.parts.push(disc([side, radius, axle], radius, TYRE));
            body.parts.push(disc([side, radius, axle], 0.55 * radius, HUB));
        }
    }
}

/// Returns a disc of twelve corners that faces outwards, to the left when `x < 0`.
fn disc([x, y, z]: [f32; 3], radius: f32, albedo: Rgb) -> ScenePart {
    // Corners must run clockwise as seen from outside, or the face would count as turned away.
    let spin = if x < 0.0 { 1.0 } else { -1.0 };
    let corner = |i: usize| {
        let t = -spin * i as f32 / 12.0;
        [x, y + radius * wave(t + 0.25), z + radius * wave(t)]
    };
    ScenePart { geometry: Shape::Polygon((0..12).map(corner).collect()), albedo, glow: DARK }
}

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
const RUBBER: Rgb = [0.06, 0.06, 0.065];

/// Makes a pedestrian; `stride` is in periods of two steps.
pub(super) fn pedestrian(random: &mut Random, stride: f32) -> Solid {
    let k = random.between(0.90, 1.08);
    let (skin, hair) = (random.pick(&SKIN), random.pick(&HAIR));
    let (top, legs) = (random.pick(&TOPS), random.pick(&TROUSERS));
    let swing = 0.32 * wave(stride);
    let at = |right: f32, up: f32, forward: f32| [right * k, up * k, forward * k];
    let mut body = PartGroup::default();
    for (side, reach) in [(-1.0, swing), (1.0, -swing)] {
        // The knee goes half as far as the foot and a little ahead, so that legs bend as in a step.
        let knee = at(0.10 * side, 0.48, 0.55 * reach + 0.04);
        body.rod(at(0.09 * side, 0.90, 0.0), knee, 0.095 * k, legs);
        body.rod(knee, at(0.10 * side, 0.07, reach), 0.075 * k, legs);
        body.rod(at(0.10 * side, 0.05, reach), at(0.11 * side, 0.05, reach + 0.12), 0.06 * k, RUBBER);
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
    // The pedals are opposite to each other, half a turn apart.
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
        body.rod(at(i), at(i + 1), 0.045, RUBBER);
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
