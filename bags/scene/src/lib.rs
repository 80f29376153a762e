//! An own driving scene in linear radiance: what a newcomer's camera looks at.
//!
//! A [`Scene`] is seeded and procedural: the same preset, seed, frame and size
//! give the same bytes on every machine (only `+ - * /` and `sqrt`, which IEEE
//! 754 fixes). It comes with the truth: each object's class, box, occlusion and
//! truncation. Nothing here reads a file or models a sensor.

mod compose;
mod hash;
mod layer;
mod light;
mod person;
mod solid;
mod spec;
mod street;
mod traffic;
mod tunnel;
mod vehicle;
mod view;

use modulo_core::BBox;
use ndarray::Array3;

pub use spec::{SceneSpec, SpecError};

/// The kind of light and place.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Preset {
    /// A street by day; a normal camera sees all of it.
    Day,
    /// A street against a low sun.
    Glare,
    /// In a tunnel, towards its bright end.
    Tunnel,
    /// A street at night, lamps on.
    Night,
}

impl Preset {
    /// All presets.
    pub const ALL: [Self; 4] = [Self::Day, Self::Glare, Self::Tunnel, Self::Night];

    /// Its name in a scene's address: day, glare, tunnel or night.
    pub fn name(self) -> &'static str {
        match self {
            Self::Day => "day",
            Self::Glare => "glare",
            Self::Tunnel => "tunnel",
            Self::Night => "night",
        }
    }
}

/// What an object is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Class {
    /// A passenger car.
    Car,
    /// A panel van.
    Van,
    /// A lorry.
    Truck,
    /// Somebody on foot.
    Pedestrian,
    /// Somebody on a bicycle, bicycle included.
    Cyclist,
}

impl Class {
    /// All classes, in the order of the demo detector's numbers.
    pub const ALL: [Self; 5] = [Self::Car, Self::Van, Self::Truck, Self::Pedestrian, Self::Cyclist];

    /// Its name: car, van, truck, pedestrian or cyclist.
    pub fn name(self) -> &'static str {
        match self {
            Self::Car => "car",
            Self::Van => "van",
            Self::Truck => "truck",
            Self::Pedestrian => "pedestrian",
            Self::Cyclist => "cyclist",
        }
    }
}

/// One object of the truth.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SceneObject {
    /// What it is.
    pub class: Class,
    /// The extent of its pixels in the image, hidden ones included, px.
    pub bbox: BBox,
    /// Share of its pixels in the image that something nearer hides, `[0, 1]`.
    pub occlusion: f32,
    /// Share of its box that lies outside the image, `[0, 1)`.
    pub truncation: f32,
}

/// One frame of a scene.
#[derive(Clone, Debug, PartialEq)]
pub struct Rendered {
    /// `H x W x 3`, red, green, blue, linear, in `[0, 1)`: 1 is the top of the
    /// range that the sensor's saturation factor represents.
    pub radiance: Array3<f32>,
    /// Everything with at least one pixel in the image, far to near.
    pub objects: Vec<SceneObject>,
}

/// A street or tunnel with its traffic.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Scene {
    preset: Preset,
    seed: u64,
}

impl Scene {
    /// The scene of a preset and a seed.
    pub fn new(preset: Preset, seed: u64) -> Self {
        Self { preset, seed }
    }

    /// Its preset.
    pub fn preset(&self) -> Preset {
        self.preset
    }

    /// Its seed.
    pub fn seed(&self) -> u64 {
        self.seed
    }

    /// Frame `frame` at `height` x `width` pixels; a side of 0 counts as 1.
    /// Frames are meant for 30 a second.
    pub fn render(&self, frame: u32, height: usize, width: usize) -> Rendered {
        compose::render(self, frame, height.max(1), width.max(1))
    }
}

#[cfg(test)]
mod tests;
