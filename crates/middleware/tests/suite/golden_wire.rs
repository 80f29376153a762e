//! Tokens, keys, hashes and samples against those of a real ROS 2 Jazzy node `/odmi/golden` under rmw_zenoh_cpp 0.2.10.

use modulo_middleware::graph::discovery::gid;
use modulo_middleware::graph::type_description;
use modulo_middleware::parameter::service::Service;
use modulo_msgs::sensor_msgs::Image;
use modulo_msgs::{cdr, ros_name, type_hash};
use modulo_runtime::wire::attachment::Attachment;
use modulo_runtime::wire::keys::{self, Endpoint, EntityKind, Token};
use modulo_runtime::{MessageKind, NodeName, Qos, Topic};
use serde_json::Value;

fn golden() -> Value {
    serde_json::from_str(include_str!("../data/golden_wire.json")).expect("JSON")
}

fn strings(list: &Value) -> impl Iterator<Item = &str> {
    list.as_array().expect("a list").iter().filter_map(Value::as_str)
}

fn hex(text: &Value) -> Vec<u8> {
    let text = text.as_str().expect("hexadecimal digits");
    let byte = |at| u8::from_str_radix(&text[at..at + 2], 16).expect("hexadecimal digits");
    (0..text.len()).step_by(2).map(byte).collect()
}

#[test]
fn every_token_is_read_and_written_and_its_hash_is_ours() {
    let golden = golden();
    let mut endpoints = 0;
    for key in strings(&golden["tokens"]) {
        let token = Token::parse(key).unwrap_or_else(|| panic!("no token: {key}"));
        assert_eq!(token.to_key(), key);
        assert_eq!(token.node_name(), "/odmi/golden");
        if let Some(endpoint) = &token.endpoint {
            let name = ros_name(&endpoint.dds_type);
            assert_eq!(modulo_msgs::dds_name(&name), endpoint.dds_type);
            assert_eq!(type_hash(&name).as_ref(), Some(&endpoint.type_hash), "{name}");
            endpoints += 1;
        }
    }
    assert_eq!(endpoints, 16);
}

/// What every node of ours declares by itself is what rcl declares.
#[test]
fn the_endpoints_of_every_node_are_those_of_rcl() {
    let golden = golden();
    let tokens: Vec<Token> = strings(&golden["tokens"]).filter_map(Token::parse).collect();
    let known = |kind, endpoint: Endpoint| {
        assert!(
            tokens.iter().any(|t| t.kind == kind && t.endpoint.as_ref() == Some(&endpoint)),
            "{endpoint:?}"
        );
    };
    let node_name = NodeName::new("golden", "/odmi", &[]).expect("a name");
    for (topic, kind) in [("/rosout", MessageKind::Log), ("/parameter_events", MessageKind::ParameterEvent)] {
        let Topic { name, kind, qos, .. } = Topic::new(topic, kind);
        known(
            EntityKind::Publisher,
            Endpoint {
                topic: name,
                dds_type: modulo_msgs::dds_name(kind.type_name()),
                type_hash: kind.type_hash(),
                qos: keys::qos_string(qos).into(),
            },
        );
    }
    let parameters = Service::ALL.iter().map(|service| (service.name_and_type(), keys::PARAMETER_QOS));
    let described = (type_description::NAME_AND_TYPE, keys::SERVICE_QOS);
    for ((name, ros_type), qos) in parameters.into_iter().chain([described]) {
        known(
            EntityKind::Server,
            Endpoint {
                topic: format!("{}/{name}", node_name.fully_qualified()),
                dds_type: modulo_msgs::dds_name(ros_type),
                type_hash: type_hash(ros_type).expect("known"),
                qos: qos.into(),
            },
        );
    }
    let latched = tokens.iter().filter_map(|t| t.endpoint.as_ref()).find(|e| e.topic == "/odmi/latched");
    assert_eq!(latched.map(|e| e.qos.as_str()), Some(keys::qos_string(Qos::Latched)));
}

#[test]
fn every_sample_is_read_and_written() {
    let golden = golden();
    let publisher = strings(&golden["tokens"]).filter_map(Token::parse).find(|t| t.entity_id == 16);
    let publisher = publisher.expect("the publisher of the samples");
    let endpoint = publisher.endpoint.as_ref().expect("a publisher has one");
    let samples = golden["samples"].as_array().expect("a list");
    assert_eq!(samples.len(), 4);
    for (number, sample) in (27..).zip(samples) {
        let key = keys::data_key(0, &endpoint.topic, &endpoint.dds_type, &endpoint.type_hash);
        assert_eq!(sample["key"], key);
        let bytes = hex(&sample["attachment"]);
        let attachment = Attachment::parse(&bytes).expect("an attachment");
        assert_eq!((attachment.sequence, attachment.gid), (number, gid(&publisher.to_key())));
        assert_eq!(attachment.to_bytes().as_slice(), bytes);
        let image: Image = cdr::from_slice(&hex(&sample["payload"])).expect("an image");
        assert_eq!((image.width, image.height, image.encoding.as_str()), (3, 2, "rgb8"));
        assert_eq!(image.data, (0..18).collect::<Vec<u8>>());
    }
}
