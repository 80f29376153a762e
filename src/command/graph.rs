//! `modulo topic` and `modulo node`: the nodes, topics and messages of the graph. No ROS installation is needed.

use std::collections::{BTreeSet, VecDeque};
use std::time::Duration;

use anyhow::{Context as _, anyhow};
use clap::Subcommand;
use modulo_middleware::graph::Graph;
use modulo_middleware::graph::discovery::Twins;
use modulo_middleware::transport::Transport as _;
use modulo_middleware::transport::zenoh::ZenohTransport;
use modulo_msgs::{dynamic, rihs, ros_name};
use modulo_runtime::Clock;
use modulo_runtime::name::{NOT_OVER_ZENOH, is_hidden, is_hidden_node, near_or_all};
use modulo_runtime::wire::keys::{Endpoint, EntityKind};

use super::{colour, completion, domain, open_session, stop_on_signals, terminal};
use crate::{Ended, Failure};

#[derive(Subcommand)]
pub enum TopicCommand {
    /// List the topics
    List {
        /// Also print the types
        #[arg(short = 't', long)]
        show_types: bool,
        /// Also list hidden topics: those with a part that begins with an underscore
        #[arg(long)]
        include_hidden_topics: bool,
    },
    /// Print the type of a topic and the number of its publishers and subscriptions
    Info {
        /// Name of the topic, such as /recovered
        #[arg(add = completion::topics())]
        topic: String,
        /// Also print nodes, quality of service and type hashes
        #[arg(short, long)]
        verbose: bool,
    },
    /// Print the messages of a topic as YAML
    Echo {
        /// Name of the topic, such as /detections
        #[arg(add = completion::topics())]
        topic: String,
        /// End after the first message
        #[arg(long)]
        once: bool,
    },
    /// Print the rate of the messages of a topic until SIGINT
    Hz {
        /// Name of the topic, such as /recovered
        #[arg(add = completion::topics())]
        topic: String,
        /// Largest number of messages over which the rate is computed
        #[arg(short, long, default_value_t = 10_000, value_parser = clap::value_parser!(u32).range(2..))]
        window: u32,
    },
}

#[derive(Subcommand)]
pub enum NodeCommand {
    /// List the nodes
    List {
        /// Also list hidden nodes: those whose name begins with an underscore
        #[arg(short, long)]
        all: bool,
    },
    /// Print the publishers, subscriptions and services of a node
    Info {
        /// Name of the node, such as /detector
        #[arg(add = completion::nodes())]
        node: String,
    },
}

pub fn topic(args: &TopicCommand) -> Result<Ended, Failure> {
    let (clock, transport) = open_session()?;
    match args {
        TopicCommand::List { show_types, include_hidden_topics } => {
            let mut topics = transport.settled_graph().topics();
            topics.retain(|topic, _| *include_hidden_topics || !is_hidden(topic));
            for (topic, types) in topics {
                let types: Vec<String> = types.into_iter().collect();
                let shown = if *show_types { format!(" [{}]", types.join(", ")) } else { String::new() };
                say!("{topic}{shown}");
            }
            tell_empty("topic", transport.graph().topics().is_empty())?;
        }
        TopicCommand::Info { topic, verbose } => {
            let topic = absolute(topic);
            let graph = transport.graph_with(&topic)?;
            info(&graph, &topic, *verbose);
        }
        TopicCommand::Echo { topic, once } => echo(&transport, topic, *once)?,
        TopicCommand::Hz { topic, window } => hz(&transport, &*clock, topic, *window as usize)?,
    }
    Ok(Ended::Done)
}

pub fn node(args: &NodeCommand) -> Result<Ended, Failure> {
    let (_clock, transport) = open_session()?;
    let graph = transport.settled_graph();
    let nodes = graph.nodes();
    match args {
        NodeCommand::List { all } => {
            let shown: Vec<_> = nodes.iter().filter(|node| *all || !is_hidden_node(node)).collect();
            if shown.windows(2).any(|pair| pair[0] == pair[1]) {
                // The words of `ros2 node list`.
                note!(
                    "{} Be aware that there are nodes in the graph that share an exact name, which can have unintended side effects.",
                    colour::warning("WARNING:")
                );
            }
            shown.iter().for_each(|node| say!("{node}"));
            tell_empty("node", nodes.is_empty())?;
        }
        NodeCommand::Info { node } => {
            let node = absolute(node);
            if !nodes.contains(&node) {
                return Err(missing(&node, &nodes));
            }
            tell_namesakes(&graph, &node, "what follows is that of all of them");
            describe(&graph, &node);
        }
    }
    Ok(Ended::Done)
}

fn missing(node: &str, nodes: &[String]) -> Failure {
    let known: Vec<&str> = nodes.iter().map(String::as_str).collect();
    let known = near_or_all(node, &known, "; there are");
    let empty = format!("; there is no node at all; {NOT_OVER_ZENOH}");
    anyhow!("no node {node}{}", if nodes.is_empty() { empty } else { known }).into()
}

/// Says on standard error that the domain has nothing to list, which may mean that its nodes speak DDS.
pub fn tell_empty(what: &str, empty: bool) -> Result<(), Failure> {
    if empty {
        note!("there is no {what} in domain {}; {NOT_OVER_ZENOH}", domain()?);
    }
    Ok(())
}

