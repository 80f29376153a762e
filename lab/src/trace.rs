//! [`Times`]: the times of the frames of a run, from the traces of its nodes.

use std::collections::BTreeMap;

use serde_json::Value;

/// The times of the frames that are counted, ms.
#[derive(Debug, Default, PartialEq)]
pub struct Times {
    /// From the arrival of the modulo image of each frame at `unwrap` to the end of the sending of its boxes.
    pub frames_ms: Vec<f64>,
    /// The age of the boxes: from the begin of the exposure of each frame by its camera to the end of the sending of its boxes.
    pub ages_ms: Vec<f64>,
    /// Frames per second between the first and the last boxes.
    pub frames_per_s: Option<f64>,
    /// The end of the sending of the first boxes, on the monotonic clock of the machine.
    pub first_box_ms: Option<f64>,
    /// Each stage of `unwrap` and `detector`, once for each frame.
    pub stages: BTreeMap<String, Vec<f64>>,
}

/// A part of the time of a node, ms.
struct Span<'a> {
    node: &'a str,
    frame: &'a str,
    name: &'a str,
    begin: f64,
    end: f64,
}

/// The spans of a trace, whose first line names its node.
fn spans(trace: &[Value]) -> impl Iterator<Item = Span<'_>> {
    let node = trace.first().and_then(|head| head["node"].as_str());
    trace.iter().filter_map(move |event| {
        // Only spans have all fields.
        let (frame, begin) = (event["args"]["frame"].as_str()?, event["ts"].as_f64()? / 1e3);
        let (name, end) = (event["name"].as_str()?, begin + event["dur"].as_f64()? / 1e3);
        // Nodes of several cameras differ by their namespaces.
        Some(Span { node: node?.rsplit('/').next()?, frame, name, begin, end })
    })
}

impl Times {
    /// Reads the traces of the nodes of a run, and leaves out its first frames.
    pub fn read(traces: &[Vec<Value>], warm_up: usize) -> Self {
        let all = || traces.iter().flat_map(|trace| spans(trace));
        let of = |node: &'static str| all().filter(move |span| span.node == node);
        let first_of = |node| {
            let mut begins = BTreeMap::new();
            for Span { frame, begin, .. } in of(node) {
                begins.entry(frame).and_modify(|first: &mut f64| *first = first.min(begin)).or_insert(begin);
            }
            begins
        };
        let (taken, arrived, mut sent) = (first_of("modulo_camera"), first_of("unwrap"), BTreeMap::new());
        for Span { frame, end, .. } in of("detector") {
            sent.entry(frame).and_modify(|last: &mut f64| *last = last.max(end)).or_insert(end);
        }
        let first_box_ms = sent.values().copied().reduce(f64::min);
        // Names of frames are stamps in ns, whose order as texts is that of time.
        let counted =
            sent.into_iter().filter_map(|(frame, sent)| Some((frame, (*arrived.get(frame)?, sent))));
        let counted: BTreeMap<_, _> = counted.skip(warm_up).collect();
        let mut stages = BTreeMap::<String, Vec<f64>>::new();
        for Span { node, frame, name, begin, end } in of("unwrap").chain(of("detector")) {
            // The span of the whole step contains those of its stages.
            if name != "step" && counted.contains_key(frame) {
                stages.entry(format!("{node} {name}")).or_default().push(end - begin);
            }
        }
        let ends = counted.values().map(|(_, sent)| *sent);
        let (first, last) = ends.fold((f64::INFINITY, 0.0f64), |(a, b), ms| (a.min(ms), b.max(ms)));
        let frames_per_s = (last > first).then(|| 1e3 * (counted.len() - 1) as f64 / (last - first));
        let frames_ms = counted.values().map(|(arrived, sent)| sent - arrived).collect();
        let ages = counted.iter().filter_map(|(frame, (_, sent))| Some(sent - taken.get(frame)?));
        Self { ages_ms: ages.collect(), frames_ms, frames_per_s, first_box_ms, stages }
    }

    /// Adds the frames of another run.
    pub fn add(&mut self, other: Self) {
        self.frames_ms.extend(other.frames_ms);
        self.ages_ms.extend(other.ages_ms);
        for (name, ms) in other.stages {
            self.stages.entry(name).or_default().extend(ms);
        }
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn a_frame_lasts_from_its_arrival_at_unwrap_to_the_end_of_its_boxes() {
        let span = |name: &str, frame: &str, ts: f64, dur: f64| json!({"name": name, "ph": "X", "ts": ts, "dur": dur, "args": {"frame": frame}});
        let [mut camera, mut detector, mut unwrap] =
            ["/modulo_camera", "/detector", "/unwrap"].map(|node| vec![json!({"node": node})]);
        for (number, frame) in ["1", "2", "3"].into_iter().enumerate() {
            let begin = 10_000.0 * number as f64;
            camera.push(span("step", frame, begin, 900.0));
            unwrap.push(span("step", frame, begin + 1_000.0, 2_000.0));
            unwrap.push(span("unwrap", frame, begin + 1_000.0, 1_500.0));
            detector.push(span("step", frame, begin + 3_000.0, 4_000.0));
            detector.push(span("infer", frame, begin + 3_000.0, 3_500.0));
        }
        // This one was replaced by a newer one.
        unwrap.push(span("step", "4", 90_000.0, 1.0));
        let times = Times::read(&[camera, detector, unwrap], 1);
        assert_eq!((times.frames_ms, times.ages_ms), (vec![6.0; 2], vec![7.0; 2]));
        assert_eq!((times.frames_per_s, times.first_box_ms), (Some(100.0), Some(7.0)));
        let stages = [("detector infer", vec![3.5; 2]), ("unwrap unwrap", vec![1.5; 2])];
        assert_eq!(times.stages, stages.map(|(name, ms)| (name.to_owned(), ms)).into());
        assert_eq!(Times::read(&[], 0), Times::default());
    }
}
