//! The pixels of one object with their coverage, without background.
//!
//! Silhouettes are antialiased by their distance to the centre of the pixel. Layers do not depend on each other;
//! `truth` compares them.

use super::light::{Rgb, add, scaled};
use modulo_core::BBox;

/// The least coverage at which a pixel belongs to an object.
pub(super) const OWNED: f32 = 0.5;

/// A window of the image with premultiplied colour and coverage.
#[derive(Clone, Debug)]
pub(super) struct Layer {
    /// The first column and row in the image.
    pub(super) left: usize,
    pub(super) top: usize,
    /// The number of columns and rows, which may be 0.
    pub(super) width: usize,
    pub(super) height: usize,
    /// Red, green, blue (premultiplied) and coverage, row by row.
    pub(super) texels: Vec<[f32; 4]>,
}

/// A shape in the world or, as a [`Silhouette`], in the image.
#[derive(Clone, Debug)]
pub(super) enum Shape<P> {
    /// A convex polygon. One in the world is visible only from the side from which its corners run clockwise; in the image, either
    /// orientation is allowed.
    Polygon(Vec<P>),
    /// All points within `radius`, half the thickness, of the segment `a`-`b`: a rod with round ends.
    Capsule { a: P, b: P, radius: f32 },
}

/// A shape that can be painted, in px of the image.
pub(super) type Silhouette = Shape<[f32; 2]>;

impl Silhouette {
    /// Returns the smallest box around the shape, `None` when it has no point.
    pub(super) fn bounds(&self) -> Option<BBox> {
        let (points, grow): (&[[f32; 2]], f32) = match self {
            Self::Polygon(points) => (points, 0.0),
            Self::Capsule { a, b, radius } => (&[*a, *b], *radius),
        };
        let around =
            |p: &[f32; 2]| BBox { x1: p[0] - grow, y1: p[1] - grow, x2: p[0] + grow, y2: p[1] + grow };
        points.iter().map(around).reduce(join)
    }

    /// Returns how far the centre of a pixel is inside the shape in px, negative outside.
    fn depth(&self, edges: &[[f32; 3]], u: f32, v: f32) -> f32 {
        match self {
            Self::Polygon(_) => edges.iter().fold(f32::MAX, |d, e| d.min(e[0] * u + e[1] * v + e[2])),
            Self::Capsule { a, b, radius } => radius - distance([u, v], *a, *b),
        }
    }

    /// Returns the share of full coverage that a shape thinner than a pixel can reach.
    fn strength(&self) -> f32 {
        match self {
            Self::Polygon(_) => 1.0,
            // A rod thinner than a pixel covers a part of it; the constant keeps thin rods visible.
            Self::Capsule { radius, .. } => (radius * 2.0 + 0.15).min(1.0),
        }
    }
}

/// Returns the smallest box around both.
pub(super) fn join(a: BBox, b: BBox) -> BBox {
    BBox { x1: a.x1.min(b.x1), y1: a.y1.min(b.y1), x2: a.x2.max(b.x2), y2: a.y2.max(b.y2) }
}

impl Layer {
    /// Makes an empty layer over the part of `bounds` that lies in the image.
    pub(super) fn over(bounds: BBox, height: usize, width: usize) -> Self {
        let cut = |x: f32, end: usize| x.clamp(0.0, end as f32) as usize;
        // The soft edge of a shape reaches a little beyond its bounds.
        let (left, top) = (cut(bounds.x1 - 2.0, width), cut(bounds.y1 - 2.0, height));
        let (right, bottom) = (cut(bounds.x2 + 3.0, width), cut(bounds.y2 + 3.0, height));
        let (width, height) = (right.saturating_sub(left), bottom.saturating_sub(top));
        Self { left, top, width, height, texels: vec![[0.0; 4]; width * height] }
    }

    /// Paints a shape over the layer: `colour` in the middle, a tenth lighter at its upper edge and darker at its
    /// lower one.
    pub(super) fn paint(&mut self, shape: &Silhouette, colour: Rgb) {
        let Some(b) = shape.bounds() else { return };
        let edges = inward_edges(shape);
        let strength = shape.strength();
        // Clipped to this layer, which may be smaller than the shape.
        let window = Self::over(b, self.top + self.height, self.left + self.width);
        let columns = self.left.max(window.left)..window.left + window.width;
        for row in self.top.max(window.top)..window.top + window.height {
            let v = row as f32 + 0.5;
            let tone = 1.0 + 0.2 * (0.5 - ((v - b.y1) / (b.y2 - b.y1).max(1.0)).clamp(0.0, 1.0));
            let lit = scaled(colour, tone);
            for column in columns.clone() {
                let depth = shape.depth(&edges, column as f32 + 0.5, v);
                // The edge is 1.25 px wide, a little more than a pixel, so that thin gaps between parts are closed.
                if depth > -0.75 {
                    let share = ((depth + 0.75) / 1.25).min(1.0) * strength;
                    let at = (row - self.top) * self.width + column - self.left;
                    over(&mut self.texels[at], lit, share);
                }
            }
        }
    }

