//! The plans of launch files, and of those that come with the suite.

use std::path::{Path, PathBuf};
use std::time::Duration;

use modulo_launch::{NodeParameter, NodePlan, Plan, compose, declared_arguments, resolve, ros_arguments};
use modulo_runtime::ros_args::RosArgs;

use crate::{Files, owned};

fn plan(text: &str, arguments: &[(&str, &str)]) -> Plan {
    Files::new(text).resolve(arguments).expect("resolves")
}

fn labels(plan: &Plan) -> Vec<&str> {
    plan.processes().map(|process| process.label.as_str()).collect()
}

#[test]
fn a_node_with_everything() {
    let text = r#"
launch:
  - arg: { name: "gain", default: "2" }
  - node:
      pkg: "modulo"
      exec: "unwrap"
      name: "u"
      namespace: "left"
      args: "--fast 'a b'"
      ros_args: "--log-level debug"
      param:
        - { name: "gain", value: "$(var gain)", type: "float" }
        - { name: "list", value: ["a", "b c", "$(var gain)"] }
        - { name: "text", value: "12", type: "str" }
        - { name: "empty", value: "", type: "str" }
      remap: [{ from: "modulo", to: "/camera/image" }]
      env: [{ name: "A", value: "$(var gain)" }]
      output: "log"
      respawn: "true"
      respawn_delay: 0.5
      on_exit: "shutdown"
      sigterm_timeout: 1.5
"#;
    let plan = plan(text, &[("gain", "4")]);
    let node = &plan.nodes[0];
    let expected = "--fast | a b | --ros-args | -r | __node:=u | -r | __ns:=/left | -p | gain:=4.0 | \
                    -p | list:=[a, 'b c', 4] | -p | text:='12' | -p | empty:='' | \
                    -r | modulo:=/camera/image | --log-level | debug";
    assert_eq!(ros_arguments(node).join(" | "), expected);
    assert_eq!(node.fully_qualified().as_deref(), Some("/left/u"));
    let process = &node.process;
    assert_eq!((process.env["A"].as_str(), process.errors_only), ("4", true));
    assert!(process.ends_all);
    assert_eq!(process.respawn, Some(Duration::from_millis(500)));
    assert_eq!((process.sigterm_timeout.as_millis(), process.sigkill_timeout.as_millis()), (1500, 5000));
}

#[test]
fn a_group_keeps_its_changes() {
    let inner = "
        - push_ros_namespace: { namespace: inner }
        - arg: { name: x, default: inner }
        - set_remap: { from: a, to: b }
        - node: { pkg: p, exec: e, name: in }";
    let outer = "
  - node: { pkg: p, exec: e, name: $(var x outer) }";
    let head = "launch:\n  - group:";
    let scoped = plan(&format!("{head}{inner}{outer}"), &[]);
    assert_eq!((scoped.nodes[0].namespace.as_str(), scoped.nodes[0].remaps.len()), ("/inner", 1));
    let after = &scoped.nodes[1];
    assert_eq!((labels(&scoped)[1], after.namespace.as_str()), ("outer", "/"));
    assert!(after.remaps.is_empty());
}

#[test]
fn namespaces_join_and_absolute_ones_replace() {
    let text = "
launch:
  - push-ros-namespace: { namespace: a }
  - push_ros_namespace: { namespace: b }
  - node: { pkg: p, exec: e }
  - node: { pkg: p, exec: e, namespace: c }
  - node: { pkg: p, exec: e, namespace: /c/ }";
    let namespaces: Vec<String> = plan(text, &[]).nodes.into_iter().map(|node| node.namespace).collect();
    assert_eq!(namespaces, ["/a/b", "/a/b/c", "/c"]);
}

#[test]
fn conditions_choose() {
    let text = "
launch:
  - arg: { name: fast, default: 'false' }
  - executable: { cmd: a, if: $(var fast) }
  - executable: { cmd: b, unless: $(var fast) }
  - group:
      if: $(not $(var fast))
      children: [{ executable: { cmd: c } }]";
    assert_eq!(labels(&plan(text, &[])), ["b", "c"]);
    assert_eq!(labels(&plan(text, &[("fast", "1")])), ["a"]);
}

#[test]
fn includes_take_arguments_and_know_their_own_folder() {
    let text = "
launch:
  - arg: { name: who, default: x }
  - include:
      file: $(dirname)/sub.launch.yaml
      arg: [{ name: name, value: $(var who)_$(var who) }]";
    let files = Files::new(text).with(
        "sub.launch.yaml",
        "launch:\n  - arg: { name: name }\n  - executable: { cmd: run $(dirname), name: $(var name) }\n",
    );
    let plan = files.resolve(&[("who", "y")]).expect("resolves");
    assert_eq!(labels(&plan), ["y_y"]);
    assert_eq!(plan.executables[0].command[1], files.0.path().display().to_string());
}

