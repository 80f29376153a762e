//! The repository as a ROS 2 package: what CMake installs is found and run.

use std::path::Path;
use std::process::{Command, Output};

use crate::harness::{Bench, data, text};

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
                - log: { message: $(find-pkg-prefix modulo) }\n";
    std::fs::write(&file, mine).expect("writable");
    let print = ["launch", "--print", file.to_str().expect("UTF-8")];
    let output =
        Command::new(&modulo).args(print).env_remove("AMENT_PREFIX_PATH").output().expect("it starts");
    done(&output);
    let said = text(&output);
    let prefix = prefix.canonicalize().expect("is there");
    assert!(said.contains(&format!("log {}\n", prefix.display())), "{said}");
    assert!(said.contains("node /detector: modulo/detector"), "{said}");
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
    let package = std::fs::read_to_string(root.join("package.xml")).expect("readable");
    assert!(package.contains(&format!("<version>{}</version>", env!("CARGO_PKG_VERSION"))), "package.xml");
}
