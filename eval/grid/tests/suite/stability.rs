//! Compares every method on every scene of the catalogue with the expected result.

use std::cell::Cell;
use std::collections::HashSet;

use modulo_core::Recovered;
use modulo_core::unwrap::{METHODS, Options, by_name};
use modulo_eval::images::runner::Row;
use modulo_eval::progress::GridEvent;
use modulo_eval::results::RESULTS;
use modulo_eval::stability::{Case, Judgement, Trial, cases, run};
use modulo_images::read_image;
use ndarray::{Array3, Axis, Slice};

/// No result is worse than expected, and there are pictures of the truth and of each result.
#[test]
fn nothing_is_worse_than_expected_and_all_has_a_picture() {
    let folder = tempfile::tempdir().unwrap();
    let steps = Cell::new(0);
    let trials =
        run(folder.path(), &|event| steps.set(steps.get() + usize::from(event == GridEvent::Frame))).unwrap();
    let of = |is_wanted: fn(&Judgement) -> bool| {
        trials
            .iter()
            .filter(|trial| is_wanted(&trial.verdict))
            .map(Trial::what)
            .collect::<Vec<_>>()
            .join("\n")
    };
    println!("better than expected:\n{}", of(|verdict| *verdict == Judgement::Better));
    let broken = of(|verdict| matches!(verdict, Judgement::Broken(_)));
    assert!(broken.is_empty(), "broken:\n{broken}");
    let results: usize = cases().iter().map(|case| case.methods().unwrap().len()).sum();
    assert_eq!((steps.get(), trials.len()), (cases().len(), results));

    let is_exact = |trial: &&Trial| trial.result().exact_k == 1.0;
    let exact: Vec<&Trial> = trials.iter().filter(is_exact).collect();
    // An exact result has the picture of the truth, but for the order in which a mosaic is demosaiced and rounded, and for the coarser codes
    // of pixels of low gain.
    for Trial { row: Row { file, method, .. }, .. } in
        exact.into_iter().filter(|trial| trial.row.sensor.mosaic.is_none() && !trial.row.sensor.gains)
    {
        let [own, truth] = [method, "truth"]
            .map(|name| read_image(&folder.path().join(format!("pictures/{file}_{name}.png"))).unwrap());
        assert!(own == truth, "{file}, {method}");
    }
    let text = std::fs::read_to_string(folder.path().join(RESULTS)).unwrap();
    let written: Vec<serde_json::Value> = serde_json::from_str(&text).unwrap();
    assert_eq!(written.len(), results);
    let first = written.iter().find(|trial| trial["file"] == "step_140").unwrap();
    assert_eq!((&first["verdict"], &first["alpha"]), (&"held".into(), &4.0.into()), "{first}");
    assert!(first["expected"].as_str().unwrap().starts_with("fails, at least 49.00 %"), "{first}");
}

/// Largest absolute first difference, and largest absolute second or mixed difference, within a channel.
fn roughness(x: &Array3<f32>) -> (f32, f32) {
    let along = |x: &Array3<f32>, axis: usize| {
        let axis = Axis(axis);
        if x.len_of(axis) < 2 {
            return Array3::zeros((1, 1, 1));
        }
        &x.slice_axis(axis, Slice::from(1..)) - &x.slice_axis(axis, Slice::from(..-1))
    };
    let most = |x: &Array3<f32>| x.iter().fold(0.0f32, |most, x| most.max(x.abs()));
    let (down, right) = (along(x, 0), along(x, 1));
    let second = [along(&down, 0), along(&right, 0), along(&right, 1)];
    (most(&down).max(most(&right)), second.iter().map(most).fold(0.0, f32::max))
}

/// Whether a method has a wrong result that is as smooth as the truth, which proves that y does not determine the truth.
fn has_twin(case: &Case) -> bool {
    let exposure = case.expose().unwrap();
    let (y, limit) = (exposure.modulo(), exposure.range().limit());
    let truth = roughness(&exposure.x().mapv(f32::floor));
    METHODS.iter().any(|method| {
        let mut out = Recovered::default();
        by_name(method, &Options::default()).unwrap().unwrap(&y, &exposure.range().into(), &mut out).unwrap();
        let twin = roughness(&out.x);
        let in_range = out.x.iter().all(|&x| x >= 0.0 && f64::from(x) < limit);
        out.k != exposure.wraps() && in_range && twin.0 <= truth.0 && twin.1 <= truth.1
    })
}

#[test]
fn what_is_called_unobservable_has_a_smoother_twin() {
    for case in cases().iter().filter(|case| !case.is_observable()) {
        assert!(has_twin(case), "{}: no method shows another scene that is as smooth", case.name);
    }
}

#[test]
fn names_are_unique_and_fit_for_files() {
    let cases = cases();
    let names: HashSet<_> = cases.iter().map(|case| &case.name).collect();
    assert_eq!(names.len(), cases.len());
    let plain = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '_';
    assert!(names.iter().all(|name| name.chars().all(plain)), "{names:?}");
}

#[test]
fn documentation_names_every_method_and_unobservable_scene() {
    let methods = include_str!("../../../../docs/explanation/methods.md");
    for method in METHODS {
        assert!(
            methods.contains(&format!("## {method}\n")),
            "docs/explanation/methods.md has no section {method}"
        );
    }
    let scenes = include_str!("../../../../docs/research/trust.md");
    for case in cases().iter().filter(|case| !case.is_observable()) {
        assert!(
            scenes.contains(&format!("`{}`", case.name)),
            "docs/research/trust.md does not list {}",
            case.name
        );
    }
}
