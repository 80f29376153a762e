//! Boxes and labels as rows of numbers in JSON, which take a third of the room of objects with named fields.

use modulo_bags::source::GroundTruth;
use modulo_core::{BBox, Detection};
use serde::{Deserialize, Deserializer, Serialize, Serializer};

fn corners(b: BBox) -> [f32; 4] {
    [b.x1, b.y1, b.x2, b.y2]
}

fn bbox([x1, y1, x2, y2]: [f32; 4]) -> BBox {
    BBox { x1, y1, x2, y2 }
}

/// `[[x1, y1, x2, y2], class, truncated, occluded]`.
pub mod labels {
    use super::*;

    type Row = ([f32; 4], String, f32, i32);

    pub fn serialize<S: Serializer>(labels: &Option<Vec<GroundTruth>>, to: S) -> Result<S::Ok, S::Error> {
        let row = |one: &GroundTruth| (corners(one.bbox), one.class.clone(), one.truncated, one.occluded);
        labels.as_ref().map(|labels| labels.iter().map(row).collect::<Vec<Row>>()).serialize(to)
    }

    pub fn deserialize<'de, D: Deserializer<'de>>(from: D) -> Result<Option<Vec<GroundTruth>>, D::Error> {
        let label =
            |(b, class, truncated, occluded): Row| GroundTruth { bbox: bbox(b), class, truncated, occluded };
        let rows = Option::<Vec<Row>>::deserialize(from)?;
        Ok(rows.map(|rows| rows.into_iter().map(label).collect()))
    }
}

/// `[[x1, y1, x2, y2], score, class]`.
pub mod boxes {
    use super::*;

    type Row = ([f32; 4], f32, String);

    pub fn serialize<S: Serializer>(boxes: &Option<Vec<Detection>>, to: S) -> Result<S::Ok, S::Error> {
        let row = |one: &Detection| (corners(one.bbox), one.score, one.class.clone());
        boxes.as_ref().map(|boxes| boxes.iter().map(row).collect::<Vec<Row>>()).serialize(to)
    }

    pub fn deserialize<'de, D: Deserializer<'de>>(from: D) -> Result<Option<Vec<Detection>>, D::Error> {
        let detection = |(b, score, class): Row| Detection { bbox: bbox(b), score, class };
        let rows = Option::<Vec<Row>>::deserialize(from)?;
        Ok(rows.map(|rows| rows.into_iter().map(detection).collect()))
    }
}
