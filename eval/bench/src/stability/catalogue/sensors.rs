//! One scene with different bits, sizes and saturation factors, and the rendered driving scenes.

use modulo_scene::Preset;

use super::super::case::{Case, Family};
use super::super::expect::Expect;
use super::super::radiance::{Radiance, SIZE, rendered};
use super::{FIRST_ORDER, LEAST_SQUARES, RIM, SORTED};

pub fn cases() -> Vec<Case> {
    [bits(), sizes(), alphas(), streets()].into_iter().flatten().collect()
}

/// A scene of 20 to 850 codes with a slope, a sky and a soft sun, without sharp edges.
fn landscape(height: usize, width: usize) -> Radiance {
    Radiance::dusk(height, width).slope(300.0).sky(height / 3, 300.0).glare(
        height / 2,
        width / 2,
        12.0,
        400.0,
    )
}

fn bits() -> Vec<Case> {
    let case = |bits: u8| {
        let what = format!("a slope with a soft sun, seen by {bits} bits");
        let scene = || Radiance::evening().slope(300.0).glare(96, 160, 30.0, 400.0).warm();
        Case::new(Family::Bits, format!("bits_{bits}"), what, scene).bits(bits)
    };
    let one = case(1)
        .why("a code is half a peak: every difference is 0 or at the limit itself")
        .all(Expect::Fails(0.1, "one bit has no difference below half a peak but 0"))
        .but(SORTED, Expect::Fails(0.5, "one bit has no difference below half a peak but 0"));
    let more =
        (2..=16).map(|bits| case(bits).why("differences are far below half a peak, in whole codes, too"));
    std::iter::once(one).chain(more).collect()
}

fn sizes() -> Vec<Case> {
    let slope = |height: usize, width: usize| {
        let what = format!("rows x columns: {height} x {width}, a slope of up to 300 codes");
        let scene = move || Radiance::dusk(height, width).slope(width.min(6) as f64 * 50.0).warm();
        Case::new(Family::Sizes, format!("size_{height}x{width}"), what, scene)
            .why("no size is too small or too odd; a side of one pixel has no differences along it")
    };
    let sizes = [(1, 1), (1, 64), (64, 1), (2, 2), (3, 5), (33, 65)];
    let mut cases: Vec<Case> = sizes.into_iter().map(|(height, width)| slope(height, width)).collect();
    cases.push(
        Case::new(
            Family::Sizes,
            "mono",
            "one channel: a slope, a sky and a soft sun through the lens",
            || landscape(SIZE.0, SIZE.1).mono(),
        )
        .lens()
        .why("without the help of other channels"),
    );
    cases
}

fn alphas() -> Vec<Case> {
    let case = |name: &'static str, alpha: f64| {
        let what = format!("a slope, a sky and a soft sun through the lens, {alpha} peaks at full scale");
        Case::new(Family::Alpha, name, what, move || landscape(SIZE.0, SIZE.1).times(alpha / 4.0).warm())
            .alpha(alpha)
            .lens()
    };
    let small = "the edge of the sky stays below half a peak a pixel";
    vec![
        case("alpha_1_5", 1.5).why(small),
        case("alpha_4", 4.0).why(small),
        case("alpha_8", 8.0)
            .why("the sky is 600 codes brighter: first differences exceed half a peak, second ones do not")
            .but(FIRST_ORDER, Expect::Fails(0.65, RIM)),
        case("alpha_16", 16.0)
            .why("the sky is 1200 codes brighter: second differences exceed half a peak, too")
            .unobservable("the same scene with a sky of another height behind a softer edge")
            .all(Expect::Fails(
                0.0,
                "the sky is some peaks too dark or too bright, and draws the rest with it",
            )),
    ]
}

fn streets() -> Vec<Case> {
    Preset::ALL.into_iter().flat_map(|preset| [soft(preset), sharp(preset)]).collect()
}

fn street(preset: Preset, suffix: &str, lens: &str) -> Case {
    let (name, what) =
        (format!("{}{suffix}", preset.name()), format!("the rendered scene {}, {lens}", preset.name()));
    Case::new(Family::Streets, name, what, move || rendered(preset, 4.0))
}

fn soft(preset: Preset) -> Case {
    let case = street(preset, "_lens", "through a lens of sigma 1 pixel")
        .gaussian(1.0)
        .why("a lens of one pixel leaves mixed differences below half a peak, and nearly all first ones")
        .but(LEAST_SQUARES, Expect::AtLeast(0.995))
        .but(SORTED, Expect::AtLeast(0.995));
    let row = "one wrong difference spoils the rest of its row";
    match preset {
        Preset::Day => case.but(&["itoh"], Expect::Fails(0.02, row)),
        _ => case.but(&["itoh"], Expect::AtLeast(0.98)),
    }
}

fn sharp(preset: Preset) -> Case {
    let (contour, row, streak) = (
        "whole contours jump by more than half a peak",
        "one wrong difference spoils the rest of its row",
        "edges that end within the image break the mixed differences and leave streaks",
    );
    // The expected shares of all methods, of itoh, and of lines.
    let (all, itoh, lines) = match preset {
        Preset::Day => (0.35, 0.1, 0.2),
        Preset::Glare => (0.6, 0.5, 0.25),
        Preset::Tunnel => (0.96, 0.96, 0.1),
        Preset::Night => (0.99, 0.98, 0.4),
    };
    let expect =
        |share: f64, why| if share < 0.99 { Expect::Fails(share, why) } else { Expect::AtLeast(share) };
    street(preset, "_sharp", "through a perfect lens")
        .why("edges of objects jump by more than half a peak from pixel to pixel: what no classical method recovers")
        .all(expect(all, contour))
        .but(&["itoh"], Expect::Fails(itoh, row))
        .but(&["lines"], Expect::Fails(lines, streak))
}
