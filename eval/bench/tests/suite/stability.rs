//! Compares every method on every scene of the catalogue with the expected result.

use std::collections::HashSet;

use modulo_bench::stability::{Case, cases, run};
use modulo_core::Recovered;
use modulo_core::unwrap::{METHODS, Options, by_name};
use ndarray::{Array3, Axis, Slice};

#[test]
fn nothing_is_worse_than_expected() {
    let folder = tempfile::tempdir().unwrap();
    let outcome = run(folder.path(), |_| {}).unwrap();
    outcome.better.iter().for_each(|line| println!("better than expected: {line}"));
    println!("{} held; {} of {} recovered results trusted", outcome.held, outcome.trusted, outcome.judged);
    assert!(outcome.broken.is_empty(), "broken:\n{}", outcome.broken.join("\n"));
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
fn page_stands_on_its_own() {
    let folder = tempfile::tempdir().unwrap();
    let mut steps = 0;
    let outcome = run(folder.path(), |_| steps += 1).unwrap();
    assert_eq!(steps, cases().len());
    let page = std::fs::read_to_string(folder.path().join("index.html")).unwrap();
    let pictures: Vec<_> = page.split("src=\"").skip(1).map(|rest| rest.split('"').next().unwrap()).collect();
    // The truth, the modulo image, and the result of each method.
    let expected: usize = cases().iter().map(|case| 2 + case.methods().len()).sum();
    assert_eq!(pictures.len(), expected);
    let missing: Vec<_> = pictures.iter().filter(|path| !folder.path().join(path).is_file()).collect();
    assert!(missing.is_empty(), "{missing:?}");
    assert!(!page.contains("http") && !page.contains("<script"), "nothing is fetched, nothing runs");
    let json = std::fs::read_to_string(folder.path().join("results.json")).unwrap();
    let results: serde_json::Value = serde_json::from_str(&json).unwrap();
    assert_eq!(results["outcome"]["held"], outcome.held);
    assert_eq!(results["scenes"].as_array().map(Vec::len), Some(cases().len()));
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
