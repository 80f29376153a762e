//! The camera node's step, without transport.

#[path = "../../../tests/harness/data.rs"]
#[allow(dead_code, reason = "these tests need no data")]
mod data;
#[path = "../../../tests/harness/encoder.rs"]
mod encoder;
#[path = "../../../tests/harness/readings.rs"]
#[allow(dead_code, reason = "these tests need whole recordings only")]
mod readings;

use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use modulo_bags::bag::{BagTopic, BagWriter, Compression};
use modulo_camera::{CameraParameters, ModuloCamera};
use modulo_core::{Frame, Mosaic};
use modulo_msgs::diagnostic_msgs::{DiagnosticArray, DiagnosticStatus, KeyValue};
use modulo_msgs::image::encode_frame;
use modulo_msgs::sensor_msgs::{CameraInfo, RegionOfInterest};
use modulo_msgs::std_msgs::{Header, Time};
use modulo_runtime::sensor_info::SensorHistory;
use modulo_runtime::{
    Context, Flow, ManualClock, Message, Node, ParameterError, ParameterSet as _, Parameters, Qos,
    StampedFrame, StepError, StepOutput, Trigger,
};
use ndarray::Array3;

/// The streams and the ground truth are wanted.
const ALL: [bool; 4] = [true; 4];

/// The output of the camera with automatic exposure, which alone is wanted.
const AUTO_EXPOSED: usize = 6;
const ONLY_AUTO_EXPOSED: [bool; 7] = [false, false, false, false, false, false, true];

/// The parameters with these changes, without a lens and black columns where the changes have none: the images are small.
fn parameters(changes: &[(&str, &str)]) -> CameraParameters {
    let bare = [("psf_sigma", "0"), ("optical_black", "0")];
    CameraParameters::from_text(&[&bare, changes].concat()).expect("possible")
}

fn camera(changes: &[(&str, &str)]) -> ModuloCamera {
    ModuloCamera::new(&parameters(changes)).expect("a camera")
}

fn step(
    node: &mut ModuloCamera,
    trigger: Trigger,
    wanted: &[bool],
) -> Result<(Flow, Vec<(usize, Message)>), StepError> {
    let clock = ManualClock::at(5_000_000_007);
    let mut cx = Context::new("/modulo_camera", &clock, wanted);
    let flow = node.step(trigger, &mut cx)?;
    let StepOutput { messages, .. } = cx.finish();
    Ok((flow, messages))
}

/// The (height, width) of the next frame, as the camera tells them before the frame is due.
fn introduced(node: &mut ModuloCamera) -> (usize, usize) {
    let clock = ManualClock::at(0);
    let mut cx = Context::new("/modulo_camera", &clock, &ALL);
    node.introduce(&mut cx);
    let messages = cx.finish().messages;
    let [(4, Message::Diagnostics(info))] = &messages[..] else { panic!("a description: {messages:?}") };
    let mut history = SensorHistory::default();
    history.note(info).expect("a sensor");
    history.size().expect("a size")
}

fn frame(messages: &[(usize, Message)], output: usize) -> &StampedFrame {
    let found = messages.iter().find(|(index, _)| *index == output).map(|(_, message)| message);
    let Some(Message::Image(image)) = found else { panic!("no image on output {output}") };
    image
}

/// A 16-bit ramp as one PNG, in steps of 8 of 512 counts. Each value is far from the next count, so that its dither changes
/// none.
fn ramp(folder: &Path) -> String {
    let path = folder.join("ramp.png");
    let pixels = Array3::from_shape_fn((4, 64, 3), |(_, j, _)| (8 * j * 128 + 64) as u16);
    modulo_images::save_png(&path, &Frame::from_u16(pixels).expect("a frame")).expect("writable");
    path.display().to_string()
}

#[test]
fn the_streams_follow_equation_one() {
    let folder = tempfile::tempdir().expect("a folder");
    let mut node = camera(&[("source", &ramp(folder.path())), ("alpha", "2"), ("headroom", "1")]);
    let (flow, sent) = step(&mut node, Trigger::Tick, &ALL).expect("a frame");
    assert_eq!(flow, Flow::Continue);
    let [modulo, saturated] = [0, 1].map(|output| frame(&sent, output).frame.as_u8().expect("8 bits"));
    for j in 0..64 {
        let codes = [modulo, saturated].map(|codes| usize::from(codes[(0, j, 0)]));
        assert_eq!(codes, [8 * j % 256, (8 * j).min(255)], "{j}");
    }
    let expected = Header { stamp: Time::from_ns(5_000_000_007), frame_id: "camera_optical".into() };
    assert!((0..3).all(|output| frame(&sent, output).header == expected));
    assert_eq!(step(&mut node, Trigger::Tick, &ALL).expect("the end").0, Flow::Done);
}

