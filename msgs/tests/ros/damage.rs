//! Damaged messages: an error or another message, never a panic, and never memory for things that are not there.

use modulo_msgs::cdr::{self, CdrError};
use modulo_msgs::sensor_msgs::Image;
use modulo_msgs::std_msgs::Header;
use proptest::prelude::*;

use crate::wire;

#[test]
fn every_truncation_is_an_error() {
    let structs = wire::structs();
    for (name, golden) in wire::goldens() {
        let reread = structs[golden.type_name.as_str()];
        let bytes = golden.bytes();
        let needed = reread(&bytes).expect("a golden").len();
        for length in 0..needed {
            let Err(error) = reread(&bytes[..length]) else { panic!("{name} cut to {length} bytes is read") };
            assert!(matches!(error, CdrError::Short { .. }), "{name} cut to {length} bytes: {error}");
        }
    }
}

#[test]
fn trailing_padding_is_ignored() {
    let structs = wire::structs();
    for (name, golden) in wire::goldens() {
        let reread = structs[golden.type_name.as_str()];
        let mut bytes = golden.bytes();
        let alone = reread(&bytes).expect("a golden");
        bytes.extend([0xa5; 4096]);
        assert_eq!(reread(&bytes), Ok(alone), "{name}");
    }
}

#[test]
fn errors_say_where_and_what() {
    let image = Image { encoding: "mono8".into(), data: vec![7; 10], ..Default::default() };
    let good = cdr::to_vec(&image).expect("an image");
    let length_at = good.len() - 10 - 4;
    let mut long = good.clone();
    long[length_at..length_at + 4].fill(0xff);
    let error = cdr::from_slice::<Image>(&long).expect_err("4 GiB are not there");
    assert_eq!(error, CdrError::Short { offset: length_at + 4, expected: u32::MAX as usize, got: 10 });

    let header = cdr::to_vec(&Header { frame_id: "ab".into(), ..Default::default() }).expect("a header");
    for (at, value, message) in [
        (1, 3, "byte 0: expected encapsulation 00 00 (CDR_BE) or 00 01 (CDR_LE), got 00 03"),
        (16, 0xff, "byte 12: expected UTF-8 text, got invalid utf-8"),
        (18, b'c', "byte 12: expected a string that ends with NUL, got 0x63"),
        (12, 9, "at byte 16, 9 bytes expected, got 3"),
    ] {
        let mut bad = header.clone();
        bad[at] = value;
        let error = cdr::from_slice::<Header>(&bad).expect_err(message).to_string();
        assert!(error.contains(message), "{error}");
    }
}

/// 10^4 unless `MODULO_MUTATIONS` says otherwise.
fn mutations() -> u32 {
    std::env::var("MODULO_MUTATIONS").ok().and_then(|n| n.parse().ok()).unwrap_or(10_000)
}

#[test]
fn mutations_never_panic() {
    let structs = wire::structs();
    let goldens: Vec<_> =
        wire::goldens().into_values().map(|g| (structs[g.type_name.as_str()], g.bytes())).collect();
    let edit = (any::<prop::sample::Index>(), prop_oneof![any::<u8>(), Just(0), Just(255)]);
    let edits = prop::collection::vec(edit, 1..8);
    let config = ProptestConfig { cases: mutations(), failure_persistence: None, ..Default::default() };
    proptest!(config, |(which in 0..goldens.len(), edits in edits, cut in any::<prop::sample::Index>())| {
        let (reread, mut bytes) = goldens[which].clone();
        for (at, value) in edits {
            let at = at.index(bytes.len());
            bytes[at] = value;
        }
        // Half of them are also cut short.
        let length = cut.index(2 * bytes.len());
        bytes.truncate(length);
        if let Ok(written) = reread(&bytes) {
            prop_assert_eq!(reread(&written), Ok(written), "what was read is written stably");
        }
    });
}
