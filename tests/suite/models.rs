//! Models that people bring: what is doubtful is told once, and what is no detector is refused with the remedy.

use std::net::{TcpListener, TcpStream};
use std::process::{Command, Stdio};

use crate::harness::{Background, Bench, assert_has, data, model, text, wait_until};

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

/// Behind the proxy of a company, a download failed where the system trusts a certificate that Mozilla does not.
#[test]
fn a_download_trusts_the_certificates_of_the_system() {
    let bench = Bench::new();
    let port = TcpListener::bind("127.0.0.1:0").and_then(|free| free.local_addr()).expect("a port").port();
    let fetch = |certificates: &str| {
        let words = bench
            .words(&format!("model fetch yolov10n --url https://localhost:{port}/made.onnx -o @/models"));
        let mut fetch = bench.modulo(&words.iter().map(String::as_str).collect::<Vec<_>>());
        let output = fetch.env("SSL_CERT_FILE", bench.path(certificates)).env_remove("SSL_CERT_DIR").output();
        let output = output.expect("it starts");
        assert_eq!(output.status.code(), Some(1), "{}", text(&output));
        text(&output)
    };
    assert_has(&fetch("none.pem"), &["no certificate can be read", "none.pem", "set SSL_CERT_FILE"]);
    let make = "req -x509 -newkey rsa:2048 -nodes -days 2 -subj /CN=localhost -addext subjectAltName=DNS:localhost \
                -addext basicConstraints=critical,CA:FALSE -keyout @/key.pem -out";
    for name in ["own.pem", "other.pem"] {
        let mut openssl = Command::new("openssl");
        openssl.args(bench.words(&format!("{make} @/{name}"))).stdout(Stdio::null()).stderr(Stdio::null());
        match openssl.status() {
            Ok(made) => assert!(made.success()),
            Err(why) => return data::skip(&format!("openssl: {why}")),
        }
        std::fs::rename(bench.path("key.pem"), bench.path(&format!("{name}.key"))).expect("writable");
    }
    std::fs::copy(model(), bench.path("made.onnx")).expect("writable");
    let server = format!("s_server -quiet -WWW -accept {port} -cert @/own.pem -key @/own.pem.key");
    let mut openssl = Command::new("openssl");
    openssl.args(bench.words(&server)).current_dir(bench.folder.path());
    let server = openssl.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null()).spawn();
    let _server = Background(server.expect("openssl starts"));
    wait_until("the server", || TcpStream::connect(("127.0.0.1", port)).is_ok());
    assert_has(&fetch("other.pem"), &["invalid peer certificate"]);
    // The file came, and is shorter than the export.
    let bytes = std::fs::metadata(model()).expect("there").len();
    assert_has(&fetch("own.pem"), &[&format!("the connection broke after {bytes} bytes")]);
}