#[test]
fn a_picture_is_decoded_into_radiance_and_the_ideal_image_is_that_picture_again() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("picture.png");
    let picture =
        Array3::from_shape_fn((4, 256, 3), |(i, j, c)| if i % 2 == 0 { j as u8 } else { (j + 80 * c) as u8 });
    modulo_images::save_png(&path, &Frame::from_u8(picture.clone()).expect("a frame")).expect("writable");
    let path = path.display().to_string();
    for transfer in ["linear", "srgb", "gamma22", "rec709"] {
        let mut node = camera(&[("source", &path), ("bits", "16"), ("transfer", transfer)]);
        let (_, sent) = step(&mut node, Trigger::Tick, &ALL).expect("a frame");
        let ideal = frame(&sent, 2).frame.as_u8().expect("8 bits");
        // A power of 2.2 leaves the darkest codes less than a count of the sensor.
        for ((at, shown), code) in ideal.indexed_iter().zip(&picture).filter(|(_, code)| **code > 3) {
            assert!(shown.abs_diff(*code) <= 1, "{transfer} {at:?}: {code} is shown as {shown}");
        }
        let x = f64::from(frame(&sent, 1).frame.to_f32()[(0, 20, 0)]);
        // A code of 20 is far below the peak, a quarter of full scale: the saturated image shows it brighter.
        assert!(x > 20.0 * 257.0, "{transfer}: {x}");
    }
}

/// Floats are radiance: a transfer function changes how they are shown, and not the light that the sensor sees.
#[test]
fn floats_are_not_decoded() {
    let pixels = Array3::from_shape_fn((2, 64, 3), |(_, j, _)| j as f32 / 64.0);
    let header = Header::default();
    let image = Arc::new(StampedFrame { header, frame: Frame::from_f32(pixels).expect("a frame") });
    let sent = |transfer| {
        let mut node = camera(&[("source", "topic:/front/hdr"), ("white", "1"), ("transfer", transfer)]);
        let trigger = Trigger::Message { input: 0, message: Message::Image(image.clone()) };
        step(&mut node, trigger, &ALL).expect("a frame").1
    };
    let (linear, coded) = (sent("linear"), sent("srgb"));
    assert_eq!(frame(&linear, 0), frame(&coded, 0));
    assert_ne!(frame(&linear, 2), frame(&coded, 2));
}

#[test]
fn a_scene_brings_its_truth_before_its_images() {
    let mut node = camera(&[("source", "scene://day?seed=3&frames=2&width=320&height=96")]);
    let (_, sent) = step(&mut node, Trigger::Tick, &ALL).expect("a frame");
    let (output, Message::Detections(truth)) = &sent[0] else { panic!("truth comes first") };
    assert_eq!(*output, 3);
    assert!(!truth.detections.is_empty());
    assert_eq!(truth.header, frame(&sent, 0).header);
}

#[test]
fn noise_depends_on_seed_and_frame_alone() {
    let run = |seed: &str, wanted: &[bool]| {
        let scene = ("source", "scene://night?seed=1&frames=3&width=96&height=32");
        let mut node = camera(&[scene, ("read_noise", "3"), ("shot_noise", "0.1"), ("seed", seed)]);
        let mut last = None;
        for _ in 0..3 {
            let (_, sent) = step(&mut node, Trigger::Tick, wanted).expect("a frame");
            last = Some(frame(&sent, 0).frame.clone());
        }
        last
    };
    let alone = [true, false, false, false];
    assert_eq!(run("7", &ALL), run("7", &alone), "whoever else listens");
    assert_ne!(run("7", &ALL), run("8", &ALL));
}

#[test]
fn a_sensor_has_the_mosaic_and_the_noise_of_its_data_sheet() {
    let scene = ("source", "scene://day?seed=1&frames=1&width=96&height=64");
    let run = |changes: &[(&str, &str)]| {
        let mut node = camera(&[&[scene][..], changes].concat());
        frame(&step(&mut node, Trigger::Tick, &ALL).expect("a frame").1, 0).frame.clone()
    };
    let mosaic = run(&[("mosaic", "gbrg")]);
    assert_eq!((mosaic.dim(), mosaic.mosaic()), ((64, 96, 1), Some(Mosaic::Gbrg)));
    // 2^8 codes over 5120 electrons are shot noise of 0.05.
    assert_eq!(run(&[("full_well_electrons", "5120")]), run(&[("shot_noise", "0.05")]));
    assert_ne!(run(&[("full_well_electrons", "5120")]), run(&[]));
    assert_ne!(run(&[("prnu", "0.01")]), run(&[]));
    assert_ne!(run(&[("hot_pixels", "0.01")]), run(&[]));
    assert_ne!(run(&[("reset_loss", "10")]), run(&[]));
}

