//! [`Graph`]: the ROS graph, made from the keys of liveliness tokens that appear and disappear, with the endpoints that do not
//! fit together; and [`Twins`]: nodes that take each other's place. It knows no transport.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt;
use std::time::Duration;

use modulo_msgs::ros_name;
use modulo_runtime::name::is_hidden;
use modulo_runtime::topic::{Durability, Profile, Reliability};
use modulo_runtime::wire::keys::{Endpoint, EntityKind, NO_HASH, Token};
use modulo_runtime::{MessageKind, warn_once};
use xxhash_rust::xxh3::xxh3_128;

/// Returns the global id of the endpoint with this token: XXH3-128 of its key, low half first.
pub fn gid(key: &str) -> [u8; 16] {
    xxh3_128(key.as_bytes()).to_le_bytes()
}

/// The maximum number of publishers of buffers that are remembered, and of the readers of one of them that have a buffer backend of their own.
const REMEMBERED: usize = 256;

/// Most entities that are kept: a peer may declare tokens without end.
const ENTITIES: usize = 8192;

/// Every entity that is alive now.
#[derive(Clone, Debug, Default)]
pub struct Graph {
    tokens: BTreeMap<String, Token>,
    /// The topic of each publisher of buffers, by its global id, with the tokens of the readers apart that it has met. Such a
    /// publisher goes on using a number for a reader that has left (rmw_zenoh_cpp 0.10.5), and outlives a cut of the link.
    met: BTreeMap<[u8; 16], (String, BTreeSet<String>)>,
    /// The publishers that were there, by their global ids.
    gone: BTreeMap<[u8; 16], LostPublisher>,
}

/// A publisher that was there, and has gone.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LostPublisher {
    /// Its topic.
    pub topic: String,
    /// The fully qualified name of its node.
    pub node: String,
    /// The time since then.
    pub since: Duration,
}

impl fmt::Display for LostPublisher {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "no link to {} since {} s", self.node, self.since.as_secs())
    }
}

impl Graph {
    /// Adds the token of `key`. A key that is not a token is ignored, and one for which there is no room.
    pub fn appear(&mut self, key: &str) {
        let Some(token) = Token::parse(key) else { return };
        if self.tokens.len() >= ENTITIES && !self.tokens.contains_key(key) {
            warn_once(format!(
                "the domain has more than {ENTITIES} nodes, topics and services of nodes; the others are not seen here"
            ));
            return;
        }
        if let Some(Endpoint { topic, .. }) = token.endpoint.as_ref().filter(|_| !token.backends.is_empty()) {
            self.meet(key, &token, topic);
        }
        if token.kind == EntityKind::Publisher {
            self.gone.remove(&gid(key));
        }
        self.tokens.insert(key.to_owned(), token);
    }

    fn meet(&mut self, key: &str, token: &Token, topic: &str) {
        if token.reads_apart() {
            let publishers = self.met.values_mut().filter(|(published, _)| published == topic);
            for (_, readers) in publishers.filter(|(_, readers)| readers.len() < REMEMBERED) {
                readers.insert(key.to_owned());
            }
        } else if token.kind == EntityKind::Publisher && !self.met.contains_key(&gid(key)) {
            if self.met.len() >= REMEMBERED {
                self.met.pop_first();
            }
            let reads =
                |other: &Token| other.endpoint.as_ref().is_some_and(|endpoint| endpoint.topic == topic);
            let readers = self.tokens.iter().filter(|(_, other)| other.reads_apart() && reads(other));
            let readers = readers.map(|(key, _)| key.clone()).take(REMEMBERED).collect();
            self.met.insert(gid(key), (topic.to_owned(), readers));
        }
    }

    /// Returns how many readers the publisher with this global id sends samples of their own.
    pub fn readers_apart(&self, publisher: &[u8; 16]) -> u32 {
        self.met.get(publisher).map_or(0, |(_, readers)| u32::try_from(readers.len()).unwrap_or(u32::MAX))
    }

