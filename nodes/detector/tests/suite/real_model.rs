//! The node on a real model and real frames.

use crate::data;
use std::path::Path;
use std::sync::Arc;

use modulo_core::{Detection, Frame};
use modulo_detector::{Detector, DetectorParameters};
use modulo_msgs::std_msgs::Header;
use modulo_runtime::{
    Context, Message, Node, ParameterSet as _, StampedFrame, StepOutput, SystemClock, Trigger,
};
use ndarray::Array3;

const MODEL: &str = "models/yolov10n_dyn_w16.onnx";
const FRAME: &str = "data/kitti_object/image_2/000008.png";

fn detector(model: &Path, engine: &str, changes: &[(&str, &str)]) -> Result<Detector, String> {
    let all: Vec<_> = [("model", model.to_str().expect("a path")), ("engine", engine)]
        .iter()
        .chain(changes)
        .copied()
        .collect();
    let parameters = DetectorParameters::from_text(&all).expect("allowed");
    Detector::new(&parameters).map_err(|error| error.to_string())
}

fn kitti(file: &Path) -> Frame {
    let pixels = image::open(file).expect("an image").into_rgb8();
    let shape = (pixels.height() as usize, pixels.width() as usize, 3);
    Frame::from_u8(Array3::from_shape_vec(shape, pixels.into_raw()).expect("its shape")).expect("a frame")
}

/// Detections and the stages with their time in ms.
fn look(detector: &mut Detector, frame: &Frame) -> (Vec<Detection>, Vec<(&'static str, f64)>) {
    let clock = SystemClock::default();
    let mut cx = Context::new("/detector", &clock, &[true, true]);
    let image = StampedFrame { header: Header::default(), frame: frame.clone() };
    let message = Message::Image(Arc::new(image));
    detector.step(Trigger::Message { input: 0, message }, &mut cx).expect("a step");
    let StepOutput { messages: sent, stages, .. } = cx.finish();
    let array = sent.into_iter().find_map(|(_, message)| match message {
        Message::Detections(array) => Some(array),
        _ => None,
    });
    let array = array.expect("detections");
    let found = array.detections.iter().filter_map(|one| one.to_detection()).collect();
    (found, stages.into_iter().map(|(name, ns)| (name, ns as f64 / 1e6)).collect())
}

fn cars(found: &[Detection]) -> usize {
    found.iter().filter(|one| one.class == "car").count()
}

#[test]
fn cars_are_found_inside_the_image() {
    let (Some(model), Some(file)) = (data::shared(MODEL), data::shared(FRAME)) else { return };
    let frame = kitti(&file);
    let map = Path::new(env!("CARGO_MANIFEST_DIR")).join("class_maps/coco_to_kitti.yaml");
    let map = map.to_str().expect("a path");
    for changes in
        [&[][..], &[("input_size", "640x192")], &[("class_map", map), ("classes", "car,pedestrian")]]
    {
        let mut detector = detector(&model, "rten", changes).expect("a detector");
        let (found, stages) = look(&mut detector, &frame);
        println!("{changes:?}: {} cars, {stages:?}", cars(&found));
        assert!(cars(&found) >= 4, "{found:?}");
        for Detection { bbox, score, .. } in &found {
            assert!(0.0 <= bbox.x1 && bbox.x1 < bbox.x2 && bbox.x2 <= frame.width() as f32);
            assert!(0.0 <= bbox.y1 && bbox.y1 < bbox.y2 && bbox.y2 <= frame.height() as f32);
            assert!((0.25..=1.0).contains(score));
        }
    }
}

#[test]
fn tiny_and_deep_images_are_answered() {
    let Some(model) = data::shared(MODEL) else { return };
    let mut detector = detector(&model, "rten", &[]).expect("a detector");
    for (height, width, channels) in [(1, 1, 1), (7, 3, 3), (1, 600, 1)] {
        let frame = Frame::from_u16(Array3::from_elem((height, width, channels), 30_000)).expect("a frame");
        look(&mut detector, &frame);
    }
}

#[test]
fn both_engines_say_the_same() {
    let (Some(model), Some(file)) = (data::shared(MODEL), data::shared(FRAME)) else { return };
    let mut ort = match detector(&model, "ort", &[]) {
        Ok(detector) => detector,
        Err(why) => {
            assert!(why.contains("ORT_DYLIB_PATH") && why.contains("rten"), "{why}");
            data::skip(&why);
            return;
        }
    };
    let mut rten = detector(&model, "rten", &[]).expect("a detector");
    let frame = kitti(&file);
    let ((a, _), (b, _)) = (look(&mut ort, &frame), look(&mut rten, &frame));
    assert_eq!(a.len(), b.len());
    for one in &a {
        let best =
            b.iter().filter(|other| other.class == one.class).map(|other| (other.bbox.iou(one.bbox), other));
        let (iou, other) = best.max_by(|x, y| x.0.total_cmp(&y.0)).expect("a peer");
        assert!(iou >= 0.99 && (other.score - one.score).abs() <= 0.002, "{one:?} against {other:?}");
    }
    let auto = detector(&model, "auto", &[]).expect("a detector");
    assert!(auto.status().contains(&("engine", "ort".to_owned())));
}
