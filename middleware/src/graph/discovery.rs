//! [`Graph`]: the ROS graph, made from the keys of liveliness tokens that appear and disappear, and [`Conflict`]: two
//! of its endpoints that do not fit together. It knows no transport.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt;

use modulo_msgs::ros_name;
use modulo_runtime::topic::{Durability, Profile, Reliability};
use modulo_runtime::wire::keys::{Endpoint, EntityKind, NO_HASH, Token};

/// Every entity that is alive now.
#[derive(Clone, Debug, Default)]
pub struct Graph {
    tokens: BTreeMap<String, Token>,
}

impl Graph {
    /// Adds the token of `key`. A key that is not a token is ignored.
    pub fn appear(&mut self, key: &str) {
        if let Some(token) = Token::parse(key) {
            self.tokens.insert(key.to_owned(), token);
        }
    }

    /// Returns the endpoints that do not fit `token`, each with the conflict.
    pub fn conflicts_with<'a>(&'a self, token: &'a Token) -> impl Iterator<Item = (&'a Token, Conflict)> {
        self.tokens().filter_map(|other| Some((other, conflict_between(token, other)?)))
    }

    /// Returns all conflicts between endpoints on `topic`.
    pub fn conflicts_on(&self, topic: &str) -> Vec<Conflict> {
        let givers = self.endpoints(EntityKind::Publisher, topic);
        givers.flat_map(|giver| self.conflicts_with(giver)).map(|(_, conflict)| conflict).collect()
    }

    /// Removes the token of `key`.
    pub fn disappear(&mut self, key: &str) {
        self.tokens.remove(key);
    }

    /// Returns the fully qualified names of all nodes.
    pub fn nodes(&self) -> BTreeSet<String> {
        self.tokens().filter(|token| token.kind == EntityKind::Node).map(Token::node_name).collect()
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

/// The reason why two endpoints do not fit together.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Cause {
    /// The types differ.
    Type,
    /// The same type with another definition.
    Hash,
    /// The reader asks for reliable samples, the publisher sends by best effort.
    Reliability,
    /// The reader asks for earlier samples, but the publisher does not keep them.
    Durability,
}

/// Two endpoints on one name that do not, or not fully, hear each other. zenoh itself is silent about it: other keys
/// are other topics.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Conflict {
    /// The reason.
    pub cause: Cause,
    /// Node and endpoint that publishes or serves.
    pub giver: (String, Endpoint),
    /// Node and endpoint that subscribes or calls.
    pub taker: (String, Endpoint),
}

/// Returns the conflict between two endpoints if they are on the same name, and one of them offers what the other one
/// requests.
fn conflict_between(one: &Token, other: &Token) -> Option<Conflict> {
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
    if gives.topic != takes.topic {
        return None;
    }
    Some(Conflict {
        cause: cause(gives, takes)?,
        giver: (giver.node_name(), gives.clone()),
        taker: (taker.node_name(), takes.clone()),
    })
}

fn cause(gives: &Endpoint, takes: &Endpoint) -> Option<Cause> {
    let (offered, asked) = (Profile::parse(&gives.qos), Profile::parse(&takes.qos));
    // The worst first: with another type or hash nothing arrives, and the policies do not matter.
    if gives.dds_type != takes.dds_type {
        Some(Cause::Type)
    } else if gives.type_hash != takes.type_hash {
        Some(Cause::Hash)
    } else if (offered.reliability, asked.reliability) == (Reliability::BestEffort, Reliability::Reliable) {
        Some(Cause::Reliability)
    } else if (offered.durability, asked.durability) == (Durability::Volatile, Durability::TransientLocal) {
        Some(Cause::Durability)
    } else {
        None
    }
}

impl fmt::Display for Conflict {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { giver: (giver, gives), taker: (taker, takes), .. } = self;
        let topic = &gives.topic;
        let (offered, asked) = (ros_name(&gives.dds_type), ros_name(&takes.dds_type));
        match self.cause {
            Cause::Type => write!(
                f,
                "{topic}: {giver} offers {offered}, {taker} asks for {asked}: nothing arrives; remap one of them"
            ),
            Cause::Hash => write!(
                f,
                "{topic}: {giver} and {taker} mean different things by {offered}: nothing arrives; {giver} has \
                 {}, {taker} has {}; {}",
                gives.type_hash,
                takes.type_hash,
                remedy(gives, takes)
            ),
            Cause::Reliability => write!(
                f,
                "{topic}: {taker} asks for reliable samples, {giver} offers best effort: some may be lost; \
                 incompatible policy: RELIABILITY"
            ),
            Cause::Durability => write!(
                f,
                "{topic}: {taker} asks for samples from before it came, {giver} keeps none: only new ones \
                 arrive; incompatible policy: DURABILITY"
            ),
        }
    }
}

fn remedy(gives: &Endpoint, takes: &Endpoint) -> &'static str {
    if gives.type_hash == NO_HASH || takes.type_hash == NO_HASH {
        "one of them is of ROS 2 Humble, which has no hashes: start all of modulo with --hash none beside \
         Humble, and without it beside later releases"
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
        }
    }

    const IMAGE: &str = "sensor_msgs::msg::dds_::Image_";

    #[test]
    fn what_does_not_fit_is_named_whoever_comes_first() {
        let giver = |dds_type, hash, qos| token(EntityKind::Publisher, "camera", dds_type, hash, qos);
        let reader = |qos| token(EntityKind::Subscription, "unwrap", IMAGE, "RIHS01_aa", qos);
        for (given, asked, cause, named) in [
            (
                giver("std_msgs::msg::dds_::String_", "RIHS01_bb", Qos::Images),
                Qos::Images,
                Cause::Type,
                "String",
            ),
            (giver(IMAGE, "RIHS01_bb", Qos::Images), Qos::Images, Cause::Hash, "RIHS01_bb"),
            (giver(IMAGE, NO_HASH, Qos::Images), Qos::Images, Cause::Hash, "--hash none"),
            (giver(IMAGE, "RIHS01_aa", Qos::Images), Qos::Results, Cause::Reliability, "RELIABILITY"),
            (giver(IMAGE, "RIHS01_aa", Qos::Results), Qos::Latched, Cause::Durability, "DURABILITY"),
        ] {
            let reader = reader(asked);
            let found = conflict_between(&given, &reader).expect("they do not fit");
            assert_eq!(conflict_between(&reader, &given).as_ref(), Some(&found));
            assert_eq!(found.cause, cause);
            let said = found.to_string();
            for word in ["/modulo", "/camera", "/unwrap", named] {
                assert!(said.contains(word), "{word}: {said}");
            }
        }
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
