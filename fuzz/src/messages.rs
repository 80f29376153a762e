//! Targets for input from other nodes: messages, attachments, keys, definitions.

#[path = "../../msgs/tests/ros/wire.rs"]
#[allow(dead_code, reason = "the list of all messages is what is needed of it")]
mod wire;

use std::sync::LazyLock;

use modulo_msgs::rihs::type_description;
use modulo_msgs::{dynamic, type_hash_of_schema};
use modulo_runtime::wire::attachment::Attachment;
use modulo_runtime::wire::keys::{Token, qos_of};
use modulo_runtime::{Message, MessageKind};

static STRUCTS: LazyLock<Vec<(&str, wire::Reread)>> = LazyLock::new(|| wire::structs().into_iter().collect());

/// The first byte chooses a type; what can be read as it is written so that it reads back as the same.
pub fn cdr(data: &[u8]) {
    let Some((&choice, bytes)) = data.split_first() else { return };
    let (name, reread) = STRUCTS[usize::from(choice) % STRUCTS.len()];
    if let Ok(written) = reread(bytes) {
        assert_eq!(reread(&written).as_ref(), Ok(&written), "{name}");
        let description = type_description(name).expect("a type of the suite is described");
        assert!(dynamic::from_slice(&description, bytes).is_ok(), "{name} by its description");
    }
    // The messages that nodes exchange are read in a second way, with images and boxes checked.
    let kind = MessageKind::ALL[usize::from(choice) % MessageKind::ALL.len()];
    if let Ok(message) = Message::decode(kind, bytes) {
        let written = message.encode().expect("what was read can be written");
        let again = Message::decode(kind, &written).expect("what was written can be read");
        assert_eq!(again.encode().as_ref(), Ok(&written), "{kind:?}");
    }
}

/// Bytes by the description of a type, as `topic echo` reads them.
pub fn dynamic(data: &[u8]) {
    let Some((&choice, bytes)) = data.split_first() else { return };
    let (name, _) = STRUCTS[usize::from(choice) % STRUCTS.len()];
    let description = type_description(name).expect("a type of the suite is described");
    if let Ok(value) = dynamic::from_slice(&description, bytes) {
        assert!(value.to_string().len() < 1000 + 100 * bytes.len(), "{name} in words");
    }
}

/// An attachment and a liveliness key are written as they were read.
pub fn keys(data: &[u8]) {
    if let Some(attachment) = Attachment::parse(data) {
        assert_eq!(attachment.to_bytes(), data);
    }
    if let Some(token) = std::str::from_utf8(data).ok().and_then(Token::parse) {
        assert_eq!(Token::parse(&token.to_key()).as_ref(), Some(&token));
        let _ = token.endpoint.map(|endpoint| qos_of(&endpoint.qos));
    }
}

/// A definition that another recorder wrote into a bag.
pub fn schema(data: &[u8]) {
    if let Ok(text) = std::str::from_utf8(data)
        && let Ok(hash) = type_hash_of_schema("std_msgs/msg/Header", text)
    {
        assert_eq!(hash.len(), "RIHS01_".len() + 64);
    }
}
