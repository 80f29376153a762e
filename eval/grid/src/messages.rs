//! What the nodes of a chain have sent in a step.

use std::collections::BTreeSet;
use std::sync::Arc;

use modulo_core::Detection;
use modulo_msgs::vision_msgs::Detection2DArray;
use modulo_runtime::lockstep::OnTopic;
use modulo_runtime::{Message, StampedFrame};

fn on<'a>(out: &'a [OnTopic], topic: &'a str) -> impl Iterator<Item = &'a Message> {
    out.iter().filter(move |(name, _)| name == topic).map(|(_, message)| message)
}

/// The image on `topic`.
pub fn image<'a>(out: &'a [OnTopic], topic: &'a str) -> Option<&'a Arc<StampedFrame>> {
    on(out, topic).find_map(|message| match message {
        Message::Image(image) => Some(image),
        _ => None,
    })
}

/// The boxes on `topic`, as messages.
pub fn arrays<'a>(out: &'a [OnTopic], topic: &'a str) -> impl Iterator<Item = &'a Detection2DArray> {
    on(out, topic).filter_map(|message| match message {
        Message::Detections(array) => Some(&**array),
        _ => None,
    })
}

/// The boxes on `topic`. `None` without an answer.
pub fn found(out: &[OnTopic], topic: &str) -> Option<Vec<Detection>> {
    arrays(out, topic)
        .map(|array| array.detections.iter().filter_map(|box_| box_.to_detection()).collect::<Vec<_>>())
        .reduce(|first, second| [first, second].concat())
}

/// The names of the classes that a detector says on `topic` that it knows.
pub fn classes(out: &[OnTopic], topic: &str) -> Option<BTreeSet<String>> {
    on(out, topic).find_map(|message| match message {
        Message::LabelInfo(info) => {
            Some(info.class_map.iter().map(|class| class.class_name.clone()).collect())
        }
        _ => None,
    })
}

/// The value of `key` in the diagnostics on `topic`.
pub fn value<'a>(out: &'a [OnTopic], topic: &'a str, key: &str) -> Option<&'a str> {
    let mut statuses = on(out, topic).flat_map(|message| match message {
        Message::Diagnostics(array) => &array.status[..],
        _ => &[],
    });
    let pair = statuses.find_map(|status| status.values.iter().find(|pair| pair.key == key))?;
    Some(&pair.value)
}
