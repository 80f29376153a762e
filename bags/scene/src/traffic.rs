//! The traffic of each frame: lanes of slots that move past the camera.
//!
//! The actors of one lane keep one speed and one distance, so they never collide. A slot that has left the view
//! comes back far ahead with another actor.

use super::hash::{Random, hash, wave};
use super::road_user::{car, cyclist, pedestrian, tree, truck, van};
use super::solid::{Facing, Solid};
use super::{Class, Preset};

/// The nearest and the farthest position of an actor's middle in m.
const REACH: [f32; 2] = [-2.0, 62.0];

/// A person, a vehicle or a tree on the street.
#[derive(Clone, Debug)]
pub(super) struct Actor {
    /// The class, `None` for a tree.
    pub(super) class: Option<Class>,
    /// The distance of its middle in m, which is the painting order.
    pub(super) z: f32,
    /// Its ground in m: centre x and z, half the extent along x and along z.
    pub(super) ground: [f32; 4],
    /// The solid in the world.
    pub(super) solid: Solid,
}

/// The kind of actors in a lane.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Users {
    Traffic,
    Parked,
    Walkers,
    Riders,
    Trees,
}

/// A row of slots along the street.
#[derive(Clone, Copy, Debug)]
struct TrafficLane {
    users: Users,
    /// The middle of the lane in m, right of the camera.
    x: f32,
    /// The distance from slot to slot in m.
    gap: f32,
    /// The speed towards the camera in m per frame.
    approach: f32,
    facing: Facing,
    /// The share of slots that are in use.
    filled: f32,
}

const fn lane(users: Users, x: f32, gap: f32, approach: f32, facing: Facing, filled: f32) -> TrafficLane {
    TrafficLane { users, x, gap, approach, facing, filled }
}

const STREET: [TrafficLane; 9] = [
    lane(Users::Traffic, -3.7, 21.0, 0.34, Facing::Towards, 0.75),
    lane(Users::Parked, 3.9, 12.5, 0.16, Facing::Ahead, 0.50),
    lane(Users::Riders, 1.95, 23.0, 0.07, Facing::Ahead, 0.55),
    lane(Users::Riders, -5.9, 29.0, 0.25, Facing::Towards, 0.50),
    lane(Users::Walkers, -7.3, 9.0, 0.20, Facing::Towards, 0.55),
    lane(Users::Walkers, 5.9, 10.0, 0.13, Facing::Ahead, 0.55),
    lane(Users::Walkers, 7.0, 15.0, 0.19, Facing::Towards, 0.40),
    lane(Users::Trees, -8.6, 13.0, 0.16, Facing::Ahead, 0.70),
    lane(Users::Trees, 8.4, 15.0, 0.16, Facing::Ahead, 0.60),
];

const BORE: [TrafficLane; 5] = [
    lane(Users::Traffic, -3.7, 16.0, 0.22, Facing::Towards, 0.80),
    lane(Users::Traffic, 3.5, 17.0, 0.05, Facing::Ahead, 0.80),
    lane(Users::Riders, 1.75, 19.0, 0.08, Facing::Ahead, 0.60),
    lane(Users::Walkers, -5.9, 11.0, 0.12, Facing::Towards, 0.60),
    lane(Users::Walkers, 5.5, 10.0, 0.07, Facing::Ahead, 0.60),
];

/// Returns all actors of a frame from far to near.
pub(super) fn actors(preset: Preset, seed: u32, frame: u32, lamps: bool) -> Vec<Actor> {
    let lanes: &[TrafficLane] = if preset == Preset::Tunnel { &BORE } else { &STREET };
    let mut found: Vec<Actor> = lanes
        .iter()
        .zip(1u32..)
        .flat_map(|(lane, id)| slots(lane, hash(seed, id, 7), frame, lamps))
        .collect();
    found.extend(leaders(seed, frame, lamps));
    if preset != Preset::Tunnel {
        found.extend(crossing(seed, frame));
    }
    // The painter's algorithm needs the farthest actor first.
    found.sort_by(|a, b| b.z.total_cmp(&a.z));
    found
}

