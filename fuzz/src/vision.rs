//! Images and what a model says of them.

use std::sync::Arc;

use modulo_core::unwrap::{METHODS, Options, Recovered, by_name, of_gains};
use modulo_core::{Frame, Gains, Mosaic, Range};
use modulo_detector::{Detector, DetectorParameters};
use modulo_runtime::{Context, ManualClock, Message, Node, ParameterSet, Parameters, StampedFrame, Trigger};
use ndarray::Array3;

/// A model whose three rows grow with the brightness of the image by the first 72 bytes, and whose classes' names are the next 37: the boxes
/// lie in the image, the best one first. The first run, on a black image, sees rows without a score.
pub fn detector(data: &[u8]) {
    const MODEL: &[u8] = include_bytes!("../../nodes/detector/tests/data/rows.onnx");
    let mut model = MODEL.to_vec();
    let at =
        |text: &[u8]| MODEL.windows(text.len()).position(|w| w == text).expect("it is in it") + text.len();
    let (rows, names) = data.split_at(data.len().min(72));
    model[at(b"boxesJH")..][..72].fill(0);
    model[at(b"lightJH")..][..rows.len()].copy_from_slice(rows);
    // A text in an ONNX file must be UTF-8.
    for (place, name) in
        model[at(b"{0: ")..].iter_mut().take(32).zip(names.iter().filter(|byte| byte.is_ascii()))
    {
        *place = *name;
    }
    let folder = super::folder(&[("a.onnx", &model)]);
    let path = folder.path().join("a.onnx").display().to_string();
    let changes = [("model", path.as_str()), ("engine", "rten"), ("score_threshold", "0"), ("threads", "1")];
    let parameters =
        Parameters::declare(DetectorParameters::descriptors()).with_text(&changes).expect("allowed");
    // Rows without numbers are refused.
    let Ok(mut detector) = Detector::new(&(&parameters).into()) else { return };
    let (clock, frame) = (ManualClock::at(0), Frame::from_u8(Array3::zeros((20, 30, 3))).expect("a frame"));
    let mut cx = Context::new("/detector", &clock, &[true, true]);
    let message = Message::Image(Arc::new(StampedFrame { header: Default::default(), frame }));
    detector.step(Trigger::Message { input: 0, message }, &mut cx).expect("a step");
    for (_, message) in cx.finish().messages {
        let Message::Detections(array) = message else { continue };
        let found: Vec<_> =
            array.detections.iter().map(|d| d.to_detection().expect("a class and a box")).collect();
        assert!(found.is_sorted_by(|a, b| a.score >= b.score), "{found:?}");
        for detection in found {
            let (b, score) = (detection.bbox, detection.score);
            assert!(0.0 <= b.x1 && b.x1 < b.x2 && b.x2 <= 30.0, "{b:?}");
            assert!(0.0 <= b.y1 && b.y1 < b.y2 && b.y2 <= 20.0, "{b:?}");
            assert!((0.0..=1.0).contains(&score), "{score}");
        }
    }
}

/// Seven bytes of header, then samples, repeated until the image is full.
fn image(data: &[u8]) -> Option<(Frame, Range, Options)> {
    let (&[bits, whole, part, height, width, channels, threads], samples) = data.split_first_chunk()?;
    // Every byte is brought into its range, so that few inputs end here.
    let bits = bits % 16 + 1;
    let range = Range::new(bits, f64::from(whole) + (f64::from(part) + 1.0) / 256.0).ok()?;
    let dim =
        (usize::from(height) % 64 + 1, usize::from(width) % 64 + 1, if channels % 2 == 0 { 1 } else { 3 });
    if samples.is_empty() {
        return None;
    }
    // A short input fills a whole image, so that the fuzzer can work with few bytes.
    let mut bytes = samples.iter().cycle().map(|&byte| u16::from(byte));
    let mut sample =
        || (bytes.next().unwrap_or(0) | bytes.next().unwrap_or(0) << 8) & ((1u32 << bits) - 1) as u16;
    let pixels = Array3::from_shape_simple_fn(dim, &mut sample);
    let frame =
        if bits <= 8 { Frame::from_u8(pixels.mapv(|value| value as u8)) } else { Frame::from_u16(pixels) };
    Some((frame.ok()?, range, Options { threads: usize::from(threads) % 3 + 1, ..Options::default() }))
}

/// Any image of any sensor through every method: what comes out is congruent with what went in and within the
/// sensor's range.
pub fn unwrap(data: &[u8]) {
    let Some((y, range, options)) = image(data) else { return };
    let mut out = Recovered::default();
    for name in METHODS {
        let mut method = by_name(name, &options).expect("a listed method");
        method.unwrap(&y, &range.into(), &mut out).expect("every code is possible");
        let y = y.to_f32();
        assert!(out.k.iter().all(|&k| k <= range.max_wraps()), "{name}: k out of range");
        let congruent =
            out.x.iter().zip(&out.k).zip(&y).all(|((x, &k), y)| *x == y + f32::from(k) * range.peak());
        assert!(congruent, "{name}: x is not y + k * peak");
    }
    let mut method = of_gains(Gains::checkerboard(range.alpha())).expect("two gains");
    let mosaic = y.clone().with_mosaic(Mosaic::Grbg).ok();
    for y in mosaic.iter().chain([&y]) {
        method.unwrap(y, &range.into(), &mut out).expect("every code is possible");
        assert!(out.x.dim() == y.dim() && out.k.iter().all(|&k| k <= range.max_wraps()));
        assert!(out.x.iter().all(|x| x.is_finite()));
    }
}
