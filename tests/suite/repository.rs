//! The repository: arrows between crates point downward, each library is named where ARCHITECTURE.md says, and the
//! installed ROS 2 package is found and run.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use serde_json::Value;

use crate::harness::{Bench, data, text};

/// The folders of the crates from the top floor down, as ARCHITECTURE.md lists them; those on one floor do not know each other.
fn floors() -> Vec<Vec<String>> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("ARCHITECTURE.md");
    let text = std::fs::read_to_string(path).expect("readable");
    let (_, list) = text.split_once("```\nsrc  ->").expect("the list of floors begins with the program");
    let (list, _) = list.split_once("```").expect("the list ends");
    let floor = |floor: &str| floor.split(',').map(|folder| folder.trim().to_owned()).collect();
    std::iter::once("src").chain(list.split("->")).map(floor).collect()
}

/// The only crates that link the transport.
const ON_A_TRANSPORT: [&str; 4] = ["modulo-bags-live", "modulo-camera", "modulo-middleware", "modulo-viewer"];

/// A package of the workspace.
struct Package {
    name: String,
    /// Its folder from the root; that of the program is `src`.
    folder: String,
    /// The names of its dependencies, and whether only its tests need them.
    dependencies: Vec<(String, bool)>,
}

/// The packages of the workspace of this manifest.
fn packages(manifest: &str) -> Vec<Package> {
    let output = Command::new(env!("CARGO"))
        .args(["metadata", "--format-version", "1", "--no-deps", "--offline", "--manifest-path", manifest])
        .current_dir(env!("CARGO_MANIFEST_DIR"))
        .output()
        .expect("cargo runs");
    let metadata: Value = serde_json::from_slice(&output.stdout).expect("cargo writes JSON");
    let name = |of: &Value| of["name"].as_str().expect("a name").to_owned();
    let list = |of: &Value, key: &str| of[key].as_array().expect("a list").clone();
    let dependencies = |package: &Value| {
        list(package, "dependencies").iter().map(|other| (name(other), other["kind"] == "dev")).collect()
    };
    let folder = |package: &Value| {
        let manifest = Path::new(package["manifest_path"].as_str().expect("a path"));
        let folder = manifest.parent().expect("a manifest lies in a folder");
        match folder.strip_prefix(env!("CARGO_MANIFEST_DIR")).expect("below the root").display().to_string() {
            root if root.is_empty() => "src".to_owned(),
            folder => folder,
        }
    };
    list(&metadata, "packages")
        .iter()
        .map(|one| Package { name: name(one), folder: folder(one), dependencies: dependencies(one) })
        .collect()
}

#[test]
fn arrows_point_downward() {
    let (packages, floors) = (packages("Cargo.toml"), floors());
    let holds = |place: &str, folder: &str| match place.strip_suffix('*') {
        Some(above) => folder.starts_with(above),
        None => folder == place,
    };
    let floor_of = |package: &Package| {
        let floor = floors.iter().position(|floor| floor.iter().any(|place| holds(place, &package.folder)));
        floor.unwrap_or_else(|| panic!("ARCHITECTURE.md gives {} no floor", package.folder))
    };
    for place in floors.iter().flatten() {
        assert!(packages.iter().any(|package| holds(place, &package.folder)), "there is no {place}");
    }
    for package in &packages {
        for (other, _) in &package.dependencies {
            if let Some(other) = packages.iter().find(|one| one.name == *other) {
                assert!(floor_of(other) > floor_of(package), "{} must not know {}", package.name, other.name);
            }
        }
    }
}

