//! Structs, definitions and hashes say the same about every type.

use std::collections::BTreeMap;

use modulo_msgs::rihs::type_description;
use modulo_msgs::type_description_interfaces::{FieldType, IndividualTypeDescription, TypeDescription};
use modulo_msgs::{interface, ros2msg, type_hash, type_hash_of_schema};
use proptest::prelude::*;
use serde_json::Value;

use crate::wire;

#[test]
fn hashes_are_those_of_ros() {
    let hashes: BTreeMap<String, String> =
        serde_json::from_str(include_str!("../data/hashes.json")).expect("the recorded hashes");
    for (name, hash) in &hashes {
        assert_eq!(type_hash(name).as_ref(), Some(hash), "{name}");
    }
    for name in wire::structs().keys().copied().chain(interface::names()) {
        assert!(hashes.contains_key(name), "no recorded hash of {name}");
    }
    assert_eq!(type_hash("nav_msgs/msg/Path"), None);
    assert_eq!(type_hash("std_srvs/srv/SetBool_Reply"), None);
}

#[test]
fn structs_have_the_fields_of_their_definitions() {
    for (name, fields) in wire::struct_fields() {
        let description = type_description(name).expect(name).type_description;
        let defined: Vec<_> = description.fields.iter().map(|field| field.name.as_str()).collect();
        let expected = if fields.is_empty() { vec!["structure_needs_at_least_one_member"] } else { fields };
        assert_eq!(defined, expected, "{name}");
    }
}

#[test]
fn every_definition_has_a_struct_and_a_schema() {
    let structs = wire::structs();
    for name in interface::names() {
        if name.contains("/srv/") {
            for part in ["Request", "Response"] {
                assert!(structs.contains_key(format!("{name}_{part}").as_str()), "{name}_{part}");
            }
        } else {
            assert!(structs.contains_key(name), "{name}");
            let schema = ros2msg(name).expect(name);
            assert_eq!(type_hash_of_schema(name, &schema).ok(), type_hash(name), "{name}");
        }
    }
}

#[test]
fn a_foreign_schema_may_use_short_names_and_crlf() {
    let line = "=".repeat(80);
    let schema = format!(
        "# Sent\r\nbuiltin_interfaces/Time stamp\r\nstring frame_id\r\n{line}\r\n\
         MSG: builtin_interfaces/Time\r\nint32 sec # s\r\nuint32 nanosec\r\n"
    );
    for name in ["std_msgs/msg/Header", "std_msgs/Header"] {
        assert_eq!(type_hash_of_schema(name, &schema).ok(), type_hash("std_msgs/msg/Header"));
    }
    let cut = schema.split('=').next().expect("its own fields");
    let error = type_hash_of_schema("std_msgs/msg/Header", cut).expect_err("Time is missing").to_string();
    assert!(error.contains("builtin_interfaces/msg/Time"), "{error}");
}

/// A reader of messages follows the types within types, so that they must have an end.
#[test]
fn a_type_within_itself_is_refused() {
    let line = "=".repeat(80);
    for text in [
        "a/B b\n".to_owned(),
        format!("a/C c\n{line}\nMSG: a/C\na/B[] b\n"),
        (0..99).map(|n| format!("a/T{} t\n{line}\nMSG: a/T{}\n", n + 1, n + 1)).collect::<String>()
            + "int8 end\n",
    ] {
        let why = type_hash_of_schema("a/B", &text).expect_err(&text).to_string();
        assert!(why.contains("'a/msg/B' contains itself"), "{why}");
    }
}

