//! Tests `auto` with the properties of ordinary chips and scenes, on rendered scenes: defects, an alpha that is known to some percent, scenes in which
//! nothing is dark.

use modulo_core::unwrap::{self, OffsetEvidence, Options, PASS_THROUGH, Trust, Unwrap as _, by_name};
use modulo_core::{Exposure, Frame, Gains, Mosaic, Psf, Range, Recovered, Sensor, SensorConfig, TwoGains};
use modulo_scene::{Preset, Scene};
use ndarray::{Array3, s};

/// Returns one scene of each preset.
fn scenes() -> Vec<Array3<f32>> {
    Preset::ALL.iter().map(|&preset| Scene::new(preset, 1).render(0, 120, 320).radiance).collect()
}

fn expose(radiance: &Array3<f32>, alpha: f64, hot_pixels: f64) -> Exposure {
    expose_by(radiance, SensorConfig { alpha, hot_pixels, ..SensorConfig::default() })
}

/// Exposes a scene by a sensor behind a lens of 1.4 px.
fn expose_by(radiance: &Array3<f32>, config: SensorConfig) -> Exposure {
    let config = SensorConfig { psf: Psf::Gaussian { sigma: 1.4 }, ..config };
    Sensor::new(config).unwrap().expose(radiance.view(), 0).unwrap()
}

/// Returns the number of sound samples with a wrong count: those of the exposure without hot samples.
fn wrong_of_sound(out: &Recovered, exposure: &Exposure, clean: &Exposure) -> usize {
    let truth = exposure.wraps();
    let samples = out.k.iter().zip(&truth).zip(exposure.x().iter().zip(clean.x()));
    samples.filter(|((k, truth), (x, clean))| k != truth && x == clean).count()
}

fn recover(exposure: &Exposure, scene: impl Into<unwrap::Scene>) -> Recovered {
    let mut out = Recovered::default();
    by_name("auto", &Options::default())
        .unwrap()
        .unwrap(&exposure.modulo(), &scene.into(), &mut out)
        .unwrap();
    out
}

#[test]
fn hot_samples_cost_neither_speed_nor_trust() {
    for radiance in scenes() {
        for (alpha, hot) in [(2.0, 1e-5), (2.0, 1e-4), (4.0, 1e-5), (4.0, 1e-4), (4.0, 4e-4)] {
            let (clean, exposure) = (expose(&radiance, alpha, 0.0), expose(&radiance, alpha, hot));
            let [expected, out] = [&clean, &exposure].map(|exposure| recover(exposure, exposure.range()));
            let (method, trust) = (out.report.method, out.report.trust);
            assert!(["lines", PASS_THROUGH].contains(&method), "alpha {alpha}, hot {hot}: {:?}", out.report);
            assert_eq!(trust, expected.report.trust, "alpha {alpha}, hot {hot}: {:?}", out.report);
            let wrong = wrong_of_sound(&out, &exposure, &clean);
            assert_eq!(wrong, 0, "alpha {alpha}, hot {hot}: sound samples with a wrong count");
        }
    }
}

#[test]
fn hot_samples_of_a_mosaic_are_found_and_cost_no_trust() {
    let (mut found, mut trusted) = (0.0, [0, 0]);
    for preset in Preset::ALL {
        let radiance = Scene::new(preset, 1).render(0, 300, 800).radiance;
        for mosaic in [Mosaic::Rggb, Mosaic::Gbrg] {
            let config = SensorConfig { alpha: 2.0, mosaic: Some(mosaic), ..SensorConfig::default() };
            let [clean, exposure] =
                [0.0, 2e-5].map(|hot_pixels| expose_by(&radiance, SensorConfig { hot_pixels, ..config }));
            let [expected, out] = [&clean, &exposure].map(|exposure| recover(exposure, exposure.range()));
            let defects = [&expected, &out].map(|out| out.report.quality.unwrap().defects);
            found += f64::from(defects[1]) * out.k.len() as f64;
            let wrong =
                [(&expected, &clean), (&out, &exposure)].map(|(out, e)| wrong_of_sound(out, e, &clean));
            assert!(wrong[1] <= wrong[0], "{preset:?}, {mosaic:?}: {wrong:?} sound samples are wrong");
            for (count, out) in trusted.iter_mut().zip([&expected, &out]) {
                *count += usize::from(out.report.trust == Trust::Trusted);
            }
        }
    }
    assert!(found > 5.0 && trusted[0] > 2 && trusted[1] >= trusted[0], "{found} found, trusted: {trusted:?}");
}

