//! Scores of detections.

use std::collections::BTreeMap;

use modulo_ap::Difficulty;
use modulo_ap::average::{self, ScoredFrame, ap, ap50_95};
use modulo_ap::matching::ImageBoxes;
use modulo_bags::source::GroundTruth;
use modulo_core::{BBox, Detection};
use pyo3::prelude::*;

use crate::image::value_error;

/// The edges of a box, its score and its class.
pub type Found = (f32, f32, f32, f32, f32, String);

/// The edges of a box, its class, and its truncation and occlusion.
pub type Object = (f32, f32, f32, f32, String, f32, i32);

/// Returns AP50, AP50:95 and the number of scored objects of each class.
#[pyfunction]
pub fn average_precision(
    py: Python<'_>,
    frames: Vec<(Vec<Found>, Vec<Object>)>,
    difficulty: &str,
) -> PyResult<BTreeMap<String, (f64, f64, usize)>> {
    let given = Difficulty::WORDS.into_iter().find(|(word, _)| *word == difficulty);
    let (_, difficulty) = given.ok_or_else(|| {
        let words = Difficulty::WORDS.map(|(word, _)| word);
        value_error(format!("difficulty is {difficulty:?}, possible are {}", words.join(", ")))
    })?;
    let frames: Vec<ScoredFrame> = frames.into_iter().map(scored_frame).collect::<PyResult<_>>()?;
    Ok(py.detach(|| by_class(&frames, difficulty)))
}

fn by_class(frames: &[ScoredFrame], difficulty: Difficulty) -> BTreeMap<String, (f64, f64, usize)> {
    let score = |(class, images): (String, Vec<ImageBoxes>)| {
        let objects = images.iter().map(ImageBoxes::objects).sum();
        Some((class, (ap(&images, 0.5)?, ap50_95(&images)?, objects)))
    };
    average::by_class(frames, difficulty).into_iter().filter_map(score).collect()
}

fn scored_frame((found, truth): (Vec<Found>, Vec<Object>)) -> PyResult<ScoredFrame> {
    let found = found.into_iter().map(|(x1, y1, x2, y2, score, class)| {
        let bbox = bounded([x1, y1, x2, y2])?;
        if !(0.0..=1.0).contains(&score) {
            return Err(value_error(format!("score is {score}, 0 to 1 is possible")));
        }
        Ok(Detection { bbox, score, class })
    });
    let truth = truth.into_iter().map(|(x1, y1, x2, y2, class, truncated, occluded)| {
        Ok(GroundTruth { bbox: bounded([x1, y1, x2, y2])?, class, truncated, occluded })
    });
    Ok((found.collect::<PyResult<_>>()?, truth.collect::<PyResult<_>>()?))
}

fn bounded([x1, y1, x2, y2]: [f32; 4]) -> PyResult<BBox> {
    // NaN is refused, too.
    if [x1, y1, x2, y2].iter().all(|edge| edge.is_finite()) && x1 <= x2 && y1 <= y2 {
        return Ok(BBox { x1, y1, x2, y2 });
    }
    Err(value_error(format!(
        "box is ({x1}, {y1}, {x2}, {y2}), finite numbers x1 <= x2 and y1 <= y2 are needed (x1, y1, x2, y2 in px)"
    )))
}
