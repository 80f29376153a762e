//! Fits an image into the input of a network: one scale for both sides, padding around it.

use crate::boxes::BBox;

/// The position of the image in its target.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum Align {
    /// The padding is on all sides; an odd pixel goes to the right or below.
    #[default]
    Centre,
    /// The padding is only right and below.
    TopLeft,
}

/// Whether a small image is enlarged.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum Scaling {
    /// The image gets the largest size that fits.
    #[default]
    Fit,
    /// Fits the image like `Fit`, but never enlarges it.
    ShrinkOnly,
}

/// The position of an image of one size in a target of another size.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Letterbox {
    source: (usize, usize),
    inner: (usize, usize),
    corner: (usize, usize),
}

/// Error: a side has no pixel.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("letterbox of {0:?} into {1:?} (height, width): every side needs at least 1 pixel")]
pub struct LetterboxError(pub (usize, usize), pub (usize, usize));

impl Letterbox {
    /// Fits an image of the size `source` into `target`, both (height, width) in px.
    ///
    /// # Errors
    /// [`LetterboxError`] when a side is 0.
    pub fn new(
        source: (usize, usize),
        target: (usize, usize),
        align: Align,
        scaling: Scaling,
    ) -> Result<Self, LetterboxError> {
        if [source.0, source.1, target.0, target.1].contains(&0) {
            return Err(LetterboxError(source, target));
        }
        // The same scale for both sides keeps the proportions that the network was trained with.
        let fit = (target.0 as f64 / source.0 as f64).min(target.1 as f64 / source.1 as f64);
        let scale = match scaling {
            Scaling::Fit => fit,
            Scaling::ShrinkOnly => fit.min(1.0),
        };
        // An image of extreme proportions still gets one pixel, and rounding never exceeds the target.
        let side = |source: usize, target: usize| ((source as f64 * scale).round() as usize).clamp(1, target);
        let inner = (side(source.0, target.0), side(source.1, target.1));
        let corner = match align {
            Align::Centre => ((target.0 - inner.0) / 2, (target.1 - inner.1) / 2),
            Align::TopLeft => (0, 0),
        };
        Ok(Self { source, inner, corner })
    }

    /// Returns (height, width) of the resized image, in px of the target.
    pub fn inner(&self) -> (usize, usize) {
        self.inner
    }

    /// Returns (top, left) of the resized image, in px of the target.
    pub fn corner(&self) -> (usize, usize) {
        self.corner
    }

    /// Returns the (vertical, horizontal) scale; sides are whole pixels, so the two differ a little.
    pub fn scale(&self) -> (f32, f32) {
        (self.inner.0 as f32 / self.source.0 as f32, self.inner.1 as f32 / self.source.1 as f32)
    }

    /// Converts from pixels of the image to pixels of the target.
    pub fn forward(&self, bbox: BBox) -> BBox {
        let (sy, sx) = self.scale();
        let (top, left) = (self.corner.0 as f32, self.corner.1 as f32);
        BBox {
            x1: bbox.x1 * sx + left,
            y1: bbox.y1 * sy + top,
            x2: bbox.x2 * sx + left,
            y2: bbox.y2 * sy + top,
        }
    }

    /// Converts from pixels of the target to pixels of the image, clamped to the image.
    pub fn inverse(&self, bbox: BBox) -> BBox {
        let (sy, sx) = self.scale();
        let (top, left) = (self.corner.0 as f32, self.corner.1 as f32);
        let (x1, x2) = ((bbox.x1 - left) / sx, (bbox.x2 - left) / sx);
        // A detection may reach into the padding, where the image has no pixel.
        BBox { x1, y1: (bbox.y1 - top) / sy, x2, y2: (bbox.y2 - top) / sy }
            .clamp(self.source.0, self.source.1)
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn a_wide_frame_in_a_square() {
        let centred = Letterbox::new((375, 1242), (640, 640), Align::Centre, Scaling::Fit).unwrap();
        assert_eq!((centred.inner(), centred.corner()), ((193, 640), (223, 0)));
        let corner = Letterbox::new((375, 1242), (640, 640), Align::TopLeft, Scaling::Fit).unwrap();
        assert_eq!((corner.inner(), corner.corner()), ((193, 640), (0, 0)));
        let small = Letterbox::new((100, 200), (640, 640), Align::Centre, Scaling::ShrinkOnly).unwrap();
        assert_eq!((small.inner(), small.corner()), ((100, 200), (270, 220)));
        assert!(Letterbox::new((0, 2), (640, 640), Align::Centre, Scaling::Fit).is_err());
    }

    fn side() -> impl Strategy<Value = usize> {
        1usize..3000
    }

    proptest! {
        #[test]
        fn inverse_undoes_forward(
            source in (side(), side()),
            target in (side(), side()),
            corners in [0f32..=1.0, 0f32..=1.0, 0f32..=1.0, 0f32..=1.0],
            align in prop_oneof![Just(Align::Centre), Just(Align::TopLeft)],
            scaling in prop_oneof![Just(Scaling::Fit), Just(Scaling::ShrinkOnly)],
        ) {
            let letterbox = Letterbox::new(source, target, align, scaling).unwrap();
            let (h, w) = (source.0 as f32, source.1 as f32);
            let [a, b, c, d] = corners;
            let bbox = BBox { x1: a.min(b) * w, y1: c.min(d) * h, x2: a.max(b) * w, y2: c.max(d) * h };
            let there = letterbox.forward(bbox);
            prop_assert!(there.x1 >= 0.0 && there.x2 <= target.1 as f32 + 1e-3, "{there:?}");
            prop_assert!(there.y1 >= 0.0 && there.y2 <= target.0 as f32 + 1e-3, "{there:?}");
            let back = letterbox.inverse(there);
            // One rounding step of the target, seen from the image.
            let (sy, sx) = letterbox.scale();
            let (tx, ty) = (1e-3 + 1e-3 / sx, 1e-3 + 1e-3 / sy);
            prop_assert!((back.x1 - bbox.x1).abs() < tx && (back.x2 - bbox.x2).abs() < tx, "{bbox:?} {back:?}");
            prop_assert!((back.y1 - bbox.y1).abs() < ty && (back.y2 - bbox.y2).abs() < ty, "{bbox:?} {back:?}");
        }

        #[test]
        fn inverse_stays_in_the_image(source in (side(), side()), values in [-1e5f32..1e5, -1e5f32..1e5]) {
            let letterbox = Letterbox::new(source, (640, 640), Align::Centre, Scaling::Fit).unwrap();
            let [low, high] = values;
            let back = letterbox.inverse(BBox { x1: low, y1: low, x2: high, y2: high });
            for (value, most) in [(back.x1, source.1), (back.x2, source.1), (back.y1, source.0), (back.y2, source.0)] {
                prop_assert!((0.0..=most as f32).contains(&value));
            }
        }
    }
}
