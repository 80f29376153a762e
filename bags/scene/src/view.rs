//! The pinhole camera of a scene: it projects metres to pixels.
//!
//! The axes of the world are x to the right, y up from the road and z ahead, in metres; the camera is above the origin.

use super::hash::{Random, wave};

/// A point in the world in m.
pub(super) type Point = [f32; 3];

/// The near plane in m: nothing nearer is drawn.
pub(super) const NEAR: f32 = 0.6;

/// The height of the camera above the road in m.
pub(super) const CAMERA_HEIGHT: f32 = 1.6;

/// The direction of the camera and the size of its image.
#[derive(Clone, Copy, Debug)]
pub(super) struct CameraView {
    pub(super) width: usize,
    pub(super) height: usize,
    /// The focal length in px.
    pub(super) focal: f32,
    /// The column of the vanishing point in px.
    pub(super) cx: f32,
    /// The row of the horizon in px.
    pub(super) cy: f32,
}

impl CameraView {
    /// Makes the view of one frame: the vanishing point sways by a few pixels, as in a car.
    pub(super) fn new(seed: u32, frame: u32, height: usize, width: usize) -> Self {
        let mut random = Random::new(seed, 1);
        let (w, h) = (width as f32, height as f32);
        let time = (frame % 36_000) as f32;
        // Two periods whose common multiple is long, so that the sway does not repeat visibly.
        let yaw = random.between(-0.07, 0.07) + 0.012 * wave(time / 211.0 + random.unit());
        let pitch = random.between(-0.02, 0.02) + 0.003 * wave(time / 37.0);
        Self { width, height, focal: 0.58 * w, cx: w * (0.5 + yaw), cy: h * 0.46 + w * pitch * 0.5 }
    }

    /// Returns the scale to a design width of 640 px, for which the sizes of lamps and halos are given.
    pub(super) fn scale(&self) -> f32 {
        self.width as f32 / 640.0
    }

    /// Returns the image position in px of a point with `z >= NEAR`.
    pub(super) fn project(&self, [x, y, z]: Point) -> [f32; 2] {
        // Points are clipped before; the bound only keeps the division safe.
        let s = self.focal / z.max(NEAR);
        [self.cx + s * x, self.cy - s * (y - CAMERA_HEIGHT)]
    }
}

/// Returns the part of a convex polygon that is at least [`NEAR`] away, which may be empty.
pub(super) fn clip_near(points: &[Point]) -> Vec<Point> {
    let mut kept = Vec::with_capacity(points.len() + 1);
    for (i, &a) in points.iter().enumerate() {
        let b = points[(i + 1) % points.len()];
        if a[2] >= NEAR {
            kept.push(a);
        }
        if (a[2] >= NEAR) != (b[2] >= NEAR) {
            // The ends lie on different sides of the plane, so the divisor is not 0.
            let t = (NEAR - a[2]) / (b[2] - a[2]);
            kept.push([a[0] + t * (b[0] - a[0]), a[1] + t * (b[1] - a[1]), NEAR]);
        }
    }
    kept
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_horizon_is_at_eye_height() {
        let view = CameraView::new(5, 0, 192, 640);
        assert_eq!(view.project([0.0, CAMERA_HEIGHT, 30.0]), [view.cx, view.cy]);
        assert!(view.project([1.0, 0.0, 10.0])[1] > view.cy, "the road lies below the horizon");
    }

    #[test]
    fn clipping_keeps_what_is_ahead() {
        let square = [[0.0, 0.0, -1.0], [1.0, 0.0, -1.0], [1.0, 0.0, 3.0], [0.0, 0.0, 3.0]];
        let kept = clip_near(&square);
        assert_eq!(kept.len(), 4);
        assert!(kept.iter().all(|p| p[2] >= NEAR));
        assert!(clip_near(&square.map(|[x, y, z]| [x, y, z - 9.0])).is_empty());
    }
}
