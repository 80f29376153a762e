//! The most accurate cells of a grid that are fast enough, from the Pareto front of time and accuracy.

use crate::labels::{self, distinct};
use crate::results::{Cell, Results, Stream};

/// The choices at one saturation factor, lens, read noise and shot noise, with times of one pass.
#[derive(Clone, Debug, PartialEq)]
pub struct Budget<'a> {
    /// The saturation factor.
    pub alpha: f64,
    /// Lens, read noise and shot noise.
    pub conditions: String,
    /// The pass that measured the times.
    pub pass: &'a str,
    /// The Pareto front, from fast to accurate.
    pub front: Vec<Choice<'a>>,
    /// The most accurate choice within the time. `None` if no choice is fast enough.
    pub best: Option<Choice<'a>>,
}

/// A cell whose image a camera can deliver.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Choice<'a> {
    /// The cell.
    pub cell: &'a Cell,
    /// Median time from the image to the boxes, ms.
    pub ms: f64,
    /// Mean over groups of AP50, 0 to 1.
    pub ap50: f64,
}

/// For each alpha, lens, noise and pass of the grid: the best choice that takes at most `ms` a frame.
pub fn within(results: &Results, ms: f64) -> Vec<Budget<'_>> {
    let alphas = labels::alphas(&results.cells.iter().collect::<Vec<_>>());
    let passes = distinct(results.cells.iter().filter_map(pass));
    let mut budgets = Vec::new();
    for conditions in labels::all_conditions(&results.cells) {
        for &alpha in &alphas {
            for pass in &passes {
                let here = |cell: &&Cell| {
                    cell.point.sensor.alpha == alpha
                        && labels::conditions_of(&cell.point) == conditions
                        && self::pass(cell) == Some(pass)
                };
                let front = front(results.cells.iter().filter(here).filter_map(choice).collect());
                // The front rises in time and in accuracy: the last choice within the time is the most accurate one.
                let best = front.iter().rev().find(|choice| choice.ms <= ms).copied();
                if !front.is_empty() {
                    let conditions = labels::conditions(&conditions);
                    budgets.push(Budget { alpha, conditions, pass, front, best });
                }
            }
        }
    }
    budgets
}

fn pass(cell: &Cell) -> Option<&str> {
    cell.frame_ms.as_ref().map(|time| time.pass.as_str())
}

/// The Pareto front of `choices`, which were measured in one pass.
fn front(choices: Vec<Choice<'_>>) -> Vec<Choice<'_>> {
    // A choice with more steps has to be faster than the measurement can be wrong, or more accurate.
    let needless = |choice: &Choice<'_>| {
        choices.iter().any(|simpler| {
            simpler.steps() < choice.steps()
                && simpler.ap50 >= choice.ap50
                && simpler.interval()[0] <= choice.interval()[1]
        })
    };
    let kept: Vec<Choice<'_>> = choices.iter().filter(|choice| !needless(choice)).copied().collect();
    let candidates: Vec<Candidate> = kept.iter().map(|choice| (choice.ms, choice.ap50)).collect();
    pareto_front(&candidates).into_iter().map(|index| kept[index]).collect()
}

/// The choice of a cell. Ideal images are no choice: no sensor delivers them.
fn choice(cell: &Cell) -> Option<Choice<'_>> {
    let figures: Vec<f64> = cell.ap50.values().flatten().copied().collect();
    let real = cell.point.stream != Stream::Ideal && !figures.is_empty();
    let ap50 = figures.iter().sum::<f64>() / figures.len().max(1) as f64;
    real.then_some(Choice { cell, ms: labels::frame_ms(cell)?, ap50 })
}

impl Choice<'_> {
    /// Number of steps between the image of the sensor and the detector: unwrapping or merging, deblurring.
    fn steps(&self) -> usize {
        let point = &self.cell.point;
        let merges = matches!(point.stream, Stream::MultiExposure | Stream::MultiExposureStill);
        usize::from(point.method.is_some() || merges) + usize::from(point.deblur)
    }

    /// Bounds of the 95 % interval of the time, ms.
    fn interval(&self) -> [f64; 2] {
        self.cell.frame_ms.as_ref().map_or([self.ms; 2], |time| time.interval95)
    }

    /// Description such as `recovered (auto), yolov10n 640x192`.
    pub fn name(&self) -> String {
        format!("{}, {}", labels::stream(&self.cell.point), labels::model(&self.cell.point))
    }
}

/// Cost and gain of a choice.
pub(crate) type Candidate = (f64, f64);

/// Indices of the candidates on the front, by rising cost: each has a higher gain than all that cost no more. Of equal
/// candidates the first is taken. A candidate that is not finite is left out.
pub(crate) fn pareto_front(candidates: &[Candidate]) -> Vec<usize> {
    let mut order: Vec<usize> = (0..candidates.len()).collect();
    order.retain(|&i| candidates[i].0.is_finite() && candidates[i].1.is_finite());
    // After sorting by cost, a candidate is on the front if its gain exceeds those of all candidates before it. Of
    // equal costs the higher gain comes first, so that the lower one does not enter. The sort is stable: of equal
    // candidates, the first stays the first.
    order.sort_by(|&a, &b| {
        let ((cost, gain), (other_cost, other_gain)) = (candidates[a], candidates[b]);
        cost.total_cmp(&other_cost).then(other_gain.total_cmp(&gain))
    });
    let mut most = f64::NEG_INFINITY;
    order.retain(|&i| {
        let better = candidates[i].1 > most;
        most = most.max(candidates[i].1);
        better
    });
    order
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn an_offer_is_on_the_front_unless_another_beats_it(
            pairs in prop::collection::vec((0u8..8, 0u8..8), 0..20),
        ) {
            let candidates: Vec<Candidate> =
                pairs.iter().map(|&(cost, gain)| (cost.into(), gain.into())).collect();
            let found = pareto_front(&candidates);
            for (i, one) in candidates.iter().enumerate() {
                let beaten = candidates.iter().enumerate().any(|(j, other)| {
                    let no_worse = other.0 <= one.0 && other.1 >= one.1;
                    no_worse && (other != one || j < i)
                });
                prop_assert_eq!(found.contains(&i), !beaten, "{:?} of {:?}", one, &candidates);
            }
            prop_assert!(found.windows(2).all(|w| candidates[w[0]].0 < candidates[w[1]].0));
        }
    }

    #[test]
    fn what_is_not_a_number_is_not_on_it() {
        assert_eq!(pareto_front(&[(f64::NAN, 1.0), (1.0, f64::NAN), (2.0, 0.0)]), [2]);
    }
}
