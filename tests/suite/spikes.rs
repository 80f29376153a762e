//! A spike recording from its readings to counts and boxes.

use std::collections::BTreeMap;
use std::time::Duration;

use modulo_bags::source::{SourceOptions, open};
use modulo_runtime::{Message, MessageKind};

use crate::harness::readings::{readings, recording, resets};
use crate::harness::{Bench, Peer, assert_has, data, evaluated, evaluated_classes, wait_until};

/// Readings, rows and columns.
const SHAPE: (usize, usize, usize) = (300, 64, 96);
/// The readings of a frame.
const WINDOW: usize = 100;
/// Counts below 100, of which 5 bits are read.
const SENSOR: &str = "bits:=5 alpha:=4.0 headroom:=1.0 psf:=unknown optical_black:=0";

/// The light of three lamps in front of a dark wall, as a share of a filling.
fn light(row: usize, column: usize) -> f64 {
    let lamp = |(y, x, width, peak): (f64, f64, f64, f64)| {
        peak * (-((row as f64 - y).powi(2) + (column as f64 - x).powi(2)) / (2.0 * width * width)).exp()
    };
    0.02 + [(20.0, 25.0, 9.0, 0.95), (40.0, 70.0, 12.0, 0.8), (52.0, 20.0, 7.0, 0.4)]
        .map(lamp)
        .iter()
        .sum::<f64>()
}

#[test]
fn a_spike_recording_is_counted_by_the_nodes_and_by_an_evaluation() {
    let bench = Bench::new();
    let made = readings(SHAPE, light);
    std::fs::write(bench.path("lamps.npz"), recording(SHAPE, &made)).expect("writable");
    let expected: Vec<_> = (0..3).map(|at| resets(&made, SHAPE.1 * SHAPE.2, at * WINDOW, WINDOW)).collect();
    assert!(expected.iter().all(|sums| sums.iter().any(|sum| *sum >= 96)), "the lamps wrap three times");

    let peer = Peer::new(&bench);
    let [codes, counted] = ["/modulo", "/hdr"].map(|topic| peer.hear(topic, MessageKind::Image));
    let source = "source:=@/lamps.npz?window=100";
    let launch = format!("launch launch/sensor.launch.yaml {source} {SENSOR} detectors:=[peer] rate:=4");
    let _suite = bench.starts(&launch);
    let (mut modulo, mut sums) = (BTreeMap::new(), BTreeMap::new());
    wait_until("each frame", || {
        for (topic, found) in [(&codes, &mut modulo), (&counted, &mut sums)] {
            while let Some(Message::Image(image)) = topic.next(Duration::from_millis(20)) {
                let samples: Vec<_> = image.frame.to_f32().iter().map(|sample| *sample as u16).collect();
                found.insert(image.header.stamp.as_ns(), samples);
            }
        }
        modulo.len() == 3 && sums.len() == 3
    });
    let low_bits = |sums: &Vec<u16>| sums.iter().map(|sum| sum % 32).collect::<Vec<_>>();
    assert!(modulo.into_values().eq(expected.iter().map(low_bits)), "/modulo has the low bits");
    assert!(sums.into_values().eq(expected), "/hdr has the sums");

    let eval = format!("eval launch/recovered.launch.yaml {source} {SENSOR} engine:=rten model:=% -o @/out");
    bench.says(0, &eval);
    let frames = evaluated(&bench.path("out"), "recovered");
    assert!(
        frames.len() == 3
            && frames.iter().all(|frame| frame["recovery"]["exact"] == frame["recovery"]["samples"])
    );
    for (change, code, words) in [
        ("window=100", 2, &["300 readings", "1 to 300"][..]),
        ("alpha:=4.0", 3, &["not below", "set a larger alpha"]),
        ("psf:=unknown", 3, &["set psf to unknown"]),
    ] {
        let other = match change {
            "window=100" => "window=301",
            "alpha:=4.0" => "alpha:=2.0",
            _ => "psf:=gaussian",
        };
        assert_has(&bench.says(code, &eval.replace(change, other).replace("@/out", "@/refused")), words);
        let _ = std::fs::remove_dir_all(bench.path("refused"));
    }
}

/// A spike camera in front of a rendered street.
#[test]
fn boxes_are_found_on_the_counts_of_a_spike_camera() {
    let bench = Bench::new();
    let street = "scene://day?seed=3&frames=1&width=480&height=144";
    let mut street = open(street, &SourceOptions::default()).expect("a scene");
    let radiance = street.next().expect("a frame").expect("a frame").radiance;
    let (height, width, _) = radiance.dim();
    // A pixel without colour filters.
    let made = readings((127, height, width), |row, column| {
        (0..3).map(|channel| f64::from(radiance[(row, column, channel)])).sum::<f64>() / 3.0
    });
    std::fs::write(bench.path("street.npz"), recording((127, height, width), &made)).expect("writable");
    let sensor = "bits:=6 alpha:=2.0 headroom:=1.0 psf:=unknown optical_black:=0 engine:=rten";
    bench.says(
        0,
        &format!("eval launch/compare.launch.yaml source:=@/street.npz?window=127 {sensor} -o @/out"),
    );
    let [ideal, recovered] =
        ["ideal", "recovered"].map(|stream| evaluated_classes(&bench.path("out"), stream));
    assert!(recovered["car"] > 1, "{recovered:?}");
    assert_eq!(recovered, ideal);
    let recovery = &evaluated(&bench.path("out"), "recovered")[0]["recovery"];
    assert_eq!(recovery["exact"], recovery["samples"], "{recovery}");
}

/// The share of right counts of the first frame, and whether it is trusted.
fn shares(bench: &Bench, source: &str, sensor: &str) -> (f64, bool) {
    let eval = format!("eval launch/recovered.launch.yaml {source} {sensor} engine:=rten model:=% -o @/real");
    bench.says(0, &eval);
    let frame = &evaluated(&bench.path("real"), "recovered")[0]["recovery"];
    std::fs::remove_dir_all(bench.path("real")).expect("a folder");
    let number = |name: &str| frame[name].as_f64().expect("a number");
    (number("exact") / number("samples"), frame["trusted"] == true)
}

#[test]
fn resets_of_a_real_sensor_are_counted_from_their_low_bits() {
    let Some(path) = data::shared("data/spike/uhsr.npz") else { return };
    let bench = Bench::new();
    for (sensor, least) in [("bits:=3 alpha:=4.0", 0.997), ("bits:=4 alpha:=2.0", 0.999)] {
        let sensor = format!("{sensor} headroom:=1.0 psf:=unknown optical_black:=0");
        let (share, is_trusted) = shares(&bench, &format!("source:={}?window=200", path.display()), &sensor);
        assert!(share >= least, "{sensor}: {share}");
        assert!(!is_trusted, "with so few bits, nothing shows a wrong count");
    }
}
