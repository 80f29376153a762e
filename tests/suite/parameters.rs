//! Parameters from one declaration: the table in the documentation, `--help`,
//! the descriptors of a running node, and the commands that read and set them.

use std::fmt::Write as _;
use std::path::Path;
use std::process::Command;

use modulo_middleware::driver::CommonParameters;
use modulo_runtime::{Descriptor, ParameterSet as _};

use crate::harness::{Background, Bench, text};

/// Every node with its parameters.
fn nodes() -> [(&'static str, Vec<Descriptor>); 4] {
    [
        ("modulo_camera", modulo_camera::CameraParameters::descriptors()),
        ("unwrap", modulo_unwrap::UnwrapParameters::descriptors()),
        ("detector", modulo_detector::DetectorParameters::descriptors()),
        ("every node", CommonParameters::descriptors()),
    ]
}

const TABLE: &str = "docs/reference/parameters.md";
const REWRITE: &str = "MODULO_REWRITE=1 cargo test --test suite parameters";

fn table() -> String {
    let mut page = format!(
        "# Parameters\n\n<!-- Made from the declarations in the nodes by {REWRITE}. -->\n\n\
         *Fixed* parameters are given at the start; the others can also be set while the node runs.\n"
    );
    for (node, declared) in nodes() {
        let _ = write!(
            page,
            "\n## {node}\n\n| parameter | type | default | possible | meaning |\n|---|---|---|---|---|\n"
        );
        for Descriptor { name, default, allowed, read_only, description } in declared {
            let fixed = if read_only { "*Fixed.* " } else { "" };
            let kind = default.type_name();
            // A vertical bar would end the cell of the table.
            let description = description.replace('|', "\\|");
            let default = default.to_yaml();
            let _ = writeln!(page, "| `{name}` | {kind} | `{default}` | {allowed} | {fixed}{description} |");
        }
    }
    page
}

#[test]
fn the_documentation_says_what_the_nodes_declare() {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join(TABLE);
    if std::env::var_os("MODULO_REWRITE").is_some() {
        std::fs::write(&file, table()).expect("writable");
    }
    let written = std::fs::read_to_string(&file).unwrap_or_default();
    assert!(written == table(), "{TABLE} is not what the nodes declare; {REWRITE} writes it anew");
}

/// `modulo run NODE --help`, and a link named after the node.
#[test]
fn help_says_what_the_nodes_declare() {
    let bench = Bench::new();
    for (node, declared) in &nodes()[..3] {
        let help = bench.run(&["run", node, "--help"]);
        let message = text(&help);
        for descriptor in declared.iter().chain(&CommonParameters::descriptors()) {
            assert!(message.contains(&format!("  {} (", descriptor.name)), "{node}: {}", descriptor.name);
            assert!(message.contains(descriptor.description), "{node}: {}", descriptor.name);
        }
        let link = bench.path(node);
        std::os::unix::fs::symlink(env!("CARGO_BIN_EXE_modulo"), &link).expect("a link");
        let linked = Command::new(&link).arg("--help").output().expect("the link starts");
        assert_eq!((linked.status.code(), text(&linked)), (Some(0), message));
    }
}

/// A node, ended with the test, once it has told its parameters.
fn unwrap(bench: &Bench, arguments: &[&str]) -> Background {
    let node = bench.start(&[&["run", "unwrap", "--ros-args"], arguments].concat());
    let named = arguments.iter().find_map(|argument| argument.strip_prefix("__node:=")).expect("a name");
    bench.ends(0, &["param", "list", &format!("/front/{named}")]);
    node
}

#[test]
fn a_running_node_tells_and_takes_parameters_as_ros2_param_shows_them() {
    let bench = Bench::new();
    let place = ["-r", "unwrap:__node:=u", "-r", "other:__node:=v", "-r", "__ns:=/front"];
    let named = ["-r", "__node:=u", "-r", "__ns:=/front", "-p", "alpha:=2", "-p", "v:alpha:=3"];
    let node = unwrap(&bench, &named);

    let listed = bench.says(0, "param list");
    assert!(listed.starts_with("/front/u:\n  alpha\n"), "{listed}");
    let typed = bench.says(0, "param list /front/u --param-type");
    assert!(
        typed.contains("  bits (type: integer)\n") && typed.contains("  wait_for (type: string array)\n")
    );
    for (name, expected) in [
        ("alpha", "Double value is: 2.0\n"),
        ("bits", "Integer value is: 0\n"),
        ("method", "String value is: auto\n"),
        ("wait_for", "String values are: []\n"),
    ] {
        assert_eq!(bench.says(0, &format!("param get /front/u {name}")), expected);
    }
    assert_eq!(bench.says(0, "param get --hide-type /front/u alpha"), "2.0\n");
    let described = bench.says(0, "param describe /front/u alpha wait_timeout");
    let expected = "Parameter name: alpha\n  Type: double\n  Description: ";
    assert!(described.starts_with(expected), "{described}");
    for line in ["(default 0.0)", "    Min value: ", "    Max value: 256.0", "    Read only: true"] {
        assert!(described.contains(line), "{described}");
    }

    assert_eq!(bench.says(0, "param set /front/u alpha 3"), "Set parameter successful\n");
    assert_eq!(bench.says(0, "param get /front/u alpha"), "Double value is: 3.0\n");
    for (name, value, why) in [
        ("alpha", "257", "Setting parameter failed: parameter 'alpha' = 257"),
        ("alpha", "-4.0", "parameter 'alpha' = -4: must be a finite number in 0 to 256"),
        ("alpha", "-.5", "parameter 'alpha' = -0.5"),
        ("wait_timeout", "1", "is read-only"),
        ("method", "magic", "must be one of"),
        ("alhpa", "1", "unknown parameter, did you mean 'alpha'?"),
    ] {
        let refused = bench.run(&["param", "set", "/front/u", name, value]);
        assert_eq!(refused.status.code(), Some(1), "{name}");
        assert!(text(&refused).contains(why), "{}", text(&refused));
    }
    assert_eq!(bench.run(&["param", "get", "/front/u", "alhpa"]).status.code(), Some(1));
    assert_eq!(node.interrupt(), Some(0));
    let node = bench.start(&[&["run", "unwrap", "--ros-args"], place.as_slice()].concat());
    assert!(bench.says(0, "param list /front/u").contains("alpha"));
    assert_eq!(node.interrupt(), Some(0));
}

#[test]
fn a_dump_is_a_parameter_file() {
    let bench = Bench::new();
    let place = ["-r", "__node:=u", "-r", "__ns:=/front"];
    let set = ["-p", "alpha:=2.5", "-p", "method:=lines", "-p", "wait_timeout:=7", "-p", "tau:=.25"];
    let first = unwrap(&bench, &[place.as_slice(), &set].concat());
    let dumped = bench.says(0, "param dump /front/u");
    assert_eq!(first.interrupt(), Some(0));
    assert!(dumped.starts_with("/front/u:\n  ros__parameters:\n    alpha: 2.5\n"), "{dumped}");
    let file = bench.path("dump.yaml");
    std::fs::write(&file, &dumped).expect("writable");
    let file = file.to_str().expect("UTF-8");
    let second = unwrap(&bench, &[place.as_slice(), &["--params-file", file]].concat());
    assert_eq!(bench.says(0, "param dump /front/u"), dumped);
    assert_eq!(second.interrupt(), Some(0));
}

#[test]
fn wrong_ros_arguments_end_with_exit_code_2_and_one_line() {
    let bench = Bench::new();
    let file = bench.path("bad.yaml");
    std::fs::write(&file, "/**:\n  ros__parameters: {alpha: wide}\n").expect("writable");
    let file = file.to_str().expect("UTF-8");
    for (arguments, why) in [
        (&["--frobnicate"][..], "--frobnicate"),
        (&["-p", "alpha=2"], "alpha=2"),
        (&["-p", "alpha:=wide"], "wide: is not a double"),
        (&["-p", "alpha:=-1"], "'alpha' = -1: must be a finite number in 0 to 256"),
        (&["--enclave", "/e"], "no secure enclaves"),
        (&["--log-level", "loud"], "is not a log level"),
        (&["--params-file", "/no/such.yaml"], "/no/such.yaml"),
        (&["--params-file", file], "wide: is not a double"),
        (&["-r", "__node:=1st"], "'1st' is not a ROS name"),
        (&["--", "alpha"], "'alpha' is unknown"),
    ] {
        let message = bench.ends(2, &[&["run", "unwrap", "--ros-args"], arguments].concat());
        assert!(message.contains(why) && message.lines().count() == 1, "{arguments:?}: {message}");
    }
}

#[test]
fn parameters_of_other_nodes_are_ignored_with_one_warning() {
    let bench = Bench::new();
    let file = bench.path("stack.yaml");
    std::fs::write(&file, "/**:\n  ros__parameters: {robot_base_frame: base_link, bits: 6}\n")
        .expect("writable");
    let file = file.to_str().expect("UTF-8");
    let given = [
        "source:=scene://tunnel?seed=3&frames=1&width=64&height=32",
        "psf_sgima:=2.0",
        "wheel_radius:=0.383",
    ];
    let overrides = "qos_overrides./clock.subscription.depth:=3";
    let given = given.iter().chain([&overrides]).flat_map(|setting| ["-p", setting]);
    let arguments: Vec<&str> =
        ["run", "modulo_camera", "--ros-args", "--params-file", file].into_iter().chain(given).collect();
    let message = bench.ends(0, &arguments);
    assert_eq!(message.matches("are ignored").count(), 1, "{message}");
    for name in [
        "'robot_base_frame'",
        "'wheel_radius'",
        "'psf_sgima' (did you mean 'psf_sigma'?)",
        "qos_overrides./clock",
    ] {
        assert!(message.contains(name), "{name}: {message}");
    }
}

#[test]
fn security_that_is_demanded_is_refused() {
    let bench = Bench::new();
    let run = |strategy: &str| {
        let source = "source:=scene://tunnel?seed=3&frames=1&width=64&height=32";
        let mut command = bench.modulo(&["run", "modulo_camera", "--ros-args", "-p", source]);
        command
            .env("ROS_SECURITY_ENABLE", "true")
            .env("ROS_SECURITY_STRATEGY", strategy)
            .output()
            .expect("starts")
    };
    let (refused, warned) = (run("Enforce"), run("Permissive"));
    assert_eq!(refused.status.code(), Some(2), "{}", text(&refused));
    assert!(text(&refused).contains("ROS_SECURITY_STRATEGY=Enforce"), "{}", text(&refused));
    assert_eq!(warned.status.code(), Some(0), "{}", text(&warned));
    assert_eq!(text(&warned).matches("without security").count(), 1, "{}", text(&warned));
}

/// As in ROS 2, an empty number is not set. The launcher refuses a wrong one before it starts anything.
#[test]
fn a_domain_is_a_number_or_not_set() {
    let bench = Bench::new();
    let run = |words: &[&str], domain: &str| {
        bench.modulo(words).env("ROS_DOMAIN_ID", domain).output().expect("starts")
    };
    let unset = run(&["doctor"], "");
    assert!(text(&unset).contains("domain   0 (ROS_DOMAIN_ID is not set)"), "{}", text(&unset));
    for words in [&["topic", "list"][..], &["launch", "recovered.launch.yaml", "source:=scene://day"]] {
        let refused = run(words, "233");
        assert_eq!(refused.status.code(), Some(2), "{}", text(&refused));
        assert_eq!(text(&refused).matches("ROS_DOMAIN_ID = '233'").count(), 1, "{}", text(&refused));
        assert_eq!(text(&refused).lines().count(), 1, "{}", text(&refused));
    }
}
