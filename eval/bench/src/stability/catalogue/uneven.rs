//! Noise, defect pixels, constant levels, and channels that differ.

use super::super::case::{Case, Family};
use super::super::expect::Expect;
use super::super::radiance::{Radiance, red_block, shift_red};
use super::{LEAST_SQUARES, SORTED};

pub fn cases() -> Vec<Case> {
    [noise(), hot_pixels(), levels(), lost_levels(), colour()].into_iter().flatten().collect()
}

/// A gentle slope of 40 to 550 codes under read noise of `sigma` codes.
fn noisy(sigma: i32) -> Case {
    Case::new(
        Family::Noise,
        format!("noise_{sigma}"),
        format!("a gentle slope under read noise of sigma {sigma} codes"),
        || Radiance::evening().times(2.0).slope(300.0).warm(),
    )
    .read_noise(f64::from(sigma))
}

/// Increasing read noise. First differences have a noise of 1.4 sigma, mixed differences of 2 sigma.
fn noise() -> Vec<Case> {
    let drowned = Expect::Fails(0.2, "differences that noise carries beyond half a peak are everywhere");
    vec![
        noisy(10).why("mixed differences have a sigma of 20 codes, far from 128"),
        noisy(30)
            .why("first differences have a sigma of 42 codes, 0.3 % of them wrap; mixed ones 60, 3 % of them wrap")
            .all(Expect::AtLeast(0.99))
            .but(&["itoh"], Expect::Fails(0.3, "one wrong difference spoils the rest of its row"))
            .but(&["lines", "gradient_tree", "auto"], Expect::Fails(0.2, "too many mixed differences wrap")),
        noisy(50)
            .why("7 % of the first differences wrap; least squares averages, the others follow")
            .all(drowned)
            .but(LEAST_SQUARES, Expect::Fails(0.85, "errors no longer cancel everywhere")),
        noisy(70)
            .why("20 % of the first differences wrap; what is left is chance, and no method is held to more than that")
            .all(Expect::Fails(0.1, "differences that noise carries beyond half a peak are everywhere"))
            .but(LEAST_SQUARES, Expect::Fails(0.4, "errors no longer cancel")),
    ]
}

fn hot_pixels() -> Vec<Case> {
    let case = Case::new(Family::Noise, "hot_pixels", "0.2 % of the pixels are 400 codes brighter", || {
        Radiance::evening().slope(300.0).hot(0.002, 400.0, 1).warm()
    });
    let case =
        case.why("the k of the hot pixels is lost; it must not spread").all(Expect::AtLeast(0.997)).but(
            &["lines"],
            Expect::Fails(0.3, "each hot pixel breaks four mixed differences and leaves a streak"),
        );
    vec![case]
}

fn levels() -> Vec<Case> {
    let even = |codes: f64| move || Radiance::even(codes).white();
    vec![
        Case::new(Family::Levels, "black", "nothing at all", even(0.0)).alpha(2.0).why("k = 0"),
        Case::new(Family::Levels, "constant_100", "100 codes everywhere", even(100.0))
            .alpha(2.0)
            .why("k = 0"),
        Case::new(Family::Levels, "dark_corner", "a dark corner of 1 % in a scene above the peak", || {
            Radiance::evening().step(0, 300.0).block(0..25, 0..25, -300.0).white()
        })
        .lens()
        .why("only the corner has k = 0; the offset rule forgives 2 % out of range, for hot pixels' sake")
        .all(Expect::Fails(0.0, "the corner is taken for an outlier, everything is one peak too dark")),
    ]
}

fn lost_levels() -> Vec<Case> {
    let even = |codes: f64| move || Radiance::even(codes).white();
    vec![
        Case::new(Family::Levels, "constant_300", "300 codes everywhere", even(300.0))
            .alpha(2.0)
            .unobservable("44 codes everywhere"),
        Case::new(Family::Levels, "top", "the top of the range everywhere", even(511.9))
            .alpha(2.0)
            .unobservable("255 codes everywhere"),
        Case::new(Family::Levels, "above_peak", "the darkest pixel is above the peak", || {
            Radiance::evening().step(0, 300.0).white()
        })
        .unobservable("the same scene, one peak darker"),
    ]
    .into_iter()
    .map(|case| {
        case.all(Expect::UpToOffset).why("no k = 0 anywhere; a whole peak more or less changes nothing in y")
    })
    .collect()
}

fn colour() -> Vec<Case> {
    let lamp = || red_block(Radiance::evening().warm(), 60..100, 100..140, 500.0);
    let rim = "first differences exceed half a peak on the edge of one channel";
    vec![
        Case::new(Family::Colour, "red_lamp", "a sharp square of +500 codes in red alone", lamp)
            .why("an island in one channel; green and blue say nothing of it")
            .unobservable("the same scene with a square 12 codes darker in red")
            .all(Expect::Fails(0.99, "the k of the square leaves no trace in y; all else is exact")),
        Case::new(Family::Colour, "red_lamp_blur", "the same square through the lens", lamp)
            .lens()
            .why("mixed differences stay below half a peak; at its corners first ones do, too, which is where trees enter")
            .but(LEAST_SQUARES, Expect::Fails(0.99, rim))
            .but(&["itoh"], Expect::Fails(0.99, rim)),
        Case::new(Family::Colour, "colour_shift", "a disc of +500 codes, red 3 pixels aside, through the lens", || {
            shift_red(Radiance::evening().disc(80, 200, 30.0, 500.0).warm(), 3)
        })
        .lens()
        .why("the channels' rims are apart, so that edges of one are even in the others")
        .but(LEAST_SQUARES, Expect::Fails(0.99, rim))
        .but(&["itoh"], Expect::Fails(0.98, rim))
        .but(SORTED, Expect::AtLeast(0.999)),
    ]
}
