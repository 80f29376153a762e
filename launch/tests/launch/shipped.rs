//! The launch files that come with the suite.

use std::path::{Path, PathBuf};

use modulo_launch::plan::{OnExit, Respawn};
use modulo_launch::{NodePlan, Plan, compose, declared_arguments, resolve};

fn file(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("{name}.launch.yaml"))
}

fn plan(name: &str, arguments: &[(&str, &str)]) -> Plan {
    let arguments: Vec<_> = arguments.iter().map(|(k, v)| ((*k).to_owned(), (*v).to_owned())).collect();
    resolve(&file(name), &arguments).expect("resolves")
}

fn parameter<'a>(node: &'a NodePlan, name: &str) -> &'a str {
    &node.parameters.iter().find(|(n, _)| n == name).expect("set").1.text
}

fn names(plan: &Plan) -> Vec<&str> {
    plan.nodes.iter().filter_map(|node| node.name.as_deref()).collect()
}

#[test]
fn raw_and_recovered_differ_in_the_input_alone() {
    let (raw, recovered) = (plan("raw", &[]), plan("recovered", &[]));
    assert_eq!(names(&raw), ["detector", "unwrap", "modulo_camera"]);
    assert_eq!(parameter(&raw.nodes[0], "input"), "modulo");
    assert_eq!(parameter(&recovered.nodes[0], "input"), "recovered");
    let shown = |plan: &Plan| plan.to_string();
    assert_eq!(shown(&raw).replace("input = modulo", "input = recovered"), shown(&recovered));
}

#[test]
fn compare_has_a_detector_for_each_stream() {
    let plan = plan("compare", &[]);
    let expected = ["modulo", "recovered", "saturated", "ideal"];
    let inputs: Vec<&str> = plan.nodes[..4].iter().map(|node| parameter(node, "input")).collect();
    assert_eq!(inputs, expected);
    assert_eq!(names(&plan)[..4], expected.map(|stream| format!("detector_{stream}")));
    assert_eq!(
        parameter(&plan.nodes[4], "wait_for"),
        "[detector_modulo, detector_recovered, detector_saturated, detector_ideal]"
    );
}

#[test]
fn the_source_ends_all_and_every_node_comes_back() {
    for name in ["raw", "recovered", "compare"] {
        for node in plan(name, &[]).nodes {
            let source = node.executable == "modulo_camera";
            assert_eq!(node.process.on_exit == OnExit::Shutdown, source, "{:?}", node.name);
            assert_ne!(node.process.respawn, Respawn::Never, "{:?}", node.name);
        }
    }
}

#[test]
fn arguments_reach_the_nodes() {
    let plan =
        plan("recovered", &[("alpha", "2.5"), ("source", "/a b/c"), ("model", "m.onnx"), ("loop", "true")]);
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

#[test]
fn all_run_in_one_process() {
    for name in ["raw", "recovered", "compare"] {
        let plan = plan(name, &[]);
        assert_eq!(compose(&plan).map(|nodes| nodes.len()), Ok(plan.nodes.len()));
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
        let plan = plan("recovered", &[("psf_sigma", "1.4"), ("deblur", deblur)]);
        // The lens itself reaches it with the description of the sensor.
        let [_, unwrap, camera] = plan.nodes.as_slice() else { panic!("three nodes") };
        assert_eq!((parameter(camera, "psf_sigma"), parameter(unwrap, "deblur")), ("1.4", deblur));
    }
}
