//! The texts and bytes of the rmw_zenoh convention: topic keys, liveliness tokens, QoS strings. Pure code.
//!
//! Source: rmw_zenoh_cpp 0.2.10 (ROS 2 Jazzy), checked against bytes that a real node sent.

use modulo_msgs::dds_name;

use crate::message::MessageKind;
use crate::name::is_absolute;
use crate::topic::Qos;

/// The kinds of entities in the graph.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum EntityKind {
    /// `NN`
    Node,
    /// `MP`
    Publisher,
    /// `MS`
    Subscription,
    /// `SS`
    Server,
    /// `SC`
    Client,
}

impl EntityKind {
    const ALL: [(Self, &'static str); 5] = [
        (Self::Node, "NN"),
        (Self::Publisher, "MP"),
        (Self::Subscription, "MS"),
        (Self::Server, "SS"),
        (Self::Client, "SC"),
    ];

    fn code(self) -> &'static str {
        Self::ALL.iter().find(|(kind, _)| *kind == self).map_or("NN", |(_, code)| code)
    }
}

/// The topic or service of an endpoint token.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct Endpoint {
    /// Absolute ROS name of the topic or service.
    pub topic: String,
    /// DDS type name, `sensor_msgs::msg::dds_::Image_`.
    pub dds_type: String,
    /// `RIHS01_...`
    pub type_hash: String,
    /// QoS string as [`qos_string`] writes it.
    pub qos: String,
}

impl Endpoint {
    /// Reads the parts of a token; `None` when one of them is not possible.
    fn read(topic: &str, [dds_type, type_hash, qos]: [&str; 3]) -> Option<Self> {
        let topic = demangle(topic);
        let is_possible = is_absolute(&topic) && is_word(dds_type) && is_word(type_hash);
        let [dds_type, type_hash, qos] = [dds_type, type_hash, qos].map(str::to_owned);
        is_possible.then_some(Self { topic, dds_type, type_hash, qos })
    }
}

/// A liveliness token: one entity of the ROS graph.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct Token {
    /// `ROS_DOMAIN_ID`.
    pub domain: u32,
    /// Id of the zenoh session.
    pub session: String,
    /// Number of the node within its session.
    pub node_id: u64,
    /// Number of the entity within its session.
    pub entity_id: u64,
    /// Kind of the entity.
    pub kind: EntityKind,
    /// Namespace with a leading slash.
    pub namespace: String,
    /// Name of the node.
    pub node: String,
    /// Present on everything but nodes.
    pub endpoint: Option<Endpoint>,
    /// The buffers that an endpoint takes part in since ROS 2 Lyrical, such as [`CPU_BUFFERS`]; empty for none.
    pub backends: String,
}

/// Returns the key expression of all tokens of a domain.
pub fn token_selector(domain: u32) -> String {
    format!("@ros2_lv/{domain}/**")
}

impl Token {
    /// Returns the key expression of the token.
    pub fn to_key(&self) -> String {
        let Self { domain, session, node_id, entity_id, .. } = self;
        let (kind, ns, node) = (self.kind.code(), mangle(&self.namespace), mangle(&self.node));
        let mut key = format!("@ros2_lv/{domain}/{session}/{node_id}/{entity_id}/{kind}/%/{ns}/{node}");
        if let Some(Endpoint { topic, dds_type, type_hash, qos }) = &self.endpoint {
            key += &format!("/{}/{}/{type_hash}/{qos}", mangle(topic), mangle(dds_type));
        }
        if !self.backends.is_empty() {
            key += &format!("/{}", self.backends);
        }
        key
    }

