//! Ramps with slopes around the limit of half a peak a pixel.

use super::super::case::{Case, Family};
use super::super::expect::Expect;
use super::super::radiance::Radiance;

pub fn cases() -> Vec<Case> {
    let lost = Expect::Fails(0.0, "the slope falls in y where it rises in x");
    vec![
        ramp(127).why("one code below the limit"),
        ramp(128)
            .why("the limit itself: M_b(128) is -128, the condition is a strict one")
            .unobservable("a slope that falls by 128 codes a pixel")
            .all(lost),
        ramp(129)
            .why("one code above the limit")
            .unobservable("a slope that falls by 127 codes a pixel")
            .all(lost),
    ]
}

/// A ramp of `codes` a column. Alpha is a power of two, so that all codes are whole numbers.
fn ramp(codes: i32) -> Case {
    Case::new(
        Family::Ramps,
        format!("ramp_{codes}"),
        format!("dark, then {codes} codes more in each of 40 columns, then even"),
        move || Radiance::ramp(f64::from(codes)).white(),
    )
    .alpha(64.0)
}
