//! What to run within a time: the most accurate choice of a grid that is fast enough.

use crate::pareto::{self, Offer};
use crate::results::{Cell, Results, Stream};
use crate::wording::{self, distinct};

/// The choices at one saturation factor, lens and noise.
#[derive(Clone, Debug, PartialEq)]
pub struct Budget<'a> {
    /// The saturation factor.
    pub alpha: f64,
    /// Lens and noise.
    pub conditions: String,
    /// The Pareto front, from fast to accurate.
    pub front: Vec<Choice<'a>>,
    /// The most accurate of it within the time; `None` where nothing is fast enough.
    pub best: Option<Choice<'a>>,
}

/// A cell that a camera can deliver.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Choice<'a> {
    /// The cell.
    pub cell: &'a Cell,
    /// Median time from the image to the boxes, ms.
    pub ms: f64,
    /// Mean over groups of AP50, 0 to 1.
    pub ap50: f64,
}

/// For each alpha, lens and noise of the grid, what is best within `ms` a frame.
pub fn within(results: &Results, ms: f64) -> Vec<Budget<'_>> {
    let mut alphas = distinct(results.cells.iter().map(|cell| cell.point.alpha));
    alphas.sort_by(f64::total_cmp);
    let mut budgets = Vec::new();
    for conditions in wording::all_conditions(&results.cells) {
        for &alpha in &alphas {
            let here =
                |cell: &&Cell| cell.point.alpha == alpha && wording::conditions_of(&cell.point) == conditions;
            let choices: Vec<Choice<'_>> = results.cells.iter().filter(here).filter_map(choice).collect();
            let offers: Vec<Offer> = choices.iter().map(|c| Offer { cost: c.ms, gain: c.ap50 }).collect();
            let front: Vec<Choice<'_>> = pareto::front(&offers).into_iter().map(|i| choices[i]).collect();
            let best = front.iter().rev().find(|choice| choice.ms <= ms).copied();
            if !front.is_empty() {
                budgets.push(Budget { alpha, conditions: wording::conditions(conditions), front, best });
            }
        }
    }
    budgets
}

/// The sharp and the blurred ideal are none: no sensor delivers them.
fn choice(cell: &Cell) -> Option<Choice<'_>> {
    let figures: Vec<f64> = cell.ap50.values().flatten().copied().collect();
    let real = cell.point.stream != Stream::Ideal && !figures.is_empty();
    let ap50 = figures.iter().sum::<f64>() / figures.len().max(1) as f64;
    real.then_some(Choice { cell, ms: wording::frame_ms(cell)?, ap50 })
}

impl Choice<'_> {
    /// Such as `recovered (auto), yolov10n 640x192`.
    pub fn name(&self) -> String {
        format!("{}, {}", wording::stream(&self.cell.point), wording::model(&self.cell.point))
    }
}