/// Each guess weighs by the difference within its pair, which leaves a hot pixel of low gain out of the counts around it.
#[test]
fn hot_samples_of_two_gains_change_no_count_beside_them() {
    for radiance in scenes() {
        for mosaic in [None, Some(Mosaic::Gbrg)] {
            for alpha in [2.0, 4.0] {
                let gains = Gains::checkerboard(alpha);
                let config = SensorConfig { alpha, gains, mosaic, ..SensorConfig::default() };
                let outcomes = [0.0, 1e-4].map(|hot_pixels| {
                    let exposure = expose_by(&radiance, SensorConfig { hot_pixels, ..config });
                    let mut out = Recovered::default();
                    let mut method = TwoGains::new(gains).unwrap();
                    method.unwrap(&exposure.modulo(), &exposure.range().into(), &mut out).unwrap();
                    (exposure, out)
                });
                let [(clean, expected), (exposure, out)] = &outcomes;
                let wrong =
                    [(expected, clean), (out, exposure)].map(|(out, e)| wrong_of_sound(out, e, clean));
                let what = format!("{mosaic:?}, alpha {alpha}");
                assert!(wrong[1] <= wrong[0], "{what}: {wrong:?} sound samples are wrong");
                // On a mosaic of this size, one doubtful count of a colour makes the result untrusted: that of a hot pixel itself.
                assert!(mosaic.is_some() || out.report.trust == expected.report.trust, "{what}");
            }
        }
    }
}

#[test]
fn a_defect_keeps_its_code_and_gets_the_nearest_count() {
    let radiance = &scenes()[0];
    let (clean, exposure) = (expose(radiance, 4.0, 0.0), expose(radiance, 4.0, 1e-4));
    let out = recover(&exposure, exposure.range());
    let defects = out.report.quality.unwrap().defects;
    assert!(defects > 0.0 && defects < 1e-4, "{defects}");
    let y = exposure.modulo();
    for ((at, x), y) in out.x.indexed_iter().zip(y.as_u8().unwrap()) {
        assert_eq!(*x, f32::from(*y) + 256.0 * f32::from(out.k[at]));
        // At the ends of the range, the nearest count may not exist.
        assert!((x - clean.x()[at]).abs() <= 140.0 || out.k[at] == 0 || out.k[at] == 3, "{at:?}");
    }
}

#[test]
fn an_alpha_that_is_known_to_two_percent_loses_no_count() {
    for radiance in scenes() {
        for alpha in [1.5, 2.0, 3.0, 4.0] {
            let exposure = expose(&radiance, alpha, 0.0);
            for wanted in [0.98, 1.0, 1.02] {
                let out = recover(&exposure, Range::new(8, alpha * wanted).unwrap());
                assert_eq!(out.k, exposure.wraps(), "alpha {alpha}, told {wanted}: {:?}", out.report);
            }
        }
        // The trees bound the count of each pixel: the brightest ones must not fall by a peak and take others with them.
        let exposure = expose(&radiance.mapv(|x| (1.5 * x).min(1.0)), 4.0, 0.0);
        let mut tree = by_name("gradient_tree", &Options::default()).unwrap();
        let mut wrong = |wanted: f64| {
            let mut out = Recovered::default();
            tree.unwrap(&exposure.modulo(), &Range::new(8, wanted).unwrap().into(), &mut out).unwrap();
            out.k.iter().zip(&exposure.wraps()).filter(|(k, truth)| k != truth).count()
        };
        let wrong = [3.92, 4.0, 4.08].map(&mut wrong);
        assert!(wrong.iter().all(|&wrong| wrong * 100 < exposure.wraps().len()), "{wrong:?}");
    }
}

/// The sensor's full scale lies a little above an integer alpha, which the given alpha just misses.
#[test]
fn a_count_beyond_the_given_range_is_found() {
    let radiance = expose(&scenes()[0], 1.0, 0.0).x().mapv(|x| x / 256.0);
    let brightest = radiance.iter().fold(0.0f32, |most, x| most.max(*x));
    let exposure = expose(&radiance.mapv(|x| x / brightest), 3.05, 0.0);
    assert!(exposure.wraps().iter().any(|&k| k == 3));
    let out = recover(&exposure, Range::new(8, 2.99).unwrap());
    assert_eq!(out.k, exposure.wraps(), "{:?}", out.report);
}

