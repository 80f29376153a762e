//! Sharp edges and bright things: steps, plateaus, lamps, poles, skies, and ramps around the limit of half a peak a pixel.

use super::super::case::{Case, Family};
use super::super::expect::Expect;
use super::super::radiance::Radiance;
use super::{FIRST_ORDER, LEAST_SQUARES, RIM};

pub fn cases() -> Vec<Case> {
    [steps(), islands(), lamps(), discs(), poles(), fences(), horizons(), ramps()]
        .into_iter()
        .flatten()
        .collect()
}

/// Column of the step, in the middle of the image.
const COLUMN: usize = 160;

fn step(codes: i32) -> Case {
    Case::new(
        Family::Steps,
        format!("step_{codes}"),
        format!("a sharp edge of +{codes} codes over the full height"),
        move || Radiance::evening().step(COLUMN, f64::from(codes)).white(),
    )
}

fn steps() -> Vec<Case> {
    // M_b shows a step of 200 codes as one of -56: it keeps steps below half a peak, 128 codes, and folds all others.
    // The folded step is lower and consistent in every row, so that no method can tell it from a true one.
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

fn lamps() -> Vec<Case> {
    vec![
        Case::new(Family::Lamps, "sun_1px", "one pixel of 840 codes more", || {
            Radiance::evening().block(60..61, 100..101, 840.0).warm()
        })
        .why("the k of that pixel is lost; it must not spread")
        .all(Expect::AtLeast(0.9999)),
        Case::new(Family::Lamps, "sun_soft", "glare of +800 codes that falls off smoothly", || {
            Radiance::evening().glare(80, 200, 12.0, 800.0).warm()
        })
        .why("nowhere steeper than half a peak a pixel"),
    ]
}

fn discs() -> Vec<Case> {
    let disc = || Radiance::evening().disc(80, 200, 18.0, 700.0);
    vec![
        Case::new(Family::Lamps, "sun_hard", "a disc of +700 codes with a hard rim", move || disc().warm())
            .why("an island that is round; the rest must stay exact")
            .unobservable(
                "the same scene with a disc 68 codes darker in red, 103 in green and 118 brighter in blue",
            )
            .all(Expect::Fails(0.98, "the k of the disc leaves no trace in y")),
        Case::new(Family::Lamps, "sun_blur", "the same disc through the lens", move || disc().warm())
            .lens()
            .why("on the rim first differences exceed half a peak, mixed and second ones do not")
            .but(FIRST_ORDER, Expect::Fails(0.98, RIM)),
        Case::new(
            Family::Lamps,
            "sun_motion",
            "the same disc, moved by 15 pixels during the exposure",
            move || disc().motion(15).warm(),
        )
        .why("soft along the row, sharp across it: only the upper and the lower rim are steep")
        .all(Expect::AtLeast(0.999))
        .but(&["lines", "itoh"], Expect::Exact)
        .but(LEAST_SQUARES, Expect::Fails(0.98, RIM)),
    ]
}

fn poles() -> Vec<Case> {
    vec![
        Case::new(Family::Poles, "pole_1px", "a line of +400 codes, one pixel wide, full height", || {
            Radiance::evening().pole(150, 1, 400.0).warm()
        })
        .why("no lens draws this; second differences wrap as well as first ones")
        .unobservable(
            "the same scene with a pole 112 codes darker in red, 124 brighter in green, 104 in blue",
        )
        .all(Expect::Fails(0.996, "the k of the pole leaves no trace in y; all else is exact"))
        .but(
            &["lines"],
            Expect::Fails(0.8, "the column is steep, so that second differences vote, and they wrap"),
        )
        .but(
            &["gradient_tree", "auto"],
            Expect::Fails(0.45, "the gradients on both sides of the pole wrap against each other"),
        ),
        Case::new(
            Family::Poles,
            "pole_blur",
            "a pole of +400 codes, 3 pixels wide, through the lens",
            || Radiance::evening().pole(150, 3, 400.0).warm(),
        )
        .lens()
        .why("the lens leaves less than half a peak a pixel"),
    ]
}

fn fences() -> Vec<Case> {
    let fence = || Radiance::evening().fence(8, 2, 300.0).warm();
    vec![
        Case::new(Family::Poles, "fence", "2 of every 8 columns are 300 codes brighter", fence)
            .why("every slat is an island from border to border")
            .unobservable("the same scene with a fence of 44 codes in red, 29 in green, 14 in blue")
            .all(Expect::Fails(0.74, "the k of the slats leaves no trace in y; all else is exact")),
        Case::new(Family::Poles, "fence_blur", "the same fence through the lens", fence)
            .lens()
            .why("the lens leaves less than half a peak a pixel"),
    ]
}

fn horizons() -> Vec<Case> {
    let sky = || Radiance::evening().sky(90, 600.0).warm();
    vec![
        Case::new(Family::Horizons, "horizon_sharp", "a sky of +600 codes over the full width, sharp", sky)
            .why("every column says the same, and it is wrong")
            .unobservable("the same scene with a sky of 88 codes in red, 58 in green, 28 in blue")
            .all(Expect::Fails(0.53, "the height of the edge leaves no trace in y")),
        Case::new(Family::Horizons, "horizon_blur", "the same sky through the lens", sky)
            .lens()
            .why("first differences exceed half a peak in every column alike; second differences do not")
            .but(FIRST_ORDER, Expect::Fails(0.35, RIM)),
    ]
}

fn ramps() -> Vec<Case> {
    let lost = Expect::Fails(0.0, "the slope falls in y where it rises in x");
    vec![
        ramp(127).why("one code below the limit"),
        // Itoh's condition is strict: a difference of exactly half a peak has two representations, and M_b takes the
        // negative one.
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
    // 40 columns of 129 codes are 5160, more than 20 peaks.
    .alpha(64.0)
}
