//! The charts of a grid, one file each. Pure: results in, [`Chart`] out.

mod alpha;
mod axis;
mod frontier;
mod histogram;
mod latency;
mod paper;
pub(crate) mod pictures;
mod text;

use modulo_charts::{Chart, ChartError, Page};

pub use pictures::Shot;

use crate::results::Results;
use crate::wording::{self, Conditions};

/// A chart and the name of its files, without extension.
#[derive(Clone, Debug, PartialEq)]
pub struct Named {
    /// Such as `frontier_alpha4_psf1.4_noise0`.
    pub name: String,
    /// What is drawn.
    pub chart: Chart,
}

/// A chart as SVG, for a desk and for a phone.
#[derive(Clone, Debug, PartialEq)]
pub struct Drawn {
    /// Of the [`Named`].
    pub name: String,
    /// Of the chart.
    pub title: String,
    /// [`Page::Wide`].
    pub wide: String,
    /// [`Page::Narrow`].
    pub narrow: String,
}

impl Named {
    /// Both forms.
    ///
    /// # Errors
    /// [`ChartError`].
    pub fn draw(&self) -> Result<Drawn, ChartError> {
        let (wide, narrow) = (self.chart.svg(Page::Wide)?, self.chart.svg(Page::Narrow)?);
        Ok(Drawn { name: self.name.clone(), title: self.chart.title.clone(), wide, narrow })
    }
}

/// All charts that the cells of `results` allow, those of the first conditions first.
pub fn all(results: &Results) -> Vec<Named> {
    let conditions = wording::all_conditions(&results.cells);
    let each = |draw: fn(&Results, Conditions) -> Vec<Named>| {
        conditions.iter().flat_map(|conditions| draw(results, *conditions)).collect::<Vec<_>>()
    };
    [
        each(frontier::charts),
        each(alpha::charts),
        each(paper::charts),
        each(latency::charts),
        each(histogram::charts),
    ]
    .concat()
}
