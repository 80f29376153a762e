//! The unwrap node's step, without transport.

use std::sync::Arc;

use modulo_core::sensor::{Sensor, SensorConfig};
use modulo_core::{Exposure, Frame, Mosaic, Psf, Transfer};
use modulo_msgs::std_msgs::{Header, Time};
use modulo_runtime::{
    Context, Flow, ManualClock, Message, Node, ParameterSet, Parameters, SensorModel, StampedFrame,
    StepError, Trigger, sensor_info,
};
use modulo_unwrap::{UnwrapNode, UnwrapParameters};
use ndarray::Array3;

fn parameters(changes: &[(&str, &str)]) -> Parameters {
    let sensor = [("bits", "8"), ("alpha", "4")];
    let declared = Parameters::declare(UnwrapParameters::descriptors());
    declared.with_text(&[&sensor, changes].concat()).expect("possible")
}

fn unwrap(changes: &[(&str, &str)]) -> UnwrapNode {
    UnwrapNode::new(&(&parameters(changes)).into()).expect("a node")
}

fn header() -> Header {
    Header { stamp: Time::from_ns(1_700_000_000_123_456_789), frame_id: "front".into() }
}

/// The headroom that a sensor has unless another one is described.
const HEADROOM: f64 = 0.97;

fn exposed(config: SensorConfig, radiance: &Array3<f32>) -> Exposure {
    Sensor::new(config).expect("a sensor").expose(radiance.view(), 0).expect("an image")
}

/// A smooth scene that wraps at alpha = 2.
fn waves() -> Array3<f32> {
    Array3::from_shape_fn((24, 40, 3), |(i, j, c)| {
        0.5 + 0.49 * ((i as f32 / 7.0).sin() * (j as f32 / 9.0 + c as f32).cos())
    })
}

/// The modulo and the ideal frame of that scene.
fn exposure(bits: u8) -> (Frame, Frame) {
    let config = SensorConfig { bits, alpha: 2.0, headroom: HEADROOM, ..SensorConfig::default() };
    let exposure = exposed(config, &waves());
    assert!(exposure.wraps().iter().any(|&k| k > 0), "the scene must wrap");
    (exposure.modulo(), exposure.ideal())
}

/// Gives a message to the node `name`; returns its result and the messages that it sends.
fn feed(
    name: &str,
    node: &mut UnwrapNode,
    (input, message): (usize, Message),
    wanted: &[bool],
) -> (Result<Flow, StepError>, Vec<(usize, Message)>) {
    let clock = ManualClock::at(0);
    let mut cx = Context::new(name, &clock, wanted);
    let flow = node.step(Trigger::Message { input, message }, &mut cx);
    (flow, cx.finish().messages)
}

/// An image of the scene with this stamp, and the description of a sensor for it.
fn frame_at(ns: u64) -> (usize, Message) {
    let header = Header { stamp: Time::from_ns(ns), ..header() };
    (0, Message::Image(Arc::new(StampedFrame { header, frame: exposure(8).0 })))
}

fn described_at(ns: u64, alpha: f64) -> (usize, Message) {
    let header = Header { stamp: Time::from_ns(ns), ..header() };
    let model = SensorModel { alpha, ..SensorModel::default() };
    (1, sensor_info::message((&header, (96, 160)), &model, "/modulo_camera", []))
}

fn step(node: &mut UnwrapNode, frame: Frame, wanted: &[bool]) -> Result<Vec<(usize, Message)>, StepError> {
    step_as("/unwrap", node, frame, wanted)
}

fn step_as(
    name: &str,
    node: &mut UnwrapNode,
    frame: Frame,
    wanted: &[bool],
) -> Result<Vec<(usize, Message)>, StepError> {
    let image = Message::Image(Arc::new(StampedFrame { header: header(), frame }));
    let (flow, messages) = feed(name, node, (0, image), wanted);
    assert_eq!(flow?, Flow::Continue);
    Ok(messages)
}