    /// Returns the endpoints that do not fit `token`, each with the conflict in words.
    pub fn conflicts_with<'a>(&'a self, token: &'a Token) -> impl Iterator<Item = (&'a Token, String)> {
        self.tokens().filter_map(|other| Some((other, conflict_between(token, other)?)))
    }

    /// Returns all conflicts between endpoints on `topic`, in words.
    pub fn conflicts_on(&self, topic: &str) -> Vec<String> {
        let givers = self.endpoints(EntityKind::Publisher, topic);
        givers.flat_map(|giver| self.conflicts_with(giver)).map(|(_, conflict)| conflict).collect()
    }

    /// Removes the token of `key`.
    pub fn disappear(&mut self, key: &str) {
        let Some(token) = self.tokens.remove(key).filter(|token| token.kind == EntityKind::Publisher) else {
            return;
        };
        if self.gone.len() >= REMEMBERED {
            // The one that has gone first says the least.
            let first = self.gone.iter().max_by_key(|(_, gone)| gone.since).map(|(gid, _)| *gid);
            first.map(|gid| self.gone.remove(&gid));
        }
        let (node, topic) = (token.node_name(), token.endpoint.map(|endpoint| endpoint.topic));
        let gone = topic.map(|topic| LostPublisher { topic, node, since: Duration::ZERO });
        self.gone.extend(gone.map(|gone| (gid(key), gone)));
    }

    /// Notes that time has passed.
    pub fn pass(&mut self, time: Duration) {
        self.gone.values_mut().for_each(|gone| gone.since += time);
    }

    /// Returns the publishers that have gone for a second, with their global ids, and whose nodes do not publish their topics again.
    /// The last word of a publisher may come after the end of its token.
    pub fn gone(&self) -> impl Iterator<Item = (&[u8; 16], &LostPublisher)> {
        let is_back = |gone: &LostPublisher| {
            self.endpoints(EntityKind::Publisher, &gone.topic).any(|token| token.node_name() == gone.node)
        };
        self.gone.iter().filter(move |(_, gone)| gone.since >= Duration::from_secs(1) && !is_back(gone))
    }

    /// Returns the fully qualified names of all nodes in their order; one that two nodes have comes twice.
    pub fn nodes(&self) -> Vec<String> {
        let nodes = self.tokens().filter(|token| token.kind == EntityKind::Node);
        let mut names: Vec<String> = nodes.map(Token::node_name).collect();
        names.sort();
        names
    }

    /// Returns the nodes that take each other's place where that concerns the session `own`: those with the name of a node with
    /// services in it, and those that publish a stream which it publishes or reads.
    pub fn twins_of(&self, own: &str) -> Vec<Twins> {
        // Each name and each stream, with its nodes and whether it is one of `own`.
        type Shared<'a> = BTreeMap<(Option<&'a str>, String), (BTreeSet<TokenNode<'a>>, bool)>;
        let mut shared = Shared::new();
        for token in self.tokens() {
            let stream = token.endpoint.as_ref().filter(|endpoint| is_stream(endpoint));
            let of_stream = stream.map(|endpoint| (Some(&*endpoint.topic), String::new()));
            let (key, is_one) = match (token.kind, of_stream) {
                (EntityKind::Node, _) => ((None, token.node_name()), true),
                // A node without services, such as a viewer, may be there several times.
                (EntityKind::Server, _) => ((None, token.node_name()), false),
                (EntityKind::Publisher, Some(stream)) => (stream, true),
                (EntityKind::Subscription, Some(stream)) => (stream, false),
                _ => continue,
            };
            let (nodes, is_own) = shared.entry(key).or_default();
            if is_one {
                nodes.insert((token.node_name(), &token.session, token.node_id));
            }
            *is_own |= token.session == own && token.kind != EntityKind::Node;
        }
        let mut twins: BTreeMap<Vec<String>, Vec<String>> = BTreeMap::new();
        for ((topic, _), (nodes, is_own)) in shared {
            if nodes.len() > 1 && is_own {
                let topics = twins.entry(nodes.into_iter().map(|(name, ..)| name).collect()).or_default();
                topics.extend(topic.map(str::to_owned));
            }
        }
        twins.into_iter().map(|(nodes, topics)| Twins { nodes, topics }).collect()
    }

    /// Returns the fully qualified names of the nodes whose parameters can be asked for.
    pub fn nodes_with_parameters(&self) -> BTreeSet<String> {
        let servers = self.tokens().filter(|token| token.kind == EntityKind::Server);
        let topics = servers.filter_map(|token| token.endpoint.as_ref()).map(|endpoint| &endpoint.topic);
        topics.filter_map(|topic| topic.strip_suffix("/list_parameters").map(str::to_owned)).collect()
    }

    /// Returns the topics that have a publisher or a subscription, each with its types.
    pub fn topics(&self) -> BTreeMap<String, BTreeSet<String>> {
        let mut topics: BTreeMap<String, BTreeSet<String>> = BTreeMap::new();
        for token in self.tokens() {
            if let (EntityKind::Publisher | EntityKind::Subscription, Some(endpoint)) =
                (token.kind, &token.endpoint)
            {
                topics.entry(endpoint.topic.clone()).or_default().insert(ros_name(&endpoint.dds_type));
            }
        }
        topics
    }

    /// Returns every entity, in the order of its key.
    pub fn tokens(&self) -> impl Iterator<Item = &Token> {
        self.tokens.values()
    }

    /// Returns whether the node with this fully qualified name is alive.
    pub fn has_node(&self, name: &str) -> bool {
        self.tokens().any(|t| t.kind == EntityKind::Node && t.node_name() == name)
    }

    /// Returns the endpoints of `kind` on `topic`.
    pub fn endpoints<'a>(&'a self, kind: EntityKind, topic: &'a str) -> impl Iterator<Item = &'a Token> {
        self.tokens().filter(move |t| t.kind == kind && t.endpoint.as_ref().is_some_and(|e| e.topic == topic))
    }
}

