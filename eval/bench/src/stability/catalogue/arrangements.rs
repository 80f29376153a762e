//! Chips whose pixels differ: colour mosaics, and two gains in one shot.

use modulo_core::Mosaic;
use modulo_scene::Preset;

use super::super::case::{Case, Family};
use super::super::expect::Expect;
use super::super::radiance::{Radiance, rendered};

pub fn cases() -> Vec<Case> {
    let mosaics = Preset::ALL.into_iter().flat_map(|preset| [2.0, 4.0].map(|alpha| mosaic(preset, alpha)));
    mosaics.chain(gains()).collect()
}

/// A rendered scene behind a lens of 1.4 px.
fn mosaic(preset: Preset, alpha: f64) -> Case {
    let scene = preset.name();
    let what = format!("the rendered scene {scene}, alpha {alpha}, through a lens of sigma 1.4 pixels");
    let draw = move || rendered(preset, alpha);
    Case::new(Family::Mosaics, format!("{scene}_mosaic_{alpha}"), what, draw)
        .alpha(alpha)
        .gaussian(1.4)
        .mosaic(Mosaic::Rggb)
        .why("green lies on a turned lattice with sides of 1.4 pixels; the lens leaves less than half a peak on them, too")
        .all(Expect::AtLeast(0.998))
}

/// Scenes for two gains: those that one gain misses, and the rendered ones without a lens.
fn gains() -> Vec<Case> {
    let case = |name: &str, what: &str, draw: fn() -> Radiance| {
        let (name, what) = (format!("{name}_checkerboard"), format!("{what}, checkerboard"));
        Case::new(Family::Gains, name, what, move || draw().warm()).two_gains()
    };
    let mut cases = vec![
        case("step_256", "a sharp edge of one peak", || Radiance::evening().step(150, 256.0))
            .why("one gain does not show the edge at all; the pixels of low gain do"),
        case("pole_1px", "a line of +400 codes, one pixel wide, full height", || {
            Radiance::evening().pole(150, 1, 400.0)
        })
        .why("the pixels of low gain above and below see the pole, too"),
        case("dark_corner", "a dark corner of 1 % in a scene above the peak", || {
            Radiance::evening().step(0, 300.0).block(0..25, 0..25, -300.0)
        })
        .lens()
        .why("the pixels of low gain show the absolute level, which one gain does not know"),
    ];
    cases.extend(Preset::ALL.map(|preset| {
        let name = format!("{}_checkerboard", preset.name());
        let what = format!("the rendered scene {} without a lens, checkerboard", preset.name());
        Case::new(Family::Gains, name, what, move || rendered(preset, 4.0))
            .two_gains()
            .why("only an object of a pixel is missed by the pixels of low gain around it")
            .all(Expect::AtLeast(0.998))
    }));
    cases
}
