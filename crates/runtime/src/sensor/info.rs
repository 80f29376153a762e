//! The sensor description: each frame of a camera comes with the model of its sensor, which no node has to guess.
//!
//! The camera publishes it on [`TOPIC`] before each frame, with the stamp of the frame, as a
//! `diagnostic_msgs/msg/DiagnosticArray`, which every ROS 2 node can read: one status named `NODE: sensor`, whose
//! values are the parameters of [`SensorModel`], `height` and `width` of its images in px, and the [`StreamKind`] of each of its image
//! topics by the name of the topic. The camera sends the first one before it waits for other nodes. `unwrap` does the same on [`RECOVERED_TOPIC`] before the images that it makes. The topics are latched: a late
//! reader gets the last one.

use std::collections::{BTreeMap, VecDeque};

use modulo_msgs::diagnostic_msgs::{DiagnosticArray, DiagnosticStatus, KeyValue};
use modulo_msgs::std_msgs::{Header, Time};

use crate::message::{Message, MessageKind};
use crate::node::Context;
use crate::parameter::{ParameterError, ParameterSet as _};
use crate::sensor::parameters::SensorModel;
use crate::sensor::scale::StreamKind;
use crate::topic::{Qos, Topic};

/// Name of the topic, relative to the namespace of the camera.
pub const TOPIC: &str = "sensor_info";
/// Name of the topic of the same description, as `unwrap` has used it, with the streams that it makes.
pub const RECOVERED_TOPIC: &str = "recovered/sensor_info";
/// The names of the sides of its images, px.
const HEIGHT: &str = "height";
const WIDTH: &str = "width";
/// The longest side of an image that is believed before there is one, px.
const LONGEST: usize = 4096;
/// Topics whose descriptions are kept.
const MOST_TOPICS: usize = 256;
/// Frames whose description is remembered; more than ever wait for a node.
const REMEMBERED: usize = 64;

/// Returns the topic, as cameras and their readers declare it.
pub fn topic() -> Topic {
    topic_of(TOPIC)
}

/// Returns [`RECOVERED_TOPIC`], as `unwrap` declares it.
pub fn recovered_topic() -> Topic {
    topic_of(RECOVERED_TOPIC)
}

fn topic_of(name: impl Into<String>) -> Topic {
    Topic { qos: Qos::Latched, ..Topic::new(name, MessageKind::Diagnostics) }
}

/// Returns the topics that a reader of the images of `stream` declares: that of its own namespace, and for an absolute
/// topic, which any node may publish, all descriptions of this namespace and of that of the topic.
pub fn topics_for(stream: &str) -> Vec<Topic> {
    let Some((namespace, _)) = stream.rsplit_once('/') else { return vec![topic()] };
    let beside = [TOPIC, RECOVERED_TOPIC].map(|name| topic_of(format!("{namespace}/{name}")));
    [topic(), recovered_topic()].into_iter().chain(beside).collect()
}

/// Returns the kind that the name of a topic tells: a declared one, and one that no description covers, as in
/// recordings of earlier versions.
fn named(topic: &str) -> Option<StreamKind> {
    StreamKind::of_word(topic.rsplit('/').next()?)
}

/// Returns whether `topic` is that of a sensor, in any namespace. Such a topic is latched, whatever a bag says of it:
/// bags of other programs, and older ones of this suite, name the quality of service usual for its type.
pub fn is_topic(topic: &str) -> bool {
    topic.rsplit('/').next() == Some(TOPIC)
}

/// Returns the description of the frame of `size` (height, width) with this `header` by the node of `cx`, which sends these streams,
/// each with its output.
pub fn message_of(
    (header, size): (&Header, (usize, usize)),
    model: &SensorModel,
    cx: &Context<'_>,
    streams: &[(usize, StreamKind)],
) -> Message {
    let streams = streams.iter().filter_map(|&(output, kind)| Some((cx.topic(output)?, kind)));
    message((header, size), model, cx.node(), streams)
}

/// Returns the description of the frame of `size` (height, width) with this `header` by the node `node`, a fully qualified name, with
/// the kinds of its image topics.
pub fn message<'a>(
    (header, (height, width)): (&Header, (usize, usize)),
    model: &SensorModel,
    node: &str,
    streams: impl IntoIterator<Item = (&'a str, StreamKind)>,
) -> Message {
    let mut values = KeyValue::all(model.to_text());
    values.extend(KeyValue::all([(HEIGHT, height.to_string()), (WIDTH, width.to_string())]));
    values.extend(KeyValue::all(streams.into_iter().map(|(topic, kind)| (topic, kind.word().to_owned()))));
    // Tools show statuses by name, and each camera has its own sensor.
    let name = format!("{}: sensor", node.trim_start_matches('/'));
    let status = DiagnosticStatus { name, values, ..DiagnosticStatus::default() };
    DiagnosticArray::of(header.clone(), status).into()
}