/// `launch_ros` keeps a string without a substitution as a string, even if it looks like a number.
#[test]
fn a_quoted_number_is_a_string() {
    let text = "launch:\n  - arg: { name: n, default: '2' }\n  - node:\n      pkg: modulo\n      exec: unwrap\n      param:\n";
    let cases = [
        ("'1'", "'1'"),
        ("$(var n), type: float", "2.0"),
        ("$(var n)", "2"),
        ("'[1, 2]'", "'[1, 2]'"),
        ("['1', a]", "['1', a]"),
        ("[1, 2]", "[1, 2]"),
        ("['$(var n)']", "[2]"),
    ];
    for (written, passed) in cases {
        let node = plan(&format!("{text}        - {{ name: p, value: {written} }}\n"), &[]).nodes.remove(0);
        assert_eq!(ros_arguments(&node).last(), Some(&format!("p:={passed}")), "{written}");
    }
}

#[test]
fn declared_arguments_are_listed_once_with_their_defaults_as_written() {
    let text = "
launch:
  - arg: { name: a, default: $(var b none), description: first }
  - include: { file: $(dirname)/sub.launch.yaml }";
    let sub = "launch:\n  - arg: { name: a }\n  - arg: { name: b, choice: [{ value: '1' }] }\n";
    let files = Files::new(text).with("sub.launch.yaml", sub);
    let declared = declared_arguments(&files.path("main.launch.yaml")).expect("readable");
    let names: Vec<&str> = declared.iter().map(|d| d.name.as_str()).collect();
    assert_eq!(names, ["a", "b"]);
    assert_eq!(declared[0].default.as_deref(), Some("$(var b none)"));
    assert_eq!((declared[1].default.as_deref(), declared[1].choices.len()), (None, 1));
}

#[test]
fn only_nodes_of_the_suite_can_share_a_process() {
    let suite =
        "launch:\n  - node: { pkg: modulo, exec: unwrap, param: [{ name: m, value: '1', type: str }] }\n";
    let plan_of_suite = plan(suite, &[]);
    let nodes = compose(&plan_of_suite).expect("composable");
    assert_eq!((nodes.len(), nodes[0].executable.as_str()), (1, "unwrap"));
    for (more, why) in [
        ("  - executable: { cmd: a }\n", "a cannot run in one process: it is an executable"),
        ("  - node: { pkg: p, exec: e }\n", "e cannot run in one process: its package is 'p'"),
        (
            "  - node: { pkg: modulo, exec: unwrap, args: a }\n",
            "unwrap cannot run in one process: it has args",
        ),
    ] {
        let error = compose(&plan(&format!("{suite}{more}"), &[])).expect_err(why).to_string();
        assert!(error.starts_with(why), "{error}");
    }
}

/// The order in the launch file decides, as in `launch_ros`, both in processes and in one process.
#[test]
fn the_last_value_of_a_parameter_wins_wherever_it_comes_from() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join("values.yaml");
    std::fs::write(&path, "/**/unwrap:\n  ros__parameters: { a: 2, b: 2 }\n").expect("writable");
    let text = format!(
        "launch:\n  - node:\n      pkg: modulo\n      exec: unwrap\n      namespace: front\n      param:\n        \
         - {{ name: a, value: 1 }}\n        - from: {}\n        - {{ name: b, value: 3 }}\n",
        path.display()
    );
    let plan = plan(&text, &[]);
    let arguments = ros_arguments(&plan.nodes[0]).join(" ");
    assert!(arguments.ends_with(&format!("-p a:=1 --params-file {} -p b:=3", path.display())), "{arguments}");
    let pairs = [("a", "1"), ("a", "2"), ("b", "2"), ("b", "3")].map(|(n, v)| (n.to_owned(), v.to_owned()));
    let (ros, _) = RosArgs::parse(&ros_arguments(&plan.nodes[0])).expect("arguments");
    let node_name = ros.node_name("unwrap").expect("a name");
    assert_eq!(ros.parameters_for(&node_name).expect("readable"), pairs);
}

#[test]
fn a_plan_can_be_shown() {
    let plan = plan(
        "launch:\n  - node: { pkg: p, exec: e, name: n, respawn: 'true' }\n  - executable: { cmd: ls }",
        &[],
    );
    let expected = "node /n: p/e\n  started again after a crash, 0 s later\nexecutable ls: ls\n";
    assert_eq!(plan.to_string(), expected);
}

/// The path of a launch file that comes with the suite.
fn file(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("{name}.launch.yaml"))
}

fn shipped_plan(name: &str, arguments: &[(&str, &str)]) -> Plan {
    resolve(&file(name), &owned(arguments)).expect("resolves")
}

fn parameter<'a>(node: &'a NodePlan, name: &str) -> &'a str {
    let value = |parameter: &'a NodeParameter| match parameter {
        NodeParameter::Value(n, value) if n == name => Some(value.text.as_str()),
        _ => None,
    };
    node.parameters.iter().find_map(value).expect("set")
}

fn names(plan: &Plan) -> Vec<&str> {
    plan.nodes.iter().filter_map(|node| node.name.as_deref()).collect()
}