#[test]
fn limit_loop_and_period_are_as_asked() {
    let folder = tempfile::tempdir().expect("a folder");
    let source = ramp(folder.path());
    let mut node = camera(&[("source", &source), ("loop", "true"), ("frames", "3"), ("rate", "4")]);
    assert_eq!(node.period(), Some(Duration::from_millis(250)));
    let flows: Vec<_> = (0..3).map(|_| step(&mut node, Trigger::Tick, &ALL).expect("a frame").0).collect();
    assert_eq!(flows, [Flow::Continue, Flow::Continue, Flow::Done]);
}

#[test]
fn a_topic_is_sensed_with_its_header() {
    let mut node = camera(&[("source", "topic:/front/image_raw"), ("alpha", "2"), ("headroom", "1")]);
    assert_eq!(node.inputs()[0].name, "/front/image_raw");
    assert_eq!(node.period(), None);
    let header = Header { stamp: Time::from_ns(42), frame_id: "front".into() };
    let pixels = Array3::from_elem((2, 2, 1), 40_000u16);
    let image =
        Arc::new(StampedFrame { header: header.clone(), frame: Frame::from_u16(pixels).expect("a frame") });
    let trigger = Trigger::Message { input: 0, message: Message::Image(image) };
    let (_, sent) = step(&mut node, trigger, &ALL).expect("a frame");
    assert_eq!(frame(&sent, 0).header, header);
    // 2 * 256 * 40000 / 65536 = 312.5
    assert_eq!(frame(&sent, 0).frame.as_u8().expect("8 bits")[(0, 0, 0)], 56);
}

/// A calibrated camera of 4 x 2 px that is binned to 2 x 1 px.
fn calibration() -> CameraInfo {
    CameraInfo {
        header: Header { stamp: Time::from_ns(1), frame_id: "lens".into() },
        height: 2,
        width: 4,
        distortion_model: "plumb_bob".into(),
        d: vec![-0.3, 0.1, 0.0, 0.002, 0.0],
        k: [700.0, 0.0, 2.0, 0.0, 701.0, 1.0, 0.0, 0.0, 1.0],
        r: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
        p: [699.0, 0.0, 2.0, -50.0, 0.0, 699.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0],
        binning_x: 2,
        binning_y: 2,
        roi: RegionOfInterest::default(),
    }
}

/// The camera info that a camera at the topic `source` sends with an image of (height, width), after it has had `info`.
fn camera_info(
    source: &str,
    info: Option<CameraInfo>,
    (height, width): (usize, usize),
) -> Option<CameraInfo> {
    let mut node = camera(&[("source", &format!("topic:{source}"))]);
    let beside: Vec<_> = node.inputs().into_iter().skip(1).map(|topic| topic.name).collect();
    assert_eq!(beside, [source.replace("image_raw", "camera_info")]);
    if let Some(info) = info {
        let trigger = Trigger::Message { input: 1, message: Message::CameraInfo(info.into()) };
        let (flow, sent) = step(&mut node, trigger, &[true; 6]).expect("taken");
        assert!(flow == Flow::Continue && sent.is_empty());
    }
    let header = Header { stamp: Time::from_ns(42), frame_id: "front".into() };
    let frame = Frame::from_u8(Array3::zeros((height, width, 3))).expect("a frame");
    let message = Message::Image(StampedFrame { header: header.clone(), frame }.into());
    let (_, sent) = step(&mut node, Trigger::Message { input: 0, message }, &[true; 6]).expect("a frame");
    let found = sent.into_iter().find_map(|(_, message)| match message {
        Message::CameraInfo(info) => Some(CameraInfo::clone(&info)),
        _ => None,
    });
    assert!(found.as_ref().is_none_or(|info| info.header == header));
    found
}

#[test]
fn the_calibration_of_the_source_is_passed_on_with_each_image() {
    let sent = |info, size| camera_info("/front/image_raw", info, size).expect("a camera info");
    let header = Header { stamp: Time::from_ns(42), frame_id: "front".into() };
    let binned = calibration();
    assert_eq!(sent(Some(binned.clone()), (1, 2)), CameraInfo { header: header.clone(), ..binned.clone() });
    let roi = RegionOfInterest { x_offset: 1, width: 2, height: 2, ..RegionOfInterest::default() };
    let region = CameraInfo { roi, binning_x: 0, binning_y: 0, ..binned.clone() };
    assert_eq!(sent(Some(region.clone()), (2, 2)), CameraInfo { header: header.clone(), ..region.clone() });
    // A calibration of other images would be wrong, one without a focal length says nothing.
    let unknown = CameraInfo { header, height: 2, width: 4, ..CameraInfo::default() };
    for info in [None, Some(binned), Some(region), Some(CameraInfo { k: [0.0; 9], ..calibration() })] {
        assert_eq!(sent(info, (2, 4)), unknown);
    }
}