/// Warns where several nodes are called `node`, an absolute name, with what that means for a command.
pub fn tell_namesakes(graph: &Graph, node: &str, means: &str) {
    let count = graph.nodes().iter().filter(|name| *name == node).count();
    if count > 1 {
        note!("{} {count} nodes are called {node}: {means}", colour::warning("WARNING:"));
    }
}

pub fn absolute(name: &str) -> String {
    format!("/{}", name.trim_matches('/'))
}

fn info(graph: &Graph, topic: &str, verbose: bool) {
    let types: Vec<String> = graph.topics().remove(topic).into_iter().flatten().collect();
    say!("Type: {}", types.join(", "));
    for (title, kind) in [("Publisher", EntityKind::Publisher), ("Subscription", EntityKind::Subscription)] {
        say!("{title} count: {}", graph.endpoints(kind, topic).count());
        for token in graph.endpoints(kind, topic).filter(|_| verbose) {
            let Some(Endpoint { dds_type, type_hash, qos, .. }) = &token.endpoint else { continue };
            say!("  {}: {} {type_hash} qos {qos}", token.node_name(), ros_name(dds_type));
        }
    }
    graph.conflicts_on(topic).iter().for_each(|conflict| say!("{conflict}"));
}

/// The titles of `ros2 node info`.
const ENDPOINTS: [(&str, EntityKind); 4] = [
    ("Subscribers", EntityKind::Subscription),
    ("Publishers", EntityKind::Publisher),
    ("Service Servers", EntityKind::Server),
    ("Service Clients", EntityKind::Client),
];

/// Prints the topics and services of a node with their types. Endpoints of the same topic and type are there once.
fn describe(graph: &Graph, node: &str) {
    say!("{node}");
    for (title, kind) in ENDPOINTS {
        say!("  {title}:");
        let own = graph.tokens().filter(|token| token.kind == kind && token.node_name() == node);
        let named = own.filter_map(|token| token.endpoint.as_ref());
        let named: BTreeSet<_> = named.map(|e| (&e.topic, ros_name(&e.dds_type))).collect();
        named.iter().for_each(|(topic, kind)| say!("    {topic}: {kind}"));
    }
}

/// Time between two looks at the graph while no message comes.
const LOOK: Duration = Duration::from_secs(1);

fn echo(transport: &ZenohTransport, topic: &str, once: bool) -> Result<(), Failure> {
    let listening = transport.listen(&absolute(topic), stop_on_signals()?)?;
    let name = ros_name(&listening.endpoint.dds_type);
    let description = match rihs::type_description(&name) {
        Some(description) => description,
        None => {
            let text =
                transport.definition_of(&listening.endpoint).context("the suite does not know the type")?;
            rihs::description_of_schema(&name, &text)?
        }
    };
    let (mut reported, mut is_told) = (Vec::new(), false);
    while listening.goes_on() {
        tell_twins(transport, &mut reported);
        // Nothing comes when the command was asked to end meanwhile.
        let Some(sample) = listening.next(Some(LOOK)) else {
            if let Some(lost) = transport.lost_publisher(&listening.endpoint.topic).filter(|_| !is_told) {
                note!("{} {lost}", colour::warning("WARNING:"));
                is_told = true;
            }
            continue;
        };
        is_told = false;
        let value = dynamic::from_slice(&description, &sample.item.payload)?;
        // The reader ends this command by closing the pipe.
        if !terminal::say(format_args!("{value}---")) || once {
            break;
        }
    }
    if listening.lost() > 0 {
        note!("{} messages are not shown: they came faster than they could be printed", listening.lost());
    }
    Ok(())
}

/// Warns of publishers whose messages mix on the topic that is listened to, each time that others join or leave.
fn tell_twins(transport: &ZenohTransport, reported: &mut Vec<Twins>) {
    let now = transport.twins();
    if *reported != now {
        now.iter().for_each(|twins| note!("{} {twins}", colour::warning("WARNING:")));
        *reported = now;
    }
}

/// Prints the rate of the messages, and its spread, once a second.
fn hz(transport: &ZenohTransport, clock: &dyn Clock, topic: &str, window: usize) -> Result<(), Failure> {
    let listening = transport.listen(&absolute(topic), stop_on_signals()?)?;
    let now = || clock.ticks_ns() as f64 / 1e9;
    let (mut arrived, mut due) = (VecDeque::new(), now() + 1.0);
    let mut reported = Vec::new();
    while listening.goes_on() {
        tell_twins(transport, &mut reported);
        let patience = Duration::from_secs_f64((due - now()).max(0.0));
        if let Some(sample) = listening.next(Some(patience)) {
            arrived.push_back(sample.stamp_ns as f64 / 1e9);
            if arrived.len() > window {
                arrived.pop_front();
            }
        }
        if now() >= due {
            // The next line is due one second after this one was due, so that delays do not add up.
            due += 1.0;
            let line = match transport.lost_publisher(&listening.endpoint.topic) {
                Some(lost) => lost.to_string(),
                None => rate(arrived.make_contiguous(), listening.lost()),
            };
            if !terminal::say(format_args!("{line}")) {
                break;
            }
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
        let printed = rate(&[0.0, 0.1, 0.2, 0.4], 3);
        assert!(
            printed.starts_with("average rate: 7.500\n\tmin: 0.100s max: 0.200s std dev: 0.04714s"),
            "{printed}"
        );
        assert!(printed.ends_with("window: 4 lost: 3"));
    }
}
