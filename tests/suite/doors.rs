//! The same codes and the same description of the sensor have the same counts and the same trust at each door of the suite: `simulate`, `unwrap`, the
//! nodes and `eval`. The Python package (`python/tests/test_equality.py`) and the page in the browser (`tests/peers/web.py`) are
//! compared with `simulate` as well.

use std::collections::BTreeMap;

use image::{GrayImage, Luma};
use modulo_runtime::sensor::recovery::Recovery;
use modulo_runtime::{Message, MessageKind};
use proptest::prelude::*;
use serde_json::Value;

use crate::harness::{Bench, Peer, evaluated as evaluated_frames, wait_until};

/// The result for one image: its picture, whether it is trusted, and the method that was used.
type Outcome = (Vec<u8>, bool, String);

const SENSOR: &str = "--alpha 3 --bits 8 --optical-black 32";

/// Lenses: the shape of the blur and its width. A Gaussian of width 0 is a perfect lens by another name.
const LENSES: [(&str, &str); 4] =
    [("gaussian", "0.0"), ("perfect", "1.4"), ("gaussian", "1.4"), ("unknown", "1.4")];

/// Rectangles on a grey ground, some of which are two peaks brighter than it: a step that the codes do not show behind a perfect lens.
fn images() -> impl Strategy<Value = Vec<GrayImage>> {
    // A peak is 255 / (0.97 * 3) = 88 grey levels.
    let shade = prop_oneof![Just(40u8), Just(215), 0u8..=255];
    let shape = (0u32..80, 0u32..50, 4u32..40, 4u32..30, shade);
    let image = prop::collection::vec(shape, 1..6).prop_map(|shapes| {
        GrayImage::from_fn(96, 64, |x, y| {
            let covers = |&&(left, top, width, height, _): &&(u32, u32, u32, u32, u8)| {
                (left..left + width).contains(&x) && (top..top + height).contains(&y)
            };
            Luma([shapes.iter().rfind(covers).map_or(40, |shape| shape.4)])
        })
    });
    prop::collection::vec(image, 3)
}

fn picture(bench: &Bench, path: &str) -> Vec<u8> {
    image::open(bench.path(path)).expect("a picture").into_luma8().into_raw()
}

fn outcome(bench: &Bench, picture_at: &str, row: &Value) -> Outcome {
    let word = row["method_used"].as_str().expect("a name").to_owned();
    (picture(bench, picture_at), row["trusted"].as_bool().expect("a claim"), word)
}

/// The frames that a camera and `unwrap` make of the images, by their pictures.
fn live(bench: &Bench, (shape, sigma): (&str, &str), count: usize) -> BTreeMap<Vec<u8>, (bool, String)> {
    let peer = Peer::new(bench);
    let (pictures, statuses) =
        (peer.hear("/recovered", MessageKind::Image), peer.hear("/recovery", MessageKind::Diagnostics));
    let sensor = "alpha:=3.0 bits:=8 optical_black:=32 loop:=true rate:=20 detectors:=[peer]";
    let _suite = bench.starts(&format!(
        "launch launch/sensor.launch.yaml source:=@/images {sensor} psf:={shape} psf_sigma:={sigma}"
    ));
    let (mut shown, mut said, mut found) = (BTreeMap::new(), BTreeMap::new(), BTreeMap::new());
    wait_until("each image", || {
        while let Some(Message::Image(image)) = pictures.next(std::time::Duration::ZERO) {
            let samples = image.frame.as_u8().expect("a picture");
            shown.insert(image.header.stamp.as_ns(), samples.iter().copied().collect::<Vec<u8>>());
        }
        while let Some(Message::Diagnostics(status)) = statuses.next(std::time::Duration::from_millis(20)) {
            let recovery = Recovery::of(&status);
            let claim = (recovery.trusted.expect("a claim"), recovery.method_used.to_owned());
            said.insert(status.header.stamp.as_ns(), claim);
        }
        for (stamp, claim) in &said {
            if let Some(picture) = shown.get(stamp) {
                found.insert(picture.clone(), claim.clone());
            }
        }
        found.len() >= count
    });
    found
}

