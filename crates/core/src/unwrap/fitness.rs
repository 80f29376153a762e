//! Up to which alpha a sensor is fit for its task: nearly all counts of real pictures can be found.

use crate::optics::Psf;

/// The widths of the lenses of [`MEASURED`], in px.
const LENSES: [f64; 6] = [0.0, 0.5, 0.8, 1.0, 1.4, 2.0];

/// The largest alpha of 1, 1.5, 2, 3, 4, 6 and 8 at which `auto` finds at least 99.5 % of the counts behind each of [`LENSES`]: by
/// whether the sensor has a colour mosaic, and by whether it has two gains. Source: docs/research/sensors.md.
const MEASURED: [(bool, bool, [f64; LENSES.len()]); 4] = [
    (false, false, [1.5, 2.0, 3.0, 4.0, 6.0, 8.0]),
    (false, true, [2.0, 4.0, 8.0, 8.0, 8.0, 8.0]),
    (true, false, [1.0, 1.5, 2.0, 3.0, 4.0, 6.0]),
    (true, true, [2.0, 2.0, 4.0, 6.0, 8.0, 8.0]),
];

/// Returns the largest alpha up to which a sensor behind `psf` is fit: at least 99.5 % of the counts of the samples that can wrap were
/// found on real pictures without noise. A lens between two measured ones counts as the sharper one.
pub fn fit_up_to(psf: Psf, has_mosaic: bool, has_two_gains: bool) -> f64 {
    let row = MEASURED.iter().find(|(mosaic, gains, _)| (*mosaic, *gains) == (has_mosaic, has_two_gains));
    let (.., fit) = row.expect("the table has each kind of mosaic and gains");
    let softer = LENSES.iter().filter(|&&lens| lens <= psf.sigma()).count();
    fit[softer.saturating_sub(1)]
}