/// Returns the actors of one lane.
fn slots(lane: &TrafficLane, seed: u32, frame: u32, lamps: bool) -> Vec<Actor> {
    let count = ((REACH[1] - REACH[0]) / lane.gap).ceil() as u32;
    let cycle = count as f32 * lane.gap;
    let start = Random::new(seed, 0).unit() * lane.gap;
    let place = |slot: u32| {
        let travelled = f64::from(frame) * f64::from(lane.approach) - f64::from(start);
        let ahead = f64::from(slot) * f64::from(lane.gap) - travelled;
        // In double precision, because long drives would lose the position in `f32`.
        let lap = (ahead / f64::from(cycle)).floor();
        let z = (ahead - lap * f64::from(cycle)) as f32 + REACH[0];
        // A new lap is a new actor: the key contains the lap.
        let mut random = Random::new(seed, hash(slot, lap as i64 as u32, 3));
        // The cycle is a whole number of gaps and may reach beyond the view.
        (random.unit() < lane.filled && z <= REACH[1]).then(|| user(lane, &mut random, z, frame, lamps))
    };
    (0..count).filter_map(place).collect()
}

fn user(lane: &TrafficLane, random: &mut Random, z: f32, frame: u32, lamps: bool) -> Actor {
    let time = frame as f32 / 26.0 + random.unit();
    // Actors are moved by less than half of the smallest gap, so two of a lane never overlap.
    let (x, z) = (lane.x + random.between(-0.25, 0.25), z + random.between(-0.8, 0.8));
    match lane.users {
        Users::Traffic => vehicle(random, x, z, lane.facing, lamps),
        // Parked cars have their lamps off in every preset.
        Users::Parked => vehicle(random, x, z, lane.facing, false),
        Users::Walkers => walker(random, x, z, lane.facing, time),
        Users::Riders => {
            let solid = cyclist(random, time).placed(x, z, lane.facing);
            Actor { class: Some(Class::Cyclist), z, ground: [x, z, 0.35, 0.9], solid }
        }
        Users::Trees => {
            Actor { class: None, z, ground: [x, z, 0.8, 0.8], solid: tree(random).placed(x, z, lane.facing) }
        }
    }
}

fn walker(random: &mut Random, x: f32, z: f32, facing: Facing, stride: f32) -> Actor {
    let solid = pedestrian(random, stride).placed(x, z, facing);
    Actor { class: Some(Class::Pedestrian), z, ground: [x, z, 0.35, 0.35], solid }
}

fn vehicle(random: &mut Random, x: f32, z: f32, facing: Facing, lamps: bool) -> Actor {
    let class = random.pick(&[Class::Car, Class::Car, Class::Car, Class::Van, Class::Van, Class::Truck]);
    let (solid, half, long) = match class {
        Class::Van => (van(random, lamps), 1.0, 2.6),
        Class::Truck => (truck(random, lamps), 1.25, 4.2),
        _ => (car(random, lamps), 0.9, 2.1),
    };
    Actor { class: Some(class), z, ground: [x, z, half, long], solid: solid.placed(x, z, facing) }
}

/// Returns two vehicles in the camera's lane that drop back and pull ahead.
fn leaders(seed: u32, frame: u32, lamps: bool) -> Vec<Actor> {
    let time = frame as f32;
    let follow = |id: u32, near: f32, sway: f32, period: f32| {
        let mut random = Random::new(seed, 900 + id);
        let z = near + random.between(0.0, 4.0) + sway * wave(time / period + random.unit());
        let x = random.between(-0.3, 0.3) + 0.25 * wave(time / 170.0 + random.unit());
        (random.unit() < 0.8).then(|| vehicle(&mut random, x, z, Facing::Ahead, lamps))
    };
    [follow(1, 15.0, 3.5, 260.0), follow(2, 36.0, 5.0, 340.0)].into_iter().flatten().collect()
}

/// Returns a pedestrian and a cyclist who cross the street between the leaders.
fn crossing(seed: u32, frame: u32) -> Vec<Actor> {
    let pass = |id: u32, z: f32, speed: f32, period: u32| {
        let mut random = Random::new(seed, 700 + id);
        // Any frame number is allowed, so the phase wraps with it.
        let shifted = frame.wrapping_add((random.unit() * period as f32) as u32);
        // Each crossing is another person, so its number is part of the key.
        let mut random = Random::new(seed, hash(id, shifted / period, 11));
        let gone = speed * (shifted % period) as f32;
        let (facing, x) = random.pick(&[(Facing::Right, gone - 9.0), (Facing::Left, 9.0 - gone)]);
        let stride = frame as f32 / 26.0;
        if x.abs() > 9.0 || random.unit() > 0.8 {
            return None;
        }
        let z = z + random.between(-0.7, 0.7);
        if id == 1 {
            return Some(walker(&mut random, x, z, facing, stride));
        }
        let solid = cyclist(&mut random, stride).placed(x, z, facing);
        Some(Actor { class: Some(Class::Cyclist), z, ground: [x, z, 0.9, 0.35], solid })
    };
    [pass(1, 24.5, 0.06, 330), pass(2, 27.5, 0.14, 170)].into_iter().flatten().collect()
}
