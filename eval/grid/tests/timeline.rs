//! The frames of several sources in one bag: each has its own time stamp and labels.

use std::path::Path;
use std::time::Duration;

use modulo_bags::bag::{BagReader, BagWriter, Compression, Selection};
use modulo_bags::import::import_kitti;
use modulo_bags::source::{GroundTruth, SourceOptions, open};
use modulo_camera::{CameraParameters, ModuloCamera};
use modulo_core::Frame;
use modulo_eval::launch_file::{Evaluation, EvaluationPlan};
use modulo_eval::results::Difficulty;
use modulo_images::save_png;
use modulo_runtime::driver::lockstep::Lockstep;
use modulo_runtime::{ManualClock, NodeName, ParameterSet as _};
use ndarray::Array3;

/// Writes a KITTI folder of `frames` images. All pixels, and the x of an object, have the value `seed`, `seed` + 8, ...
fn write_kitti(folder: &Path, frames: u8, seed: u8) {
    for name in ["image_2", "label_2"] {
        std::fs::create_dir_all(folder.join(name)).expect("a folder");
    }
    for value in (0..frames).map(|number| seed + 8 * number) {
        let frame = Frame::from_u8(Array3::from_elem((64, 200, 3), value)).expect("a frame");
        save_png(&folder.join(format!("image_2/{value:06}.png")), &frame).expect("a PNG");
        let label = format!("Car 0.00 0 0.00 {value}.00 0.00 190.00 60.00 1 1 1 0 0 0 0\n");
        std::fs::write(folder.join(format!("label_2/{value:06}.txt")), label).expect("a label");
    }
}

/// Evaluates a camera at rate 0 over each of `sources`, and records into `bag`.
fn record(sources: &[&Path], more: &[(&str, &str)], bag: &Path) {
    let mut recorder = BagWriter::create(bag, Compression::None).expect("a new bag");
    let mut evaluation = Evaluation::new(Difficulty::Moderate);
    let topics = ["/ideal", "/ground_truth"].map(str::to_owned).to_vec();
    let plan = EvaluationPlan {
        interval: Duration::ZERO,
        streams: Vec::new(),
        truth: Some(topics[1].clone()),
        save_images: false,
        folder: bag.with_extension("out"),
        bagged: topics.clone(),
    };
    for source in sources {
        let source = source.to_str().expect("UTF-8");
        let pairs = [&[("source", source), ("rate", "0")], more].concat();
        let parameters = CameraParameters::from_text(&pairs).expect("possible");
        let timer = ManualClock::default();
        let mut chain = Lockstep::new(&timer, topics.clone());
        let camera = ModuloCamera::new(&parameters).expect("a camera");
        chain.add(Box::new(camera), &NodeName::new("camera", "/", &[]).expect("a name")).expect("a node");
        evaluation.add(&mut chain, 0, &plan, Some(&mut recorder), &|_| {}).expect("evaluated");
    }
    recorder.finish().expect("finished");
}

/// Checks that the images of `bag` are those of `expected`, in this order, at strictly increasing times, each with its
/// own object.
fn check(bag: &Path, expected: &[u8]) {
    let reader = BagReader::open(bag).expect("a bag");
    for topic in ["/ideal", "/ground_truth"] {
        let messages = reader.messages(&Selection::of([topic]));
        let times: Vec<u64> = messages.map(|message| message.expect("readable").log_time).collect();
        assert_eq!(times.len(), expected.len(), "{topic}");
        assert!(times.windows(2).all(|pair| pair[0] < pair[1]), "{topic}: {times:?}");
    }
    let options = SourceOptions { topic: Some("/ideal".into()), ..SourceOptions::default() };
    let mut source = open(bag.to_str().expect("UTF-8"), &options).expect("a source");
    let frames = std::iter::from_fn(|| source.next()).map(|frame| frame.expect("whole"));
    let found: Vec<(u8, f32)> = frames
        .map(|frame| {
            let truth: Vec<GroundTruth> = frame.ground_truth.expect("labelled");
            let [object] = &truth[..] else { panic!("one object: {truth:?}") };
            ((frame.radiance[[0, 0, 0]] * 256.0).round() as u8, object.bbox.x1)
        })
        .collect();
    let objects: Vec<f32> = expected.iter().map(|value| f32::from(*value)).collect();
    assert_eq!(found.iter().map(|(_, x1)| *x1).collect::<Vec<_>>(), objects, "{found:?}");
    let pixels: Vec<u8> = found.iter().map(|(pixel, _)| *pixel).collect();
    assert!(
        pixels.windows(2).zip(expected.windows(2)).all(|(a, b)| a[0].cmp(&a[1]) == b[0].cmp(&b[1])),
        "{pixels:?}"
    );
}

#[test]
fn sources_without_stamps_follow_each_other() {
    let folder = tempfile::tempdir().expect("a folder");
    let [a, b] = ["a", "b"].map(|name| folder.path().join(name));
    write_kitti(&a, 3, 10);
    write_kitti(&b, 2, 60);
    let bag = folder.path().join("bag");
    record(&[&a, &b], &[], &bag);
    check(&bag, &[10, 18, 26, 60, 68]);
    let looped = folder.path().join("looped");
    record(&[&b, &a], &[("loop", "true"), ("frames", "4")], &looped);
    check(&looped, &[60, 68, 60, 68, 10, 18, 26, 10]);
}

/// Imported drives start at the same time stamp.
#[test]
fn sources_with_the_same_stamps_follow_each_other() {
    let folder = tempfile::tempdir().expect("a folder");
    let bags = [("a", 10), ("b", 60)].map(|(name, seed)| {
        let (kitti, bag) = (folder.path().join(name), folder.path().join(format!("{name}_bag")));
        write_kitti(&kitti, 2, seed);
        import_kitti(&kitti, &bag, Compression::None).expect("imported");
        bag
    });
    let bag = folder.path().join("bag");
    record(&[&bags[0], &bags[1]], &[("loop", "true"), ("frames", "3")], &bag);
    check(&bag, &[10, 18, 10, 60, 68, 60]);
    // A plain copy of both bags is refused, because it has two labels with one stamp.
    let error = both(&bags, &folder.path().join("both"));
    assert!(error.contains("other labels") && error.contains("/ground_truth"), "{error}");
}

/// Copies the messages of all `bags` into one, and opens it.
fn both(bags: &[std::path::PathBuf], out: &Path) -> String {
    let mut recorder = BagWriter::create(out, Compression::None).expect("a new bag");
    for bag in bags {
        for message in BagReader::open(bag).expect("a bag").messages(&Selection::default()) {
            let message = message.expect("readable");
            let (log_time, publish_time) = (message.log_time, message.publish_time);
            recorder.record(&message.topic, log_time, publish_time, &message.data).expect("written");
        }
    }
    recorder.finish().expect("finished");
    open(out.to_str().expect("UTF-8"), &SourceOptions::default()).err().expect("refused").to_string()
}
