//! Arguments of `modulo topic` and `modulo node`.

use clap::{Args, Subcommand};

/// `modulo topic`
#[derive(Subcommand)]
pub enum Topic {
    /// Names of all topics
    List {
        /// With their types
        #[arg(short = 't', long)]
        show_types: bool,
    },
    /// Type, publishers and subscriptions of one topic
    Info {
        /// Such as /recovered
        topic: String,
        /// With nodes, quality of service and type hashes
        #[arg(short, long)]
        verbose: bool,
    },
    /// Print messages as YAML
    Echo(Echo),
    /// Print the rate at which messages come, until SIGINT
    Hz {
        /// Such as /recovered
        topic: String,
        /// Messages over which the rate is taken
        #[arg(short, long, default_value_t = 10_000, value_parser = clap::value_parser!(u32).range(2..))]
        window: u32,
    },
}

/// `modulo topic echo`
#[derive(Args)]
pub struct Echo {
    /// Such as /detections
    pub topic: String,
    /// End after the first message
    #[arg(long)]
    pub once: bool,
}

/// `modulo node`
#[derive(Subcommand)]
pub enum Node {
    /// Names of all nodes
    List,
    /// What a node publishes, subscribes to and serves
    Info {
        /// Such as /detector
        node: String,
    },
}
