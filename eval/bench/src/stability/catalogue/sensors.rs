//! Noise, defect pixels, constant levels, channels that differ, other bits, sizes and saturation factors, and the rendered
//! driving scenes.

use modulo_core::Transfer;
use modulo_scene::Preset;

use super::super::case::{Case, Family};
use super::super::expect::Expect;
use super::super::radiance::{Radiance, SIZE, red_block, rendered, shift_red};
use super::{AVERAGING, FIRST_ORDER, LEAST_SQUARES, RIM};

pub fn cases() -> Vec<Case> {
    let uneven = [noise(), hot_pixels(), levels(), lost_levels(), colour()];
    let varied = [bits(), sizes(), alphas(), streets()];
    uneven.into_iter().chain(varied).flatten().collect()
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
    // A difference wraps if its noise exceeds 128 codes, half a peak. At a read noise of 30 codes this is 3 sigma of
    // the first differences (42 codes), and 2.1 sigma of the mixed ones (60 codes).
    let drowned = Expect::Fails(0.2, "differences that noise carries beyond half a peak are everywhere");
    vec![
        noisy(10).why("mixed differences have a sigma of 20 codes, far from 128"),
        noisy(30)
            .why("first differences have a sigma of 42 codes, 0.3 % of them wrap; mixed ones 60, 3 % of them wrap")
            .all(Expect::AtLeast(0.99))
            .but(&["itoh"], Expect::Fails(0.3, "one wrong difference spoils the rest of its row"))
            .but(&["lines", "gradient_tree"], Expect::Fails(0.2, "too many mixed differences wrap")),
        noisy(50)
            .why("7 % of the first differences wrap; least squares averages, the others follow")
            .all(drowned)
            .but(AVERAGING, Expect::Fails(0.85, "errors no longer cancel everywhere")),
        noisy(70)
            .why("20 % of the first differences wrap; what is left is chance, and no method is held to more than that")
            .all(Expect::Fails(0.1, "differences that noise carries beyond half a peak are everywhere"))
            .but(AVERAGING, Expect::Fails(0.4, "errors no longer cancel")),
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
        // The offset is the darkest level with nearly as many pixels in range as the best one. A corner of 1 % is
        // within the 2 % that this rule gives up.
        Case::new(Family::Levels, "dark_corner", "a dark corner of 1 % in a scene above the peak", || {
            Radiance::evening().step(0, 300.0).block(0..25, 0..25, -300.0).white()
        })
        .lens()
        .why("only the corner has k = 0; the offset rule forgives 2 % out of range, for hot pixels' sake")
        .all(Expect::Fails(0.0, "the corner is taken for an outlier, everything is one peak too dark"))
        // Its result has no jump, with which it forgives 0.2 % only.
        .but(&["auto"], Expect::Exact),
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
        .but(&["tree"], Expect::AtLeast(0.999)),
    ]
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
    // With one bit the peak is two codes, so that a difference of one code is half a peak: no step at all is below the
    // limit.
    let one = case(1)
        .why("a code is half a peak: every difference is 0 or at the limit itself")
        .all(Expect::Fails(0.1, "one bit has no difference below half a peak but 0"))
        .but(&["tree"], Expect::Fails(0.5, "one bit has no difference below half a peak but 0"));
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
        Case::new(
            Family::Alpha,
            "linear_light",
            "the picture of a slope, a sky and a soft sun, decoded by sRGB into radiance of 4 peaks, through the lens",
            || landscape(SIZE.0, SIZE.1).decoded(Transfer::Srgb, 1024.0).warm(),
        )
        .lens()
        .why("radiance is steeper than codes where it is bright; the edge of the sky still stays below half a peak a pixel"),
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
    Preset::ALL.into_iter().flat_map(|preset| [soft(preset), half(preset), sharp(preset)]).collect()
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
        .but(&["tree"], Expect::AtLeast(0.995));
    let row = "one wrong difference spoils the rest of its row";
    match preset {
        Preset::Day => case.but(&["itoh"], Expect::Fails(0.02, row)),
        _ => case.but(&["itoh"], Expect::AtLeast(0.98)),
    }
}

/// A lens of half a pixel is sharper than what `auto` needs at this alpha.
fn half(preset: Preset) -> Case {
    let (row, streak) = (
        "one wrong difference spoils the rest of its row",
        "edges that end within the image break the mixed differences and leave streaks",
    );
    let case = street(preset, "_half", "through a lens of sigma 0.5 pixels")
        .gaussian(0.5)
        .why("the highest edges still jump by more than half a peak from pixel to pixel");
    match preset {
        Preset::Day => case
            .all(Expect::Fails(0.35, "the sky jumps along its whole contour and is one peak off"))
            .but(&["itoh"], Expect::Fails(0.1, row))
            .but(LEAST_SQUARES, Expect::Fails(0.9, "the errors of the contour spread, and mostly cancel")),
        Preset::Glare => case
            .all(Expect::AtLeast(0.99))
            .but(LEAST_SQUARES, Expect::Fails(0.98, "errors at the highest edges spread"))
            .but(&["itoh"], Expect::Fails(0.85, row))
            .but(&["lines"], Expect::Fails(0.5, streak)),
        Preset::Tunnel => case
            .all(Expect::Fails(0.96, "the mouth of the tunnel jumps along its whole contour"))
            .but(&["lines"], Expect::Fails(0.6, streak)),
        Preset::Night => case.all(Expect::AtLeast(0.99)).but(&["lines"], Expect::Fails(0.4, streak)),
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
        // The region that is lost depends on a few pixels, so the bound is far below the 99.97 % that the trees reach.
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
