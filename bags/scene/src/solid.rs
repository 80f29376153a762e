//! Bodies in the world, made of flat faces and rods that are painted from far to near.
//!
//! A solid has shape, reflectance and lamps; it depends on light and camera only when it is painted.

use super::layer::{Layer, Shape, Silhouette, area, join};
use super::light::{Light, Rgb, add};
use super::view::{CameraView, NEAR, Point, clip_near};
use modulo_core::BBox;

/// A part of one colour.
#[derive(Clone, Debug)]
pub(super) struct ScenePart {
    pub(super) geometry: Shape<Point>,
    pub(super) albedo: Rgb,
    /// The radiance of the part itself.
    pub(super) glow: Rgb,
}

/// The halo of a lamp, drawn as light in front of the solid.
#[derive(Clone, Copy, Debug)]
pub(super) struct Halo {
    pub(super) at: Point,
    /// The direction of its light.
    pub(super) towards: Point,
    /// The radius in m at which half the light is left.
    pub(super) radius: f32,
    /// The radiance in the middle.
    pub(super) glow: Rgb,
}

/// Parts in an order of painting that holds from every side.
#[derive(Clone, Debug, Default)]
pub(super) struct PartGroup {
    /// The parts from back to front.
    pub(super) parts: Vec<ScenePart>,
    /// The light around lamps.
    pub(super) halos: Vec<Halo>,
}

/// A solid: bodies from its rear to its front in its own axes (right, up, forward), and from far to near in the world.
#[derive(Clone, Debug)]
pub(super) struct Solid(pub(super) Vec<PartGroup>);

/// The direction of a solid: one of the four directions of a street grid.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Facing {
    /// The solid faces as the camera does.
    Ahead,
    /// The solid faces the camera.
    Towards,
    Left,
    Right,
}

impl Facing {
    /// Turns (right, up, forward) into world axes.
    fn rotate(self, [right, up, forward]: Point) -> Point {
        match self {
            Self::Ahead => [right, up, forward],
            Self::Towards => [-right, up, -forward],
            Self::Left => [-forward, up, right],
            Self::Right => [forward, up, -right],
        }
    }
}

impl Solid {
    /// Moves the solid into the world, its own origin at (`x`, 0, `z`).
    pub(super) fn placed(mut self, x: f32, z: f32, facing: Facing) -> Self {
        let go = |p: Point| {
            let q = facing.rotate(p);
            [q[0] + x, q[1], q[2] + z]
        };
        // Bodies are stored from rear to front; seen from behind, the front is the far end.
        if facing == Facing::Ahead {
            self.0.reverse();
        }
        for body in &mut self.0 {
            for part in &mut body.parts {
                match &mut part.geometry {
                    Shape::Polygon(points) => points.iter_mut().for_each(|p| *p = go(*p)),
                    Shape::Capsule { a, b, .. } => (*a, *b) = (go(*a), go(*b)),
                }
            }
            for halo in &mut body.halos {
                (halo.at, halo.towards) = (go(halo.at), facing.rotate(halo.towards));
            }
        }
        self
    }

    /// Returns the halos of the lamps that shine towards the camera.
    pub(super) fn halos(&self) -> impl Iterator<Item = &Halo> {
        // The camera is at the origin, so a negative product means that the lamp shines towards it.
        let seen = |h: &&Halo| h.at[0] * h.towards[0] + h.at[2] * h.towards[2] < 0.0;
        self.0.iter().flat_map(|b| &b.halos).filter(seen)
    }

    /// Paints only this solid; also returns the box of all of it, in the image or not.
    pub(super) fn layer(&self, view: &CameraView, light: &Light) -> Option<(Layer, BBox)> {
        let parts = self.0.iter().flat_map(|b| &b.parts);
        let shapes: Vec<(Silhouette, Rgb)> = parts.filter_map(|p| flat(p, view, light)).collect();
        // The box of all parts, also of those outside of the image: truncation is measured against it.
        let whole = shapes.iter().filter_map(|(s, _)| s.bounds()).reduce(join)?;
        let mut layer = Layer::over(whole, view.height, view.width);
        for (shape, colour) in &shapes {
            layer.paint(shape, *colour);
        }
        Some((layer, whole))
    }
}

impl PartGroup {
    /// Adds a rod of one colour.
    pub(super) fn rod(&mut self, a: Point, b: Point, radius: f32, albedo: Rgb) {
        self.parts.push(ScenePart { geometry: Shape::Capsule { a, b, radius }, albedo, glow: [0.0; 3] });
    }
}

