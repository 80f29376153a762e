//! Arrows between crates point downward, and each library is named where ARCHITECTURE.md says.

use std::path::{Path, PathBuf};
use std::process::Command;

use serde_json::Value;

/// Crates from the top floor down; those on one floor do not know each other.
const FLOORS: [&[&str]; 8] = [
    &["modulo"],
    &["modulo-launch", "modulo-eval", "modulo-bench"],
    &["modulo-camera", "modulo-unwrap", "modulo-detector", "modulo-viewer"],
    &["modulo-bags"],
    &["modulo-runtime"],
    &["modulo-msgs"],
    &["modulo-images", "modulo-scene"],
    &["modulo-core", "modulo-charts", "modulo-models"],
];

fn floor_of(name: &str) -> Option<usize> {
    FLOORS.iter().position(|floor| floor.contains(&name))
}

#[test]
fn arrows_point_downward() {
    let output = Command::new(env!("CARGO"))
        .args(["metadata", "--format-version", "1", "--no-deps", "--offline"])
        .current_dir(env!("CARGO_MANIFEST_DIR"))
        .output()
        .expect("cargo runs");
    let metadata: Value = serde_json::from_slice(&output.stdout).expect("cargo writes JSON");
    let packages = metadata["packages"].as_array().expect("a list of packages");
    // A new crate has to be placed on a floor before its arrows can be checked.
    assert_eq!(packages.len(), FLOORS.iter().map(|floor| floor.len()).sum::<usize>(), "a crate has no floor");
    for package in packages {
        let name = package["name"].as_str().expect("a name");
        let floor = floor_of(name).unwrap_or_else(|| panic!("{name} has no floor"));
        for dependency in package["dependencies"].as_array().expect("a list of dependencies") {
            let other = dependency["name"].as_str().expect("a name");
            if let Some(below) = floor_of(other) {
                assert!(below > floor, "{name} must not know {other}");
            }
        }
    }
}

/// Every source file of the workspace with its path from the root.
fn sources(folder: &Path, found: &mut Vec<(PathBuf, String)>) {
    for entry in std::fs::read_dir(folder).expect("a readable folder").flatten() {
        let path = entry.path();
        let name = entry.file_name();
        if path.is_dir() && name != "target" && name != "tests" && !name.to_string_lossy().starts_with('.') {
            sources(&path, found);
        } else if path.extension().is_some_and(|e| e == "rs") {
            let text = std::fs::read_to_string(&path).expect("a readable file");
            let root = Path::new(env!("CARGO_MANIFEST_DIR"));
            found.push((path.strip_prefix(root).expect("below the root").to_owned(), text));
        }
    }
}

/// Examples compare, measure and show: they may name what the product must not.
fn is_example(path: &Path) -> bool {
    path.iter().any(|part| part == "examples" || part == "benches")
}

#[test]
fn each_library_is_named_in_one_place() {
    let mut files = Vec::new();
    sources(Path::new(env!("CARGO_MANIFEST_DIR")), &mut files);
    for (library, home) in [
        ("zenoh", "runtime/src/transport/zenoh/"),
        ("ort", "nodes/detector/src/engine/onnxruntime.rs"),
        ("rten", "nodes/detector/src/engine/rten.rs"),
    ] {
        let named = |text: &str| {
            text.lines().any(|line| {
                let line = line.trim_start();
                line.starts_with(&format!("use {library}::")) || line.contains(&format!(" {library}::"))
            })
        };
        let product = files.iter().filter(|(path, _)| !is_example(path));
        let found: Vec<_> = product.filter(|(_, text)| named(text)).map(|(path, _)| path).collect();
        assert!(!found.is_empty(), "{library} is nowhere");
        assert!(
            found.iter().all(|path| path.starts_with(home)),
            "{library} belongs to {home} alone: {found:?}"
        );
    }
}

#[test]
fn the_wall_clock_is_read_in_one_file() {
    let mut files = Vec::new();
    sources(Path::new(env!("CARGO_MANIFEST_DIR")), &mut files);
    // The launcher waits for processes, which have no other time than the wall's; a benchmark measures it.
    let homes = ["runtime/src/clock.rs", "eval/bench/src/benchmark/timing.rs", "launch"];
    let allowed = |path: &Path| homes.iter().any(|home| path.starts_with(home));
    let found: Vec<_> = files
        .iter()
        .filter(|(path, text)| {
            (text.contains("SystemTime::now") || text.contains("Instant::now"))
                && !allowed(path)
                && !is_example(path)
        })
        .map(|(path, _)| path)
        .collect();
    assert!(found.is_empty(), "{found:?}");
}
