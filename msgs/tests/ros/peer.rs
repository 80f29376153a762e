//! Messages that another ROS 2 has filled and written: tests/peers/rclpy_messages.py makes the file that `MODULO_PEER_MESSAGES` names.

use std::collections::BTreeMap;

use modulo_msgs::type_hash;
use serde::Deserialize;

use crate::wire;

#[derive(Deserialize)]
struct Type {
    name: String,
    hash: String,
    /// The bytes of each message of the type in hexadecimal digits, and the names of its fields.
    messages: BTreeMap<String, (String, Vec<String>)>,
}

/// Without a file there is nothing to compare; `tests/peers/run rclpy` runs this test with one.
#[test]
fn messages_of_a_peer_are_read_and_written() {
    let Some(file) = std::env::var_os("MODULO_PEER_MESSAGES") else { return };
    let types: Vec<Type> = serde_json::from_slice(&std::fs::read(file).expect("a file")).expect("JSON");
    let (structs, fields) = (wire::structs(), wire::struct_fields());
    let mut compared = 0;
    for Type { name, hash, messages } in &types {
        assert_eq!(type_hash(name).as_ref(), Some(hash), "{name}");
        for (name, (digits, names)) in messages {
            let reread = structs.get(name.as_str()).unwrap_or_else(|| panic!("{name} has no struct"));
            // rclpy does not name the byte of a message without fields.
            let own =
                fields[name.as_str()].iter().filter(|field| **field != "structure_needs_at_least_one_member");
            assert!(own.eq(names), "{name}: {names:?}");
            let theirs = wire::Golden { type_name: name.clone(), hex: digits.clone() }.bytes();
            let ours = reread(&theirs).expect(name);
            // ROS may send more bytes than the message has: it estimates the length first.
            assert!(ours.len() <= theirs.len(), "{name}: {ours:02x?} {theirs:02x?}");
            for at in (0..ours.len()).filter(|&at| ours[at] != theirs[at]) {
                // ROS leaves padding as it finds it: whatever stands there, the message is the same.
                let mut other = theirs.clone();
                other[at] ^= 0x55;
                assert_eq!(
                    (ours[at], reread(&other)),
                    (0, Ok(ours.clone())),
                    "{name}: byte {at} of {theirs:02x?}"
                );
            }
            compared += 1;
        }
    }
    println!("{} hashes, {compared} messages", types.len());
    assert!(compared >= 50, "{compared}");
}
