//! The bytes that a real ROS 2 wrote for stated contents, whole and damaged. Damaged bytes give an error or another message,
//! but never a panic, and never memory for bytes that are missing.

use modulo_core::{BBox, Detection};
use modulo_msgs::builtin_interfaces::Time;
use modulo_msgs::cdr::{self, CdrError};
use modulo_msgs::diagnostic_msgs::{DiagnosticArray, DiagnosticStatus, KeyValue};
use modulo_msgs::rcl_interfaces::*;
use modulo_msgs::rosgraph_msgs::Clock;
use modulo_msgs::sensor_msgs::{CompressedImage, Image};
use modulo_msgs::std_msgs::{self, Header};
use modulo_msgs::std_srvs::SetBoolRequest;
use modulo_msgs::vision_msgs::{Detection2D, Detection2DArray};
use proptest::prelude::*;
use serde::Serialize;
use serde::de::DeserializeOwned;

use crate::wire;

/// Reads the golden and compares; writes the message and compares all bytes but padding, which ROS leaves as it finds
/// it.
fn check<T>(name: &str, expected: T)
where
    T: Serialize + DeserializeOwned + PartialEq + std::fmt::Debug + modulo_msgs::Interface,
{
    let golden = &wire::goldens()[name];
    assert_eq!(golden.type_name, T::NAME);
    let recorded = golden.bytes();
    let read: T = cdr::from_slice(&recorded).expect(name);
    assert_eq!(read, expected, "{name} as read");

    let written = cdr::to_vec(&expected).expect(name);
    assert_eq!(recorded.len() - written.len(), slack(name), "{name}: bytes behind the message");
    assert_eq!(written[..4], recorded[..4], "{name}: encapsulation");
    for at in 4..written.len() {
        assert!(
            written[at] == recorded[at] || is_padding(&written, at, &expected),
            "{name}: byte {at} is {:#04x}, ROS writes {:#04x}",
            written[at],
            recorded[at]
        );
    }
}

/// Bytes that ROS leaves behind a message, because it estimates the size: four for each empty sequence of 8-byte
/// numbers, two of which are in each `ParameterValue`; and up to a multiple of four behind a lone bool.
fn slack(name: &str) -> usize {
    match name {
        "set_parameters_request" => 5 * 8,
        "get_parameters_response" => 2 * 8,
        "parameter_event" => 8,
        "set_bool_request" => 3,
        _ => 0,
    }
}

/// Whether the byte can be anything without changing the message.
fn is_padding<T: DeserializeOwned + PartialEq>(written: &[u8], at: usize, message: &T) -> bool {
    let mut other = written.to_vec();
    other[at] = !other[at];
    written[at] == 0 && cdr::from_slice::<T>(&other).is_ok_and(|read| read == *message)
}

fn stamp() -> Time {
    Time { sec: 1_700_000_000, nanosec: 123_456_789 }
}

fn header() -> Header {
    Header { stamp: stamp(), frame_id: "camera".into() }
}

fn counting(n: u8) -> Vec<u8> {
    (0..n).collect()
}

fn image(encoding: &str, step: u32, data: Vec<u8>) -> Image {
    Image { header: header(), height: 2, width: 3, encoding: encoding.into(), is_bigendian: 0, step, data }
}

fn parameter(name: &str, value: ParameterValue) -> Parameter {
    Parameter { name: name.into(), value }
}

fn string(text: &str) -> ParameterValue {
    ParameterValue {
        r#type: ParameterType::PARAMETER_STRING,
        string_value: text.into(),
        ..Default::default()
    }
}

