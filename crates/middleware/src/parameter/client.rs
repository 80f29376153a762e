//! [`ParameterClient`]: the parameters of another node, through the services that `ros2 param` uses.

use std::fmt;
use std::time::Duration;

use modulo_msgs::cdr;
use modulo_msgs::rcl_interfaces::{
    DescribeParametersRequest, DescribeParametersResponse, GetParametersRequest, GetParametersResponse,
    ListParametersRequest, ListParametersResponse, Parameter, ParameterDescriptor, ParameterValue,
    SetParametersRequest, SetParametersResponse,
};
use modulo_runtime::parameter::{from_ros, to_ros};
use modulo_runtime::{Stop, SystemClock, Value};
use serde::Serialize;
use serde::de::DeserializeOwned;

use super::service::Service;
use crate::driver::wait_until_ready;
use crate::transport::zenoh::ZenohTransport;

/// Time limit for a node to appear, and for it to answer.
const PATIENCE: Duration = Duration::from_secs(5);
/// Time limit for the answer to a change of a parameter, which a node gives within 20 s: it may have to load a model.
const SET_PATIENCE: Duration = Duration::from_secs(25);

/// Error: the node did not do what was requested; it does not answer, not as it should, or refuses a value. The text says which.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub struct ClientError(String);

impl ClientError {
    /// Returns the error of the node `node`, which does not answer, or with something that cannot be read.
    pub fn of_node(node: &str, why: impl fmt::Display) -> Self {
        Self(format!("node {node}: {why}"))
    }
}

/// The parameters of one node in the graph of a session.
pub struct ParameterClient<'a> {
    transport: &'a ZenohTransport,
    node: String,
}

impl<'a> ParameterClient<'a> {
    /// Creates a client for `node`, a fully qualified name with or without the slash in front.
    pub fn new(transport: &'a ZenohTransport, node: &str) -> Self {
        Self { transport, node: format!("/{}", node.trim_matches('/')) }
    }

    /// Returns the names of all parameters.
    pub fn names(&self) -> Result<Vec<String>, ClientError> {
        let ListParametersResponse { result } =
            self.call(Service::ListParameters, &ListParametersRequest::default())?;
        Ok(result.names)
    }

    /// Returns the values of `names`, one for each name; the type of an unknown parameter is `NOT_SET`.
    ///
    /// # Errors
    /// [`ClientError`] when the node does not answer, or not for each name.
    pub fn values(&self, names: &[String]) -> Result<Vec<ParameterValue>, ClientError> {
        let GetParametersResponse { values } =
            self.call(Service::GetParameters, &GetParametersRequest { names: names.to_vec() })?;
        // An answer has no names, so that values would belong to wrong ones.
        if values.len() == names.len() { Ok(values) } else { Err(self.miscounted(values.len(), names.len())) }
    }

    /// Returns the descriptors of `names`; the type of an unknown parameter is `NOT_SET`.
    pub fn descriptors(&self, names: &[String]) -> Result<Vec<ParameterDescriptor>, ClientError> {
        let DescribeParametersResponse { descriptors } =
            self.call(Service::DescribeParameters, &DescribeParametersRequest { names: names.to_vec() })?;
        Ok(descriptors)
    }

    /// Sets one parameter to the value that `text` has in YAML, read as the type of its present value if it has one.
    ///
    /// # Errors
    /// [`ClientError`] when the text has another type, the node refuses the value, or it does not answer.
    pub fn set(&self, name: &str, text: &str) -> Result<(), ClientError> {
        let present = self.values(&[name.to_owned()])?.pop().and_then(from_ros);
        // A node refuses a value of another type: `2` has to be sent as 2.0 to a parameter of type double.
        let value = match present {
            None => Value::guess(text),
            Some(like) => like.parse_like(text).ok_or_else(|| {
                ClientError(format!("parameter '{name}' = {text}: is not of type {}", like.type_name()))
            })?,
        };
        let parameters = vec![Parameter { name: name.to_owned(), value: to_ros(Some(&value)) }];
        let SetParametersResponse { mut results } =
            self.call(Service::SetParameters, &SetParametersRequest { parameters })?;
        match results.pop() {
            Some(result) if result.successful => Ok(()),
            Some(result) => Err(ClientError(format!("Setting parameter failed: {}", result.reason))),
            None => Err(self.miscounted(0, 1)),
        }
    }

    fn miscounted(&self, given: usize, asked: usize) -> ClientError {
        ClientError(format!("{} gave {given} values for {asked} parameters", self.node))
    }

    /// Waits for the node, and calls one of its services.
    fn call<Q: Serialize, R: DeserializeOwned>(
        &self,
        service: Service,
        request: &Q,
    ) -> Result<R, ClientError> {
        // A node that was just started is not in the graph yet, and its services answer only when it is.
        let (clock, nodes) = (SystemClock::default(), vec![self.node.clone()]);
        // The call of a node that is still missing tells why nobody answers.
        let _ = wait_until_ready(self.transport, &clock, nodes, PATIENCE, &Stop::default());
        let (name, ros_type) = service.name_and_type();
        let request = cdr::to_vec(request).map_err(|why| ClientError::of_node(&self.node, why))?;
        let patience = if service == Service::SetParameters { SET_PATIENCE } else { PATIENCE };
        let answer = self.transport.call(&format!("{}/{name}", self.node), ros_type, request, patience);
        let answer = answer.map_err(|why| ClientError::of_node(&self.node, why))?;
        cdr::from_slice(&answer).map_err(|why| ClientError::of_node(&self.node, why))
    }
}
