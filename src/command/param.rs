//! `modulo param`: parameters of running nodes, through the services that `ros2 param` uses.

use std::collections::BTreeSet;
use std::io::Write as _;
use std::time::Duration;

use anyhow::{Context, anyhow};
use clap::Subcommand;
use modulo_msgs::cdr;
use modulo_msgs::rcl_interfaces::{
    DescribeParametersRequest, DescribeParametersResponse, GetParametersRequest, GetParametersResponse,
    ListParametersRequest, ListParametersResponse, Parameter, ParameterDescriptor, ParameterType,
    ParameterValue, SetParametersRequest, SetParametersResponse,
};
use modulo_runtime::Value;
use modulo_runtime::graph::Graph;
use modulo_runtime::parameter::file;
use modulo_runtime::parameter::service::{Service, from_ros, to_ros};
use modulo_runtime::parameter::text::{bare, described, labelled, type_name};
use modulo_runtime::transport::Transport;
use modulo_runtime::transport::keys::{EntityKind, Token};
use modulo_runtime::transport::zenoh::ZenohTransport;

use serde::Serialize;
use serde::de::DeserializeOwned;

use super::{graph, open_session};
use crate::{Ended, Failure};

/// Time limit for a node to appear, and for it to answer.
const PATIENCE: Duration = Duration::from_secs(5);

/// `modulo param`
#[derive(Subcommand)]
pub enum Param {
    /// List the parameters of a node, or of all nodes
    List {
        /// Fully qualified node name, such as /detector
        node: Option<String>,
        /// Also print the types
        #[arg(long)]
        param_type: bool,
    },
    /// Print the value of a parameter
    Get {
        /// Fully qualified node name
        node: String,
        /// Name of the parameter
        name: String,
        /// Print the value without its type
        #[arg(long)]
        hide_type: bool,
    },
    /// Print the type, meaning and range of parameters
    Describe {
        /// Fully qualified node name
        node: String,
        /// Names of the parameters
        #[arg(required = true)]
        names: Vec<String>,
    },
    /// Print all values as a file for --params-file
    Dump {
        /// Fully qualified node name
        node: String,
    },
    /// Change the value of a parameter, which the node may refuse
    Set {
        /// Fully qualified node name
        node: String,
        /// Name of the parameter
        name: String,
        /// New value
        #[arg(allow_hyphen_values = true)]
        value: String,
    },
}

/// Runs one of the parameter commands.
pub fn param(args: &Param) -> Result<Ended, Failure> {
    let (_clock, transport) = open_session()?;
    match args {
        Param::List { node: Some(node), param_type } => print_names(&transport, node, *param_type)?,
        Param::List { node: None, param_type } => {
            for node in serving(&transport.settled_graph()) {
                say!("{node}:");
                print_names(&transport, &node, *param_type)?;
            }
        }
        Param::Get { node, name, hide_type } => {
            let value = get_one(&transport, node, name)?;
            if value.r#type == ParameterType::NOT_SET {
                return Err(Failure::Run(anyhow!("{node} has no parameter '{name}'")));
            }
            say!("{}", if *hide_type { bare(&value) } else { labelled(&value) });
        }
        Param::Describe { node, names } => {
            for descriptor in describe(&transport, node, names)? {
                if descriptor.r#type == ParameterType::NOT_SET {
                    return Err(Failure::Run(anyhow!("{node} has no parameter '{}'", descriptor.name)));
                }
                say!("{}", described(&descriptor));
            }
        }
        Param::Dump { node } => {
            let names = list(&transport, node)?;
            let values = get(&transport, node, &names)?;
            let all: Vec<_> = names.into_iter().zip(values).collect();
            let node = graph::absolute(node);
            // A reader that has left, such as `head`, is no failure.
            let _ = std::io::stdout().write_all(file::write(&node, &all).as_bytes());
        }
        Param::Set { node, name, value } => set(&transport, node, name, value)?,
    }
    transport.close();
    Ok(Ended::Done)
}