    /// Reads the key of a token; `None` when it is not one, or one with names that ROS does not allow: they come into logs and lists.
    pub fn parse(key: &str) -> Option<Self> {
        let parts: Vec<&str> = key.split('/').collect();
        // The enclave between kind and namespace is ignored: the suite has no secure communication.
        if parts.len() > MOST_PARTS || parts.iter().any(|part| part.len() > LONGEST_PART) {
            return None;
        }
        let (&["@ros2_lv", domain, session, node_id, entity_id, kind, _enclave, namespace, node], rest) =
            parts.split_first_chunk::<9>()?
        else {
            return None;
        };
        let (kind, _) = EntityKind::ALL.into_iter().find(|(_, code)| *code == kind)?;
        let (namespace, node) = (demangle(namespace), demangle(node));
        if !(namespace == "/" || is_absolute(&namespace))
            || !is_absolute(&format!("/{node}"))
            || !is_word(session)
        {
            return None;
        }
        let endpoint = match (kind, rest) {
            // Tokens of nodes end with the name of the node.
            (EntityKind::Node, _) => None,
            (_, [topic, dds_type, type_hash, qos, ..]) => {
                Some(Endpoint::read(topic, [dds_type, type_hash, qos])?)
            }
            _ => return None,
        };
        Some(Self {
            domain: domain.parse().ok()?,
            session: session.to_owned(),
            node_id: node_id.parse().ok()?,
            entity_id: entity_id.parse().ok()?,
            kind,
            namespace,
            node,
            backends: endpoint.as_ref().and(rest.get(4)).map_or("", |part| part).to_owned(),
            endpoint,
        })
    }

    /// Returns whether a publisher of buffers sends this subscription samples of its own: where it takes other buffers than
    /// those of the CPU, which all readers share.
    pub fn reads_apart(&self) -> bool {
        self.kind == EntityKind::Subscription && !self.backends.is_empty() && self.backends != CPU_BUFFERS
    }

    /// Returns `/namespace/node`.
    pub fn node_name(&self) -> String {
        format!("{}/{}", self.namespace.trim_end_matches('/'), self.node)
    }
}

/// Most parts of a token, and the longest one: a peer may declare any key. A token of ROS 2 Lyrical has 14 parts.
const MOST_PARTS: usize = 20;
const LONGEST_PART: usize = 255;

/// Returns whether `text` may be a type, a hash or the id of a session.
fn is_word(text: &str) -> bool {
    !text.is_empty() && text.chars().all(|c| c.is_ascii_alphanumeric() || c == '_' || c == ':')
}

fn mangle(name: &str) -> String {
    // A slash separates the parts of a key, so names carry another character in its place.
    name.replace('/', "%")
}

fn demangle(name: &str) -> String {
    name.replace('%', "/")
}

/// The form of type hashes in keys and tokens.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Hashes {
    /// `RIHS01_...`, as since ROS 2 Iron.
    #[default]
    Rihs01,
    /// [`NO_HASH`], as in ROS 2 Humble.
    None,
}

impl Hashes {
    /// Each form with its word in `MODULO_TYPE_HASH`.
    pub const WORDS: [(&'static str, Self); 2] = [("rihs01", Self::Rihs01), ("none", Self::None)];
}

/// The text that rmw_zenoh writes for a ROS release without type hashes.
pub const NO_HASH: &str = "TypeHashNotSupported";

/// Returns the key of a topic's or service's data.
pub fn data_key(domain: u32, name: &str, dds_type: &str, type_hash: &str) -> String {
    // A key of zenoh must not begin with a slash or contain two in a row.
    format!("{domain}/{}/{dds_type}/{type_hash}", name.trim_matches('/'))
}

/// The buffers of a reader that takes ordinary CDR, as its token names them.
pub const CPU_BUFFERS: &str = "backends:cpu:";

/// Returns the key on which a publisher of rmw_zenoh_cpp 0.10.5 or later (ROS 2 Lyrical) sends the samples of the topic `key` in
/// place of `key`, when each reader that it knows of names buffers in its token.
pub fn buffers_key(key: &str) -> String {
    format!("{key}/_buf_cpu")
}

/// Returns whether messages of a DDS type may have an `uint8[]`, which is what makes a publisher use buffers. An unknown type may.
pub fn may_use_buffers(dds_type: &str) -> bool {
    let with_bytes = [MessageKind::Image, MessageKind::CompressedImage];
    let kind = MessageKind::ALL.iter().find(|kind| dds_name(kind.type_name()) == dds_type);
    kind.is_none_or(|kind| with_bytes.contains(kind))
}

/// Returns the QoS as tokens carry it; fields equal to the default stay empty.
pub fn qos_string(qos: Qos) -> &'static str {
    match qos {
        Qos::Images => "2::,5:,:,:,,",
        Qos::Results => "::,10:,:,:,,",
        Qos::Latched => ":1:,1:,:,:,,",
        Qos::Clock => "2::,1:,:,:,,",
        Qos::Events => "::,1000:,:,:,,",
        Qos::Logs => ":1:,1000:,:10,0:,,",
    }
}

/// Returns the nearest of the suite's profiles to a token's QoS.
pub fn qos_of(text: &str) -> Qos {
    if let Some(known) = Qos::ALL.into_iter().find(|qos| qos_string(*qos) == text) {
        return known;
    }
    // Only these two policies decide how the suite treats an endpoint.
    let mut fields = text.split(':');
    match (fields.next(), fields.next()) {
        (_, Some("1")) => Qos::Latched,
        (Some("2"), _) => Qos::Images,
        _ => Qos::Results,
    }
}

/// QoS of the parameter services: reliable, keep last 1000.
pub const PARAMETER_QOS: &str = "::,1000:,:,:,,";

/// QoS of other services: reliable, keep last 10.
pub const SERVICE_QOS: &str = "::,10:,:,:,,";

#[cfg(test)]
mod tests {
    use super::*;
    use crate::topic::{Durability, Profile, Reliability};
    use proptest::prelude::*;

