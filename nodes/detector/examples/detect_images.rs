//! Boxes of a folder of images as JSON, for comparison with other tools: `detect_images MODEL ENGINE FOLDER [SCORE_THRESHOLD]`.

use std::collections::BTreeMap;
use std::error::Error;
use std::path::Path;
use std::sync::Arc;

use modulo_core::Frame;
use modulo_detector::{Detector, DetectorParameters};
use modulo_msgs::std_msgs::Header;
use modulo_runtime::{
    Context, Message, Node, ParameterSet as _, StampedFrame, StepOutput, SystemClock, Trigger,
};
use ndarray::Array3;
use serde_json::{Value, json};

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<_> = std::env::args().skip(1).collect();
    let [model, engine, folder, threshold @ ..] = &arguments[..] else {
        return Err("detect_images MODEL ENGINE FOLDER [SCORE_THRESHOLD]".into());
    };
    let mut parameters = vec![("model", model.as_str()), ("engine", engine)];
    parameters.extend(threshold.iter().map(|threshold| ("score_threshold", threshold.as_str())));
    let mut detector = Detector::new(&DetectorParameters::from_text(&parameters)?)?;
    let mut boxes = BTreeMap::new();
    let mut spent = BTreeMap::<_, Vec<u64>>::new();
    for entry in std::fs::read_dir(folder)? {
        let path = entry?.path();
        let Some(name) = path.file_name().and_then(|name| name.to_str()) else { continue };
        let (found, stages) = detect(&mut detector, &path)?;
        boxes.insert(name.to_owned(), found);
        stages.into_iter().for_each(|(stage, time)| spent.entry(stage).or_default().push(time));
    }
    println!("{}", serde_json::to_string(&boxes)?);
    eprintln!("{:?}", detector.status());
    for (stage, mut times) in spent {
        times.sort_unstable();
        let ms = |at: usize| times[at] as f64 / 1e6;
        eprintln!("{stage}: least {:.2} ms, median {:.2} ms of {}", ms(0), ms(times.len() / 2), times.len());
    }
    Ok(())
}

type Stages = Vec<(&'static str, u64)>;

fn detect(detector: &mut Detector, path: &Path) -> Result<(Vec<Value>, Stages), Box<dyn Error>> {
    let pixels = image::open(path)?.into_rgb8();
    let shape = (pixels.height() as usize, pixels.width() as usize, 3);
    let frame = Frame::from_u8(Array3::from_shape_vec(shape, pixels.into_raw())?)?;
    let message = Message::Image(Arc::new(StampedFrame { header: Header::default(), frame }));
    let clock = SystemClock::default();
    let mut cx = Context::new("/detector", &clock, &[true, false]);
    detector.step(Trigger::Message { input: 0, message }, &mut cx)?;
    let StepOutput { messages: sent, stages, .. } = cx.finish();
    let found = match sent.first() {
        Some((_, Message::Detections(array))) => array.detections.as_slice(),
        _ => &[],
    };
    let rows = found.iter().filter_map(|one| one.to_detection()).map(|one| {
        let bbox = one.bbox;
        json!([bbox.x1, bbox.y1, bbox.x2, bbox.y2, one.score, one.class])
    });
    Ok((rows.collect(), stages))
}
