//! The watch of the graph: keeps the graph up to date, and warns once about each endpoint that does not fit an endpoint of this session, since zenoh gives no warning.

use std::collections::BTreeSet;
use std::sync::{Arc, Mutex};

use zenoh::pubsub::Subscriber;
use zenoh::sample::SampleKind;
use zenoh::{Session, Wait};

use super::lock;
use crate::graph::Graph;
use crate::transport::TransportError;
use crate::transport::keys::{self, Token};

/// Keeps `graph` as it is in `domain` until the subscriber is dropped.
pub(super) fn start(
    session: &Session,
    domain: u32,
    graph: &Arc<Mutex<Graph>>,
) -> Result<Subscriber<()>, TransportError> {
    let (graph, own) = (graph.clone(), session.zid().to_string());
    let said = Mutex::new(BTreeSet::new());
    session
        .liveliness()
        .declare_subscriber(keys::token_selector(domain))
        .history(true)
        .callback(move |sample| {
            let key = sample.key_expr().as_str();
            match sample.kind() {
                SampleKind::Put => {
                    for conflict in appear(&graph, key, &own) {
                        if lock(&said).insert(conflict.clone()) {
                            tracing::warn!("{conflict}");
                        }
                    }
                }
                SampleKind::Delete => lock(&graph).disappear(key),
            }
        })
        .wait()
        .map_err(|why| TransportError::new(format!("watch of domain {domain}"), why))
}

/// Adds a token to the graph. Returns its conflicts with the endpoints of session `own` in words.
fn appear(graph: &Mutex<Graph>, key: &str, own: &str) -> Vec<String> {
    let mut graph = lock(graph);
    graph.appear(key);
    let Some(token) = Token::parse(key) else { return Vec::new() };
    let conflicts = graph.conflicts_with(&token);
    let ours = conflicts.filter(|(other, _)| token.session == own || other.session == own);
    ours.map(|(_, conflict)| conflict.to_string()).collect()
}
