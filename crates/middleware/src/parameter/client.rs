//! [`ParameterClient`]: the parameters of another node, through the services that `ros2 param` uses.

use std::thread::sleep;
use std::time::Duration;

use modulo_msgs::cdr::{self, CdrError};
use modulo_msgs::rcl_interfaces::{
    DescribeParametersRequest, DescribeParametersResponse, GetParametersRequest, GetParametersResponse,
    ListParametersRequest, ListParametersResponse, Parameter, ParameterDescriptor, ParameterValue,
    SetParametersRequest, SetParametersResponse,
};
use modulo_runtime::Value;
use modulo_runtime::parameter::ros::{from_ros, to_ros};
use serde::Serialize;
use serde::de::DeserializeOwned;

use super::service::Service;
use crate::transport::zenoh::ZenohTransport;
use crate::transport::{Transport as _, TransportError};

/// Time limit for a node to appear, and for it to answer.
const PATIENCE: Duration = Duration::from_secs(5);
/// Time limit for the answer to a change of a parameter, which a node gives within 20 s: it may have to load a model.
const SET_PATIENCE: Duration = Duration::from_secs(25);
const GLANCE: Duration = Duration::from_millis(20);

/// Error: the node did not do what was requested.
#[derive(Debug, thiserror::Error)]
pub enum ClientError {
    /// The node does not answer.
    #[error("node {0}: {1}")]
    Call(String, TransportError),
    /// The answer is not readable.
    #[error("node {0}: {1}")]
    Cdr(String, CdrError),
    /// The node gave so many values for so many names. An answer has no names, so that values would belong to wrong ones.
    #[error("{0} gave {1} values for {2} parameters")]
    Count(String, usize, usize),
    /// The parameter of this name has another type than this text; its type comes last.
    #[error("parameter '{0}' = {1}: is not of type {2}")]
    Type(String, String, &'static str),
    /// The node refuses the value.
    #[error("Setting parameter failed: {0}")]
    Refused(String),
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
        let (given, asked) = (values.len(), names.len());
        if given == asked { Ok(values) } else { Err(ClientError::Count(self.node.clone(), given, asked)) }
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
            Some(like) => like
                .parse_like(text)
                .ok_or_else(|| ClientError::Type(name.to_owned(), text.to_owned(), like.type_name()))?,
        };
        let parameters = vec![Parameter { name: name.to_owned(), value: to_ros(Some(&value)) }];
        let SetParametersResponse { mut results } =
            self.call(Service::SetParameters, &SetParametersRequest { parameters })?;
        match results.pop() {
            Some(result) if result.successful => Ok(()),
            Some(result) => Err(ClientError::Refused(result.reason)),
            None => Err(ClientError::Count(self.node.clone(), 0, 1)),
        }
    }

    /// Waits for the node, and calls one of its services.
    fn call<Q: Serialize, R: DeserializeOwned>(
        &self,
        service: Service,
        request: &Q,
    ) -> Result<R, ClientError> {
        // A node that was just started is not in the graph yet, and its services answer only when it is.
        for _ in 0..PATIENCE.as_millis() / GLANCE.as_millis() {
            if self.transport.is_ready(&self.node) {
                break;
            }
            sleep(GLANCE);
        }
        let (name, ros_type) = service.name_and_type();
        let unreadable = |why| ClientError::Cdr(self.node.clone(), why);
        let request = cdr::to_vec(request).map_err(unreadable)?;
        let patience = if service == Service::SetParameters { SET_PATIENCE } else { PATIENCE };
        let answer = self.transport.call(&format!("{}/{name}", self.node), ros_type, request, patience);
        let answer = answer.map_err(|why| ClientError::Call(self.node.clone(), why))?;
        cdr::from_slice(&answer).map_err(unreadable)
    }
}
