//! The most accurate cells of a grid that are fast enough.

use crate::labels::{self, distinct};
use crate::pareto::{self, Candidate};
use crate::results::{Cell, Results, Stream};

/// The choices at one saturation factor, lens and noise.
#[derive(Clone, Debug, PartialEq)]
pub struct Budget<'a> {
    /// The saturation factor.
    pub alpha: f64,
    /// Lens and noise.
    pub conditions: String,
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

/// For each alpha, lens and noise of the grid: the best choice that takes at most `ms` a frame.
pub fn within(results: &Results, ms: f64) -> Vec<Budget<'_>> {
    let mut alphas = distinct(results.cells.iter().map(|cell| cell.point.alpha));
    alphas.sort_by(f64::total_cmp);
    let mut budgets = Vec::new();
    for conditions in labels::all_conditions(&results.cells) {
        for &alpha in &alphas {
            let here =
                |cell: &&Cell| cell.point.alpha == alpha && labels::conditions_of(&cell.point) == conditions;
            let choices: Vec<Choice<'_>> = results.cells.iter().filter(here).filter_map(choice).collect();
            let candidates: Vec<Candidate> =
                choices.iter().map(|c| Candidate { cost: c.ms, gain: c.ap50 }).collect();
            let front: Vec<Choice<'_>> = pareto::front(&candidates).into_iter().map(|i| choices[i]).collect();
            let best = front.iter().rev().find(|choice| choice.ms <= ms).copied();
            if !front.is_empty() {
                budgets.push(Budget { alpha, conditions: labels::conditions(conditions), front, best });
            }
        }
    }
    budgets
}

/// The choice of a cell. Ideal images are no choice: no sensor delivers them.
fn choice(cell: &Cell) -> Option<Choice<'_>> {
    let figures: Vec<f64> = cell.ap50.values().flatten().copied().collect();
    let real = cell.point.stream != Stream::Ideal && !figures.is_empty();
    let ap50 = figures.iter().sum::<f64>() / figures.len().max(1) as f64;
    real.then_some(Choice { cell, ms: labels::frame_ms(cell)?, ap50 })
}

impl Choice<'_> {
    /// Description such as `recovered (auto), yolov10n 640x192`.
    pub fn name(&self) -> String {
        format!("{}, {}", labels::stream(&self.cell.point), labels::model(&self.cell.point))
    }
}
