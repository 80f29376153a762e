//! Boxes in image pixels.
//!
//! Coordinates are continuous: pixel (0, 0) covers `[0, 1) x [0, 1)`, so a box
//! over a whole image is `(0, 0, width, height)`.

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

/// One object that a detector saw.
#[derive(Clone, Debug, PartialEq)]
pub struct Detection {
    /// Where, in pixels of the original image.
    pub bbox: BBox,
    /// Confidence in `[0, 1]`.
    pub score: f32,
    /// Class name, as the model or the class map calls it.
    pub class: String,
}
