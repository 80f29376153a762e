//! Sharp steps over the full height, and closed plateaus.

use super::super::case::{Case, Family};
use super::super::expect::Expect;
use super::super::radiance::Radiance;

/// Column of the step, in the middle of the image.
const COLUMN: usize = 160;

pub fn cases() -> Vec<Case> {
    [steps(), islands()].into_iter().flatten().collect()
}

fn step(codes: i32) -> Case {
    Case::new(
        Family::Steps,
        format!("step_{codes}"),
        format!("a sharp edge of +{codes} codes over the full height"),
        move || Radiance::evening().step(COLUMN, f64::from(codes)).white(),
    )
}

fn steps() -> Vec<Case> {
    let low = step(120).why("120 codes are less than half a peak: the step is seen as it is");
    let high = [140, 200, 256, 300, 512].into_iter().map(|codes| {
        step(codes)
            .why("every row says the same, no loop of four pixels contradicts itself; half of the image is lost")
            .unobservable("the same scene with a step of M_b of that height, which is no more than 116 codes")
            .all(Expect::Fails(0.49, "the step is no step of that height in y"))
    });
    std::iter::once(low).chain(high).collect()
}

fn island(name: &'static str, codes: f64) -> Case {
    Case::new(
        Family::Islands,
        name,
        format!("a closed plateau, {codes} codes above its surroundings"),
        move || Radiance::evening().block(60..130, 100..200, codes).white(),
    )
}

fn islands() -> Vec<Case> {
    let lost =
        Expect::Fails(0.88, "the contour is no contour of that height in y; all but the plateau is exact");
    let soft = "through the lens the contour is a slope of less than half a peak a pixel";
    vec![
        island("island_256", 256.0)
            .why("one whole peak: y is that of the scene without any island")
            .unobservable("the scene without an island")
            .all(lost),
        island("island_256_blur", 256.0).lens().why(soft),
        island("island_330", 330.0)
            .why(
                "the whole contour steps by 330 codes, which y shows as 74, without a contradiction anywhere",
            )
            .unobservable("the same scene with an island of 74 codes")
            .all(lost),
        island("island_330_blur", 330.0).lens().why(soft),
    ]
}
