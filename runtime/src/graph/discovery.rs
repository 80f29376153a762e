//! [`Graph`]: the ROS graph, made from the keys of liveliness tokens that appear and disappear. It knows no transport.

use std::collections::{BTreeMap, BTreeSet};

use modulo_msgs::ros_name;

use super::conflict::{self, Conflict};
use crate::transport::keys::{EntityKind, Token};

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
        self.tokens().filter_map(|other| Some((other, conflict::between(token, other)?)))
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

#[cfg(test)]
mod tests {
    use super::*;

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
}