/// Reads the kinds of image topics, whose names are absolute and therefore no names of parameters.
fn read_kinds(message: &DiagnosticArray) -> Result<BTreeMap<String, StreamKind>, ParameterError> {
    let values = message.status.iter().flat_map(|status| &status.values);
    let mut kinds = BTreeMap::new();
    for KeyValue { key, value } in values.filter(|value| value.key.starts_with('/')) {
        let why = match StreamKind::of_word(value) {
            None => format!("must be one of {}", StreamKind::WORDS.map(|(word, _)| word).join(", ")),
            Some(kind) if kinds.insert(key.clone(), kind).is_none_or(|other| other == kind) => continue,
            Some(_) => "the topic is described as another stream as well".to_owned(),
        };
        return Err(ParameterError::new(key, value, why));
    }
    Ok(kinds)
}

fn read(message: &DiagnosticArray) -> Result<SensorModel, ParameterError> {
    let known = SensorModel::descriptors();
    let values = message.status.iter().flat_map(|status| &status.values);
    let mut pairs: Vec<(&str, &str)> = values
        // Another camera may describe more than this model has.
        .filter(|value| known.iter().any(|descriptor| descriptor.name == value.key))
        .map(|value| (value.key.as_str(), value.value.as_str()))
        .collect();
    // The range needs both, and their defaults would be a guess.
    for name in ["bits", "alpha"] {
        if !pairs.iter().any(|(key, _)| *key == name) {
            return Err(ParameterError::new(name, "missing", "the sensor description must contain it"));
        }
    }
    // A Gaussian has a width, and a width is that of a Gaussian.
    let is_given = |name: &str| pairs.iter().any(|(key, _)| *key == name);
    match (is_given("psf"), is_given("psf_sigma")) {
        (false, true) => pairs.push(("psf", "gaussian")),
        (true, false) => pairs.retain(|pair| *pair != ("psf", "gaussian")),
        _ => {}
    }
    // A camera does not have what it does not describe, such as one of an older bag.
    let unknown = SensorModel { headroom: 1.0, ..SensorModel::unknown() }.to_text();
    pairs.splice(0..0, unknown.iter().map(|(name, text)| (*name, text.as_str())));
    SensorModel::from_text(&pairs)
}

/// Reads a side of the images. One that no camera has is unknown: a reader may allocate as much before the first image comes.
fn side(message: &DiagnosticArray, name: &str) -> Option<usize> {
    let side = message.value(name)?.parse().ok()?;
    (1..=LONGEST).contains(&side).then_some(side)
}

/// The descriptions that have come, by the stamp of their frame.
#[derive(Clone, Debug, Default)]
pub struct SensorHistory {
    by_stamp: VecDeque<(Time, SensorModel)>,
    /// The kinds of the image topics that the last description names.
    kinds: BTreeMap<String, StreamKind>,
    /// (height, width) of the images, if the last description has them.
    size: Option<(usize, usize)>,
}

/// The descriptions of all sensors that a reader hears of, by the topic on which they come.
#[derive(Clone, Debug, Default)]
pub struct Descriptions {
    by_topic: BTreeMap<String, SensorHistory>,
}

impl Descriptions {
    /// Takes a message of `topic`. Topics beyond the first 256 are left out.
    ///
    /// # Errors
    /// Returns the [`ParameterError`] of the value that describes no sensor.
    pub fn note(&mut self, topic: &str, message: &DiagnosticArray) -> Result<(), ParameterError> {
        if self.by_topic.len() == MOST_TOPICS && !self.by_topic.contains_key(topic) {
            return Ok(());
        }
        self.by_topic.entry(topic.to_owned()).or_default().note(message)
    }

    /// Returns the kind of the images on `topic`, and the sensor behind them: those of the description that names the
    /// topic, else those that the name tells.
    pub fn of(&self, topic: &str) -> (Option<StreamKind>, Option<&SensorHistory>) {
        let described = |history: &&SensorHistory| history.kinds.contains_key(topic);
        match self.by_topic.values().find(described) {
            Some(history) => (history.kinds.get(topic).copied(), Some(history)),
            None => {
                let kind = named(topic);
                let beside = topic.rsplit_once('/').filter(|_| kind.is_some());
                let beside = beside.map_or(TOPIC.to_owned(), |(namespace, _)| format!("{namespace}/{TOPIC}"));
                (kind, self.by_topic.get(&beside))
            }
        }
    }
}