/// Returns whether the messages of two publishers on this topic would mix: those of images and boxes, not of statuses.
fn is_stream(endpoint: &Endpoint) -> bool {
    let kinds =
        [MessageKind::Image, MessageKind::CompressedImage, MessageKind::CameraInfo, MessageKind::Detections];
    let type_name = ros_name(&endpoint.dds_type);
    !is_hidden(&endpoint.topic) && kinds.iter().any(|kind| kind.type_name() == type_name)
}

type TokenNode<'a> = (String, &'a str, u64);

/// Nodes that have one name, or publish one stream, as when a suite runs twice in a domain.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Twins {
    /// Their fully qualified names, at least two.
    pub nodes: Vec<String>,
    /// The streams that all of them publish.
    pub topics: Vec<String>,
}

/// Most nodes that a warning names.
const SHOWN: usize = 8;

impl fmt::Display for Twins {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { nodes, topics } = self;
        let count = nodes.len();
        if nodes.iter().all(|node| *node == nodes[0]) {
            write!(
                f,
                "{count} nodes are called {}, and a request to this name reaches all of them; ",
                nodes[0]
            )?;
        }
        // A compressed variant goes with its topic.
        let variant = |topic: &&String| topic.ends_with("/compressed") && topics.len() > 1;
        let shown: Vec<&str> = topics.iter().filter(|topic| !variant(topic)).map(String::as_str).collect();
        if !shown.is_empty() {
            let (shown, have) = (shown.join(", "), if shown.len() > 1 { "have" } else { "has" });
            let left_out = count.saturating_sub(SHOWN);
            let mut nodes = nodes[..count - left_out].join(", ");
            if left_out > 0 {
                nodes += &format!(" and {left_out} more");
            }
            write!(f, "{shown} {have} {count} publishers ({nodes}): readers receive interleaved frames; ")?;
        }
        write!(f, "give one of the suites another namespace or another ROS_DOMAIN_ID")
    }
}

/// Returns in words why two endpoints do not, or not fully, hear each other, where they are on one name and one of them offers
/// what the other one requests. zenoh itself is silent about it: other keys are other topics.
fn conflict_between(one: &Token, other: &Token) -> Option<String> {
    let (giver, taker) = match (one.kind, other.kind) {
        (EntityKind::Publisher, EntityKind::Subscription) | (EntityKind::Server, EntityKind::Client) => {
            (one, other)
        }
        (EntityKind::Subscription, EntityKind::Publisher) | (EntityKind::Client, EntityKind::Server) => {
            (other, one)
        }
        _ => return None,
    };
    let (gives, takes) = (giver.endpoint.as_ref()?, taker.endpoint.as_ref()?);
    // Topics and services share one space of names here; the kinds above keep them apart.
    let same_name = gives.topic == takes.topic;
    let why = same_name.then(|| mismatch(gives, takes, &giver.node_name(), &taker.node_name())).flatten()?;
    Some(format!("{}: {why}", gives.topic))
}

