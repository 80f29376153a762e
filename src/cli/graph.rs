//! Arguments of `modulo topic` and `modulo node`.

use clap::{Args, Subcommand};

/// `modulo topic`
#[derive(Subcommand)]
pub enum Topic {
    /// List all topics
    List {
        /// Also print the types
        #[arg(short = 't', long)]
        show_types: bool,
    },
    /// Print the type of a topic and the number of its publishers and subscriptions
    Info {
        /// Name of the topic, such as /recovered
        topic: String,
        /// Also print nodes, quality of service and type hashes
        #[arg(short, long)]
        verbose: bool,
    },
    /// Print the messages of a topic as YAML
    Echo(Echo),
    /// Print the rate of the messages of a topic until SIGINT
    Hz {
        /// Name of the topic, such as /recovered
        topic: String,
        /// Largest number of messages over which the rate is computed
        #[arg(short, long, default_value_t = 10_000, value_parser = clap::value_parser!(u32).range(2..))]
        window: u32,
    },
}

/// `modulo topic echo`
#[derive(Args)]
pub struct Echo {
    /// Name of the topic, such as /detections
    pub topic: String,
    /// End after the first message
    #[arg(long)]
    pub once: bool,
}

/// `modulo node`
#[derive(Subcommand)]
pub enum Node {
    /// List all nodes
    List,
    /// Print the publishers, subscriptions and services of a node
    Info {
        /// Name of the node, such as /detector
        node: String,
    },
}
