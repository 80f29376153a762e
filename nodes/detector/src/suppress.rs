//! Non-maximum suppression: one box an object.

use crate::candidates::Candidate;

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
    use modulo_core::BBox;
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
