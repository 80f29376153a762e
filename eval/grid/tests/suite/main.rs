//! Grids and their reports.

mod grid;
mod report;