    const HASH: &str = "RIHS01_d31d41a9a4c4bc8eae9be757b0beed306564f7526c88ea6a4588fb9582527d47";
    const SESSION: &str = "112af272cd2810ecb4616e7a6a617677";

    /// Sent by a real ROS 2 Jazzy node `/odmi/golden` under rmw_zenoh_cpp.
    fn golden_tokens() -> [String; 3] {
        [
            format!("@ros2_lv/0/{SESSION}/0/0/NN/%/%odmi/golden"),
            format!(
                "@ros2_lv/0/{SESSION}/0/11/MP/%/%odmi/golden/%odmi%image_sensor/\
                 sensor_msgs::msg::dds_::Image_/{HASH}/2::,5:,:,:,,"
            ),
            format!(
                "@ros2_lv/0/{SESSION}/0/16/MP/%/%odmi/golden/%odmi%image_reliable2/\
                 sensor_msgs::msg::dds_::Image_/{HASH}/::,10:,:,:,,"
            ),
        ]
    }

    fn image_publisher(entity_id: u64, topic: &str, qos: Qos) -> Token {
        Token {
            domain: 0,
            session: SESSION.into(),
            node_id: 0,
            entity_id,
            kind: EntityKind::Publisher,
            namespace: "/odmi".into(),
            node: "golden".into(),
            endpoint: Some(Endpoint {
                topic: topic.into(),
                dds_type: "sensor_msgs::msg::dds_::Image_".into(),
                type_hash: HASH.into(),
                qos: qos_string(qos).into(),
            }),
            backends: String::new(),
        }
    }

    #[test]
    fn tokens_equal_those_of_a_real_node() {
        let [node, sensor, reliable] = golden_tokens();
        assert_eq!(image_publisher(11, "/odmi/image_sensor", Qos::Images).to_key(), sensor);
        assert_eq!(image_publisher(16, "/odmi/image_reliable2", Qos::Results).to_key(), reliable);
        for key in [&node, &sensor, &reliable] {
            let token = Token::parse(key).expect("a real token parses");
            assert_eq!(&token.to_key(), key);
            assert_eq!(token.node_name(), "/odmi/golden");
        }
    }

    #[test]
    fn data_keys_equal_those_of_a_real_node() {
        assert_eq!(
            data_key(0, "/odmi/image_reliable2", "sensor_msgs::msg::dds_::Image_", HASH),
            format!("0/odmi/image_reliable2/sensor_msgs::msg::dds_::Image_/{HASH}")
        );
    }

    #[test]
    fn qos_is_read_back() {
        for qos in [Qos::Images, Qos::Results, Qos::Latched] {
            assert_eq!(qos_of(qos_string(qos)), qos);
        }
    }

