//! The sensor description: each frame of a camera comes with the model of its sensor, which no node has to guess.
//!
//! The camera publishes it on [`TOPIC`] before each frame, with the stamp of the frame, as a
//! `diagnostic_msgs/msg/DiagnosticArray`, which every ROS 2 node can read: one status named `NODE: sensor`, whose values are
//! the parameters of [`SensorModel`]. The topic is latched: a late reader gets the last one.

use std::collections::VecDeque;
use std::sync::Arc;

use modulo_msgs::diagnostic_msgs::{DiagnosticArray, DiagnosticStatus, KeyValue};
use modulo_msgs::std_msgs::{Header, Time};

use crate::message::{Message, MessageKind};
use crate::parameter::{ParameterError, ParameterSet as _};
use crate::sensor::parameters::SensorModel;
use crate::sensor::scale::StreamScale;
use crate::topic::{Qos, Topic};

/// Name of the topic, relative to the namespace of the camera.
pub const TOPIC: &str = "sensor_info";
/// Frames whose description is remembered; more than ever wait for a node.
const REMEMBERED: usize = 64;

/// Returns the topic, as cameras and their readers declare it.
pub fn topic() -> Topic {
    Topic { qos: Qos::Latched, ..Topic::new(TOPIC, MessageKind::Diagnostics) }
}

/// Returns the topic of the sensor that made the images of `stream`: that of the namespace of the reader, and beside an absolute topic whose
/// name is that of a stream of the suite, such as `/front/modulo`.
pub fn topic_beside(stream: &str) -> Topic {
    match stream.rsplit_once('/') {
        Some((namespace, name)) if StreamScale::covers(name) => {
            Topic { name: format!("{namespace}/{TOPIC}"), ..topic() }
        }
        _ => topic(),
    }
}

/// Returns whether `topic` is that of a sensor, in any namespace. Such a topic is latched, whatever a bag says of it: bags
/// of other programs, and older ones of this suite, name the quality of service usual for its type.
pub fn is_topic(topic: &str) -> bool {
    topic.rsplit('/').next() == Some(TOPIC)
}

/// Returns the description of the frame with this `header` by the camera `node`, a fully qualified name.
pub fn message(header: &Header, model: &SensorModel, node: &str) -> Message {
    let values = KeyValue::all(model.to_text());
    // Tools show statuses by name, and each camera has its own sensor.
    let name = format!("{}: sensor", node.trim_start_matches('/'));
    let status = DiagnosticStatus { name, values, ..DiagnosticStatus::default() };
    Message::Diagnostics(Arc::new(DiagnosticArray { header: header.clone(), status: vec![status] }))
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
    // What a camera does not describe, such as that of an older bag, it does not have.
    let unknown = SensorModel { headroom: 1.0, ..SensorModel::unknown() }.to_text();
    pairs.splice(0..0, unknown.iter().map(|(name, text)| (*name, text.as_str())));
    SensorModel::from_text(&pairs)
}

/// The descriptions that have come, by the stamp of their frame.
#[derive(Clone, Debug, Default)]
pub struct SensorHistory {
    by_stamp: VecDeque<(Time, SensorModel)>,
}

impl SensorHistory {
    /// Takes a message of [`TOPIC`].
    ///
    /// # Errors
    /// [`ParameterError`] of the value that describes no sensor.
    pub fn note(&mut self, message: &DiagnosticArray) -> Result<(), ParameterError> {
        let model = read(message)?;
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

    /// Returns the sensor of the frame of `stamp` as far as it is known: where its own description is late or lost, that of the
    /// last frame before it, else the last one that has come.
    pub fn nearest(&self, stamp: Time) -> Option<&SensorModel> {
        // The description of the next frame may have come already, and that one may have another sensor.
        let before = self.by_stamp.iter().rev().find(|(at, _)| at.as_ns() <= stamp.as_ns());
        before.map(|(_, model)| model).or_else(|| self.latest())
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
        let Message::Diagnostics(array) = message(&header(ns), model, "/front/modulo_camera") else {
            unreachable!("a description is a DiagnosticArray")
        };
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
        for (stream, topic) in [
            ("recovered", "sensor_info"),
            ("/front/modulo", "/front/sensor_info"),
            ("/modulo", "/sensor_info"),
            ("/camera/image_raw", "sensor_info"),
        ] {
            assert_eq!(topic_beside(stream).name, topic, "{stream}");
        }
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
