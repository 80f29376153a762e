//! Boxes and detections in the coordinates of the image, in pixels.
//!
//! Coordinates are continuous: pixel (0, 0) covers `[0, 1) x [0, 1)`, so a box over a whole image is `(0, 0,
//! width, height)`.

/// An axis-aligned box, `x1 <= x2`, `y1 <= y2`, in pixels of the original image.
#[derive(Clone, Copy, Debug, PartialEq, Default)]
pub struct BBox {
    /// Left edge, px.
    pub x1: f32,
    /// Top edge, px.
    pub y1: f32,
    /// Right edge, px.
    pub x2: f32,
    /// Bottom edge, px.
    pub y2: f32,
}

/// One object that a detector has found.
#[derive(Clone, Debug, PartialEq)]
pub struct Detection {
    /// The box around the object, in pixels of the original image.
    pub bbox: BBox,
    /// Confidence in `[0, 1]`.
    pub score: f32,
    /// The name of the class, as in the model or in the class map.
    pub class: String,
}

impl BBox {
    /// Returns the box with this centre and size, in px.
    pub fn from_centre((cx, cy): (f32, f32), (width, height): (f32, f32)) -> Self {
        Self { x1: cx - width / 2.0, y1: cy - height / 2.0, x2: cx + width / 2.0, y2: cy + height / 2.0 }
    }

    /// Returns (width, height) in px; a side whose ends are swapped or NaN counts as 0.
    pub fn size(self) -> (f32, f32) {
        ((self.x2 - self.x1).max(0.0), (self.y2 - self.y1).max(0.0))
    }

    /// Returns the area in square pixels.
    pub fn area(self) -> f32 {
        let (width, height) = self.size();
        width * height
    }

    /// Returns the area of the intersection of both boxes in square pixels.
    pub fn intersection(self, other: Self) -> f32 {
        let (x1, y1) = (self.x1.max(other.x1), self.y1.max(other.y1));
        Self { x1, y1, x2: self.x2.min(other.x2), y2: self.y2.min(other.y2) }.area()
    }

    /// Returns the intersection over union in [0, 1]; it is 0 when both boxes are empty.
    pub fn iou(self, other: Self) -> f32 {
        let intersection = self.intersection(other);
        let union = self.area() + other.area() - intersection;
        // Two empty boxes have no union to divide by, and rounding may lift the quotient slightly above 1.
        if union > 0.0 { (intersection / union).min(1.0) } else { 0.0 }
    }

    /// Returns the part of the box inside an image of `height` x `width` pixels; a box outside shrinks onto its edge.
    pub fn clamp(self, height: usize, width: usize) -> Self {
        let (right, bottom) = (width as f32, height as f32);
        Self {
            x1: self.x1.clamp(0.0, right),
            y1: self.y1.clamp(0.0, bottom),
            x2: self.x2.clamp(0.0, right),
            y2: self.y2.clamp(0.0, bottom),
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn any_box() -> impl Strategy<Value = BBox> {
        let side = -50f32..150.0;
        (side.clone(), side.clone(), side.clone(), side).prop_map(|(a, b, c, d)| BBox {
            x1: a.min(b),
            y1: c.min(d),
            x2: a.max(b),
            y2: c.max(d),
        })
    }

    proptest! {
        #[test]
        fn iou_is_symmetric_and_a_share(a in any_box(), b in any_box()) {
            prop_assert_eq!(a.iou(b), b.iou(a));
            prop_assert!((0.0..=1.0).contains(&a.iou(b)));
            prop_assert!(a.area() == 0.0 || (a.iou(a) - 1.0).abs() < 1e-6);
        }

        #[test]
        fn centre_and_size_rebuild_the_box(a in any_box()) {
            let centre = ((a.x1 + a.x2) / 2.0, (a.y1 + a.y2) / 2.0);
            let b = BBox::from_centre(centre, a.size());
            for (a, b) in [(a.x1, b.x1), (a.y1, b.y1), (a.x2, b.x2), (a.y2, b.y2)] {
                prop_assert!((a - b).abs() < 1e-4);
            }
        }

        #[test]
        fn clamp_is_the_intersection_with_the_image(a in any_box(), h in 1usize..100, w in 1usize..100) {
            let image = BBox { x1: 0.0, y1: 0.0, x2: w as f32, y2: h as f32 };
            let inside = a.clamp(h, w);
            prop_assert_eq!(inside.area(), a.intersection(image));
            prop_assert_eq!(inside, inside.clamp(h, w));
        }
    }

    #[test]
    fn iou_of_known_boxes() {
        let a = BBox { x1: 0.0, y1: 0.0, x2: 10.0, y2: 10.0 };
        let b = BBox { x1: 5.0, y1: 0.0, x2: 15.0, y2: 10.0 };
        assert_eq!((a.intersection(b), a.iou(b)), (50.0, 50.0 / 150.0));
        assert_eq!((a.iou(BBox { x1: 10.0, ..b }), BBox::default().iou(BBox::default())), (0.0, 0.0));
    }
}