/// Every interface that ROS 2 reported, whether the suite defines it or not.
#[test]
fn schemas_of_the_whole_installation_hash_as_in_ros() {
    let Some(file) = crate::data::shared("ros/interfaces.json") else { return };
    let text = std::fs::read_to_string(file).expect("readable");
    let all: BTreeMap<String, Value> = serde_json::from_str(&text).expect("interfaces.json");
    let body = |name: &str| {
        let fields = all[name]["fields"].as_array().expect("fields");
        let word = |v: &Value| v.as_str().expect("a word").to_owned();
        fields.iter().map(|f| format!("{} {}\n", word(&f[1]), word(&f[0]))).collect::<String>()
    };
    let everything: String =
        all.keys().map(|name| format!("{}\nMSG: {name}\n{}", "=".repeat(80), body(name))).collect();
    for (name, interface) in &all {
        let schema = body(name) + &everything;
        assert_eq!(type_hash_of_schema(name, &schema).ok().as_deref(), interface["hash"].as_str(), "{name}");
    }
    println!("{} interfaces", all.len());
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    /// The oracle writes random contents as the definition says, knowing nothing of the structs; the structs must read
    /// and write the same.
    #[test]
    fn structs_read_and_write_what_their_definitions_say(seed in any::<u64>()) {
        for (name, reread) in wire::structs() {
            let description = type_description(name).expect(name);
            let little = Oracle::write(&description, seed, Order::Little);
            prop_assert_eq!(reread(&little), Ok(little.clone()), "{}", name);
            let big = Oracle::write(&description, seed, Order::Big);
            prop_assert_eq!(reread(&big), Ok(little), "{}, big endian", name);
        }
    }
}

#[derive(Clone, Copy)]
enum Order {
    Big,
    Little,
}

struct Oracle<'a> {
    types: BTreeMap<&'a str, &'a IndividualTypeDescription>,
    out: Vec<u8>,
    order: Order,
    state: u64,
}

impl<'a> Oracle<'a> {
    fn write(description: &'a TypeDescription, seed: u64, order: Order) -> Vec<u8> {
        let referenced = description.referenced_type_descriptions.iter();
        let types = referenced.map(|t| (t.type_name.as_str(), t)).collect();
        let head = if let Order::Big = order { [0, 0, 0, 0] } else { [0, 1, 0, 0] };
        let mut oracle = Self { types, out: head.to_vec(), order, state: seed };
        oracle.message(&description.type_description);
        oracle.out
    }

    fn message(&mut self, description: &IndividualTypeDescription) {
        for field in &description.fields {
            if field.name == "structure_needs_at_least_one_member" {
                self.out.push(0);
            } else {
                self.field(&field.r#type);
            }
        }
    }

    fn field(&mut self, r#type: &FieldType) {
        let count = match r#type.type_id / 48 {
            0 => 1,
            1 => r#type.capacity,
            2 => self.random(r#type.capacity + 1),
            _ => self.random(4),
        };
        if r#type.type_id / 48 >= 2 {
            self.number(count, 4);
        }
        for _ in 0..count {
            self.element(r#type);
        }
    }

    fn element(&mut self, r#type: &FieldType) {
        let bits = self.random(u64::MAX);
        match r#type.type_id % 48 {
            1 => self.message(self.types[r#type.nested_type_name.as_str()]),
            2 | 3 | 16 => self.number(bits, 1),
            4 | 5 => self.number(bits, 2),
            6 | 7 | 10 => self.number(bits, 4),
            8 | 9 | 11 => self.number(bits, 8),
            15 => self.number(bits & 1, 1),
            17 | 21 => {
                let text = &"seven é"[..bits as usize % 7];
                self.number(text.len() as u64 + 1, 4);
                self.out.extend(text.bytes().chain([0]));
            }
            other => panic!("no struct here has type {other}"),
        }
    }

    fn number(&mut self, value: u64, size: usize) {
        while !(self.out.len() - 4).is_multiple_of(size) {
            self.out.push(0);
        }
        match self.order {
            Order::Big => self.out.extend(&value.to_be_bytes()[8 - size..]),
            Order::Little => self.out.extend(&value.to_le_bytes()[..size]),
        }
    }

    /// splitmix64, below `end`.
    fn random(&mut self, end: u64) -> u64 {
        self.state = self.state.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (self.state ^ (self.state >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        (z ^ (z >> 31)) % end
    }
}