    /// Returns the box of the pixels with at least half coverage, `None` when there is none.
    pub(super) fn extent(&self) -> Option<BBox> {
        let mut found: Option<BBox> = None;
        for (i, texel) in self.texels.iter().enumerate() {
            if texel[3] >= OWNED {
                let (x, y) = ((self.left + i % self.width) as f32, (self.top + i / self.width) as f32);
                let pixel = BBox { x1: x, y1: y, x2: x + 1.0, y2: y + 1.0 };
                found = Some(found.map_or(pixel, |b| join(b, pixel)));
            }
        }
        found
    }
}

/// Paints `colour` with coverage `share` over a premultiplied texel.
fn over(texel: &mut [f32; 4], colour: Rgb, share: f32) {
    let rest = 1.0 - share;
    let old = [texel[0], texel[1], texel[2]];
    let new = add(scaled(colour, share), scaled(old, rest));
    *texel = [new[0], new[1], new[2], share + texel[3] * rest];
}

/// Returns a line `a u + b v + c` for each edge, whose value is the distance inwards.
fn inward_edges(shape: &Silhouette) -> Vec<[f32; 3]> {
    let Silhouette::Polygon(points) = shape else { return Vec::new() };
    // Both orientations are allowed, so the sign of the area tells on which side of an edge the inside is.
    let sign = if area(points) >= 0.0 { 1.0 } else { -1.0 };
    let next = points.iter().cycle().skip(1);
    points.iter().zip(next).filter_map(|(p, q)| edge(*p, *q, sign)).collect()
}

fn edge(p: [f32; 2], q: [f32; 2], sign: f32) -> Option<[f32; 3]> {
    let (dx, dy) = (q[0] - p[0], q[1] - p[1]);
    let length = (dx * dx + dy * dy).sqrt();
    // Corners that coincide have no edge; their normal would be undefined.
    if length < 1e-4 {
        return None;
    }
    let (a, b) = (-dy * sign / length, dx * sign / length);
    Some([a, b, -(a * p[0] + b * p[1])])
}

/// Returns twice the signed area, positive for clockwise on the screen (y down).
pub(super) fn area(points: &[[f32; 2]]) -> f32 {
    let next = points.iter().cycle().skip(1);
    points.iter().zip(next).map(|(p, q)| p[0] * q[1] - q[0] * p[1]).sum()
}

fn distance(p: [f32; 2], a: [f32; 2], b: [f32; 2]) -> f32 {
    let (dx, dy) = (b[0] - a[0], b[1] - a[1]);
    let (px, py) = (p[0] - a[0], p[1] - a[1]);
    // A capsule with equal ends is a disc, and its direction has no length to divide by.
    let t = ((px * dx + py * dy) / (dx * dx + dy * dy).max(1e-9)).clamp(0.0, 1.0);
    let (ex, ey) = (px - t * dx, py - t * dy);
    (ex * ex + ey * ey).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_square_covers_its_pixels() {
        let square = Silhouette::Polygon(vec![[2.0, 3.0], [8.0, 3.0], [8.0, 7.0], [2.0, 7.0]]);
        let mut layer = Layer::over(square.bounds().unwrap(), 20, 20);
        layer.paint(&square, [1.0; 3]);
        assert_eq!(layer.extent(), Some(BBox { x1: 2.0, y1: 3.0, x2: 8.0, y2: 7.0 }));
    }

    #[test]
    fn either_winding_is_the_same_shape() {
        let points = vec![[2.0, 3.0], [8.0, 4.0], [5.0, 9.0]];
        let paint = |points: Vec<[f32; 2]>| {
            let shape = Silhouette::Polygon(points);
            let mut layer = Layer::over(shape.bounds().unwrap(), 20, 20);
            layer.paint(&shape, [0.5; 3]);
            layer.texels
        };
        let (forth, mut turned) = (paint(points.clone()), points);
        turned.reverse();
        let back = paint(turned);
        assert!(forth.iter().zip(&back).all(|(a, b)| (a[3] - b[3]).abs() < 1e-4));
    }

    #[test]
    fn what_lies_outside_the_image_costs_nothing() {
        let away = BBox { x1: 900.0, y1: -80.0, x2: 950.0, y2: -40.0 };
        let layer = Layer::over(away, 20, 20);
        assert_eq!((layer.texels.len(), layer.extent()), (0, None));
    }
}
