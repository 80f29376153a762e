//! `modulo param`: parameters of running nodes, through the services that
//! `ros2 param` uses.

use std::time::Duration;

use anyhow::{Context, anyhow};
use modulo_msgs::cdr;
use modulo_msgs::rcl_interfaces::{
    GetParametersRequest, GetParametersResponse, ListParametersRequest, ListParametersResponse, Parameter,
    ParameterValue, SetParametersRequest, SetParametersResponse,
};
use modulo_runtime::Value;
use modulo_runtime::parameter_service::{Service, from_ros, to_ros};
use modulo_runtime::transport::Transport;
use modulo_runtime::transport::zenoh::ZenohTransport;

use super::open_session;
use crate::cli::Param;
use crate::{Ended, Failure};

/// How long a node may take to appear, and to answer.
const PATIENCE: Duration = Duration::from_secs(5);

/// Runs one of the parameter commands.
pub fn param(args: &Param) -> Result<Ended, Failure> {
    let (_clock, transport) = open_session()?;
    match args {
        Param::List { node } => {
            let names = list(&transport, node)?;
            for (name, value) in names.iter().zip(get(&transport, node, &names)?) {
                say!("{name}: {}", shown(value));
            }
        }
        Param::Get { node, name } => {
            let value = get(&transport, node, std::slice::from_ref(name))?.pop().unwrap_or_default();
            let known = from_ros(value.clone()).is_ok();
            say!("{}", shown(value));
            if !known {
                return Err(Failure::Run(anyhow!("{node} has no parameter '{name}'")));
            }
        }
        Param::Set { node, name, value } => set(&transport, node, name, value)?,
    }
    transport.close();
    Ok(Ended::Done)
}

fn shown(value: ParameterValue) -> String {
    from_ros(value).map_or_else(|_| "not set".to_owned(), |value| value.to_string())
}

/// Calls one of the node's parameter services, once the node has been found.
fn call(
    transport: &ZenohTransport,
    node: &str,
    service: Service,
    request: Vec<u8>,
) -> anyhow::Result<Vec<u8>> {
    let node = format!("/{}", node.trim_matches('/'));
    for _ in 0..PATIENCE.as_millis() / 20 {
        if transport.is_ready(&node) {
            break;
        }
        std::thread::sleep(Duration::from_millis(20));
    }
    let (name, ros_type) = service.name_and_type();
    let answer = transport.call(&format!("{node}/{name}"), ros_type, request, PATIENCE);
    answer.with_context(|| format!("node {node}"))
}

fn list(transport: &ZenohTransport, node: &str) -> anyhow::Result<Vec<String>> {
    let request = cdr::to_vec(&ListParametersRequest::default())?;
    let answer = call(transport, node, Service::List, request)?;
    Ok(cdr::from_slice::<ListParametersResponse>(&answer)?.result.names)
}

fn get(transport: &ZenohTransport, node: &str, names: &[String]) -> anyhow::Result<Vec<ParameterValue>> {
    let request = cdr::to_vec(&GetParametersRequest { names: names.to_vec() })?;
    let answer = call(transport, node, Service::Get, request)?;
    Ok(cdr::from_slice::<GetParametersResponse>(&answer)?.values)
}

/// The present value tells the type that the text is read as.
fn set(transport: &ZenohTransport, node: &str, name: &str, text: &str) -> anyhow::Result<()> {
    let present = get(transport, node, &[name.to_owned()])?.pop().unwrap_or_default();
    let like = from_ros(present).unwrap_or(Value::String(String::new()));
    let value = like
        .parse_like(text)
        .with_context(|| format!("parameter '{name}' = {text}: is not a {}", like.type_name()))?;
    let parameters = vec![Parameter { name: name.to_owned(), value: to_ros(Some(&value)) }];
    let answer = call(transport, node, Service::Set, cdr::to_vec(&SetParametersRequest { parameters })?)?;
    match cdr::from_slice::<SetParametersResponse>(&answer)?.results.pop() {
        Some(result) if result.successful => {
            say!("{node} {name} = {value}");
            Ok(())
        }
        Some(result) => Err(anyhow!("{node} refused: {}", result.reason)),
        None => Err(anyhow!("{node} gave no result")),
    }
}