    #[test]
    fn a_later_field_is_ignored_and_a_missing_one_refused() {
        let [_, sensor, _] = golden_tokens();
        let buffers = |kind: &str, backends: &str| {
            let key = format!("{}/{backends}", sensor.replace("/MP/", kind));
            let token = Token::parse(&key).expect("a token of Lyrical");
            assert_eq!((token.backends.as_str(), token.to_key()), (backends, key));
            assert_eq!(Token::parse(&format!("{}/later", token.to_key())), Some(token.clone()));
            token.reads_apart()
        };
        assert_eq!(["backends:cpu:", "backends:cuda:0;cpu:"].map(|b| buffers("/MS/", b)), [false, true]);
        assert!(!buffers("/MP/", "backends:cuda:0"), "a publisher");
        assert!(!Token::parse(&sensor.replace("/MP/", "/MS/")).expect("a token of Jazzy").reads_apart());
        assert_eq!(Token::parse(sensor.rsplit_once('/').expect("has parts").0), None);
    }

    /// Such names came into the graph, into lists of nodes, and with a line break into the log.
    #[test]
    fn impossible_names_are_no_token() {
        let [_, sensor, _] = golden_tokens();
        for (part, other) in [
            ("/golden/", "/../"),
            ("/golden/", "/%golden/"),
            ("/golden/", "/1st/"),
            ("/golden/", "/gol\nden/"),
            ("/%odmi/", "/odmi/"),
            ("/%odmi/", "/%odmi%/"),
            ("/%odmi/", "/%%%%%%16/"),
            ("/%odmi%image_sensor/", "/odmi%image_sensor/"),
            ("/%odmi%image_sensor/", "/%<script>/"),
            ("::dds_::", "::dds_%"),
            ("/RIHS01_", "/RIHS01_\u{1b}"),
            ("/golden/", &format!("/{}/", "g".repeat(256))),
            (SESSION, "se ssion"),
        ] {
            assert!(sensor.contains(part), "{part}");
            assert_eq!(Token::parse(&sensor.replace(part, other)), None, "{other}");
        }
        assert_eq!(Token::parse(&(sensor + &"/later".repeat(10))), None);
    }

    proptest! {
        /// A node needs its name, anything else four more parts. What is read is written in the same way.
        #[test]
        fn a_key_with_all_of_its_parts_is_a_token(
            (domain, node, entity) in (0..233_u32, any::<u64>(), any::<u64>()),
            kind in "NN|MP|MS|SS|SC|XX",
            rest in "/(%|(%[a-z_]{1,5}){1,2})/[a-z]{1,4}(|/(%[a-z]{1,4}){1,3}(/[A-Za-z0-9:]{1,6}){2}(/[A-Za-z0-9%:,]{0,6}){0,4})",
        ) {
            let token = Token::parse(&format!("@ros2_lv/{domain}/1f/{node}/{entity}/{kind}/%{rest}"));
            let more = rest.matches('/').count() - 2;
            prop_assert_eq!(token.is_some(), kind == "NN" || (kind != "XX" && more >= 4));
            if let Some(token) = token {
                prop_assert_eq!((token.domain, token.node_id, token.entity_id), (domain, node, entity));
                prop_assert_eq!(Token::parse(&token.to_key()), Some(token));
            }
        }
    }

    #[test]
    fn reads_what_real_nodes_write() {
        let read = |text| {
            let Profile { reliability, durability, depth } = Profile::parse(text);
            (reliability == Reliability::Reliable, durability == Durability::TransientLocal, depth)
        };
        assert_eq!(read(":1:,1000:,:10,0:,,"), (true, true, 1000));
        assert_eq!(read("2::,5:,:,:,,"), (false, false, 5));
        assert_eq!(read("::2,:,:,:,,"), (true, false, usize::MAX));
        assert_eq!(read("1:2:1,7:1,2:3,4:5,6,7"), (true, false, 7));
        for text in ["2::,5:,:,:,,", "::,10:,:,:,,", ":1:,1:,:,:,,", "2:1:2,:,:,:,,", "::,:,:,:,,"] {
            assert_eq!(Profile::parse(text).to_string(), text);
        }
        for text in ["", ":", "::,x:", "é:::::"] {
            assert_eq!(read(text), (true, false, 42), "{text}");
        }
    }
}