/// In the namespace of the source, its camera info is beside the images of this camera already.
#[test]
fn a_camera_info_of_the_source_is_not_sent_a_second_time() {
    for source in ["/image_raw", "image_raw"] {
        assert_eq!(camera_info(source, None, (2, 4)), None, "{source}");
        assert!(camera_info(source, Some(calibration()), (1, 2)).is_some(), "its own topic is remapped");
    }
}

/// A structure can hold what the services would refuse; the node refuses it as well.
#[test]
fn a_value_out_of_range_is_refused_before_it_is_used() {
    let mut below = parameters(&[("source", "scene://day?frames=1")]);
    below.sensor.read_noise = -1.0;
    let refusal = ModuloCamera::new(&below).err().expect("refused").to_string();
    assert!(refusal.contains("'read_noise' = -1") && refusal.contains("0 to 65536"), "{refusal}");
}

#[test]
fn both_ends_of_each_range_are_a_sensor() {
    for (alpha, noise, sigma) in [("0.001", "0", "0"), ("256", "65536", "100")] {
        let pairs = [("alpha", alpha), ("read_noise", noise), ("shot_noise", noise), ("psf_sigma", sigma)];
        assert!(parameters(&pairs).sensor.simulated().is_ok(), "{pairs:?}");
    }
}

/// A folder of `count` different images.
fn folder_of(count: u8) -> tempfile::TempDir {
    let folder = tempfile::tempdir().expect("a folder");
    for number in 0..count {
        let pixels = Array3::from_elem((4, 8, 1), 20 * number);
        let path = folder.path().join(format!("{number}.png"));
        modulo_images::save_png(&path, &Frame::from_u8(pixels).expect("a frame")).expect("writable");
    }
    folder
}

/// Another source starts with its first frame; one that cannot be opened leaves the camera as it is.
#[test]
fn the_source_is_exchanged_or_refused() {
    let (one, two) = (folder_of(3), folder_of(5));
    let declared = Parameters::declare(CameraParameters::descriptors());
    let with =
        |source: &str| declared.with_text(&[("source", source), ("optical_black", "0")]).expect("possible");
    let [one, two] = [&one, &two].map(|folder| folder.path().display().to_string());
    let mut node = camera(&[("source", &one)]);
    let mean = |node: &mut ModuloCamera| {
        let (_, sent) = step(node, Trigger::Tick, &ALL).expect("a frame");
        frame(&sent, 2).frame.to_f32().mean().expect("pixels")
    };
    let [first, second] = [mean(&mut node), mean(&mut node)];
    let part = node.prepare(&with(&one), &with(&two)).expect("another source")().expect("it opens");
    node.exchange(&with(&two), part).expect("possible");
    assert_eq!((node.position(), [mean(&mut node), mean(&mut node)]), (Some(0), [first, second]));
    assert!(node.state().contains(&("source", two.clone())));
    let refused = node.prepare(&with(&two), &with("/no/such")).expect("another source")().err();
    assert!(refused.expect("refused").to_string().contains("/no/such"));
    let unopened =
        node.configure(&with(&one)).expect_err("a node opens nothing between two frames").to_string();
    assert!(unopened.contains("was not opened"), "{unopened}");
    assert_eq!(node.position(), Some(2));
    // From frames to a topic and back.
    assert_eq!(node.inputs_with(&with("topic:/front")).expect("possible").first[0].name, "/front");
    change_parameters(&mut node, &with(&two), &with("topic:/front")).expect("possible");
    assert_eq!((node.inputs()[0].name.as_str(), node.inputs().len(), node.period()), ("/front", 2, None));
    for bad in ["topic:", "topic:a b", "topic:/x//y"] {
        let why = change_parameters(&mut node, &with("topic:/front"), &with(bad)).expect_err(bad).to_string();
        assert!(why.contains(bad) && why.contains("topic:/camera/image_raw"), "{why}");
    }
    change_parameters(&mut node, &with("topic:/front"), &with(&one)).expect("possible");
    assert_eq!((node.inputs().len(), node.period()), (0, Some(Duration::ZERO)));
}

/// Writes a video of five frames; without ffmpeg this part of the test is skipped.
fn write_video(path: &Path) -> bool {
    if let Err(why) = modulo_video::version() {
        data::skip(&why);
        return false;
    }
    encoder::write_video(path, (96, 32), (0..5_u8).map(|n| vec![40 * n + 20; 96 * 32 * 3]));
    true
}

