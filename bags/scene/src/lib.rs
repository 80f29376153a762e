//! Procedural driving scenes in linear radiance with exact ground truth.
//!
//! The same preset, seed, frame and size give the same bytes on every machine: only `+ - * /` and `sqrt` are
//! used, which IEEE 754 defines exactly. The ground truth is the class, box, occlusion and truncation of each
//! object. This crate reads no file and models no sensor.

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

/// The light and the location of a scene.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Preset {
    /// A street by day, within the range of a normal camera.
    Day,
    /// A street against a low sun.
    Glare,
    /// The inside of a tunnel, towards its bright exit.
    Tunnel,
    /// A street at night, with lamps on.
    Night,
}

impl Preset {
    /// All presets.
    pub const ALL: [Self; 4] = [Self::Day, Self::Glare, Self::Tunnel, Self::Night];

    /// Returns the name in the address of a scene: day, glare, tunnel or night.
    pub fn name(self) -> &'static str {
        match self {
            Self::Day => "day",
            Self::Glare => "glare",
            Self::Tunnel => "tunnel",
            Self::Night => "night",
        }
    }
}

/// The class of an object.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Class {
    /// A passenger car.
    Car,
    /// A panel van.
    Van,
    /// A lorry.
    Truck,
    /// A person on foot.
    Pedestrian,
    /// A person on a bicycle, bicycle included.
    Cyclist,
}

impl Class {
    /// All classes, in the order of the demonstration detector's class numbers.
    pub const ALL: [Self; 5] = [Self::Car, Self::Van, Self::Truck, Self::Pedestrian, Self::Cyclist];

    /// Returns the name: car, van, truck, pedestrian or cyclist.
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

/// One object of the ground truth.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SceneObject {
    /// The class.
    pub class: Class,
    /// The extent of its pixels in the image in px, hidden ones included.
    pub bbox: BBox,
    /// The share of its pixels in the image that nearer objects hide, `[0, 1]`.
    pub occlusion: f32,
    /// The share of its box that lies outside the image, `[0, 1)`.
    pub truncation: f32,
}

/// One rendered frame of a scene.
#[derive(Clone, Debug, PartialEq)]
pub struct Rendered {
    /// The radiance, `H x W x 3`: red, green, blue, linear, in `[0, 1)`, where 1 is the top of the range that the
    /// sensor's saturation factor represents.
    pub radiance: Array3<f32>,
    /// All objects with at least one pixel in the image, from far to near.
    pub objects: Vec<SceneObject>,
}

/// A street or tunnel with its traffic.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Scene {
    preset: Preset,
    seed: u64,
}

impl Scene {
    /// Makes the scene of a preset and a seed.
    pub fn new(preset: Preset, seed: u64) -> Self {
        Self { preset, seed }
    }

    /// Returns the preset.
    pub fn preset(&self) -> Preset {
        self.preset
    }

    /// Returns the seed.
    pub fn seed(&self) -> u64 {
        self.seed
    }

    /// Renders frame `frame`, of 30 a second, at `height` x `width` pixels; a side of 0 counts as 1.
    pub fn render(&self, frame: u32, height: usize, width: usize) -> Rendered {
        compose::render(self, frame, height.max(1), width.max(1))
    }
}

#[cfg(test)]
mod tests;
