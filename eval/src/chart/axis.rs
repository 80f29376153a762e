//! The axes that the charts of a grid share: growing to the right and upwards.

use modulo_charts::{Axis, Direction, Scale, Unit};

/// Alphas or durations.
pub fn log(label: impl Into<String>) -> Axis {
    Axis { label: label.into(), scale: Scale::Log, unit: Unit::Plain, direction: Direction::Up }
}

/// Fractions from 0 to `most`, shown as percent.
pub fn percent(label: impl Into<String>, most: f64) -> Axis {
    let scale = Scale::Linear { from: 0.0, to: most };
    Axis { label: label.into(), scale, unit: Unit::Percent, direction: Direction::Up }
}
