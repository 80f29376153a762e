//! Models that people bring: what is doubtful is told once, and what is no detector is refused with the remedy.

use crate::harness::{Bench, assert_has, model};

/// Writes the small model of the detector's tests with three other rows, of which `mean * light` is added to each value of `rows`, and with
/// other names of its classes.
fn made(bench: &Bench, rows: [f32; 18], light: [f32; 18], names: &str) {
    let mut model = std::fs::read(model()).expect("the model");
    let mut put = |after: &[u8], bytes: &[u8]| {
        let at =
            model.windows(after.len()).position(|window| window == after).expect("it is in it") + after.len();
        model[at..at + bytes.len()].copy_from_slice(bytes);
    };
    for (name, values) in [("boxes", rows), ("light", light)] {
        put(format!("{name}JH").as_bytes(), &values.map(f32::to_le_bytes).concat());
    }
    put(b"names\x12\x25", format!("{names:<37}").as_bytes());
    std::fs::write(bench.path("made.onnx"), model).expect("writable");
}

/// Two frames with a car, as YOLO labels.
fn labelled(bench: &Bench) {
    bench.images(2);
    std::fs::create_dir(bench.path("labels")).expect("writable");
    for number in 0..2 {
        std::fs::write(bench.path(&format!("labels/{number:06}.txt")), "2 0.5 0.5 0.25 0.25\n")
            .expect("writable");
    }
    std::fs::write(bench.path("data.yaml"), "names: [person, bicycle, car]\n").expect("writable");
}

#[track_caller]
fn assert_told_once(text: &str, what: &str) {
    assert_eq!(text.matches(what).count(), 1, "{what} in\n{text}");
}

const ON_FRAMES: &str = "eval --yolo @ --stream ideal --alpha 1,2 --psf-sigma 0 --engine rten --threads 1";

#[test]
fn names_that_are_not_readable_are_told_once() {
    let bench = Bench::new();
    labelled(&bench);
    let row = [8.0, 4.0, 40.0, 20.0, 0.5, 2.0];
    let rows = [row; 3].concat().try_into().expect("three rows");
    made(&bench, rows, [0.0; 18], "person bicycle car");
    let told = "its class names are no list";
    assert_told_once(&bench.says(0, "model check @/made.onnx --engine rten"), told);
    assert_told_once(&bench.says(0, &format!("{ON_FRAMES} --model @/made.onnx -o @/scored")), told);
    made(&bench, rows, [0.0; 18], "['person', 'bicycle', 'car']");
    let message = bench.says(0, "model check @/made.onnx --engine rten");
    assert_has(&message, &["3: person, bicycle, car"]);
    assert!(!message.contains("WARN"), "{message}");
}

/// Boxes that a model gives in bright pictures only are looked at when they come.
#[test]
fn boxes_that_are_shares_of_the_input_are_told() {
    let bench = Bench::new();
    labelled(&bench);
    let names = "['person', 'bicycle', 'car']";
    let share = [0.25, 0.25, 0.625, 0.75, 1.0, 2.0];
    made(&bench, [0.0; 18], [share; 3].concat().try_into().expect("three rows"), names);
    assert!(!bench.says(0, "model check @/made.onnx --engine rten").contains("WARN"));
    assert_told_once(
        &bench.says(0, &format!("{ON_FRAMES} --model @/made.onnx -o @/scored")),
        "no box is larger than one pixel",
    );
    // A model that gives them in every picture does not start.
    made(&bench, [share; 3].concat().try_into().expect("three rows"), [0.0; 18], names);
    let eval = format!("{ON_FRAMES} --model @/made.onnx -o @/other");
    for line in ["model check @/made.onnx --engine rten", &eval] {
        assert_has(&bench.says(2, line), &["made.onnx", "all boxes lie between 0 and 1"]);
    }
}

#[test]
fn a_form_that_the_anchors_alone_tell_is_told() {
    let bench = Bench::new();
    let model = model().replace("rows.onnx", "one_class.onnx");
    let message = bench.says(0, &format!("model check {model} --engine rten"));
    assert_has(&message, &["output0 [1, N, 6]: centre, size, objectness, class scores", "1: car"]);
    assert_told_once(&message, "set the metadata property end2end to False");
}

#[test]
fn what_is_no_onnx_file_is_refused_with_the_remedy() {
    let bench = Bench::new();
    std::fs::write(bench.path("best.pt"), "PK\u{3}\u{4} and the rest").expect("writable");
    let pointer = "version https://git-lfs.github.com/spec/v1\noid sha256:00\nsize 9\n";
    std::fs::write(bench.path("model.onnx"), pointer).expect("writable");
    assert_has(&bench.says(2, "model check @/best.pt"), &["is a PyTorch file", "best.pt format=onnx"]);
    assert_has(&bench.says(2, "model check @/model.onnx"), &["is a pointer of git LFS", "git lfs pull"]);
}
