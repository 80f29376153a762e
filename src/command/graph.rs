//! `modulo topic` and `modulo node`: the nodes, topics and messages of the graph. No ROS installation is needed.

use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::sync::Arc;
use std::time::Duration;

use anyhow::{Context, anyhow};
use modulo_msgs::{dynamic, rihs, ros_name};
use modulo_runtime::end_on_signals;
use modulo_runtime::graph::Graph;
use modulo_runtime::queue::{Arrived, Keep, Lane, Limit, Next, Queue};
use modulo_runtime::transport::keys::{Endpoint, EntityKind, Token};
use modulo_runtime::transport::zenoh::ZenohTransport;
use modulo_runtime::transport::{Guard, RawSample, Transport};
use modulo_runtime::{Clock, NodeName, Stop, Urgency};

use super::open_session;
use crate::cli::graph::{Echo, Node, Topic};
use crate::{Ended, Failure};

/// The graph is as it is when nothing has changed for this long.
const CALM: Duration = Duration::from_millis(300);
/// Time limit for a topic or node to appear.
const PATIENCE: Duration = Duration::from_secs(5);
const GLANCE: Duration = Duration::from_millis(20);
/// Samples that wait to be shown.
const WAITING: Limit = Limit { messages: 4096, bytes: 64 << 20 };

/// Runs one of the topic commands.
pub fn topic(args: &Topic) -> Result<Ended, Failure> {
    let (clock, transport) = open_session()?;
    match args {
        Topic::List { show_types } => {
            for (topic, types) in topics(&calm(&transport)) {
                let types: Vec<String> = types.into_iter().collect();
                let shown = if *show_types { format!(" [{}]", types.join(", ")) } else { String::new() };
                say!("{topic}{shown}");
            }
        }
        Topic::Info { topic, verbose } => info(&found(&transport, topic)?, &absolute(topic), *verbose),
        Topic::Echo(args) => echo(&transport, &clock, args)?,
        Topic::Hz { topic, window } => hz(&transport, &clock, topic, *window as usize)?,
    }
    transport.close();
    Ok(Ended::Done)
}

/// Runs one of the node commands.
pub fn node(args: &Node) -> Result<Ended, Failure> {
    let (_clock, transport) = open_session()?;
    let graph = calm(&transport);
    let nodes = graph.tokens().filter(|t| t.kind == EntityKind::Node).map(Token::node_name);
    let nodes: BTreeSet<String> = nodes.collect();
    match args {
        Node::List => nodes.iter().for_each(|node| say!("{node}")),
        Node::Info { node } => {
            let node = absolute(node);
            if !nodes.contains(&node) {
                let known: Vec<_> = nodes.into_iter().collect();
                return Err(anyhow!("no node {node}; there are {}", known.join(", ")).into());
            }
            describe(&graph, &node);
        }
    }
    transport.close();
    Ok(Ended::Done)
}

pub fn absolute(name: &str) -> String {
    format!("/{}", name.trim_matches('/'))
}

/// Returns the graph, once it has stopped changing.
pub fn calm(transport: &ZenohTransport) -> Graph {
    let (mut graph, mut unchanged, mut waited) = (transport.graph(), Duration::ZERO, Duration::ZERO);
    while unchanged < CALM && waited < PATIENCE {
        std::thread::sleep(GLANCE);
        waited += GLANCE;
        let now = transport.graph();
        unchanged = if now.tokens().eq(graph.tokens()) { unchanged + GLANCE } else { Duration::ZERO };
        graph = now;
    }
    graph
}

/// Returns the types of each topic that has a publisher or a reader.
fn topics(graph: &Graph) -> BTreeMap<String, BTreeSet<String>> {
    let mut topics: BTreeMap<String, BTreeSet<String>> = BTreeMap::new();
    for token in graph.tokens().filter(|t| is_topic(t.kind)) {
        if let Some(Endpoint { topic, dds_type, .. }) = &token.endpoint {
            topics.entry(topic.clone()).or_default().insert(type_name(dds_type));
        }
    }
    topics
}

fn is_topic(kind: EntityKind) -> bool {
    matches!(kind, EntityKind::Publisher | EntityKind::Subscription)
}

fn type_name(dds_type: &str) -> String {
    ros_name(dds_type)
}

/// Returns the graph as soon as `topic` has an endpoint.
fn found(transport: &ZenohTransport, topic: &str) -> anyhow::Result<Graph> {
    let topic = absolute(topic);
    let mut waited = Duration::ZERO;
    loop {
        let graph = transport.graph();
        if topics(&graph).contains_key(&topic) {
            return Ok(calm(transport));
        }
        if waited >= PATIENCE {
            let known: Vec<String> = topics(&graph).into_keys().collect();
            let known = if known.is_empty() { "no topic at all".to_owned() } else { known.join(", ") };
            return Err(anyhow!("nobody is on {topic}; there is {known}"));
        }
        std::thread::sleep(GLANCE);
        waited += GLANCE;
    }
}

fn info(graph: &Graph, topic: &str, verbose: bool) {
    let types: Vec<String> = topics(graph).remove(topic).into_iter().flatten().collect();
    say!("Type: {}", types.join(", "));
    for (title, kind) in [("Publisher", EntityKind::Publisher), ("Subscription", EntityKind::Subscription)] {
        let endpoints: Vec<&Token> = graph.endpoints(kind, topic).collect();
        say!("{title} count: {}", endpoints.len());
        if verbose {
            for token in endpoints {
                let Some(endpoint) = &token.endpoint else { continue };
                say!(
                    "  {}: {} {} qos {}",
                    token.node_name(),
                    type_name(&endpoint.dds_type),
                    endpoint.type_hash,
                    endpoint.qos
                );
            }
        }
    }
    for conflict in graph.conflicts_on(topic) {
        say!("{conflict}");
    }
}