/// A camera that goes on after a crash sends what it would have sent without one, noise included.
#[test]
fn it_goes_on_behind_the_last_frame() {
    let folder = folder_of(5);
    let images = folder.path().display().to_string();
    let scene = "scene://night?seed=1&frames=5&width=96&height=32";
    let video = folder.path().join("drive.mp4");
    let video = write_video(&video).then(|| video.display().to_string());
    let sources = [Some(images), Some(scene.to_owned()), video].into_iter().flatten();
    let rounds = sources.flat_map(|source| [(source.clone(), "false"), (source, "true")]);
    for (source, repeat) in rounds {
        let source = source.as_str();
        let noisy = [("source", source), ("loop", repeat), ("read_noise", "3"), ("frames", "12")];
        let frames = |node: &mut ModuloCamera| {
            let mut sent = Vec::new();
            while let Ok((flow, messages)) = step(node, Trigger::Tick, &ALL) {
                if !messages.is_empty() {
                    sent.push(frame(&messages, 0).frame.clone());
                }
                if flow == Flow::Done {
                    break;
                }
            }
            sent
        };
        let mut whole = camera(&noisy);
        let all = frames(&mut whole);
        assert_eq!(all.len(), if repeat == "true" { 12 } else { 5 }, "{source}");
        assert_eq!(whole.position(), Some(all.len() as u64));
        // At every frame, because a crash may come at any of them.
        for position in 0..all.len() {
            let mut again = camera(&noisy);
            again.resume(position as u64);
            let (height, width, _) = all[position].dim();
            assert_eq!([(); 2].map(|()| introduced(&mut again)), [(height, width); 2], "{source}");
            assert_eq!(again.position(), Some(position as u64));
            assert_eq!(frames(&mut again), all[position..], "{source}, loop {repeat}, behind {position}");
        }
    }
}

/// Codes of 12 bits are refused until a larger one has come, which may have been in an earlier round.
#[test]
fn a_crash_in_a_later_round_changes_no_frame() {
    let folder = tempfile::tempdir().expect("a folder");
    for (number, code) in [3000, 60_000, 2000].into_iter().enumerate() {
        let image = Frame::from_u16(Array3::from_elem((4, 6, 1), code)).expect("a frame");
        modulo_images::save_png(&folder.path().join(format!("{number}.png")), &image).expect("writable");
    }
    let source = folder.path().display().to_string();
    let settings = [("source", source.as_str()), ("loop", "true"), ("frames", "8")];
    let sent = |node: &mut ModuloCamera, count: usize| -> Vec<Option<Frame>> {
        let mut next = || step(node, Trigger::Tick, &ALL).ok().map(|(_, sent)| frame(&sent, 0).frame.clone());
        std::iter::repeat_with(&mut next).take(count).collect()
    };
    let whole = sent(&mut camera(&settings), 8);
    assert_eq!(whole.iter().filter(|frame| frame.is_none()).count(), 1, "only the first one is refused");
    for position in 0..8 {
        let mut again = camera(&settings);
        again.resume(position as u64);
        assert_eq!(sent(&mut again, 8 - position), whole[position..], "behind {position}");
    }
}

/// The camera describes no frame that is missing or cannot be read; such a frame counts when it is due.
#[test]
fn a_camera_without_a_good_first_frame_tells_nothing_before_it() {
    let folder = folder_of(2);
    std::fs::write(folder.path().join("0.png"), "no image").expect("writable");
    let mut node = camera(&[("source", &folder.path().display().to_string())]);
    let clock = ManualClock::at(0);
    let mut cx = Context::new("/modulo_camera", &clock, &ALL);
    node.introduce(&mut cx);
    assert!(cx.finish().messages.is_empty());
    assert!(
        matches!(step(&mut node, Trigger::Tick, &ALL), Err(StepError::Skip(why)) if why.contains("0.png"))
    );
    assert_eq!(introduced(&mut node), (4, 8));
}