/// Projects a part into the image; `None` when it faces away or lies behind.
fn flat(part: &ScenePart, view: &CameraView, light: &Light) -> Option<(Silhouette, Rgb)> {
    let (shape, normal, z) = match &part.geometry {
        Shape::Polygon(points) => {
            let ahead = clip_near(points);
            let corners: Vec<[f32; 2]> = ahead.iter().map(|p| view.project(*p)).collect();
            // The orientation in the image tells whether the outside of the face is visible.
            if corners.len() < 3 || area(&corners) <= 0.0 {
                return None;
            }
            (Silhouette::Polygon(corners), normal(points), ahead[0][2])
        }
        Shape::Capsule { a, b, radius } => {
            let z = 0.5 * (a[2] + b[2]);
            // Rods are not clipped: one that crosses the near plane is left out as a whole.
            if a[2].min(b[2]) < NEAR {
                return None;
            }
            let radius = radius * view.focal / z;
            // A rod has no face of its own. This normal looks up and towards the camera.
            (Silhouette::Capsule { a: view.project(*a), b: view.project(*b), radius }, [0.0, 0.45, -0.89], z)
        }
    };
    Some((shape, add(light.shade(part.albedo, normal, z), part.glow)))
}

fn normal(points: &[Point]) -> Point {
    let side = |i: usize| [0, 1, 2].map(|k| points[i][k] - points[0][k]);
    let (p, q) = (side(1), side(2));
    let n = [p[1] * q[2] - p[2] * q[1], p[2] * q[0] - p[0] * q[2], p[0] * q[1] - p[1] * q[0]];
    // Corners that coincide span no plane, and must not divide by 0.
    let length = (n[0] * n[0] + n[1] * n[1] + n[2] * n[2]).sqrt().max(1e-9);
    n.map(|c| c / length)
}

/// Four corners in space as seen from outside: lower left, lower right, upper right, upper left.
#[derive(Clone, Copy, Debug)]
pub(super) struct Quadrilateral(pub(super) [Point; 4]);

impl Quadrilateral {
    /// Returns the point at (`u`, `v`) of the panel, (0, 0) at the lower left and (1, 1) at the upper right.
    pub(super) fn at(&self, u: f32, v: f32) -> Point {
        let Self([a, b, c, d]) = self;
        let along = |p: &Point, q: &Point| [0, 1, 2].map(|k| p[k] + (q[k] - p[k]) * u);
        let (low, high) = (along(a, b), along(d, c));
        [0, 1, 2].map(|k| low[k] + (high[k] - low[k]) * v)
    }

    /// Returns a face over the part of the panel from (`u1`, `v1`) to (`u2`, `v2`).
    pub(super) fn patch(&self, [u1, v1, u2, v2]: [f32; 4], albedo: Rgb, glow: Rgb) -> ScenePart {
        let corners = vec![self.at(u1, v2), self.at(u2, v2), self.at(u2, v1), self.at(u1, v1)];
        ScenePart { geometry: Shape::Polygon(corners), albedo, glow }
    }
}

/// A box that may taper: a level rectangle at each end of its height.
#[derive(Clone, Copy, Debug)]
pub(super) struct Block {
    /// The height of the lower and the upper rectangle in m.
    pub(super) height: [f32; 2],
    /// The rear and the front end of each in m.
    pub(super) rear: [f32; 2],
    /// The front end, see `rear`.
    pub(super) front: [f32; 2],
    /// Half the width of each in m.
    pub(super) half: [f32; 2],
}

impl Block {
    /// Returns the panels rear, right, front, left and roof.
    pub(super) fn panels(&self) -> [Quadrilateral; 5] {
        let corner = |end: usize, forward: f32, side: f32| [side * self.half[end], self.height[end], forward];
        // Corners of a wall run as seen from outside, from the lower left on, so that its patches face outwards.
        let wall = |p: [f32; 2], ps: f32, q: [f32; 2], qs: f32| {
            Quadrilateral([
                corner(0, p[0], ps),
                corner(0, q[0], qs),
                corner(1, q[1], qs),
                corner(1, p[1], ps),
            ])
        };
        let (rear, front) = (self.rear, self.front);
        let roof = Quadrilateral([
            corner(1, rear[1], -1.0),
            corner(1, rear[1], 1.0),
            corner(1, front[1], 1.0),
            corner(1, front[1], -1.0),
        ]);
        [
            wall(rear, -1.0, rear, 1.0),
            wall(rear, 1.0, front, 1.0),
            wall(front, 1.0, front, -1.0),
            wall(front, -1.0, rear, -1.0),
            roof,
        ]
    }
}