impl SensorHistory {
    /// Takes a message of [`TOPIC`].
    ///
    /// # Errors
    /// [`ParameterError`] of the value that describes no sensor.
    pub fn note(&mut self, message: &DiagnosticArray) -> Result<(), ParameterError> {
        let model = read(message)?;
        self.kinds = read_kinds(message)?;
        self.size = side(message, HEIGHT).zip(side(message, WIDTH));
        if self.by_stamp.len() == REMEMBERED {
            self.by_stamp.pop_front();
        }
        self.by_stamp.push_back((message.header.stamp, model));
        Ok(())
    }

    /// Returns the sensor that made the frame of `stamp`.
    pub fn of(&self, stamp: Time) -> Option<&SensorModel> {
        // A frame is mostly asked for right after its description came.
        self.by_stamp.iter().rev().find(|(at, _)| *at == stamp).map(|(_, model)| model)
    }

    /// Returns the sensor of the frame of `stamp` as far as it is known: where its own description is late or lost,
    /// that of the last frame before it, else the last one that has come.
    pub fn nearest(&self, stamp: Time) -> Option<&SensorModel> {
        // The description of the next frame may have come already, and that one may have another sensor.
        let before = self.by_stamp.iter().rev().find(|(at, _)| at.as_ns() <= stamp.as_ns());
        before.map(|(_, model)| model).or_else(|| self.latest())
    }

    /// Returns (height, width) of the images in px, if the last description has them.
    pub fn size(&self) -> Option<(usize, usize)> {
        self.size
    }