#[test]
fn what_needs_no_transport_links_none() {
    let mut all = packages("Cargo.toml");
    for outside in ["python/Cargo.toml", "fuzz/Cargo.toml", "web/Cargo.toml"] {
        all.extend(packages(outside));
    }
    // From the floor of the transport upward: a crate links it with the first dependency that does.
    let mut linking: BTreeSet<String> = BTreeSet::from(["zenoh".to_owned(), "zenoh-ext".to_owned()]);
    loop {
        let links =
            |one: &&Package| one.dependencies.iter().any(|(other, dev)| !dev && linking.contains(other));
        let names = all.iter().filter(links).map(|one| one.name.clone());
        let further: Vec<_> = names.filter(|name| !linking.contains(name)).collect();
        if further.is_empty() {
            break;
        }
        linking.extend(further);
    }
    linking.retain(|name| !name.starts_with("zenoh"));
    assert_eq!(linking.iter().collect::<Vec<_>>(), ON_A_TRANSPORT, "these link the transport");
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

/// The lines of a source file that are neither comments nor tests.
fn product(text: &str) -> impl Iterator<Item = &str> {
    let (product, _) = text.split_once("#[cfg(test)]").unwrap_or((text, ""));
    product.lines().filter(|line| !line.trim_start().starts_with("//"))
}

/// The sensor computes with a parameter and its model declares it; options, results, tables and charts go over the declarations. The
/// stability suite has a scene of hot pixels.
#[test]
fn a_parameter_of_the_sensor_is_named_in_few_files() {
    let mut files = Vec::new();
    sources(Path::new(env!("CARGO_MANIFEST_DIR")), &mut files);
    let names = [
        "shot_noise",
        "full_well_electrons",
        "prnu",
        "hot_pixels",
        "reset_loss",
        "reset_spread",
        "optical_black",
    ];
    for name in names {
        let is_word = |word: &str| word == name;
        let named = |line: &str| line.split(|c: char| !c.is_alphanumeric() && c != '_').any(is_word);
        let found = files.iter().filter(|(path, text)| !is_example(path) && product(text).any(named));
        let found: Vec<_> = found.map(|(path, _)| path).collect();
        assert!(!found.is_empty() && found.len() <= 4, "{name} is named in {found:#?}");
    }
}

/// Examples, the research in `lab/` and the page of `web/` compare, measure and show: they may name what the product must not.
fn is_example(path: &Path) -> bool {
    path.starts_with("web")
        || path.starts_with("lab")
        || path.iter().any(|part| part == "examples" || part == "benches")
}

#[test]
fn each_library_is_named_in_one_place() {
    let mut files = Vec::new();
    sources(Path::new(env!("CARGO_MANIFEST_DIR")), &mut files);
    for (library, home) in [
        ("zenoh", "crates/middleware/src/transport/zenoh/"),
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

/// The product files with one of `words`, but for those below `homes`.
fn with_words(words: &[&str], homes: &[&str]) -> Vec<PathBuf> {
    let mut files = Vec::new();
    sources(Path::new(env!("CARGO_MANIFEST_DIR")), &mut files);
    let has_one = |text: &str| product(text).any(|line| words.iter().any(|word| line.contains(word)));
    let is_home = |path: &Path| is_example(path) || homes.iter().any(|home| path.starts_with(home));
    files.into_iter().filter(|(path, text)| !is_home(path) && has_one(text)).map(|(path, _)| path).collect()
}

#[test]
fn the_wall_clock_is_read_in_one_file() {
    // The launcher waits for processes, which have no other time than the wall's.
    let homes = ["crates/runtime/src/clock.rs", "launch"];
    assert_eq!(with_words(&["SystemTime::now", "Instant::now"], &homes), [] as [&Path; 0]);
}

/// The macros of the standard library end the program where a line cannot be written. The bridge is a program of its own,
/// a build script speaks to cargo, and a benchmark prints its figures.
#[test]
fn lines_are_printed_in_one_file() {
    let words = ["println!(", "eprint!(", " print!(", "io::stdout()", "io::stderr()"];
    let homes = ["src/command/terminal.rs", "nodes/ros2_bridge", "build.rs", "msgs/build.rs", "lab"];
    assert_eq!(with_words(&words, &homes), [] as [&Path; 0]);
}

fn done(output: &Output) {
    assert!(output.status.success(), "{}", text(output));
}

/// The package, installed below the test's folder with the binary of this build.
fn installed(bench: &Bench) -> bool {
    let run = |arguments: &[String]| match Command::new("cmake").args(arguments).output() {
        Ok(output) => {
            done(&output);
            true
        }
        Err(why) => {
            data::skip(&format!("cmake does not start: {why}"));
            false
        }
    };
    let (build, prefix) = (bench.path("build").display().to_string(), bench.path("prefix"));
    run(&[
        "-S".to_owned(),
        env!("CARGO_MANIFEST_DIR").to_owned(),
        "-B".to_owned(),
        build.clone(),
        format!("-DMODULO_BINARY={}", env!("CARGO_BIN_EXE_modulo")),
        format!("-DCMAKE_INSTALL_PREFIX={}", prefix.display()),
    ]) && run(&["--install".to_owned(), build])
}

#[test]
fn the_installed_tree_is_a_package_and_runs() {
    let bench = Bench::new();
    if !installed(&bench) {
        return;
    }
    let prefix = bench.path("prefix");
    for file in ["share/ament_index/resource_index/packages/modulo", "share/modulo/package.xml"] {
        assert!(prefix.join(file).is_file(), "{file}");
    }
    let modulo = prefix.join("bin/modulo").canonicalize().expect("a link");
    for node in ["modulo_camera", "unwrap", "detector"] {
        let program = prefix.join("lib/modulo").join(node);
        assert_eq!(program.canonicalize().expect("a link"), modulo);
        let output = Command::new(&program).arg("--help").output().expect("it starts");
        done(&output);
        assert!(text(&output).starts_with(&format!("{node}: ")), "{}", text(&output));
    }

    // A launch file of somebody else, far from the package.
    let file = bench.path("mine.launch.yaml");
    let mine = "launch:\n  - include: { file: $(find-pkg-share modulo)/launch/recovered.launch.yaml }\n  \
                - executable: { cmd: ls $(find-pkg-share modulo) }\n";
    std::fs::write(&file, mine).expect("writable");
    let print = ["launch", "--print", file.to_str().expect("UTF-8")];
    let output =
        Command::new(&modulo).args(print).env_remove("AMENT_PREFIX_PATH").output().expect("it starts");
    done(&output);
    let message = text(&output);
    let prefix = prefix.canonicalize().expect("is there");
    assert!(message.contains(&format!("executable ls: ls {}/share/modulo\n", prefix.display())), "{message}");
    assert!(message.contains("node /detector: modulo/detector"), "{message}");
}

/// `AMENT_PREFIX_PATH` is what `ros2 run` and `ros2 launch` look at.
#[test]
fn the_environment_leads_to_the_package() {
    let bench = Bench::new();
    if !installed(&bench) {
        return;
    }
    let setup = bench.path("prefix").join("share/modulo/local_setup.sh");
    // Sourced twice, as shells that start each other do: the prefix must not be added a second time.
    let script = format!(". {0}; . {0}; echo $AMENT_PREFIX_PATH", setup.display());
    let output = Command::new("sh")
        .args(["-c", &script])
        .env("AMENT_PREFIX_PATH", "/opt/ros/jazzy")
        .output()
        .expect("sh starts");
    assert_eq!(text(&output).trim(), format!("{}:/opt/ros/jazzy", bench.path("prefix").display()));
}

#[test]
fn all_packages_have_one_version() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let version = env!("CARGO_PKG_VERSION");
    for (file, line) in [
        ("package.xml", format!("<version>{version}</version>")),
        ("CITATION.cff", format!("\nversion: {version}\n")),
        ("python/Cargo.toml", format!("\nversion = \"{version}\"\n")),
    ] {
        let text = std::fs::read_to_string(root.join(file)).expect("readable");
        assert!(text.contains(&line), "{file}");
    }
}