#[test]
fn a_bad_image_is_skipped_and_a_source_without_a_good_one_is_not_repeated() {
    // With the number of skipped images, the index of the last step, and whether it is a failure.
    for (bad, repeat, expected, fails) in [
        (&[1][..], "false", (1, Some(3)), false),
        // 7 frames: two rounds and one more.
        (&[1], "true", (2, Some(6)), false),
        // Each was skipped and counted; nothing else is wrong.
        (&[0, 1, 2], "false", (3, Some(3)), false),
        (&[0, 1, 2], "true", (3, Some(3)), true),
    ] {
        let folder = folder_of(3);
        for number in bad {
            std::fs::write(folder.path().join(format!("{number}.png")), "no picture").expect("writable");
        }
        let source = folder.path().display().to_string();
        let mut node = camera(&[("source", &source), ("loop", repeat), ("frames", "7")]);
        let mut next = || step(&mut node, Trigger::Tick, &ALL).map(|(flow, _)| flow);
        let steps: Vec<_> = std::iter::repeat_with(&mut next).take(9).collect();
        let ended = steps.iter().position(|s| *s == Ok(Flow::Done) || matches!(s, Err(StepError::Fatal(_))));
        let is_skipped = |s: &&Result<_, _>| matches!(s, Err(StepError::Skip(why)) if why.contains(".png"));
        let last = ended.expect("it ends");
        assert_eq!((steps[..last].iter().filter(is_skipped).count(), ended), expected, "{bad:?} {repeat}");
        let has_failed = matches!(&steps[last], Err(StepError::Fatal(why)) if why.contains("2.png"));
        assert_eq!(has_failed, fails, "{steps:?}");
    }
}

/// Writes a bag of these images, 2 s apart.
fn write_bag(path: &Path, images: &[Frame]) {
    let mut bag = BagWriter::create(path, Compression::None).expect("a new bag");
    let topic = bag.topic(&BagTopic::new("/image", "sensor_msgs/msg/Image", Qos::Images)).expect("a topic");
    for (stamp, image) in (0..).step_by(2_000_000_000).zip(images) {
        let header = Header { stamp: Time::from_ns(stamp), frame_id: String::new() };
        bag.write(topic, stamp, stamp, &encode_frame(&header, image).expect("short")).expect("written");
        bag.settle(stamp).expect("flushed");
    }
    bag.finish().expect("finished");
}

/// A raw mosaic of companded codes is the same scene from a folder, a bag and a topic, and is sensed as the mosaic that it is.
#[test]
fn a_raw_mosaic_is_sensed_as_it_is_from_a_folder_a_bag_and_a_topic() {
    let folder = tempfile::tempdir().expect("a folder");
    // The codes of 12 bits from 64 to 3967, all of them.
    let codes = |start: usize| {
        let pixels =
            Array3::from_shape_fn((64, 64, 1), |(i, j, _)| (64 + (start + 64 * i + j) % 3904) as u16);
        Frame::from_u16(pixels).expect("a frame")
    };
    let (images, bag) = (folder.path().join("images"), folder.path().join("bag"));
    std::fs::create_dir(&images).expect("a new folder");
    let frames = [codes(0), codes(1000)];
    for (number, frame) in frames.iter().enumerate() {
        modulo_images::save_png(&images.join(format!("{number}.png")), frame).expect("writable");
    }
    let mosaics = frames.map(|frame| frame.with_mosaic(Mosaic::Grbg).expect("one channel"));
    write_bag(&bag, &mosaics);
    let sensor = [
        ("knees", "1023:1023, 2559:4095, 3455:32767, 3967:65535"),
        ("black", "64"),
        ("bits", "12"),
        ("alpha", "16"),
        ("headroom", "1"),
        ("mosaic", "grbg"),
    ];
    let from = |source: &str| camera(&[&sensor[..], &[("source", source)]].concat());
    let images_of = |mut node: ModuloCamera| {
        [0, 1].map(|_| frame(&step(&mut node, Trigger::Tick, &ALL).expect("a frame").1, 0).frame.clone())
    };
    let sent = images_of(from(&images.display().to_string()));
    assert_eq!(images_of(from(&bag.display().to_string())), sent);
    let mut node = from("topic:/raw/image");
    let by_topic = mosaics.clone().map(|frame_of_topic| {
        let image = StampedFrame { header: Header::default(), frame: frame_of_topic };
        let trigger = Trigger::Message { input: 0, message: Message::Image(Arc::new(image)) };
        frame(&step(&mut node, trigger, &ALL).expect("a frame").1, 0).frame.clone()
    });
    assert_eq!(by_topic, sent);

    assert_eq!(sent[0].mosaic(), Some(Mosaic::Grbg));
    let y = sent[0].to_f32();
    // (code, its linear value, the half of a step): x = (linear - 64) / (65535 - 64) * 16 * 2^12, of which y has the low bits.
    for (code, linear, half) in
        [(64, 64.0, 0.5), (1000, 1000.0, 0.5), (2000, 2977.0, 1.0), (3000, 18207.0, 16.0)]
    {
        let at = code - 64;
        let x = (linear - 64.0_f32) / 65471.0 * 65536.0;
        let away = (y[(at / 64, at % 64, 0)] - x).rem_euclid(4096.0);
        assert!(away <= half + 1.0 || away >= 4096.0 - half - 1.0, "code {code}: {away}");
    }

    for (mosaic, lens, wanted) in [
        ("none", "0", &["set mosaic to grbg"][..]),
        ("rggb", "0", &["grbg", "mosaic is rggb"]),
        ("grbg", "1", &["set psf_sigma to 0"]),
    ] {
        let source = bag.display().to_string();
        let other = [("mosaic", mosaic), ("psf_sigma", lens), ("source", &source)];
        let mut node = camera(&[&sensor[..5], &other].concat());
        let Err(StepError::Skip(why)) = step(&mut node, Trigger::Tick, &ALL) else {
            panic!("{mosaic} sees it")
        };
        assert!(wanted.iter().all(|wanted| why.contains(wanted)), "{why}");
    }
    let why = ModuloCamera::new(&parameters(&[("source", "topic:/raw"), ("knees", "9:9,5:20")])).err();
    assert!(why.is_some_and(|why| why.name == "knees"));
}