    /// Returns the sensor of the last description.
    pub fn latest(&self) -> Option<&SensorModel> {
        self.by_stamp.back().map(|(_, model)| model)
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::sensor::parameters::BlurShape;

    fn header(ns: u64) -> Header {
        Header { stamp: Time::from_ns(ns), frame_id: "camera".into() }
    }

    fn description(ns: u64, model: &SensorModel) -> DiagnosticArray {
        described(ns, model, &[])
    }

    fn described(ns: u64, model: &SensorModel, streams: &[(&str, StreamKind)]) -> DiagnosticArray {
        let message =
            message((&header(ns), (375, 1242)), model, "/front/modulo_camera", streams.iter().copied());
        let Message::Diagnostics(array) = message else { unreachable!("a description is a DiagnosticArray") };
        DiagnosticArray::clone(&array)
    }

    proptest! {
        #[test]
        fn a_description_gives_the_same_sensor(
            bits in 1u8..=16,
            (alpha, headroom) in (1e-3f64..256.0, 1e-3f64..=1.0),
            (transfer, optical_black) in (0usize..4, 0usize..=64),
            psf in 0usize..3,
            psf_sigma in 0.0f64..4.0,
            (gains, gain_ratio) in (any::<bool>(), 1e-9f64..1.0),
        ) {
            let psf = BlurShape::WORDS[psf].1;
            let transfer = modulo_core::Transfer::WORDS[transfer].1;
            let rest = SensorModel { bits, alpha, headroom, transfer, optical_black, ..SensorModel::default() };
            let model = SensorModel { psf, psf_sigma, gains, gain_ratio: Some(gain_ratio), ..rest };
            prop_assert_eq!(read(&description(1, &model)), Ok(model));
        }
    }

    #[test]
    fn each_frame_has_its_own_sensor() {
        let mut history = SensorHistory::default();
        let model = |alpha| SensorModel { alpha, ..SensorModel::default() };
        for n in 0..2 * REMEMBERED as u64 {
            history.note(&description(n, &model(n as f64 + 1.0))).expect("a sensor");
        }
        let last = 2 * REMEMBERED as u64 - 1;
        assert_eq!(history.of(Time::from_ns(last - 1)), Some(&model(last as f64)));
        assert_eq!(history.latest(), Some(&model(last as f64 + 1.0)));
        assert_eq!(history.of(Time::from_ns(0)), None, "too long ago");
        assert_eq!(history.nearest(Time::from_ns(last - 1)), Some(&model(last as f64)));
        assert_eq!(history.nearest(Time::from_ns(last + 7)), history.latest(), "its own is late");
        assert_eq!(history.nearest(Time::from_ns(0)), history.latest(), "nothing is known of that time");
        assert_eq!(history.by_stamp.len(), REMEMBERED);
    }

    /// Tools show statuses by their name alone.
    #[test]
    fn the_status_of_each_camera_has_its_own_name() {
        assert_eq!(description(1, &SensorModel::default()).status[0].name, "front/modulo_camera: sensor");
        for (stream, topics) in [
            ("recovered", &["sensor_info"][..]),
            ("/modulo", &["sensor_info", "recovered/sensor_info", "/sensor_info", "/recovered/sensor_info"]),
            (
                "/a/image",
                &["sensor_info", "recovered/sensor_info", "/a/sensor_info", "/a/recovered/sensor_info"],
            ),
        ] {
            let names: Vec<String> = topics_for(stream).into_iter().map(|topic| topic.name).collect();
            assert_eq!(names, topics, "{stream}");
        }
    }

    /// A stream is what its description says, whatever its name; a recording of an earlier version says nothing of it.
    #[test]
    fn a_remapped_stream_keeps_its_kind_and_its_sensor() {
        let sensor = |bits| SensorModel { bits, ..SensorModel::default() };
        let mut descriptions = Descriptions::default();
        let streams = [("/x/anything", StreamKind::Modulo), ("/front/modulo", StreamKind::Ideal)];
        descriptions.note("/rear/sensor_info", &described(1, &sensor(6), &streams)).expect("a sensor");
        descriptions.note("/front/sensor_info", &description(1, &sensor(10))).expect("a sensor");
        let of = |topic| {
            let (kind, history) = descriptions.of(topic);
            (kind, history.and_then(SensorHistory::latest).map(|sensor| sensor.bits))
        };
        assert_eq!(of("/x/anything"), (Some(StreamKind::Modulo), Some(6)));
        assert_eq!(
            of("/front/modulo"),
            (Some(StreamKind::Ideal), Some(6)),
            "its name is that of another stream"
        );
        assert_eq!(of("/front/saturated"), (Some(StreamKind::Saturated), Some(10)), "an earlier version");
        assert_eq!(of("/x/saturated"), (Some(StreamKind::Saturated), None));
        assert_eq!(of("/front/image"), (None, None));
    }

    #[test]
    fn a_kind_that_is_unknown_or_has_two_values_is_refused() {
        let streams = [("/image", StreamKind::Modulo), ("/image", StreamKind::Hdr)];
        let mut array = described(1, &SensorModel::default(), &streams);
        let why = SensorHistory::default().note(&array).expect_err("two kinds").to_string();
        assert!(why.contains("'/image' = hdr") && why.contains("as another stream as well"), "{why}");
        array.status[0].values.last_mut().expect("the kind").value = "modulp".into();
        let why = SensorHistory::default().note(&array).expect_err("no such kind").to_string();
        assert!(why.contains("'/image' = modulp") && why.contains("modulo, recovered, metered"), "{why}");
    }

    #[test]
    fn a_camera_that_does_not_describe_its_headroom_black_columns_or_lens_has_none() {
        let mut array = description(1, &SensorModel::default());
        let older = |key: &str| !["headroom", "optical_black", "psf_sigma"].contains(&key);
        array.status[0].values.retain(|value| older(&value.key));
        assert_eq!(read(&array), Ok(SensorModel { headroom: 1.0, ..SensorModel::unknown() }));
        let mut array = description(1, &SensorModel::default());
        array.status[0].values.retain(|value| value.key != "psf");
        assert_eq!(read(&array), Ok(SensorModel::default()), "a width is that of a Gaussian");
    }

    #[test]
    fn a_description_without_a_sensor_is_refused() {
        let mut history = SensorHistory::default();
        let why = history.note(&DiagnosticArray::default()).expect_err("no values").to_string();
        assert!(why.contains("bits") && why.contains("missing"), "{why}");
        let mut array = description(1, &SensorModel::default());
        array.status[0].values[1].value = "-4".into();
        let why = history.note(&array).expect_err("a negative alpha").to_string();
        assert!(why.contains("alpha") && why.contains("-4"), "{why}");
        let mut array = description(1, &SensorModel { gains: true, ..SensorModel::default() });
        let gains = array.status[0].values.iter_mut().find(|value| value.key == "gains");
        gains.expect("it is described").value = "rows".into();
        let why = history.note(&array).expect_err("no such gains").to_string();
        assert!(why.contains("'gains' = 'rows'") && why.contains("none, checkerboard"), "{why}");
        assert!(history.latest().is_none());
    }
}
