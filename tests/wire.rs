//! What crosses the wire: bags of a run, replays, live parameters.

mod harness;

use std::path::Path;
use std::time::Duration;

use harness::{Background, Bench, arg, json, model, text, wait_until};
use modulo_bags::bag::{BagReader, Selection};
use modulo_msgs::cdr;
use modulo_msgs::sensor_msgs::Image;
use modulo_msgs::vision_msgs::Detection2DArray;

/// Every detection message of a bag.
fn detections(bag: &Path) -> Vec<Detection2DArray> {
    let bag = BagReader::open(bag).expect("a whole bag");
    let messages = bag.messages(&Selection::of(["/detector/detections"]));
    messages.map(|m| cdr::from_slice(&m.expect("readable").data).expect("detections")).collect()
}

fn images(bag: &Path, topic: &str) -> Vec<Image> {
    let bag = BagReader::open(bag).expect("a whole bag");
    let messages = bag.messages(&Selection::of([topic]));
    messages.map(|m| cdr::from_slice(&m.expect("readable").data).expect("an image")).collect()
}

/// A recording that has begun.
fn record(bench: &Bench, bag: &Path) -> Background {
    let recording = bench.start(&["bag", "record", "-o", bag.to_str().expect("UTF-8")]);
    wait_until("the bag's folder", || bag.is_dir());
    recording
}

#[test]
fn a_recorded_run_replayed_gives_the_same_boxes() {
    let bench = Bench::new();
    let source = arg("source", bench.images(5));
    let model = arg("model", model());
    let (live, again) = (bench.path("live"), bench.path("again"));

    let recording = record(&bench, &live);
    let output =
        bench.run(&["launch", "launch/recovered.launch.yaml", &source, &model, "engine:=rten", "rate:=4"]);
    assert_eq!(output.status.code(), Some(0), "{}", text(&output));
    assert_eq!(recording.interrupt(), Some(0));
    let first = detections(&live);
    assert_eq!(first.len(), 5);
    let modulo = images(&live, "/modulo");
    for (array, image) in first.iter().zip(&modulo) {
        assert_eq!(array.header, image.header, "a result carries stamp and frame of its image");
        for detection in &array.detections {
            let bbox = detection.to_detection().expect("a class").bbox;
            assert!(bbox.x1 >= 0.0 && bbox.y1 >= 0.0 && bbox.x2 <= 96.0 && bbox.y2 <= 64.0, "{bbox:?}");
        }
    }

    let recording = record(&bench, &again);
    let replayed = live.display().to_string();
    let bag = arg("bag", &replayed);
    let output =
        bench.run(&["launch", "launch/replay.launch.yaml", &bag, &model, "engine:=rten", "play_rate:=0.5"]);
    assert_eq!(output.status.code(), Some(0), "{}", text(&output));
    assert_eq!(recording.interrupt(), Some(0));
    assert_eq!(detections(&again), first);
}

#[test]
fn the_input_is_swapped_while_the_suite_runs() {
    let bench = Bench::new();
    let source = arg("source", bench.images(4));
    let model = arg("model", model());
    let (bag, summary) = (bench.path("bag"), bench.path("summary.json"));
    let recording = record(&bench, &bag);
    let running = bench.start(&[
        "launch",
        "launch/recovered.launch.yaml",
        &source,
        &model,
        "engine:=rten",
        "rate:=10",
        "loop:=true",
        "--summary",
        &summary.display().to_string(),
    ]);
    wait_until("the detector", || {
        let got = bench.run(&["param", "get", "/detector", "input"]);
        text(&got).contains("recovered")
    });
    let swapped = bench.run(&["param", "set", "/detector", "input", "modulo"]);
    assert_eq!(swapped.status.code(), Some(0), "{}", text(&swapped));
    let refused = bench.run(&["param", "set", "/detector", "input", "recoverd"]);
    assert_eq!(refused.status.code(), Some(1));
    assert!(
        text(&refused).contains("recoverd") && text(&refused).contains("saturated"),
        "{}",
        text(&refused)
    );
    assert!(text(&bench.run(&["param", "get", "/detector", "input"])).contains("modulo"));
    // Frames of the new stream are answered, and counted for it.
    let counted = || json(&summary)["detections"]["modulo"]["car"].as_u64() > Some(3);
    std::thread::sleep(Duration::from_millis(500));
    assert_eq!(running.interrupt(), Some(0));
    assert_eq!(recording.interrupt(), Some(0));
    assert!(detections(&bag).len() > 3 && counted(), "{}", json(&summary));
}

/// A message that is no image is counted and skipped; the node lives.
#[test]
fn a_bad_frame_on_a_topic_is_skipped() {
    use modulo_bags::bag::{BagTopic, BagWriter, Compression};
    use modulo_runtime::Qos;

    let bench = Bench::new();
    let source = arg("source", bench.images(1));
    let bag = bench.path("bad");
    let mut writer = BagWriter::create(&bag, Compression::None).expect("a new bag");
    let topic =
        writer.topic(&BagTopic::new("/modulo", "sensor_msgs/msg/Image", Qos::Images)).expect("a topic");
    let good = Image::from_frame(
        Default::default(),
        &modulo_core::Frame::from_u8(ndarray::Array3::zeros((64, 96, 3))).expect("a frame"),
    );
    let mut odd = good.clone();
    odd.encoding = "bayer_rggb8".into();
    let good = cdr::to_vec(&good).expect("encodes");
    let payloads = [good.clone(), good[..200].to_vec(), cdr::to_vec(&odd).expect("encodes"), vec![], good];
    for (number, payload) in (0u64..).zip(&payloads) {
        let time = number * 200_000_000 + 1;
        writer.write(topic, time, time, payload).expect("writable");
    }
    writer.finish().expect("writable");

    let summary = bench.path("summary.json");
    let (bag, model) = (arg("bag", &bag), arg("model", model()));
    let file = summary.display().to_string();
    let arguments =
        ["launch", "launch/replay.launch.yaml", "engine:=rten", "bits:=8", "alpha:=4.0", "--summary", &file];
    let output = bench.run(&[&arguments[..], &[&bag, &model]].concat());
    assert_eq!(output.status.code(), Some(3), "done, but something was lost: {}", text(&output));
    let summary = harness::json(&summary);
    assert_eq!(summary["topics"]["/modulo"]["bad"], 3, "{summary}");
    assert_eq!(summary["topics"]["/detector/detections"]["out"], 2, "{summary}");
    drop(source);
}