fn integer(value: i64) -> ParameterValue {
    ParameterValue { r#type: ParameterType::PARAMETER_INTEGER, integer_value: value, ..Default::default() }
}

#[test]
fn stamped_text() {
    check("header", header());
    check("clock", Clock { clock: stamp() });
    check("string", std_msgs::String { data: "hello".into() });
    check(
        "log",
        Log {
            stamp: stamp(),
            level: Log::INFO,
            name: "detector".into(),
            msg: "ready".into(),
            file: "main.rs".into(),
            function: "main".into(),
            line: 7,
        },
    );
}

#[test]
fn images() {
    check("image_rgb8", image("rgb8", 9, counting(18)));
    check("image_rgb16", image("rgb16", 18, counting(36)));
    check("image_empty", Image::default());
    let format = "rgb8; jpeg compressed rgb8".into();
    check("compressed", CompressedImage { header: header(), format, data: vec![255, 216, 255] });
}

#[test]
fn detections() {
    check("detections_empty", Detection2DArray { header: header(), detections: vec![] });
    let car = BBox { x1: 80.5, y1: 40.25, x2: 120.5, y2: 60.25 };
    let person = BBox { x1: 6.0, y1: 12.0, x2: 14.0, y2: 28.0 };
    let [mut car, person] = [(car, 0.875, "car"), (person, 0.5, "person")].map(|(bbox, score, class)| {
        Detection2D::from_detection(&Detection { bbox, score, class: class.into() }, &header())
    });
    car.id = "0".into();
    check("detections_two", Detection2DArray { header: header(), detections: vec![car, person] });
}

#[test]
fn diagnostics() {
    let pair = |key: &str, value: &str| KeyValue { key: key.into(), value: value.into() };
    let status = DiagnosticStatus {
        level: DiagnosticStatus::OK,
        name: "detector: inference".into(),
        message: "ok".into(),
        hardware_id: "cpu".into(),
        values: vec![pair("rate", "10.0"), pair("drops", "0")],
    };
    check("diagnostics", DiagnosticArray { header: header(), status: vec![status] });
}

#[test]
fn setting_parameters() {
    let double =
        ParameterValue { r#type: ParameterType::PARAMETER_DOUBLE, double_value: 0.25, ..Default::default() };
    let bool =
        ParameterValue { r#type: ParameterType::PARAMETER_BOOL, bool_value: true, ..Default::default() };
    let strings = ParameterValue {
        r#type: ParameterType::PARAMETER_STRING_ARRAY,
        string_array_value: vec!["car".into(), "person".into()],
        ..Default::default()
    };
    let parameters = vec![
        parameter("input", string("recovered")),
        parameter("score_threshold", double),
        parameter("max_det", integer(300)),
        parameter("use_sim_time", bool),
        parameter("classes", strings),
    ];
    check("set_parameters_request", SetParametersRequest { parameters });
    let done = SetParametersResult { successful: true, reason: String::new() };
    let refused = SetParametersResult { successful: false, reason: "unknown stream".into() };
    check("set_parameters_response", SetParametersResponse { results: vec![done, refused] });
    check("set_bool_request", SetBoolRequest { data: true });
    check(
        "parameter_event",
        ParameterEvent {
            stamp: stamp(),
            node: "/detector".into(),
            changed_parameters: vec![parameter("input", string("recovered"))],
            ..Default::default()
        },
    );
}

#[test]
fn getting_parameters() {
    let names = vec!["input".to_owned(), "max_det".to_owned()];
    check("get_parameters_request", GetParametersRequest { names: names.clone() });
    check(
        "get_parameters_response",
        GetParametersResponse { values: vec![string("recovered"), integer(300)] },
    );
    check("list_parameters_request", ListParametersRequest::default());
    let result = ListParametersResult { names, prefixes: vec![] };
    check("list_parameters_response", ListParametersResponse { result });
    let descriptor = ParameterDescriptor {
        name: "score_threshold".into(),
        r#type: ParameterType::PARAMETER_DOUBLE,
        description: "lowest score kept".into(),
        floating_point_range: vec![FloatingPointRange { from_value: 0.0, to_value: 1.0, step: 0.0 }],
        ..Default::default()
    };
    check("describe_parameters_response", DescribeParametersResponse { descriptors: vec![descriptor] });
}

#[test]
fn every_golden_is_known() {
    let structs = wire::structs();
    assert_eq!(wire::goldens().len(), 20);
    for (name, golden) in wire::goldens() {
        assert!(structs.contains_key(golden.type_name.as_str()), "{name}");
    }
}

#[test]
fn every_truncation_is_an_error() {
    let structs = wire::structs();
    for (name, golden) in wire::goldens() {
        let reread = structs[golden.type_name.as_str()];
        let bytes = golden.bytes();
        let needed = reread(&bytes).expect("a golden").len();
        for length in 0..needed {
            let Err(error) = reread(&bytes[..length]) else { panic!("{name} cut to {length} bytes is read") };
            assert!(matches!(error, CdrError::Read(..)), "{name} cut to {length} bytes: {error}");
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
    let why = "unexpected end of input".to_owned();
    assert_eq!(error, CdrError::Read(length_at + 4, long.len(), why));

    let header = cdr::to_vec(&Header { frame_id: "ab".into(), ..Default::default() }).expect("a header");
    for (at, value, message) in [
        (1, 3, "byte 0 of 19: an encapsulation of 4 bytes is needed, 00 00 (CDR_BE) or 00 01 (CDR_LE) first"),
        (16, 0xff, "byte 19 of 19: invalid utf-8"),
        (12, 9, "byte 16 of 19: unexpected end of input"),
    ] {
        let mut bad = header.clone();
        bad[at] = value;
        let error = cdr::from_slice::<Header>(&bad).expect_err(message).to_string();
        assert!(error.contains(message), "{error}");
    }
}

#[test]
fn a_length_beyond_the_rest_is_refused_before_its_elements_are_read() {
    let mut bytes = cdr::to_vec(&GetParametersRequest { names: vec!["a".into()] }).expect("short");
    bytes[4] = 200;
    let error =
        cdr::from_slice::<GetParametersRequest>(&bytes).expect_err("200 elements are not there").to_string();
    assert!(error.contains("byte 8 of 14: 200 elements expected, but only 6 bytes are left"), "{error}");
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
