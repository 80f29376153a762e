//! The boxes in the output of a model, whatever its form, before the removal of overlapping ones.

use modulo_core::BBox;
use modulo_core::candidates::{Candidate, of_columns};
use ndarray::{Array2, ArrayView1, ArrayView2};

use crate::head::Head;
use crate::names::MOST_CLASS;

impl Head {
    /// Returns the boxes with an area whose best class has a score of at least `least`, in the order of the output.
    pub fn candidates(self, output: &Array2<f32>, least: f32) -> Vec<Candidate> {
        let rows = output.rows().into_iter();
        let mut found: Vec<_> = match self {
            Self::EndToEnd => rows.filter(|row| row[4] >= least).filter_map(finished).collect(),
            Self::Columns { .. } => of_columns(output, least),
            Self::Rows { .. } => rows.filter(|row| row[4] >= least).map(of_row).collect(),
        };
        found.retain(|Candidate { bbox: BBox { x1, y1, x2, y2 }, score, .. }| {
            *score >= least
                && x1 < x2
                && y1 < y2
                && [x1, y1, x2, y2, score].iter().all(|value| value.is_finite())
        });
        found
    }

    /// Returns the output with a box and its scores in each row.
    pub fn by_box(self, output: &Array2<f32>) -> ArrayView2<'_, f32> {
        match self {
            Self::EndToEnd | Self::Rows { .. } => output.view(),
            Self::Columns { .. } => output.t(),
        }
    }
}

fn finished(row: ArrayView1<'_, f32>) -> Option<Candidate> {
    let class = Some(row[5].round()).filter(|class| (0.0..=MOST_CLASS as f32).contains(class))?;
    let bbox = BBox { x1: row[0], y1: row[1], x2: row[2], y2: row[3] };
    Some(Candidate { bbox, score: row[4], class: class as usize })
}

fn of_row(row: ArrayView1<'_, f32>) -> Candidate {
    let (mut score, mut class) = (f32::NEG_INFINITY, 0);
    for (index, &other) in row.iter().skip(5).enumerate() {
        if other > score {
            (score, class) = (other, index);
        }
    }
    let bbox = BBox::from_centre((row[0], row[1]), (row[2], row[3]));
    Candidate { bbox, score: row[4] * score, class }
}

#[cfg(test)]
mod tests {
    use ndarray::{Axis, concatenate};
    use proptest::prelude::*;

    use super::*;

    /// The definition, one anchor at a time.
    fn naive(
        boxes: &Array2<f32>,
        objectness: Option<&[f32]>,
        scores: &Array2<f32>,
        least: f32,
    ) -> Vec<Candidate> {
        let mut found = Vec::new();
        for anchor in 0..boxes.nrows() {
            let score = |class: usize| scores[[anchor, class]];
            let class =
                (0..scores.ncols()).rev().max_by(|&a, &b| score(a).total_cmp(&score(b))).expect("a class");
            let score = objectness.map_or(1.0, |objectness| objectness[anchor]) * score(class);
            let [cx, cy, width, height] = [0, 1, 2, 3].map(|side| boxes[[anchor, side]]);
            let bbox = BBox::from_centre((cx, cy), (width, height));
            if score >= least && bbox.x1 < bbox.x2 && bbox.y1 < bbox.y2 {
                found.push(Candidate { bbox, score, class });
            }
        }
        found
    }

    proptest! {
        #[test]
        fn both_raw_forms_are_read_as_defined(
            (anchors, classes) in (0usize..20, 1usize..6),
            seed in any::<u32>(),
            least in 0f32..1.0,
        ) {
            let mut random = seed;
            let mut next = || {
                random = random.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                // Few levels, so that classes often have the same score.
                (random >> 29) as f32 / 8.0
            };
            let boxes = Array2::from_shape_simple_fn((anchors, 4), || 40.0 * next() - 5.0);
            let objectness = Array2::from_shape_simple_fn((anchors, 1), &mut next);
            let scores = Array2::from_shape_simple_fn((anchors, classes), &mut next);
            let columns = concatenate![Axis(1), boxes, scores].t().as_standard_layout().into_owned();
            let found = Head::Columns { classes }.candidates(&columns, least);
            prop_assert_eq!(found, naive(&boxes, None, &scores, least));
            let rows = concatenate![Axis(1), boxes, objectness, scores];
            let found = Head::Rows { classes }.candidates(&rows, least);
            let objectness = objectness.as_slice().expect("contiguous");
            prop_assert_eq!(found, naive(&boxes, Some(objectness), &scores, least));
        }

        /// No value of a model leads to a box without an area, or to a score below the threshold.
        #[test]
        fn any_output_gives_boxes(values in prop::collection::vec(any::<f32>(), 48), least in 0f32..1.0) {
            for (head, sides) in
                [(Head::EndToEnd, (8, 6)), (Head::Columns { classes: 4 }, (8, 6)), (Head::Rows { classes: 3 }, (6, 8))]
            {
                let output = Array2::from_shape_vec(sides, values.clone()).expect("48 values");
                for Candidate { bbox, score, .. } in head.candidates(&output, least) {
                    prop_assert!(score >= least && score.is_finite() && bbox.x1 < bbox.x2 && bbox.y1 < bbox.y2);
                }
            }
        }
    }
}