fn mismatch(gives: &Endpoint, takes: &Endpoint, giver: &str, taker: &str) -> Option<String> {
    let (offered, asked) = (ros_name(&gives.dds_type), ros_name(&takes.dds_type));
    let (profile, wanted) = (Profile::parse(&gives.qos), Profile::parse(&takes.qos));
    // The worst first: with another type or hash nothing arrives, and the policies do not matter.
    Some(if gives.dds_type != takes.dds_type {
        format!("{giver} offers {offered}, {taker} asks for {asked}: nothing arrives; remap one of them")
    } else if gives.type_hash != takes.type_hash {
        let (given, needed, remedy) = (&gives.type_hash, &takes.type_hash, remedy(gives, takes));
        format!(
            "{giver} and {taker} mean different things by {offered}: nothing arrives; {giver} has {given}, {taker} has \
             {needed}; {remedy}"
        )
    } else if (profile.reliability, wanted.reliability) == (Reliability::BestEffort, Reliability::Reliable) {
        format!(
            "{taker} asks for reliable samples, {giver} offers best effort: some may be lost; \
             incompatible policy: RELIABILITY"
        )
    } else if (profile.durability, wanted.durability) == (Durability::Volatile, Durability::TransientLocal) {
        format!(
            "{taker} asks for samples from before it came, {giver} keeps none: only new ones arrive; \
             incompatible policy: DURABILITY"
        )
    } else {
        return None;
    })
}

