//! Conversion between [`Detection2D`], whose box has a centre and a size, and [`Detection`], whose box has edges.

use modulo_core::{BBox, Detection};

use crate::std_msgs::Header;
use crate::vision_msgs::{
    BoundingBox2D, Detection2D, ObjectHypothesis, ObjectHypothesisWithPose, Point2D, Pose2D,
};

impl From<BBox> for BoundingBox2D {
    /// Computes centre and size in `f64`, so that the edges of a box return bit for bit.
    fn from(bbox: BBox) -> Self {
        let [x1, y1, x2, y2] = [bbox.x1, bbox.y1, bbox.x2, bbox.y2].map(f64::from);
        let position = Point2D { x: (x1 + x2) / 2.0, y: (y1 + y2) / 2.0 };
        Self { center: Pose2D { position, theta: 0.0 }, size_x: x2 - x1, size_y: y2 - y1 }
    }
}

impl BoundingBox2D {
    /// Returns the box by its edges. `None` when it is rotated, has a negative size, or is not finite.
    pub fn to_bbox(&self) -> Option<BBox> {
        let Self { center: Pose2D { position: Point2D { x, y }, theta }, size_x, size_y } = *self;
        let edges = [x - size_x / 2.0, y - size_y / 2.0, x + size_x / 2.0, y + size_y / 2.0];
        let [x1, y1, x2, y2] = edges.map(|edge| edge as f32);
        // The edges are checked after the conversion to `f32`, in which a large `f64` becomes infinite. The suite has
        // no rotated boxes: dropping the angle would give a box around another area.
        let finite = [x1, y1, x2, y2].iter().all(|edge| edge.is_finite());
        let upright = theta == 0.0 && size_x >= 0.0 && size_y >= 0.0;
        (finite && upright).then_some(BBox { x1, y1, x2, y2 })
    }
}

impl Detection2D {
    /// The message of `detection` in the image of `header`. Its `id` is empty, because the object is not tracked.
    pub fn from_detection(detection: &Detection, header: &Header) -> Self {
        let hypothesis =
            ObjectHypothesis { class_id: detection.class.clone(), score: f64::from(detection.score) };
        Self {
            header: header.clone(),
            results: vec![ObjectHypothesisWithPose { hypothesis, ..Default::default() }],
            bbox: detection.bbox.into(),
            id: String::new(),
        }
    }

    /// Returns the box with its likeliest class. `None` without a class, and for a box that [`BoundingBox2D::to_bbox`]
    /// refuses.
    pub fn to_detection(&self) -> Option<Detection> {
        let likeliest = self
            .results
            .iter()
            .map(|result| &result.hypothesis)
            .max_by(|a, b| a.score.total_cmp(&b.score))?;
        Some(Detection {
            bbox: self.bbox.to_bbox()?,
            score: likeliest.score as f32,
            class: likeliest.class_id.clone(),
        })
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn bbox() -> impl Strategy<Value = BBox> {
        // Edges of real detectors: fractions of a pixel, also a little outside.
        let edge = || (-100_f32..10_000.0).prop_map(|edge| edge + 0.0);
        (edge(), edge(), edge(), edge()).prop_map(|(a, b, c, d)| BBox {
            x1: a.min(c),
            y1: b.min(d),
            x2: a.max(c),
            y2: b.max(d),
        })
    }

    proptest! {
        #[test]
        fn a_detection_returns_bit_for_bit(bbox in bbox(), score in 0_f32..=1.0, class in "\\PC{0,12}") {
            let detection = Detection { bbox, score, class };
            let header = Header { frame_id: "camera".into(), ..Default::default() };
            let message = Detection2D::from_detection(&detection, &header);
            prop_assert_eq!(&message.header, &header);
            prop_assert_eq!(message.id.as_str(), "");
            prop_assert_eq!(message.to_detection(), Some(detection));
        }
    }

    #[test]
    fn takes_the_likeliest_class() {
        let detection = Detection { bbox: BBox::default(), score: 0.25, class: "van".into() };
        let mut message = Detection2D::from_detection(&detection, &Header::default());
        let mut other = message.results[0].clone();
        other.hypothesis = ObjectHypothesis { class_id: "car".into(), score: 0.75 };
        message.results.push(other);
        assert_eq!(message.to_detection().map(|d| (d.class, d.score)), Some(("car".into(), 0.75)));
    }

    #[test]
    fn refuses_what_is_no_upright_box() {
        let detection = Detection { bbox: BBox::default(), score: 0.5, class: "car".into() };
        let good = Detection2D::from_detection(&detection, &Header::default());
        assert!(good.to_detection().is_some());
        let spoil: [fn(&mut Detection2D); 5] = [
            |d| d.results.clear(),
            |d| d.bbox.center.theta = 0.1,
            |d| d.bbox.size_x = -1.0,
            |d| d.bbox.center.position.y = f64::NAN,
            |d| d.bbox.size_y = 1e300,
        ];
        for (i, spoil) in spoil.iter().enumerate() {
            let mut bad = good.clone();
            spoil(&mut bad);
            assert_eq!(bad.to_detection(), None, "case {i}");
        }
    }
}
