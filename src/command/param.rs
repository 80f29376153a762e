//! `modulo param`: parameters of running nodes, through the services that `ros2 param` uses.

use std::collections::BTreeSet;

use anyhow::anyhow;
use clap::Subcommand;
use modulo_middleware::parameter::client::ParameterClient;
use modulo_middleware::transport::zenoh::ZenohTransport;
use modulo_msgs::rcl_interfaces::{ParameterType, ParameterValue};
use modulo_runtime::parameter::file;
use modulo_runtime::parameter::text::{bare, described, labelled, type_name};

use super::{completion, graph, open_session};
use crate::{Ended, Failure};

#[derive(Subcommand)]
pub enum Param {
    /// List the parameters of a node, or of all nodes
    List {
        /// Fully qualified node name, such as /detector
        #[arg(add = completion::nodes())]
        node: Option<String>,
        /// Also print the types
        #[arg(long)]
        param_type: bool,
    },
    /// Print the value of a parameter
    Get {
        /// Fully qualified node name
        #[arg(add = completion::nodes())]
        node: String,
        /// Name of the parameter
        #[arg(add = completion::parameters())]
        name: String,
        /// Print the value without its type
        #[arg(long)]
        hide_type: bool,
    },
    /// Print the type, meaning and range of parameters
    Describe {
        /// Fully qualified node name
        #[arg(add = completion::nodes())]
        node: String,
        /// Names of the parameters
        #[arg(required = true, add = completion::parameters())]
        names: Vec<String>,
    },
    /// Print all values as a file for --params-file
    Dump {
        /// Fully qualified node name
        #[arg(add = completion::nodes())]
        node: String,
    },
    /// Change the value of a parameter, which the node may refuse
    Set {
        /// Fully qualified node name
        #[arg(add = completion::nodes())]
        node: String,
        /// Name of the parameter
        #[arg(add = completion::parameters())]
        name: String,
        /// New value
        #[arg(allow_hyphen_values = true)]
        value: String,
    },
}

pub fn param(args: &Param) -> Result<Ended, Failure> {
    let (_clock, transport) = open_session()?;
    // All nodes of a name get the request, whichever of them is found first.
    transport.settled_graph();
    let done = ask(args, &transport);
    let node = match args {
        Param::List { node, .. } => node.as_ref(),
        Param::Get { node, .. }
        | Param::Describe { node, .. }
        | Param::Dump { node }
        | Param::Set { node, .. } => Some(node),
    };
    if let Some(node) = node {
        let means = "each of them got the request, and the answer is that of the first one that gave it";
        graph::tell_namesakes(&transport.graph(), &graph::absolute(node), means);
    }
    done
}

fn ask(args: &Param, transport: &ZenohTransport) -> Result<Ended, Failure> {
    let client = |node: &str| ParameterClient::new(transport, node);
    let missing = |node, name| Failure::Run(anyhow!("{node} has no parameter '{name}'"));
    match args {
        Param::List { node, param_type } => list(node.as_deref(), *param_type, transport)?,
        Param::Get { node, name, hide_type } => {
            let values = client(node).values(std::slice::from_ref(name))?;
            let value = values.first().filter(|value| value.r#type != ParameterType::PARAMETER_NOT_SET);
            let value = value.ok_or_else(|| missing(node, name))?;
            say!("{}", if *hide_type { bare(value) } else { labelled(value) });
        }
        Param::Describe { node, names } => {
            for descriptor in client(node).descriptors(names)? {
                if descriptor.r#type == ParameterType::PARAMETER_NOT_SET {
                    return Err(missing(node, &descriptor.name));
                }
                say!("{}", described(&descriptor));
            }
        }
        Param::Dump { node } => {
            let file = file::write(&graph::absolute(node), &all_values(&client(node))?);
            say!("{}", file.trim_end());
        }
        Param::Set { node, name, value } => {
            client(node).set(name, value)?;
            say!("Set parameter successful");
        }
    }
    Ok(Ended::Done)
}

/// Prints the parameters of a node, or of all nodes.
fn list(node: Option<&str>, types: bool, transport: &ZenohTransport) -> Result<(), Failure> {
    let one = node.map(|node| BTreeSet::from([graph::absolute(node)]));
    let nodes = one.unwrap_or_else(|| transport.graph().nodes_with_parameters());
    graph::tell_empty("node with parameters", nodes.is_empty())?;
    for name in nodes {
        if node.is_none() {
            say!("{name}:");
        }
        print_names(&ParameterClient::new(transport, &name), types)?;
    }
    Ok(())
}

fn all_values(node: &ParameterClient<'_>) -> anyhow::Result<Vec<(String, ParameterValue)>> {
    let names = node.names()?;
    let values = node.values(&names)?;
    Ok(names.into_iter().zip(values).collect())
}

fn print_names(node: &ParameterClient<'_>, types: bool) -> anyhow::Result<()> {
    let mut names = node.names()?;
    names.sort();
    if !types {
        names.iter().for_each(|name| say!("  {name}"));
        return Ok(());
    }
    for descriptor in node.descriptors(&names)? {
        say!("  {} (type: {})", descriptor.name, type_name(descriptor.r#type));
    }
    Ok(())
}