#[test]
fn raw_and_recovered_differ_in_the_input_alone() {
    let (raw, recovered) = (shipped_plan("raw", &[]), shipped_plan("recovered", &[]));
    assert_eq!(names(&raw), ["detector", "unwrap", "modulo_camera"]);
    assert_eq!(parameter(&raw.nodes[0], "input"), "modulo");
    assert_eq!(parameter(&recovered.nodes[0], "input"), "recovered");
    let shown = |plan: &Plan| plan.to_string();
    assert_eq!(shown(&raw).replace("input = modulo", "input = recovered"), shown(&recovered));
}

#[test]
fn compare_has_a_detector_for_each_stream() {
    let plan = shipped_plan("compare", &[]);
    let expected = ["modulo", "recovered", "metered", "saturated", "auto_exposed", "ideal"];
    let inputs: Vec<&str> = plan.nodes[..6].iter().map(|node| parameter(node, "input")).collect();
    assert_eq!(inputs, expected);
    let detectors = expected.map(|stream| format!("detector_{stream}"));
    assert_eq!(names(&plan)[..6], detectors);
    assert_eq!(parameter(&plan.nodes[6], "wait_for"), format!("[{}]", detectors.join(", ")));
}

#[test]
fn the_source_ends_all_and_every_node_comes_back() {
    for name in ["raw", "recovered", "compare"] {
        for node in shipped_plan(name, &[]).nodes {
            let source = node.executable == "modulo_camera";
            assert_eq!(node.process.ends_all, source, "{:?}", node.name);
            assert_ne!(node.process.respawn, None, "{:?}", node.name);
        }
    }
}

/// A camera on another machine describes its sensor; only what is given here replaces that. A detector may read any topic.
#[test]
fn the_sensor_is_given_where_the_camera_is_elsewhere() {
    let sensor =
        |node: &NodePlan| ["bits", "alpha", "psf_sigma"].map(|name| parameter(node, name).to_owned());
    let plan = shipped_plan("recovered", &[("bits", "10")]);
    let [_, unwrap, camera] = plan.nodes.as_slice() else { panic!("three nodes") };
    assert_eq!(
        (sensor(camera), sensor(unwrap)),
        (["10", "4.0", "1.4"].map(Into::into), ["0", "0.0", "0.0"].map(Into::into))
    );
    for (given, expected) in [
        (&[][..], ["0", "0.0", "0.0"]),
        (&[("bits", "10"), ("alpha", "3.0"), ("psf_sigma", "1.4")], ["10", "3.0", "1.4"]),
    ] {
        let plan = shipped_plan("recovered", &[&[("camera", "false")], given].concat());
        assert_eq!((plan.nodes.len(), sensor(&plan.nodes[1])), (2, expected.map(str::to_owned)));
    }
    for input in ["auto", "/camera/image_raw"] {
        let plan = shipped_plan("detector", &[("input", input)]);
        assert_eq!(parameter(&plan.nodes[0], "input"), input);
    }
}

#[test]
fn arguments_reach_the_nodes() {
    let plan = shipped_plan(
        "recovered",
        &[("alpha", "2.5"), ("source", "/a b/c"), ("model", "m.onnx"), ("loop", "true")],
    );
    let [detector, unwrap, camera] = plan.nodes.as_slice() else { panic!("three nodes") };
    assert_eq!((parameter(camera, "alpha"), parameter(unwrap, "method")), ("2.5", "auto"));
    assert_eq!((parameter(camera, "source"), parameter(camera, "loop")), ("/a b/c", "true"));
    assert_eq!(parameter(detector, "model"), "m.onnx");
    let error = resolve(&file("raw"), &[("alpha".into(), "big".into())]).expect_err("no number").to_string();
    assert!(error.ends_with("parameter 'alpha' = big is no float"), "{error}");
    assert!(resolve(&file("raw"), &[("input".into(), "ideal".into())]).is_err(), "raw has a fixed input");
}

#[test]
fn every_argument_has_a_default_and_a_description() {
    for name in ["raw", "recovered", "compare", "suite"] {
        let declared = declared_arguments(&file(name)).expect("readable");
        assert!(declared.len() >= 15, "{name}");
        for argument in declared {
            assert!(argument.default.is_some() && argument.description.is_some(), "{name}: {argument:?}");
        }
    }
}

/// `$(dirname)` of a file given by a relative path was joined to it twice.
#[test]
fn a_relative_path_finds_what_the_file_includes() {
    let path = Path::new("../launch/recovered.launch.yaml");
    assert_eq!(names(&resolve(path, &[]).expect("resolves")), ["detector", "unwrap", "modulo_camera"]);
}

/// unwrap knows the lens in any case, and removes its blur on request.
#[test]
fn deblur_is_a_yes_or_no_for_unwrap() {
    for deblur in ["false", "true"] {
        let plan = shipped_plan("recovered", &[("psf_sigma", "1.4"), ("deblur", deblur)]);
        // The lens itself reaches it with the description of the sensor.
        let [_, unwrap, camera] = plan.nodes.as_slice() else { panic!("three nodes") };
        assert_eq!((parameter(camera, "psf_sigma"), parameter(unwrap, "deblur")), ("1.4", deblur));
    }
}