fn remedy(gives: &Endpoint, takes: &Endpoint) -> &'static str {
    if gives.type_hash == NO_HASH || takes.type_hash == NO_HASH {
        "one of them is of ROS 2 Humble, which has no hashes: start all of modulo with MODULO_TYPE_HASH=none \
         beside Humble, and without it beside later releases"
    } else {
        "their message definitions are of different releases"
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use modulo_runtime::Qos;
    use modulo_runtime::wire::keys::qos_string;

    #[test]
    fn entities_come_and_go() {
        let mut graph = Graph::default();
        let node = "@ros2_lv/0/a/0/0/NN/%/%/unwrap";
        let publisher = "@ros2_lv/0/a/0/1/MP/%/%/unwrap/%recovered/T_/RIHS01_0/2::,5:,:,:,,";
        graph.appear(node);
        graph.appear(publisher);
        graph.appear("@ros2_lv/nonsense");
        assert!(graph.has_node("/unwrap"));
        assert_eq!(graph.endpoints(EntityKind::Publisher, "/recovered").count(), 1);
        assert_eq!(graph.endpoints(EntityKind::Subscription, "/recovered").count(), 0);
        graph.disappear(publisher);
        assert_eq!(graph.endpoints(EntityKind::Publisher, "/recovered").count(), 0);
        assert_eq!(graph.tokens().count(), 1);
    }

    /// A peer that declared 10,000 tokens kept each node busy, and one warning had 116 names.
    #[test]
    fn entities_without_end_are_neither_kept_nor_printed() {
        let mut graph = Graph::default();
        let key = |number: usize| format!("@ros2_lv/0/a/0/{number}/NN/%/%/n{number}");
        (0..ENTITIES + 9).for_each(|number| graph.appear(&key(number)));
        assert_eq!((graph.tokens.len(), graph.has_node("/n8192")), (ENTITIES, false));
        graph.disappear(&key(0));
        graph.appear(&key(ENTITIES));
        assert_eq!((graph.tokens.len(), graph.has_node("/n8192")), (ENTITIES, true));

        let twins = |count| {
            let nodes = (0..count).map(|number| format!("/n{number}")).collect();
            Twins { nodes, topics: vec!["/modulo".to_owned()] }.to_string()
        };
        assert!(
            twins(8).contains("has 8 publishers (/n0, ") && twins(8).contains(", /n7): "),
            "{}",
            twins(8)
        );
        assert!(twins(999).contains(", /n7 and 991 more): ") && twins(999).len() < 300, "{}", twins(999));
    }

    fn token(kind: EntityKind, node: &str, dds_type: &str, type_hash: &str, qos: Qos) -> Token {
        let endpoint = Endpoint {
            topic: "/modulo".into(),
            dds_type: dds_type.into(),
            type_hash: type_hash.into(),
            qos: qos_string(qos).into(),
        };
        Token {
            domain: 0,
            session: "a".into(),
            node_id: 0,
            entity_id: 1,
            kind,
            namespace: "/".into(),
            node: node.into(),
            endpoint: Some(endpoint),
            backends: String::new(),
        }
    }

    /// A publisher of Lyrical sends each reader with a buffer of its own a sample with a number of its own, also after it left.
    #[test]
    fn readers_apart_are_those_that_the_publisher_has_met() {
        let key = |session: &str, kind: &str, topic: &str, backends: &str| {
            format!("@ros2_lv/0/{session}/0/1/{kind}/%/%/n/%{topic}/{IMAGE}/RIHS01_0/2::,5:,:,:,,{backends}")
        };
        let reader =
            |session: &str, buffers: &str| key(session, "MS", "modulo", &format!("/backends:{buffers}"));
        let (early, gone, cpu) = (reader("a", "cuda:0"), reader("b", "cuda:0"), reader("c", "cpu:"));
        let camera = |session: &str| key(session, "MP", "modulo", "/backends:cpu:");
        let (p, q, jazzy) = (camera("p"), camera("q"), key("j", "MP", "modulo", ""));
        let elsewhere = key("d", "MS", "other", "/backends:cuda:0");
        let mut graph = Graph::default();
        [&early, &cpu, &p, &gone, &gone, &elsewhere].into_iter().for_each(|key| graph.appear(key));
        [&gone, &p].into_iter().for_each(|key| graph.disappear(key));
        [&p, &q, &jazzy].into_iter().for_each(|key| graph.appear(key));
        let apart = [&p, &q, &jazzy].map(|key| graph.readers_apart(&gid(key)));
        assert_eq!(
            apart,
            [2, 1, 0],
            "the second one came after a reader had left, the third one is of Jazzy"
        );
        for number in 0..2 * REMEMBERED {
            graph.appear(&key(&format!("s{number}"), "MP", "other", "/backends:cpu:"));
        }
        assert_eq!(graph.met.len(), REMEMBERED);
        let many = key("many", "MP", "many", "/backends:cpu:");
        graph.appear(&many);
        for number in 0..2 * REMEMBERED {
            graph.appear(&key(&format!("r{number}"), "MS", "many", "/backends:cuda:0"));
        }
        assert_eq!(graph.readers_apart(&gid(&many)), REMEMBERED as u32);
    }

    const IMAGE: &str = "sensor_msgs::msg::dds_::Image_";

    #[test]
    fn what_does_not_fit_is_named_whoever_comes_first() {
        let giver = |dds_type, hash, qos| token(EntityKind::Publisher, "camera", dds_type, hash, qos);
        let reader = |qos| token(EntityKind::Subscription, "unwrap", IMAGE, "RIHS01_aa", qos);
        for (given, asked, named) in [
            (giver("std_msgs::msg::dds_::String_", "RIHS01_bb", Qos::Images), Qos::Images, "String"),
            (giver(IMAGE, "RIHS01_bb", Qos::Images), Qos::Images, "RIHS01_bb"),
            (giver(IMAGE, NO_HASH, Qos::Images), Qos::Images, "MODULO_TYPE_HASH=none"),
            (giver(IMAGE, "RIHS01_aa", Qos::Images), Qos::Results, "RELIABILITY"),
            (giver(IMAGE, "RIHS01_aa", Qos::Results), Qos::Latched, "DURABILITY"),
        ] {
            let reader = reader(asked);
            let message = conflict_between(&given, &reader).expect("they do not fit");
            assert_eq!(conflict_between(&reader, &given).as_ref(), Some(&message));
            for word in ["/modulo", "/camera", "/unwrap", named] {
                assert!(message.contains(word), "{word}: {message}");
            }
        }
    }

    /// A suite that is there twice: both nodes of a name and both publishers of a stream are told to those whom it concerns.
    #[test]
    fn nodes_that_take_each_others_place_are_twins() {
        let mut graph = Graph::default();
        let suite = |session: &str, ns: &str| {
            let key = |number: u32, kind: &str, rest: &str| {
                format!("@ros2_lv/0/{session}/0/{number}/{kind}/%/{ns}/unwrap{rest}")
            };
            let on = |topic: &str, kind: &str| {
                let topic = format!("{}%{topic}", ns.trim_end_matches('%'));
                format!("/{topic}/sensor_msgs::msg::dds_::{kind}_/RIHS01_0/2::,5:,:,:,,")
            };
            [
                key(0, "NN", ""),
                key(1, "MP", &on("recovered", "Image")),
                key(2, "MP", &on("recovered%compressed", "CompressedImage")),
                key(3, "MS", &on("modulo", "Image")),
                key(
                    4,
                    "MP",
                    "/%diagnostics/diagnostic_msgs::msg::dds_::DiagnosticArray_/RIHS01_0/::,10:,:,:,,",
                ),
                key(
                    5,
                    "SS",
                    "/%unwrap%list_parameters/rcl_interfaces::srv::dds_::ListParameters_/RIHS01_0/::,10:,:,:,,",
                ),
            ]
        };
        let mut appear = |keys: &[String]| keys.iter().for_each(|key| graph.appear(key));
        appear(&suite("a", "%"));
        appear(&suite("b", "%front"));
        // A viewer, twice, and a recorder.
        appear(&["v", "w"].map(|session| format!("@ros2_lv/0/{session}/0/0/NN/%/%/modulo_view")));
        let image = "sensor_msgs::msg::dds_::Image_/RIHS01_0/2::,5:,:,:,,";
        appear(&[format!("@ros2_lv/0/r/0/1/MS/%/%/rosbag2_recorder/%recovered/{image}")]);
        for session in ["a", "b", "v", "r"] {
            assert_eq!(graph.twins_of(session), [], "{session}");
        }
        let second = suite("c", "%");
        second.iter().for_each(|key| graph.appear(key));
        let nodes = vec!["/unwrap".to_owned(); 2];
        let twins = |topics: &[&str]| {
            let topics = topics.iter().map(|topic| (*topic).to_owned()).collect();
            [Twins { nodes: nodes.clone(), topics }]
        };
        for session in ["a", "c"] {
            assert_eq!(graph.twins_of(session), twins(&["/recovered", "/recovered/compressed"]));
        }
        assert_eq!((graph.twins_of("b"), graph.twins_of("v")), (vec![], vec![]));
        assert_eq!(graph.twins_of("r"), twins(&["/recovered"]));
        assert_eq!(graph.nodes().iter().filter(|name| *name == "/unwrap").count(), 2);
        let message = graph.twins_of("a")[0].to_string();
        for part in
            ["2 nodes are called /unwrap", "/recovered has 2 publishers", "interleaved", "ROS_DOMAIN_ID"]
        {
            assert!(message.contains(part), "{message}");
        }
        assert!(!message.contains("compressed"), "{message}");
        second.iter().for_each(|key| graph.disappear(key));
        assert_eq!(graph.twins_of("a"), []);
    }

    #[test]
    fn what_fits_is_no_conflict() {
        let giver = |qos| token(EntityKind::Publisher, "camera", IMAGE, "RIHS01_aa", qos);
        let reader = |qos| token(EntityKind::Subscription, "unwrap", IMAGE, "RIHS01_aa", qos);
        for (given, asked) in [
            (Qos::Images, Qos::Images),
            (Qos::Results, Qos::Images),
            (Qos::Latched, Qos::Results),
            (Qos::Logs, Qos::Latched),
        ] {
            assert_eq!(conflict_between(&giver(given), &reader(asked)), None);
        }
        assert_eq!(conflict_between(&giver(Qos::Images), &giver(Qos::Results)), None, "two that give");
    }
}