fn image(message: &Message) -> &StampedFrame {
    let Message::Image(image) = message else { panic!("an image is expected, not {message:?}") };
    image
}

#[test]
fn the_recovered_image_is_the_ideal_one_with_the_same_header() {
    let (modulo, ideal) = exposure(8);
    for method in modulo_core::unwrap::METHODS {
        let mut node = unwrap(&[("method", method), ("alpha", "2")]);
        let sent = step(&mut node, modulo.clone(), &[true, true]).expect("a good frame");
        assert_eq!(sent.len(), 2, "{method}");
        let (recovered, hdr) = (image(&sent[0].1), image(&sent[1].1));
        assert_eq!((&recovered.header, &hdr.header), (&header(), &header()), "{method}");
        assert_eq!(recovered.frame, ideal, "{method}");
        assert_eq!(hdr.frame.depth(), 16, "{method}");
        // Without a reader of the radiance, the picture is the same.
        let alone = step(&mut node, modulo.clone(), &[true, false]).expect("a good frame");
        assert_eq!((alone.len(), &image(&alone[0].1).frame), (1, &ideal), "{method}");
    }
}

#[test]
fn the_metered_image_is_the_recovered_one_with_an_exposure_of_its_own() {
    let config = SensorConfig { alpha: 4.0, headroom: HEADROOM, ..SensorConfig::default() };
    let dark = waves().mapv(|radiance| 0.15 * radiance);
    let mut node = unwrap(&[]);
    let wanted = [true, false, false, false, false, true];
    let sent = step(&mut node, exposed(config, &dark).modulo(), &wanted).expect("unwrapped");
    let [recovered, metered] = [0, 1].map(|at| image(&sent[at].1).frame.to_f32());
    let mean = |image: &Array3<f32>| image.mean().expect("samples") / 255.0;
    assert!(mean(&recovered) < 0.09 && (mean(&metered) - 0.18).abs() < 0.01, "{}", mean(&metered));
    let gain = mean(&metered) / mean(&recovered);
    for (recovered, metered) in recovered.iter().zip(&metered) {
        assert!((gain * recovered - metered).abs() < 4.0 || *metered == 255.0, "{recovered} {metered}");
    }
}

#[test]
fn what_nobody_reads_is_not_made() {
    let (modulo, _) = exposure(8);
    let mut node = unwrap(&[("alpha", "2")]);
    assert!(step(&mut node, modulo.clone(), &[false, false, false]).expect("a good frame").is_empty());
    assert_eq!(step(&mut node, modulo, &[false, true]).expect("a good frame")[0].0, 1);
}

#[test]
fn the_images_are_described_with_the_sensor_that_was_used() {
    let (modulo, _) = exposure(8);
    let mut node = unwrap(&[("alpha", "2")]);
    let wanted = [true, false, false, false, false, false, true];
    let sent = step(&mut node, modulo, &wanted).expect("a good frame");
    let [(6, Message::Diagnostics(info)), (0, _)] = &sent[..] else {
        panic!("a description first: {sent:?}")
    };
    assert_eq!((&info.header, info.value("alpha")), (&header(), Some("2.0")));
}

#[test]
fn a_frame_of_another_sensor_is_skipped_and_the_node_lives() {
    let (ten_bits, _) = exposure(10);
    let (eight_bits, ideal) = exposure(8);
    let mut node = unwrap(&[("alpha", "2")]);
    let error = step(&mut node, ten_bits.clone(), &[true, false]).expect_err("values above 255");
    assert!(matches!(&error, StepError::Skip(why) if why.contains("255") || why.contains("8")), "{error}");
    let sent = step(&mut node, eight_bits, &[true, false]).expect("a good frame");
    assert_eq!(image(&sent[0].1).frame, ideal);

    node.configure(&parameters(&[("alpha", "2"), ("bits", "10")])).expect("possible");
    assert!(step(&mut node, ten_bits, &[true, false]).is_ok());
}

