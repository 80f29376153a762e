//! [`GroundTruth`]: a labelled object, and its form as a detection.
//!
//! Evaluation needs to know which objects are hard to see and which areas to leave out; `Detection2D` has no fields for
//! that, so they stand in its `id`.

use modulo_core::{BBox, Detection};
use modulo_msgs::std_msgs::Header;
use modulo_msgs::vision_msgs::{Detection2D, Detection2DArray};

/// [`GroundTruth::occluded`] of a crowd: an area in which the objects of the class are not labelled individually.
pub const CROWD: i32 = 4;

/// One labelled object.
#[derive(Clone, Debug, PartialEq)]
pub struct GroundTruth {
    /// Box in pixels of the original image.
    pub bbox: BBox,
    /// The data set's class in lower case; `dontcare` is an area to leave out.
    pub class: String,
    /// Fraction of the object outside the image, 0 to 1; -1 when it is unknown.
    pub truncated: f32,
    /// 0 fully visible, 1 partly occluded, 2 largely occluded, 3 unknown, [`CROWD`]; -1 when it is unknown.
    pub occluded: i32,
}

impl GroundTruth {
    fn to_detection(&self, header: &Header) -> Detection2D {
        let detection = Detection { bbox: self.bbox, score: 1.0, class: self.class.clone() };
        let id = format!("occluded={} truncated={:.2}", self.occluded, self.truncated);
        Detection2D { id, ..Detection2D::from_detection(&detection, header) }
    }

    fn from_detection(message: &Detection2D) -> Option<Self> {
        let Detection { bbox, class, .. } = message.to_detection()?;
        let field = |key: &str| {
            let fields = message.id.split_whitespace().filter_map(|field| field.split_once('='));
            fields.into_iter().find(|(name, _)| *name == key).map(|(_, value)| value)
        };
        let truncated = field("truncated").and_then(|v| v.parse().ok()).filter(|v: &f32| v.is_finite());
        let occluded = field("occluded").and_then(|v| v.parse().ok());
        Some(Self { bbox, class, truncated: truncated.unwrap_or(-1.0), occluded: occluded.unwrap_or(-1) })
    }
}

/// Returns the labels of one image as a message with that image's header; class and box as in a detection of score 1,
/// the rest in `id` as `occluded=1 truncated=0.00`.
pub fn to_detections(labels: &[GroundTruth], header: &Header) -> Detection2DArray {
    let detections = labels.iter().map(|label| label.to_detection(header)).collect();
    Detection2DArray { header: header.clone(), detections }
}

/// Returns the labels in a message. An `id` without occlusion or truncation leaves these at -1; a detection without
/// class or with a rotated box is no label.
pub fn from_detections(message: &Detection2DArray) -> Vec<GroundTruth> {
    message.detections.iter().filter_map(GroundTruth::from_detection).collect()
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn label() -> impl Strategy<Value = GroundTruth> {
        // KITTI writes two decimals.
        let number = |range: std::ops::Range<i32>| range.prop_map(|n| n as f32 / 100.0);
        let edges = (number(0..200_000), number(0..60_000), number(0..90_000), number(0..90_000));
        (edges, "[a-z_]{1,12}", number(-100..101), -1..4).prop_map(
            |((x, y, w, h), class, truncated, occluded)| {
                let bbox = BBox { x1: x, y1: y, x2: x + w, y2: y + h };
                GroundTruth { bbox, class, truncated, occluded }
            },
        )
    }

    proptest! {
        #[test]
        fn labels_return(labels in proptest::collection::vec(label(), 0..4)) {
            let header = Header::default();
            prop_assert_eq!(from_detections(&to_detections(&labels, &header)), labels);
        }
    }

    #[test]
    fn an_untold_occlusion_is_minus_one() {
        let label = GroundTruth { bbox: BBox::default(), class: "car".into(), truncated: 0.5, occluded: 2 };
        let mut message = to_detections(&[label], &Header::default());
        assert_eq!(message.detections[0].id, "occluded=2 truncated=0.50");
        message.detections[0].id = "truncated=NaN".into();
        let labels = from_detections(&message);
        assert_eq!((labels[0].truncated, labels[0].occluded), (-1.0, -1));
    }
}
