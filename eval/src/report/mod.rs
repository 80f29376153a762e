//! The report: one HTML file that needs no network and no script.
//!
//! Pure: results and charts in, text out. Every cell of the results is a row of
//! its last table; the script, a dozen lines, sorts tables and nothing else.

mod cells;
mod figures;
mod files;
mod glance;
mod html;
mod paper;
mod setup;

use crate::chart::Drawn;
use crate::results::Results;
pub use files::{PAGE, keep, write};

/// The whole page; `charts` are shown in their order.
pub fn page(results: &Results, charts: &[Drawn]) -> String {
    let (done, all) = (results.cells.len(), results.setup.grid.len());
    let unfinished = if done < all {
        format!(
            "<p class=\"warning\">{done} of {all} cells are here: a part of the grid, or a run that was ended.</p>\n"
        )
    } else {
        String::new()
    };
    let body = [
        unfinished,
        glance::section(results),
        figures::section(charts),
        paper::section(results),
        cells::section(results),
        setup::section(results),
    ];
    html::document(&format!("modulo eval: {}", results.setup.source), &body.concat())
}