#[test]
fn each_frame_is_described_with_its_own_stamp_and_counted() {
    let (modulo, _) = exposure(8);
    let mut node = unwrap(&[("alpha", "2"), ("psf", "gaussian"), ("psf_sigma", "1.4")]);
    // A reader of the verdicts alone is enough.
    let sent = step(&mut node, modulo.clone(), &[false, false, true]).expect("a good frame");
    assert!(matches!(&sent[..], [(2, Message::Diagnostics(_))]), "{sent:?}");
    let sent = step(&mut node, modulo.clone(), &[true, false, true]).expect("a good frame");
    let [(2, Message::Diagnostics(printed)), (0, _)] = &sent[..] else {
        panic!("a description is expected: {sent:?}")
    };
    assert_eq!(printed.header, header());
    let value = |key: &str| {
        printed.status[0].values.iter().find(|pair| pair.key == key).map(|pair| pair.value.clone())
    };
    assert_eq!(value("method").as_deref(), Some("auto"));
    assert_eq!(value("trusted").as_deref(), Some("true"), "{printed:?}");

    // A new alpha is a new method, but the count goes on.
    node.configure(&parameters(&[("alpha", "2.5"), ("method", "itoh")])).expect("possible");
    let sent = step(&mut node, modulo, &[true, false, true]).expect("a good frame");
    let [(2, Message::Diagnostics(printed)), (0, _)] = &sent[..] else {
        panic!("a description is expected: {sent:?}")
    };
    assert!(printed.status[0].values.iter().all(|pair| pair.key != "trusted"), "itoh makes no claim");
    let status = node.status();
    assert!(status.contains(&("trusted", "2 of 3 frames".to_owned())), "{status:?}");
}

/// A uniform image violates no assumption, but nothing in it tells the absolute offset.
#[test]
fn the_reason_of_an_untrusted_frame_covers_missing_evidence() {
    let mut node = unwrap(&[("alpha", "4"), ("psf", "gaussian"), ("psf_sigma", "1.4")]);
    let uniform = Frame::from_u8(Array3::from_elem((30, 40, 3), 44)).expect("an image");
    let sent = step(&mut node, uniform, &[false, false, true]).expect("a good frame");
    let [(2, Message::Diagnostics(printed))] = &sent[..] else { panic!("a description: {sent:?}") };
    let message = &printed.status[0].message;
    assert!(
        message.starts_with("not trusted: ") && message.contains("the absolute level is unknown"),
        "{message}"
    );
}

#[test]
fn two_nodes_differ_in_diagnostics() {
    let (modulo, _) = exposure(8);
    let mut node = unwrap(&[("alpha", "2")]);
    for (name, status) in [("/unwrap", "unwrap: recovery"), ("/left/unwrap_b", "left/unwrap_b: recovery")] {
        let sent = step_as(name, &mut node, modulo.clone(), &[true, false, true]).expect("a good frame");
        let Message::Diagnostics(printed) = &sent[0].1 else { panic!("a description is expected: {sent:?}") };
        assert_eq!(printed.status[0].name, status);
    }
}