fn describe(graph: &Graph, node: &str) {
    say!("{node}");
    for (title, kind) in [
        ("Subscribers", EntityKind::Subscription),
        ("Publishers", EntityKind::Publisher),
        ("Service Servers", EntityKind::Server),
        ("Service Clients", EntityKind::Client),
    ] {
        say!("  {title}:");
        let own = graph.tokens().filter(|t| t.kind == kind && t.node_name() == node);
        let lines: BTreeSet<String> = own
            .filter_map(|t| t.endpoint.as_ref())
            .map(|e| format!("    {}: {}", e.topic, type_name(&e.dds_type)))
            .collect();
        lines.iter().for_each(|line| say!("{line}"));
    }
}

/// A subscription to `topic`: its type, and the samples as they arrive.
struct Listening {
    type_name: String,
    samples: Arc<Queue<RawSample>>,
    lane: Lane,
    stop: Stop,
    _guards: (Guard, Guard),
}

impl Listening {
    fn start(transport: &ZenohTransport, clock: &Arc<dyn Clock>, topic: &str) -> anyhow::Result<Self> {
        let stop = Stop::default();
        end_on_signals(&stop).context("signal handlers")?;
        let (graph, topic) = (found(transport, topic)?, absolute(topic));
        let publisher = graph.endpoints(EntityKind::Publisher, &topic).next();
        let any = publisher.or_else(|| graph.endpoints(EntityKind::Subscription, &topic).next());
        let endpoint = any.and_then(|token| token.endpoint.clone()).context("the topic went away")?;
        let node_name = NodeName { name: "modulo_topic".into(), namespace: "/".into(), remaps: Vec::new() };
        let node = transport.announce(&node_name)?;
        let samples = Arc::new(Queue::new(clock.clone(), WAITING));
        stop.wakes(&samples);
        let (queue, lane) = (samples.clone(), samples.open(Keep::All));
        let take = move |sample| drop(queue.push(lane, sample));
        let subscription = transport.subscribe_raw(&node_name, &endpoint, take)?;
        let type_name = type_name(&endpoint.dds_type);
        Ok(Self { type_name, samples, lane, stop, _guards: (subscription, node) })
    }

    /// Returns the next sample within `patience`, `None`: without limit.
    fn next(&self, patience: Option<Duration>) -> Option<Arrived<RawSample>> {
        match self.samples.take(patience) {
            Next::Item(arrived) => Some(arrived),
            Next::Idle | Next::Ended => None,
        }
    }

    /// Samples that were sent, but not shown.
    fn lost(&self) -> u64 {
        self.samples.counts(self.lane).lost()
    }

    fn goes_on(&self) -> bool {
        self.stop.urgency() == Urgency::None
    }
}

fn echo(transport: &ZenohTransport, clock: &Arc<dyn Clock>, args: &Echo) -> anyhow::Result<()> {
    let listening = Listening::start(transport, clock, &args.topic)?;
    let name = &listening.type_name;
    let description = rihs::type_description(name);
    let description = description.with_context(|| format!("{name} is no type that modulo knows"))?;
    while listening.goes_on() {
        let Some(sample) = listening.next(None) else { continue };
        let value = dynamic::from_slice(&description, &sample.item.payload)?;
        say!("{value}---");
        if args.once {
            break;
        }
    }
    if listening.lost() > 0 {
        eprintln!("{} messages are not shown: they came faster than they could be printed", listening.lost());
    }
    Ok(())
}

/// Once a second: rate, and how even it is.
fn hz(transport: &ZenohTransport, clock: &Arc<dyn Clock>, topic: &str, window: usize) -> anyhow::Result<()> {
    let listening = Listening::start(transport, clock, topic)?;
    let now = || clock.ticks_ns() as f64 / 1e9;
    let (mut arrived, mut due) = (VecDeque::new(), now() + 1.0);
    while listening.goes_on() {
        let patience = Duration::from_secs_f64((due - now()).max(0.0));
        if let Some(sample) = listening.next(Some(patience)) {
            arrived.push_back(sample.stamp_ns as f64 / 1e9);
            if arrived.len() > window {
                arrived.pop_front();
            }
        }
        if now() >= due {
            due += 1.0;
            say!("{}", rate(arrived.make_contiguous(), listening.lost()));
        }
    }
    Ok(())
}

/// Describes the rate as `ros2 topic hz` does, with the number of lost messages.
fn rate(arrived: &[f64], lost: u64) -> String {
    let periods: Vec<f64> = arrived.windows(2).map(|pair| pair[1] - pair[0]).collect();
    if periods.is_empty() {
        return "no new messages".to_owned();
    }
    let mean = periods.iter().sum::<f64>() / periods.len() as f64;
    let variance = periods.iter().map(|period| (period - mean).powi(2)).sum::<f64>() / periods.len() as f64;
    let (least, most) =
        periods.iter().fold((f64::MAX, 0f64), |(a, b), &period| (a.min(period), b.max(period)));
    format!(
        "average rate: {:.3}\n\tmin: {least:.3}s max: {most:.3}s std dev: {:.5}s window: {} lost: {lost}",
        1.0 / mean.max(1e-9),
        variance.sqrt(),
        arrived.len()
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_rate_is_messages_over_time() {
        assert_eq!(rate(&[], 0), "no new messages");
        assert_eq!(rate(&[5.0], 0), "no new messages");
        let said = rate(&[0.0, 0.1, 0.2, 0.4], 3);
        assert!(
            said.starts_with("average rate: 7.500\n\tmin: 0.100s max: 0.200s std dev: 0.04714s"),
            "{said}"
        );
        assert!(said.ends_with("window: 4 lost: 3"));
    }
}