/// Makes `eval` sense the images behind this lens; returns for each frame the share of right counts and whether it is trusted.
fn evaluated(bench: &Bench, (shape, sigma): (&str, &str)) -> Vec<(f64, bool)> {
    let parameters = format!("/**:\n  ros__parameters:\n    psf: {shape}\n    psf_sigma: {sigma}\n");
    std::fs::write(bench.path("sensor.yaml"), parameters).expect("writable");
    // Its sensor has 8 bits and 32 black columns.
    let sensor = "--alpha 3 --sensor @/sensor.yaml --stream recovered --method auto --deblur off --engine rten --model %";
    bench.says(0, &format!("eval --yolo @/set {sensor} -o @/eval"));
    let frames = evaluated_frames(&bench.path("eval"), "recovered");
    std::fs::remove_dir_all(bench.path("eval")).expect("a folder");
    let frame = |frame: &Value| {
        let recovery = &frame["recovery"];
        let number = |name: &str| recovery[name].as_f64().expect("a number");
        (number("exact") / number("samples"), recovery["trusted"].as_bool().expect("a claim"))
    };
    frames.iter().map(frame).collect()
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 2, failure_persistence: None, max_shrink_iters: 0, ..ProptestConfig::default() })]
    #[test]
    fn one_image_has_one_result_at_each_door(images in images()) {
        let bench = Bench::new();
        for folder in ["images", "set/images", "set/labels"] {
            std::fs::create_dir_all(bench.path(folder)).expect("writable");
        }
        for (at, image) in images.iter().enumerate() {
            image.save(bench.path(&format!("images/{at}.png"))).expect("writable");
            image.save(bench.path(&format!("set/images/{at}.png"))).expect("writable");
            std::fs::write(bench.path(&format!("set/labels/{at}.txt")), "0 0.5 0.5 0.5 0.5\n").expect("writable");
        }
        std::fs::write(bench.path("set/data.yaml"), "val: images\nnames: [car]\n").expect("writable");
        for lens @ (shape, sigma) in LENSES {
            let options = format!("--psf {shape} --psf-sigma {sigma}");
            bench.says(0, &format!("simulate @/images {SENSOR} {options} -o @/simulated"));
            let rows = bench.json("simulated/results.json");
            let rows = rows.as_array().expect("a row for each image");
            let mut expected = BTreeMap::new();
            for (at, row) in rows.iter().enumerate() {
                let (picture, is_trusted, method) = outcome(&bench, &format!("simulated/{at}_alpha3_auto.png"), row);
                let exact = row["exact_k"].as_f64().expect("a share");
                prop_assert!(!is_trusted || exact >= 0.999, "{options}: {row}");
                // Nobody sees the steps of whole peaks behind a perfect lens.
                prop_assert!(!is_trusted || shape != "perfect" && sigma != "0.0", "{row}");
                bench.says(0, &format!("unwrap @/simulated/{at}_alpha3_modulo.png {SENSOR} {options} -o @/unwrapped"));
                let row = &bench.json("unwrapped/results.json")[0];
                let unwrapped = outcome(&bench, &format!("unwrapped/{at}_alpha3_modulo_auto.png"), row);
                std::fs::remove_dir_all(bench.path("unwrapped")).expect("a folder");
                prop_assert_eq!(&unwrapped, &(picture.clone(), is_trusted, method.clone()), "unwrap {}", options.clone());
                expected.insert(picture, (is_trusted, method));
            }
            std::fs::remove_dir_all(bench.path("simulated")).expect("a folder");
            // Two images may be alike.
            prop_assert_eq!(live(&bench, lens, expected.len()), expected, "the nodes, {}", options);
            // A grid varies the width of a Gaussian only.
            if shape != "gaussian" {
                continue;
            }
            let of_eval = rows.iter().map(|row| (row["exact_k"].as_f64().expect("a share"), row["trusted"] == true));
            prop_assert_eq!(evaluated(&bench, lens), of_eval.collect::<Vec<_>>(), "eval {}", options);
        }
    }
}