#[test]
fn a_mosaic_is_shown_in_colours_and_kept_in_hdr() {
    let radiance = Array3::from_shape_fn((48, 64, 3), |(i, j, c)| {
        0.5 + 0.4 * ((i as f32 / 17.0).sin() * (j as f32 / 19.0 + c as f32).cos())
    });
    let mosaic = Some(Mosaic::Bggr);
    let config = SensorConfig { alpha: 2.0, headroom: HEADROOM, mosaic, ..SensorConfig::default() };
    let exposure = exposed(config, &radiance);
    let mut node = unwrap(&[("alpha", "2")]);
    let wanted = [true, true, false, false, true];
    let sent = step(&mut node, exposure.modulo(), &wanted).expect("a good frame");
    let [(0, recovered), (1, hdr), (4, confidence)] = &sent[..] else {
        panic!("three images are expected: {sent:?}")
    };
    let [recovered, hdr, confidence] = [recovered, hdr, confidence].map(|sent| &image(sent).frame);
    assert_eq!((recovered.dim(), recovered.mosaic()), ((48, 64, 3), None));
    let apart = (recovered.to_f32() - exposure.ideal().demosaiced().to_f32()).mapv(f32::abs);
    assert!(apart.iter().all(|difference| *difference <= 1.0), "{apart}");
    assert_eq!((hdr.dim(), hdr.mosaic()), ((48, 64, 1), mosaic));
    assert_eq!(hdr.to_f32(), exposure.x().mapv(f32::floor));
    assert!(confidence.as_u8().expect("8 bits").iter().all(|&value| value == 255));
}

/// The oracle is the sensor: a range of 18 bits leaves no room in 16.
#[test]
fn hdr_has_every_count_of_a_range_beyond_16_bits() {
    for (alpha, depth) in [(4.0, 32), (1.0, 16)] {
        let exposure = exposed(SensorConfig { bits: 16, alpha, ..SensorConfig::default() }, &waves());
        let mut node = unwrap(&[("bits", "16"), ("alpha", &alpha.to_string())]);
        let sent = step(&mut node, exposure.modulo(), &[false, true]).expect("a good frame");
        let hdr = &image(&sent[0].1).frame;
        assert_eq!((hdr.depth(), hdr.to_f32()), (depth, exposure.x().mapv(f32::floor)), "alpha {alpha}");
    }
}

#[test]
fn the_recovered_image_is_shown_as_the_pictures_that_the_camera_sees() {
    let radiance = Array3::from_shape_fn((24, 40, 3), |(i, j, _)| (i + j) as f32 / 64.0);
    let (camera, own) = (Transfer::Srgb, Transfer::Rec709);
    let model = SensorModel { alpha: 2.0, headroom: 0.8, transfer: camera, ..SensorModel::default() };
    let described = sensor_info::message((&header(), (24, 40)), &model, "/modulo_camera", []);
    for (set, of_range, transfer, headroom) in
        [("camera", "0", camera, 0.8), ("rec709", "0", own, 0.8), ("camera", "0.9", camera, 0.9)]
    {
        let config = SensorConfig { alpha: 2.0, headroom, transfer, ..SensorConfig::default() };
        let exposure = exposed(config, &radiance);
        let set = [("transfer", set), ("headroom", of_range)];
        let with = UnwrapParameters::from_text(&set).expect("possible");
        let mut node = UnwrapNode::new(&with).expect("a node");
        feed("/unwrap", &mut node, (1, described.clone()), &[]).0.expect("a description");
        let sent = step(&mut node, exposure.modulo(), &[true]).expect("a good frame");
        assert_eq!(image(&sent[0].1).frame, exposure.ideal(), "{set:?}");
    }
}

#[test]
fn what_only_one_method_reads_is_checked_for_all() {
    for (name, value) in [("threads", "0"), ("trust_lines", "-0.1"), ("trust_jumps", "2.5"), ("tau", "-1")] {
        let refused = UnwrapParameters::from_text(&[(name, value)]);
        assert!(refused.is_err_and(|why| why.to_string().contains(name)), "{name} = {value}");
    }
}