#[test]
fn nothing_that_is_too_dark_by_a_peak_is_trusted() {
    let mut seen = [0; 2];
    for radiance in scenes() {
        for (alpha, dark) in
            [(2.0, 0.0), (2.0, 0.5), (3.0, 0.35), (4.0, 0.0), (4.0, 0.25), (4.0, 0.3), (8.0, 0.13)]
        {
            let exposure = expose(&radiance.mapv(|x| dark + (1.0 - dark) * x), alpha, 0.0);
            let truth = exposure.wraps();
            for wanted in [0.9, 0.98, 1.0, 1.02, 1.1] {
                let out = recover(&exposure, Range::new(8, alpha * wanted).unwrap());
                let right = out.k.iter().zip(&truth).filter(|(k, truth)| k == truth).count();
                let trusted = out.report.trust == Trust::Trusted;
                assert!(
                    !trusted || right as f64 >= 0.999 * truth.len() as f64,
                    "alpha {alpha}, told {wanted}, darkest {dark}: {right} of {} right, {:?}",
                    truth.len(),
                    out.report
                );
                seen[usize::from(trusted)] += 1;
            }
        }
    }
    assert!(seen.iter().all(|&count| count > 5), "both are met: {seen:?}");
}

/// Scenes of which nothing shows the absolute level, by black columns at the border.
#[test]
fn black_columns_show_the_offset() {
    let mut trusted = 0;
    for radiance in scenes() {
        for (alpha, dark) in [(2.0, 0.6), (4.0, 0.0), (4.0, 0.3), (8.0, 0.0), (8.0, 0.2)] {
            let light = radiance.mapv(|x| 0.9 * (dark + (1.0 - dark) * x));
            let lens = Psf::Gaussian { sigma: 2.0 };
            let config = SensorConfig { alpha, optical_black: 32, psf: lens, ..SensorConfig::default() };
            let exposure = Sensor::new(config).unwrap().expose(light.view(), 0).unwrap();
            let out = recover(&exposure, exposure.scene());
            let is_exact = out.k == exposure.wraps();
            assert!(is_exact || out.report.trust != Trust::Trusted, "{alpha} {dark}: {:?}", out.report);
            trusted += usize::from(out.report.trust == Trust::Trusted);
        }
    }
    assert_eq!(trusted, 5 * Preset::ALL.len(), "all are trusted");
}

/// A sequence that begins with evidence, in which the light then fades, cuts to another scene, or rises above the peak.
#[test]
fn the_last_trusted_frame_gives_the_offset_until_a_cut() {
    let frames = |preset, number| Scene::new(preset, 1).render(number, 120, 320).radiance;
    // The same evidence is found where the radiance is left out at first.
    let mut methods = [true, false].map(|radiance| {
        (by_name("auto", &Options { successive: true, ..Options::default() }).unwrap(), radiance)
    });
    let mut recover = |light: &Array3<f32>| {
        let exposure = expose(light, 4.0, 0.0);
        let [out, left_out] = methods.each_mut().map(|(method, radiance)| {
            let mut out = Recovered::default();
            let scene = unwrap::Scene { radiance: *radiance, ..exposure.range().into() };
            method.unwrap(&exposure.modulo(), &scene, &mut out).unwrap();
            out.fill(&exposure.modulo(), exposure.range());
            out
        });
        assert_eq!((&out.x, &out.k, out.report), (&left_out.x, &left_out.k, left_out.report));
        let exact = exposure.exact_share(&out.k).unwrap();
        (exact >= 0.999, out.report.trust, out.report.offset)
    };
    let (day, night) = (frames(Preset::Glare, 0), frames(Preset::Night, 0));
    let dimmed = |light: &Array3<f32>| light.mapv(|x| 0.1 + 0.7 * x);
    let brighter = |light: &Array3<f32>, dark: f32| light.mapv(|x| dark + (0.8 - dark) * x);
    // Without a frame before, nothing shows the offset of a dimmed scene.
    assert_eq!(recover(&dimmed(&day)).1, Trust::Relative);
    assert_eq!(recover(&day), (true, Trust::Trusted, Some(OffsetEvidence::Range)));
    for number in 1..4 {
        let next = dimmed(&frames(Preset::Glare, number));
        assert_eq!(recover(&next), (true, Trust::Trusted, Some(OffsetEvidence::LastFrame)), "{number}");
    }
    // Nothing is below the peak in the end, and the result is one peak too dark without the frame before.
    for dark in [0.13, 0.16, 0.19, 0.22, 0.25, 0.28] {
        let next = recover(&brighter(&day, dark));
        assert_eq!(next, (true, Trust::Trusted, Some(OffsetEvidence::LastFrame)), "{dark}");
    }
    let (_, trust, _) = recover(&dimmed(&night));
    assert_eq!(trust, Trust::Relative, "after a cut");
    assert_eq!(
        recover(&brighter(&day, 0.28)),
        (true, Trust::Trusted, Some(OffsetEvidence::LastFrame)),
        "the scene is back"
    );
}