/// A part that is missing in a bag is reported once, before the first frame. It takes no frame number, so that the noise of the frames stays.
#[test]
fn the_codes_of_a_spike_recording_are_the_low_bits_of_its_resets() {
    let folder = tempfile::tempdir().expect("a folder");
    let (path, shape) = (folder.path().join("a.npz"), (120, 16, 24));
    let readings = readings::readings(shape, |row, column| (24 * row + column) as f64 / 384.0);
    std::fs::write(&path, readings::recording(shape, &readings)).expect("writable");
    let source = format!("{}?window=60", path.display());
    // Neither the range, the headroom nor the white changes what was counted: 0 to 60 resets.
    for (bits, alpha, headroom, white) in [
        ("3", "8", "1", "0"),
        ("3", "8", "0.97", "61"),
        ("4", "4.1", "0.97", "64"),
        ("2", "200", "0.1", "1000"),
        ("1", "31.5", "0.99", "0"),
        ("16", "1", "0.5", "0"),
    ] {
        let sensor =
            [("bits", bits), ("alpha", alpha), ("headroom", headroom), ("white", white), ("psf", "unknown")];
        let mut node = camera(&[&sensor[..], &[("source", &source)]].concat());
        for first in [0, 60] {
            let (_, sent) = step(&mut node, Trigger::Tick, &ALL).expect("a frame");
            let codes = frame(&sent, 0).frame.to_f32();
            let mask = ((1u32 << bits.parse::<u32>().expect("a number")) - 1) as u16;
            let resets = readings::resets(&readings, 16 * 24, first, 60);
            assert!(resets.contains(&59) && resets.contains(&0));
            let expected = resets.iter().map(|resets| f32::from(resets & mask));
            assert!(codes.iter().copied().eq(expected), "{sensor:?}");
        }
        assert_eq!(step(&mut node, Trigger::Tick, &ALL).expect("the end").0, Flow::Done);
    }
    let bare = [("bits", "3"), ("alpha", "4"), ("headroom", "1"), ("psf", "unknown"), ("source", &source)];
    for (change, words) in [
        (("alpha", "4"), &["32 resets at row 8, column 13 are not below", "32; set a larger alpha"][..]),
        (("psf", "perfect"), &["set psf to unknown and optical_black to 0"]),
        (("optical_black", "1"), &["set psf to unknown and optical_black to 0"]),
    ] {
        let mut node = camera(&[&bare[..], &[change]].concat());
        let Err(StepError::Skip(why)) = step(&mut node, Trigger::Tick, &ALL) else { panic!("{change:?}") };
        assert!(why.contains("frame 000000") && words.iter().all(|word| why.contains(word)), "{why}");
    }
}

#[test]
fn a_bag_that_was_cut_is_told_before_its_frames() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("bag");
    let pixels = |number: u8| Frame::from_u8(Array3::from_elem((4, 8, 3), 40 * number)).expect("a frame");
    write_bag(&path, &[0, 1, 2, 3].map(pixels));
    let file = path.join("bag_0.mcap");
    let bytes = std::fs::read(&file).expect("readable");
    let cut = folder.path().join("cut.mcap");
    let end = bytes.windows(4).position(|four| four == [120; 4]).expect("the last image");
    std::fs::write(&cut, &bytes[..end]).expect("written");
    let steps = |source: &Path| -> Vec<_> {
        let source = source.display().to_string();
        let mut node = camera(&[("source", &source), ("read_noise", "4"), ("frames", "3")]);
        let mut next = || {
            step(&mut node, Trigger::Tick, &ALL)
                .map(|(_, sent)| (!sent.is_empty()).then(|| frame(&sent, 0).frame.clone()))
        };
        std::iter::repeat_with(&mut next).take(4).collect()
    };
    let (whole, cut) = (steps(&file), steps(&cut));
    assert!(matches!(&cut[0], Err(StepError::Skip(why)) if why.contains("cut at byte")), "{:?}", cut[0]);
    assert_eq!(cut[1..], whole[..3]);
    assert!(whole[..3].iter().all(|step| matches!(step, Ok(Some(_)))));
}