#[test]
fn deblur_sharpens_the_image_for_the_detector_and_leaves_the_radiance() {
    let bars =
        Array3::from_shape_fn((24, 40, 3), |(i, j, _)| if (i / 6 + j / 5) % 2 == 0 { 0.1 } else { 0.3 });
    let config = SensorConfig { alpha: 2.0, headroom: HEADROOM, ..SensorConfig::default() };
    let [blurred, sharp] =
        [Psf::Gaussian { sigma: 1.0 }, Psf::None].map(|psf| exposed(SensorConfig { psf, ..config }, &bars));
    let run = |deblur| {
        let mut node = unwrap(&[("alpha", "2"), ("psf_sigma", "1.0"), ("deblur", deblur)]);
        let sent = step(&mut node, blurred.modulo(), &[true, true]).expect("a good frame");
        [0, 1].map(|output| image(&sent[output].1).frame.to_f32())
    };
    let ([blurry, blurry_hdr], [sharpened, hdr]) = (run("false"), run("true"));
    let ideal = sharp.ideal().to_f32();
    let errors = [sharpened, blurry].map(|shown| (shown - &ideal).mapv(|d| d * d).sum());
    assert!(errors[0] * 2.0 < errors[1], "sharper than before: {errors:?}");
    assert_eq!(hdr, blurry_hdr, "the radiance is what the sensor saw");
}

/// The description of a frame comes before or after it.
#[test]
fn each_frame_is_unwrapped_with_the_sensor_that_made_it() {
    let mut node = UnwrapNode::new(&UnwrapParameters::default()).expect("a node");
    let mut feed = |message| feed("/unwrap", &mut node, message, &[true, false, false]);
    let (_, ideal) = exposure(8);

    assert!(feed(described_at(1, 2.0)).1.is_empty());
    assert!(feed(described_at(2, 4.0)).1.is_empty(), "the next frame has another sensor");
    let (flow, sent) = feed(frame_at(1));
    assert_eq!((flow, &image(&sent[0].1).frame), (Ok(Flow::Continue), &ideal));

    let (flow, sent) = feed(frame_at(3));
    let answer = (flow, sent.is_empty());
    assert_eq!(answer, (Ok(Flow::Continue), false), "its description is late: that of frame 2 is used");
    assert!(feed(described_at(3, 2.0)).1.is_empty(), "it is answered already");
    assert!(feed(described_at(5, 2.0)).1.is_empty());
    let (flow, sent) = feed(frame_at(5));
    assert_eq!((flow, &image(&sent[0].1).frame), (Ok(Flow::Continue), &ideal));
    let (_, sent) = feed(frame_at(6));
    assert_eq!(&image(&sent[0].1).frame, &ideal, "the description of frame 5");
    assert!(node.status().contains(&("description_reused", "2".to_owned())), "{:?}", node.status());
}

/// Before the very first description a frame waits, and those after it only as long as it does.
#[test]
fn a_frame_waits_for_the_first_description_and_not_for_ever() {
    let feed = |node: &mut UnwrapNode, message| feed("/unwrap", node, message, &[true, false, false]);
    let (_, ideal) = exposure(8);
    let mut node = UnwrapNode::new(&UnwrapParameters::default()).expect("a node");
    assert_eq!(node.give_up(), None);
    assert_eq!(feed(&mut node, frame_at(1)).0, Ok(Flow::Deferred));
    let (flow, sent) = feed(&mut node, described_at(1, 2.0));
    let answered = image(&sent[0].1);
    assert_eq!(
        (flow, answered.header.stamp, &answered.frame),
        (Ok(Flow::Continue), Time::from_ns(1), &ideal)
    );

    let mut node = UnwrapNode::new(&UnwrapParameters::default()).expect("a node");
    assert_eq!(feed(&mut node, frame_at(1)).0, Ok(Flow::Deferred));
    let Err(StepError::Skip(why)) = feed(&mut node, frame_at(2)).0 else { panic!("the newer frame is kept") };
    assert!(why.contains("sensor_info") && why.contains("alpha"), "{why}");
    assert_eq!(node.give_up(), Some(why.clone()));
    assert_eq!(feed(&mut node, frame_at(3)).0, Err(StepError::Skip(why)), "the next ones do not wait");
    assert!(feed(&mut node, described_at(4, 2.0)).1.is_empty());
    assert_eq!(feed(&mut node, frame_at(4)).0, Ok(Flow::Continue));
}
