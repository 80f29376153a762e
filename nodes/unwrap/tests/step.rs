//! The unwrap node's step, without transport.

use std::sync::Arc;

use modulo_core::sensor::{Sensor, SensorConfig};
use modulo_core::{Frame, Mosaic, Psf, Transfer};
use modulo_msgs::std_msgs::{Header, Time};
use modulo_runtime::{
    Context, Flow, ManualClock, Message, Node, ParameterSet, Parameters, SensorModel, StampedFrame,
    StepError, StepOutput, Trigger, sensor_info,
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

/// A smooth scene that wraps at alpha = 2: its modulo and its ideal frame.
fn exposure(bits: u8) -> (Frame, Frame) {
    let radiance = Array3::from_shape_fn((24, 40, 3), |(i, j, c)| {
        0.5 + 0.49 * ((i as f32 / 7.0).sin() * (j as f32 / 9.0 + c as f32).cos())
    });
    let config = SensorConfig { bits, alpha: 2.0, headroom: HEADROOM, ..SensorConfig::default() };
    let exposure = Sensor::new(config).expect("a sensor").expose(radiance.view(), 0).expect("an image");
    assert!(exposure.wraps().iter().any(|&k| k > 0), "the scene must wrap");
    (exposure.modulo(), exposure.ideal())
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
    let clock = ManualClock::at(0);
    let mut cx = Context::new(name, &clock, wanted);
    let image = Arc::new(StampedFrame { header: header(), frame });
    let flow = node.step(Trigger::Message { input: 0, message: Message::Image(image) }, &mut cx)?;
    assert_eq!(flow, Flow::Continue);
    let StepOutput { messages, .. } = cx.finish();
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
    let mut node = unwrap(&[("alpha", "2")]);
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
    let mut node = unwrap(&[("alpha", "4")]);
    let uniform = Frame::from_u8(Array3::from_elem((30, 40, 3), 44)).expect("an image");
    let sent = step(&mut node, uniform, &[false, false, true]).expect("a good frame");
    let [(2, Message::Diagnostics(printed))] = &sent[..] else { panic!("a description: {sent:?}") };
    let message = &printed.status[0].message;
    assert!(
        message.starts_with("not trusted: ") && message.contains("nothing shows the absolute offset"),
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
    let exposure = Sensor::new(config).expect("a sensor").expose(radiance.view(), 0).expect("an image");
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
    let radiance = Array3::from_shape_fn((24, 40, 3), |(i, j, c)| {
        0.5 + 0.49 * ((i as f32 / 7.0).sin() * (j as f32 / 9.0 + c as f32).cos())
    });
    for (alpha, depth) in [(4.0, 32), (1.0, 16)] {
        let config = SensorConfig { bits: 16, alpha, ..SensorConfig::default() };
        let exposure = Sensor::new(config).expect("a sensor").expose(radiance.view(), 0).expect("an image");
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
    let ideal = |transfer, headroom| {
        let config = SensorConfig { alpha: 2.0, headroom, transfer, ..SensorConfig::default() };
        let exposure = Sensor::new(config).expect("a sensor").expose(radiance.view(), 0).expect("an image");
        (exposure.modulo(), exposure.ideal())
    };
    let model = SensorModel { alpha: 2.0, headroom: 0.8, transfer: camera, ..SensorModel::default() };
    let described = sensor_info::message(&header(), &model, "/modulo_camera");
    for (set, of_range, expected, headroom) in
        [("camera", "0", camera, 0.8), ("rec709", "0", own, 0.8), ("camera", "0.9", camera, 0.9)]
    {
        let (modulo, ideal) = ideal(expected, headroom);
        let set = [("transfer", set), ("headroom", of_range)];
        let with = UnwrapParameters::from_text(&set).expect("possible");
        let mut node = UnwrapNode::new(&with).expect("a node");
        let clock = ManualClock::at(0);
        let mut cx = Context::new("/unwrap", &clock, &[]);
        let trigger = Trigger::Message { input: 1, message: described.clone() };
        node.step(trigger, &mut cx).expect("a description");
        let sent = step(&mut node, modulo, &[true]).expect("a good frame");
        assert_eq!(image(&sent[0].1).frame, ideal, "{set:?}");
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
    let psf = Psf::Gaussian { sigma: 1.0 };
    let config = SensorConfig { alpha: 2.0, headroom: HEADROOM, psf, ..SensorConfig::default() };
    let expose = |psf| {
        Sensor::new(SensorConfig { psf, ..config })
            .expect("a sensor")
            .expose(bars.view(), 0)
            .expect("an image")
    };
    let (blurred, sharp) = (expose(config.psf), expose(Psf::None));
    let run = |deblur| {
        let mut node = unwrap(&[("alpha", "2"), ("psf_sigma", "1.0"), ("deblur", deblur)]);
        step(&mut node, blurred.modulo(), &[true, true]).expect("a good frame")
    };
    let (blurry, sharpened) = (run("false"), run("true"));
    let error = |sent: &Message| {
        let difference = image(sent).frame.to_f32() - sharp.ideal().to_f32();
        difference.mapv(|d| d * d).sum()
    };
    let errors = [error(&sharpened[0].1), error(&blurry[0].1)];
    assert!(errors[0] * 2.0 < errors[1], "sharper than before: {errors:?}");
    assert_eq!(
        image(&sharpened[1].1).frame,
        image(&blurry[1].1).frame,
        "the radiance is what the sensor saw"
    );
}

/// The sensor of each frame comes from its own description, before or after it.
#[test]
fn each_frame_is_unwrapped_with_the_sensor_that_made_it() {
    let mut node = UnwrapNode::new(&UnwrapParameters::default()).expect("a node");
    let clock = ManualClock::at(0);
    let mut feed = |input, message| {
        let mut cx = Context::new("/unwrap", &clock, &[true, false, false]);
        let flow = node.step(Trigger::Message { input, message }, &mut cx);
        (flow, cx.finish().messages)
    };
    let (modulo, ideal) = exposure(8);
    let at = |ns| Header { stamp: Time::from_ns(ns), ..header() };
    let frame = |ns| Message::Image(Arc::new(StampedFrame { header: at(ns), frame: modulo.clone() }));
    let model = |alpha| SensorModel { alpha, ..SensorModel::default() };
    let described = |ns, alpha| sensor_info::message(&at(ns), &model(alpha), "/modulo_camera");

    assert!(feed(1, described(1, 2.0)).1.is_empty());
    assert!(feed(1, described(2, 4.0)).1.is_empty(), "the next frame has another sensor");
    let (flow, sent) = feed(0, frame(1));
    assert_eq!((flow, &image(&sent[0].1).frame), (Ok(Flow::Continue), &ideal));

    let (flow, sent) = feed(0, frame(3));
    assert_eq!(
        (flow, !sent.is_empty()),
        (Ok(Flow::Continue), true),
        "its description is late: that of frame 2 is used"
    );
    assert!(feed(1, described(3, 2.0)).1.is_empty(), "it is answered already");
    assert!(feed(1, described(5, 2.0)).1.is_empty());
    let (flow, sent) = feed(0, frame(5));
    assert_eq!((flow, &image(&sent[0].1).frame), (Ok(Flow::Continue), &ideal));
    let (_, sent) = feed(0, frame(6));
    assert_eq!(&image(&sent[0].1).frame, &ideal, "the description of frame 5");
    assert!(node.status().contains(&("description_reused", "2".to_owned())), "{:?}", node.status());
}

/// Before the very first description a frame waits, and those after it only as long as it does.
#[test]
fn a_frame_waits_for_the_first_description_and_not_for_ever() {
    let clock = ManualClock::at(0);
    let feed = |node: &mut UnwrapNode, input, message| {
        let mut cx = Context::new("/unwrap", &clock, &[true, false, false]);
        let flow = node.step(Trigger::Message { input, message }, &mut cx);
        (flow, cx.finish().messages)
    };
    let (modulo, ideal) = exposure(8);
    let at = |ns| Header { stamp: Time::from_ns(ns), ..header() };
    let frame = |ns| Message::Image(Arc::new(StampedFrame { header: at(ns), frame: modulo.clone() }));
    let model = SensorModel { alpha: 2.0, ..SensorModel::default() };
    let described = |ns| sensor_info::message(&at(ns), &model, "/modulo_camera");
    let mut node = UnwrapNode::new(&UnwrapParameters::default()).expect("a node");
    assert_eq!(node.give_up(), None);
    assert_eq!(feed(&mut node, 0, frame(1)).0, Ok(Flow::Deferred));
    let (flow, sent) = feed(&mut node, 1, described(1));
    let answered = image(&sent[0].1);
    assert_eq!((flow, &answered.header, &answered.frame), (Ok(Flow::Continue), &at(1), &ideal));

    let mut node = UnwrapNode::new(&UnwrapParameters::default()).expect("a node");
    assert_eq!(feed(&mut node, 0, frame(1)).0, Ok(Flow::Deferred));
    let Err(StepError::Skip(why)) = feed(&mut node, 0, frame(2)).0 else { panic!("the newer frame is kept") };
    assert!(why.contains("sensor_info") && why.contains("alpha"), "{why}");
    assert_eq!(node.give_up(), Some(why.clone()));
    assert_eq!(feed(&mut node, 0, frame(3)).0, Err(StepError::Skip(why)), "the next ones do not wait");
    assert!(feed(&mut node, 1, described(4)).1.is_empty());
    assert_eq!(feed(&mut node, 0, frame(4)).0, Ok(Flow::Continue));
}