/// The sensor files of the project are sensors, but for the one that leaves all to the arguments.
#[test]
fn the_sensor_files_are_possible() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../sensors");
    for name in ["paper", "mosaic", "two_gains"] {
        let sensor = CameraParameters::read_sensor(&folder.join(format!("{name}.yaml"))).expect(name);
        sensor.simulated().expect(name);
        assert_eq!(sensor.mosaic.is_some(), name == "mosaic", "{name}");
        assert_eq!(sensor.gains, name == "two_gains", "{name}");
    }
    assert!(CameraParameters::read_sensor(&folder.join("arguments.yaml")).is_err());
    let exposed = tempfile::tempdir().expect("a temporary folder");
    let file = exposed.path().join("alpha.yaml");
    std::fs::write(&file, "/**:\n  ros__parameters: { bits: 8, alpha: 2.0 }\n").expect("writable");
    let why = CameraParameters::read_sensor(&file).expect_err("alpha is no value of a chip").to_string();
    assert!(why.contains("alpha.yaml") && why.contains("'alpha'"), "{why}");
}

#[test]
fn a_camera_with_automatic_exposure_follows_the_light_with_its_delay() {
    let source = "scene://glare?seed=3&frames=60&width=96&height=48&light=tunnels";
    let means = |delay: &str, wanted: &[bool], output| {
        let mut node = camera(&[("source", source), ("alpha", "4"), ("exposure_delay", delay)]);
        let mean = |_| {
            let (_, sent) = step(&mut node, Trigger::Tick, wanted).expect("a frame");
            frame(&sent, output).frame.to_f32().mean().expect("samples")
        };
        (0..60).map(mean).collect::<Vec<f32>>()
    };
    let [quick, slow] = ["1", "3"].map(|delay| means(delay, &ONLY_AUTO_EXPOSED, AUTO_EXPOSED));
    // The goal is 0.18 of the largest code.
    assert!(quick[..50].iter().all(|mean| (mean / 255.0 - 0.18).abs() < 0.02), "{quick:?}");
    // The light falls to a 16th within 6 frames; the gain brings it back.
    let during = |means: &[f32]| means[50..58].iter().sum::<f32>();
    assert!(during(&slow) < 0.9 * during(&quick), "{slow:?} {quick:?}");
    assert!(during(&quick) < 0.9 * quick[..8].iter().sum::<f32>(), "{quick:?}");
}

#[test]
fn the_exposure_follows_the_trust_of_the_unwrapper_and_is_described() {
    let source = "scene://day?seed=3&frames=60&width=96&height=48";
    let mut node =
        camera(&[("source", source), ("alpha", "2"), ("exposure", "trusted"), ("alpha_most", "6")]);
    assert_eq!(node.inputs().iter().map(|topic| topic.name.as_str()).collect::<Vec<_>>(), ["recovery"]);
    let alpha = |node: &ModuloCamera| {
        let state = node.state().into_iter().find(|(name, _)| *name == "alpha").expect("described").1;
        state.parse::<f64>().expect("a number")
    };
    let mut alphas = Vec::new();
    for number in 0..60 {
        let (_, sent) = step(&mut node, Trigger::Tick, &ALL).expect("a frame");
        alphas.push(alpha(&node));
        let header = frame(&sent, 0).header.clone();
        let values = vec![KeyValue { key: "trusted".into(), value: (alphas[number] < 3.0).to_string() }];
        let status = vec![DiagnosticStatus { values, ..DiagnosticStatus::default() }];
        let message = Message::Diagnostics(Arc::new(DiagnosticArray { header, status }));
        step(&mut node, Trigger::Message { input: 0, message }, &ALL).expect("a status");
    }
    assert_eq!(alphas[0], 2.0);
    assert!(alphas.iter().any(|alpha| *alpha >= 3.0), "it looks for the limit: {alphas:?}");
    assert!(alphas.iter().filter(|alpha| **alpha >= 3.0).count() <= 2, "{alphas:?}");
    assert!(alphas[40..].iter().all(|alpha| (2.3..3.0).contains(alpha)), "{alphas:?}");
}

/// Changes the parameters of `node` as a driver does, and waits for the part that the change needs.
fn change_parameters(node: &mut dyn Node, now: &Parameters, next: &Parameters) -> Result<(), ParameterError> {
    node.inputs_with(next)?;
    match node.prepare(now, next) {
        None => node.configure(next),
        Some(job) => node.exchange(next, job()?),
    }
}
