//! The boxes that a network proposes, and non-maximum suppression: one box an object.

use ndarray::ArrayRef2;

use crate::boxes::BBox;
use crate::simd::widest;

/// A box with its score and its best class.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Candidate {
    /// The box, in px.
    pub bbox: BBox,
    /// Confidence in this class.
    pub score: f32,
    /// Index of the class.
    pub class: usize,
}

/// Returns a candidate for each column of an array of 4 + C rows whose best score is at least `least`: centre, width and height, then the scores
/// of C classes. Of classes with the same score, the first one counts; a score that is NaN does not.
pub fn of_columns(columns: &ArrayRef2<f32>, least: f32) -> Vec<Candidate> {
    let (values, count) = (columns.as_standard_layout(), columns.ncols());
    let values = values.as_slice().expect("it has the standard layout");
    let Some((boxes, scores)) = values.split_at_checked(4 * count).filter(|_| count > 0) else {
        return Vec::new();
    };
    let (mut best, mut classes) = (vec![f32::NEG_INFINITY; count], vec![0_u32; count]);
    // The scores are read once and in the order of the memory: those of one class in all columns, then those of the next one.
    widest!(for (class, scores) in (0..).zip(scores.chunks_exact(count)) {
        for ((&score, best), best_class) in scores.iter().zip(&mut best).zip(&mut classes) {
            let is_better = score > *best;
            *best_class = if is_better { class } else { *best_class };
            *best = if is_better { score } else { *best };
        }
    });
    let candidate = |(at, (score, class)): (usize, (f32, u32))| {
        let [cx, cy, width, height] = [0, 1, 2, 3].map(|row| boxes[row * count + at]);
        let bbox = BBox::from_centre((cx, cy), (width, height));
        Candidate { bbox, score, class: class as usize }
    };
    let all = best.into_iter().zip(classes).enumerate();
    all.filter(|(_, (score, _))| *score >= least).map(candidate).collect()
}

/// The most candidates that are compared, as ultralytics has it: those with the best scores.
const MOST: usize = 30_000;

/// Returns the candidates, best first, without those that overlap a better one of their class by an intersection over union of more than
/// `most_iou`; at most `most_kept`.
pub fn suppress(mut candidates: Vec<Candidate>, most_iou: f32, most_kept: usize) -> Vec<Candidate> {
    candidates.sort_by(|a, b| b.score.total_cmp(&a.score));
    candidates.truncate(MOST);
    let mut kept: Vec<Candidate> = Vec::new();
    for one in candidates {
        let hides = |better: &Candidate| better.class == one.class && better.bbox.iou(one.bbox) > most_iou;
        if !kept.iter().any(hides) {
            kept.push(one);
            if kept.len() == most_kept {
                break;
            }
        }
    }
    kept
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn candidate(x: f32, score: f32, class: usize) -> Candidate {
        Candidate { bbox: BBox { x1: x, y1: 0.0, x2: x + 10.0, y2: 10.0 }, score, class }
    }

    #[test]
    fn a_worse_box_of_the_same_class_is_removed() {
        let (best, copy, person) = (candidate(0.0, 0.9, 2), candidate(1.0, 0.8, 2), candidate(1.0, 0.7, 0));
        let next = candidate(2.0, 0.6, 2);
        let all = vec![next, person, copy, best];
        // The intersections over union with the best one are 9 / 11 and 8 / 12.
        assert_eq!(suppress(all.clone(), 0.7, 300), [best, person, next]);
        assert_eq!(suppress(all.clone(), 0.9, 300), [best, copy, person, next]);
        assert_eq!(suppress(all.clone(), 0.0, 300), [best, person]);
        assert_eq!(suppress(all, 0.7, 2), [best, person]);
        let half = candidate(5.0, 0.5, 2);
        assert_eq!(suppress(vec![best, half], 5.0 / 15.0, 300), [best, half], "as large as allowed");
    }

    #[test]
    fn many_candidates_cost_no_more_than_those_that_are_kept() {
        let all: Vec<_> =
            (0..200_000).map(|i| candidate(i as f32 * 20.0, 1.0 - i as f32 * 1e-6, 0)).collect();
        assert_eq!(suppress(all.clone(), 0.7, 1000), all[..1000]);
    }

    proptest! {
        /// The definition: a box stays unless a better one stays that overlaps it too much.
        #[test]
        fn what_stays_is_as_defined(
            boxes in prop::collection::vec((0f32..40.0, 0f32..1.0, 0usize..3), 0..40),
            most_iou in 0f32..1.0,
        ) {
            let all: Vec<_> = boxes.into_iter().map(|(x, score, class)| candidate(x, score, class)).collect();
            let kept = suppress(all.clone(), most_iou, usize::MAX);
            prop_assert!(kept.is_sorted_by(|a, b| a.score >= b.score));
            let overlaps = |a: &Candidate, b: &Candidate| a.class == b.class && a.bbox.iou(b.bbox) > most_iou;
            for one in &all {
                let is_hidden = kept.iter().any(|better| better.score >= one.score && overlaps(better, one) && better != one);
                prop_assert_eq!(kept.contains(one), !is_hidden);
            }
        }
    }
}
