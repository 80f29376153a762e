//! Files and arguments that a user writes: launch files, parameters, and labels of images.

use modulo_bags::source::{GroundTruth, Source, SourceOptions, from_detections, to_detections};
use modulo_launch::substitution::pieces;
use modulo_launch::{NodeParameter, resolve, ros_arguments};
use modulo_runtime::parameter::file;
use modulo_runtime::ros_args::RosArgs;
use modulo_runtime::{NodeName, ParameterSet, Parameters, Value};
use modulo_unwrap::UnwrapParameters;

/// A launch file: what it plans can be started, and a text stays the text that it is.
pub fn launch(data: &[u8]) {
    let Ok(text) = std::str::from_utf8(data) else { return };
    let _ = pieces(text, None);
    let folder = super::folder(&[("a.launch.yaml", data)]);
    let Ok(plan) = resolve(&folder.path().join("a.launch.yaml"), &[]) else { return };
    for node in &plan.nodes {
        let _ = RosArgs::parse(&ros_arguments(node));
        for parameter in &node.parameters {
            let NodeParameter::Value(name, text) = parameter else { continue };
            if text.kind != Some("str") {
                continue;
            }
            let read = Value::String(String::new()).parse_like(&text.to_string());
            assert_eq!(read, Some(Value::String(text.text.clone())), "{name}");
        }
    }
}

/// A parameter file, and lines as arguments behind `--ros-args`; a value is written so that it reads back as the same.
pub fn parameters(data: &[u8]) {
    let Ok(text) = std::str::from_utf8(data) else { return };
    let folder = super::folder(&[("a.yaml", data)]);
    let node_name = NodeName::new("a", "/", &[]).expect("a name");
    let mut found = file::read(&folder.path().join("a.yaml"), &node_name).unwrap_or_default();
    // A line with the name of a file would let the fuzzer read any file of this machine.
    let lines = std::iter::once("--ros-args").chain(text.lines().filter(|line| !line.contains("-file")));
    if let Ok((arguments, _)) = RosArgs::parse(&lines.map(str::to_owned).collect::<Vec<_>>())
        && let Ok(node_name) = arguments.node_name("a")
    {
        let _ = arguments.log_level_of("a");
        found.extend(arguments.parameters_for(&node_name).unwrap_or_default());
    }
    let kinds = [
        Value::Bool(false),
        Value::Integer(0),
        Value::Double(0.0),
        Value::String(String::new()),
        Value::Bytes(Vec::new()),
        Value::Bools(Vec::new()),
        Value::Integers(Vec::new()),
        Value::Doubles(Vec::new()),
        Value::Strings(Vec::new()),
    ];
    for (name, text) in &found {
        for value in kinds.iter().filter_map(|kind| kind.parse_like(text)) {
            let again = value.parse_like(&value.to_yaml());
            // Compared as text, since a value that is not a number is not equal to itself.
            assert_eq!(format!("{again:?}"), format!("{:?}", Some(&value)), "{name}");
        }
        let _ =
            Parameters::declare(UnwrapParameters::descriptors()).with_text(&[(name.clone(), text.clone())]);
    }
}

/// A PNG file of one grey pixel.
const PIXEL: &[u8] =
    b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR\0\0\0\x01\0\0\0\x01\x08\0\0\0\0:~\x9bU\0\0\0\nIDATx\x9cch\0\0\0\x82\
    \0\x81w\xcdr\xb6\0\0\0\0IEND\xaeB`\x82";

/// KITTI's labels of an image, and of a drive.
pub fn kitti(data: &[u8]) {
    let folder = super::folder(&[
        ("image_2/0.png", PIXEL),
        ("label_2/0.txt", data),
        ("drives/image_02/7/0.png", PIXEL),
        ("drives/label_02/7.txt", data),
    ]);
    for path in [folder.path().to_owned(), folder.path().join("drives/image_02/7")] {
        if let Ok(mut source) = Source::kitti(&path, None, &SourceOptions::default()) {
            all(&mut source);
        }
    }
}

/// COCO's annotations of the image `a.png`.
pub fn coco(data: &[u8]) {
    let folder = super::folder(&[("a.json", data), ("images/a.png", PIXEL)]);
    let images = folder.path().join("images");
    if let Ok(mut source) =
        Source::coco(&folder.path().join("a.json"), Some(&images), &SourceOptions::default())
    {
        all(&mut source);
    }
}

/// YOLO's labels of an image, and the names of its classes, parted by a zero.
pub fn yolo(data: &[u8]) {
    let cut = data.iter().position(|&byte| byte == 0).unwrap_or(data.len());
    let (labels, names) = data.split_at(cut);
    let folder = super::folder(&[
        ("images/0.png", PIXEL),
        ("labels/0.txt", labels),
        ("data.yaml", names.get(1..).unwrap_or(b"names: []")),
    ]);
    if let Ok(mut source) = Source::yolo(folder.path(), &SourceOptions::default()) {
        all(&mut source);
    }
}

fn all(source: &mut Source) {
    let mut read = 0;
    for frame in source.by_ref() {
        read += 1;
        if let Ok(Some(labels)) = frame.map(|frame| frame.ground_truth) {
            check_labels(&labels);
        }
    }
    assert_eq!(source.len, Some(read));
}

/// Boxes are finite and not inside out, and none is lost on the way through a message.
fn check_labels(labels: &[GroundTruth]) {
    for GroundTruth { bbox, .. } in labels {
        assert!([bbox.x1, bbox.y1, bbox.x2, bbox.y2].iter().all(|v| v.is_finite()), "{bbox:?}");
        assert!(bbox.x1 <= bbox.x2 && bbox.y1 <= bbox.y2, "{bbox:?}");
    }
    let sent = from_detections(&to_detections(labels, &Default::default()));
    let classes = |labels: &[GroundTruth]| labels.iter().map(|label| label.class.clone()).collect::<Vec<_>>();
    assert_eq!(classes(&sent), classes(labels));
}
