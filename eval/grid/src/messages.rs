//! What the nodes of a chain have sent in a step.

use std::collections::BTreeSet;
use std::sync::Arc;

use modulo_core::Detection;
use modulo_runtime::lockstep::OnTopic;
use modulo_runtime::sensor::recovery::Recovery;
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

/// The boxes on `topic`. `None` without an answer.
pub fn found(out: &[OnTopic], topic: &str) -> Option<Vec<Detection>> {
    let boxes = on(out, topic).filter_map(|message| match message {
        Message::Detections(array) => Some(array.detections.iter().filter_map(|one| one.to_detection())),
        _ => None,
    });
    boxes.map(Vec::from_iter).reduce(|first, second| [first, second].concat())
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

/// Returns what `unwrap` says on `topic` of the image of this frame.
pub fn recovery<'a>(out: &'a [OnTopic], topic: &'a str) -> Option<Recovery<'a>> {
    let mut statuses = on(out, topic).filter_map(|message| match message {
        Message::Diagnostics(array) => Some(Recovery::of(array)),
        _ => None,
    });
    statuses.find(|status| !status.method_used.is_empty())
}