/// Returns the exposure of a street with a white wall, of which samples of all channels at `places` (x, y) are stuck at `code`, the result of `auto`, and
/// the number of sound samples with a wrong count.
fn stuck(places: &[(usize, usize)], code: u8) -> (Recovered, usize) {
    // Its dark part is far from both codes.
    let mut radiance = scenes().swap_remove(0).mapv(|x| 0.12 + 0.88 * x);
    radiance.slice_mut(s![30..70, 100..160, ..]).fill(0.87);
    let exposure = expose(&radiance, 4.0, 0.0);
    let mut codes = exposure.modulo().as_u8().unwrap().clone();
    let is_stuck = |(i, j, _)| places.contains(&(j, i));
    codes.indexed_iter_mut().filter(|(at, _)| is_stuck(*at)).for_each(|(_, y)| *y = code);
    let mut out = Recovered::default();
    let mut auto = by_name("auto", &Options::default()).unwrap();
    auto.unwrap(&Frame::from_u8(codes.clone()).unwrap(), &exposure.range().into(), &mut out).unwrap();
    assert!(out.x.indexed_iter().all(|(at, x)| *x == f32::from(codes[at]) + 256.0 * f32::from(out.k[at])));
    let truth = exposure.wraps();
    let wrong = out.k.indexed_iter().filter(|(at, k)| !is_stuck(*at) && **k != truth[*at]).count();
    (out, wrong)
}

#[test]
fn stuck_samples_change_no_count_beside_them() {
    let cases: [(&str, &[(usize, usize)]); 7] = [
        ("inside", &[(40, 20), (250, 100)]),
        ("two neighbours in a row", &[(40, 20), (41, 20)]),
        ("two neighbours in a column", &[(200, 90), (200, 91)]),
        ("at the borders", &[(0, 60), (319, 60), (200, 0), (200, 119)]),
        ("in the corners", &[(0, 0), (319, 0), (0, 119), (319, 119)]),
        ("in and beside a plateau", &[(130, 50), (98, 50), (161, 60), (130, 72)]),
        ("one pixel between them", &[(40, 20), (42, 20)]),
    ];
    let (mut failed, mut found) = (Vec::new(), 0);
    for (name, places) in cases {
        for code in [0, 255] {
            let (out, wrong) = stuck(places, code);
            found += out.defects.len();
            if wrong > 0 || out.report.trust != Trust::Trusted {
                failed.push(format!(
                    "{name}, stuck at {code}: {wrong} wrong, {} left out, {:?}",
                    out.defects.len(),
                    out.report
                ));
            }
        }
    }
    assert!(failed.is_empty(), "{failed:#?}");
    assert!(found > 20, "{found} samples are left out");
}

#[test]
fn small_lights_are_no_defects() {
    const HOT: (usize, usize, usize) = (100, 200, 1);
    for alpha in [2.0, 4.0, 8.0] {
        let mut radiance = Array3::from_shape_fn((120, 320, 3), |(i, j, _)| 0.02 + (i + j) as f32 / 2200.0);
        // A window, as evidence for the offset.
        radiance.slice_mut(s![10..40, 10..60, ..]).fill(0.99);
        let lights: Vec<_> = (0..6).map(|n| (70, 20 + 50 * n, n)).collect();
        for &(i, j, n) in &lights {
            let light = (n + 1) as f32 / 6.0;
            radiance.slice_mut(s![i, j, ..]).assign(&ndarray::arr1(&[light, 0.9 * light, 0.7 * light]));
        }
        let config = SensorConfig { alpha, psf: Psf::Gaussian { sigma: 0.8 }, ..SensorConfig::default() };
        let exposure = Sensor::new(config).unwrap().expose(radiance.view(), 0).unwrap();
        let mut codes = exposure.modulo().as_u8().unwrap().clone();
        codes[HOT] = codes[HOT].wrapping_add(120);
        let mut out = Recovered::default();
        let mut auto = by_name("auto", &Options::default()).unwrap();
        auto.unwrap(&Frame::from_u8(codes).unwrap(), &exposure.range().into(), &mut out).unwrap();
        let near = |at: usize| {
            let (i, j) = (at / 3 / 320, at / 3 % 320);
            lights.iter().any(|&(row, column, _)| i.abs_diff(row) < 3 && j.abs_diff(column) < 3)
        };
        let truth = exposure.wraps();
        let wrong =
            out.k.iter().zip(&truth).enumerate().filter(|(at, (k, truth))| near(*at) && k != truth).count();
        let hot = (HOT.0 * 320 + HOT.1) * 3 + HOT.2;
        assert_eq!((&out.defects[..], wrong), (&[hot][..], 0), "alpha {alpha}: {:?}", out.report);
    }
}