/// Returns the nodes whose parameters can be asked for.
fn serving(graph: &Graph) -> BTreeSet<String> {
    let lists = |token: &Token| {
        let endpoint = token.endpoint.as_ref()?;
        endpoint.topic.strip_suffix("/list_parameters").map(str::to_owned)
    };
    graph.tokens().filter(|token| token.kind == EntityKind::Server).filter_map(lists).collect()
}

fn print_names(transport: &ZenohTransport, node: &str, types: bool) -> anyhow::Result<()> {
    let mut names = list(transport, node)?;
    names.sort();
    if !types {
        names.iter().for_each(|name| say!("  {name}"));
        return Ok(());
    }
    for descriptor in describe(transport, node, &names)? {
        say!("  {} (type: {})", descriptor.name, type_name(descriptor.r#type));
    }
    Ok(())
}

/// Waits for `node`, and calls one of its parameter services.
fn call<Q: Serialize, R: DeserializeOwned>(
    transport: &ZenohTransport,
    node: &str,
    service: Service,
    request: &Q,
) -> anyhow::Result<R> {
    let node = graph::absolute(node);
    // A node that was just started is not in the graph yet, and its services answer only when it is.
    for _ in 0..PATIENCE.as_millis() / 20 {
        if transport.is_ready(&node) {
            break;
        }
        std::thread::sleep(Duration::from_millis(20));
    }
    let (name, ros_type) = service.name_and_type();
    let answer = transport.call(&format!("{node}/{name}"), ros_type, cdr::to_vec(request)?, PATIENCE);
    Ok(cdr::from_slice(&answer.with_context(|| format!("node {node}"))?)?)
}

fn list(transport: &ZenohTransport, node: &str) -> anyhow::Result<Vec<String>> {
    let request = ListParametersRequest::default();
    let ListParametersResponse { result } = call(transport, node, Service::ListParameters, &request)?;
    Ok(result.names)
}

/// Reads the values of `names`, one for each name.
fn get(transport: &ZenohTransport, node: &str, names: &[String]) -> anyhow::Result<Vec<ParameterValue>> {
    let request = GetParametersRequest { names: names.to_vec() };
    let GetParametersResponse { values } = call(transport, node, Service::GetParameters, &request)?;
    // The answer has no names: with another length, values would be shown under wrong names.
    if values.len() != names.len() {
        return Err(anyhow!("{node} gave {} values for {} parameters", values.len(), names.len()));
    }
    Ok(values)
}

fn get_one(transport: &ZenohTransport, node: &str, name: &str) -> anyhow::Result<ParameterValue> {
    Ok(get(transport, node, &[name.to_owned()])?.remove(0))
}

fn describe(
    transport: &ZenohTransport,
    node: &str,
    names: &[String],
) -> anyhow::Result<Vec<ParameterDescriptor>> {
    let request = DescribeParametersRequest { names: names.to_vec() };
    let response: DescribeParametersResponse = call(transport, node, Service::DescribeParameters, &request)?;
    Ok(response.descriptors)
}

/// Sets one parameter. The type of its present value is the type that the text is read as; without a value, the type is
/// that of the notation.
fn set(transport: &ZenohTransport, node: &str, name: &str, text: &str) -> anyhow::Result<()> {
    let present = get_one(transport, node, name)?;
    // A node refuses a value of another type: `2` has to be sent as 2.0 to a parameter of type double.
    let value = match from_ros(present) {
        Some(like) => like
            .parse_like(text)
            .with_context(|| format!("parameter '{name}' = {text}: is not of type {}", like.type_name()))?,
        None => Value::guess(text),
    };
    let parameters = vec![Parameter { name: name.to_owned(), value: to_ros(Some(&value)) }];
    let request = SetParametersRequest { parameters };
    let SetParametersResponse { mut results } = call(transport, node, Service::SetParameters, &request)?;
    match results.pop() {
        Some(result) if result.successful => {
            say!("Set parameter successful");
            Ok(())
        }
        Some(result) => Err(anyhow!("Setting parameter failed: {}", result.reason)),
        None => Err(anyhow!("{node} gave no result")),
    }
}
