//! The six parameter services of a ROS 2 node, as functions from request bytes to response bytes; no transport.

use std::sync::mpsc::{RecvError, RecvTimeoutError, channel};
use std::time::Duration;

use modulo_msgs::cdr::{self, CdrError};
use modulo_msgs::rcl_interfaces::{
    DescribeParametersRequest, DescribeParametersResponse, FloatingPointRange, GetParameterTypesRequest,
    GetParameterTypesResponse, GetParametersRequest, GetParametersResponse, IntegerRange,
    ListParametersRequest, ListParametersResponse, ListParametersResult, Parameter, ParameterDescriptor,
    SetParametersAtomicallyRequest, SetParametersAtomicallyResponse, SetParametersRequest,
    SetParametersResponse, SetParametersResult,
};
use modulo_runtime::parameter::{from_ros, to_ros};
use modulo_runtime::{Allowed, Descriptor, ParameterError, Value};
use serde::Serialize;
use serde::de::DeserializeOwned;

use crate::transport::{Claim, ParameterAnswer, ParameterPort, ParameterRequest};

/// Time that a caller waits until the node has finished its current frame.
const PATIENCE: Duration = Duration::from_secs(10);
/// Time that a caller waits after that until the node has loaded what the request needs, such as a model.
const LOADING: Duration = Duration::from_secs(10);

crate::services! {
    /// The six parameter services of a node.
    pub enum Service in "rcl_interfaces" {
        DescribeParameters = "describe_parameters",
        GetParameterTypes = "get_parameter_types",
        GetParameters = "get_parameters",
        ListParameters = "list_parameters",
        SetParameters = "set_parameters",
        SetParametersAtomically = "set_parameters_atomically",
    }
}

impl Service {
    /// Answers one request, which is CDR with its encapsulation header.
    ///
    /// # Errors
    /// [`CdrError`] when the request cannot be read.
    pub fn answer(self, request: &[u8], port: &ParameterPort) -> Result<Vec<u8>, CdrError> {
        match self {
            Self::DescribeParameters => respond(request, |DescribeParametersRequest { names }| {
                let set = (port.read)();
                let descriptors = names.iter().map(|n| describe(n, set.descriptor(n))).collect();
                DescribeParametersResponse { descriptors }
            }),
            Self::GetParameterTypes => respond(request, |GetParameterTypesRequest { names }| {
                let set = (port.read)();
                GetParameterTypesResponse { types: names.iter().map(|n| to_ros(set.get(n)).r#type).collect() }
            }),
            Self::GetParameters => respond(request, |GetParametersRequest { names }| {
                let set = (port.read)();
                let value = |name: &String| to_ros(set.get(name).map(Value::without_secrets).as_ref());
                GetParametersResponse { values: names.iter().map(value).collect() }
            }),
            Self::ListParameters => respond(request, |ListParametersRequest { prefixes, .. }| {
                let set = (port.read)();
                let names = set.descriptors().iter().map(|d| d.name.to_owned());
                let names = names.filter(|name| has_prefix(name, &prefixes)).collect();
                ListParametersResponse { result: ListParametersResult { names, prefixes: Vec::new() } }
            }),
            Self::SetParameters => respond(request, |SetParametersRequest { parameters }| {
                // Each parameter is a change of its own here: one that is refused does not stop the others.
                let changes = parameters.into_iter().map(|parameter| vec![parameter]).collect();
                SetParametersResponse { results: set(changes, port) }
            }),
            Self::SetParametersAtomically => {
                respond(request, |SetParametersAtomicallyRequest { parameters }| {
                    let result = set(vec![parameters], port).pop().expect("one answer for one change");
                    SetParametersAtomicallyResponse { result }
                })
            }
        }
    }
}

/// Answers a request by `answer`, both as CDR with its encapsulation header.
pub(crate) fn respond<Q: DeserializeOwned, R: Serialize>(
    request: &[u8],
    answer: impl FnOnce(Q) -> R,
) -> Result<Vec<u8>, CdrError> {
    cdr::to_vec(&answer(cdr::from_slice(request)?))
}

fn has_prefix(name: &str, prefixes: &[String]) -> bool {
    prefixes.is_empty()
        || prefixes.iter().any(|p| name.strip_prefix(p).is_some_and(|r| r.is_empty() || r.starts_with('.')))
}

/// Hands the changes to the node's loop, all at once, and waits for its answers, one for each change.
fn set(changes: Vec<Vec<Parameter>>, port: &ParameterPort) -> Vec<SetParametersResult> {
    let read = |p: Parameter| match from_ros(p.value) {
        Some(value) => Ok((p.name, value)),
        None => Err(ParameterError::new(p.name, "not set", "cannot be removed; send a value")),
    };
    let changes: Vec<Result<Vec<_>, _>> =
        changes.into_iter().map(|parameters| parameters.into_iter().map(read).collect()).collect();
    let possible: Vec<Vec<(String, Value)>> =
        changes.iter().filter_map(|c| c.as_ref().ok().cloned()).collect();
    let asked = possible.len();
    // One request for all of them: a node that is busy with a long step takes one request after each step.
    let mut answers = ask(possible, port).unwrap_or_else(|why| vec![Err(why); asked]).into_iter();
    let result = |change: Result<Vec<_>, _>| {
        let answer = change.and_then(|_| answers.next().expect("one answer for each change"));
        SetParametersResult {
            successful: answer.is_ok(),
            reason: answer.err().map_or_else(String::new, |why| why.to_string()),
        }
    };
    changes.into_iter().map(result).collect()
}

/// Returns the answers of the node to all changes, or the reason why it gave none.
fn ask(
    changes: Vec<Vec<(String, Value)>>,
    port: &ParameterPort,
) -> Result<Vec<Result<(), ParameterError>>, ParameterError> {
    if changes.is_empty() {
        return Ok(Vec::new());
    }
    let (names, values): (Vec<_>, Vec<_>) =
        changes.iter().flatten().map(|(name, value)| (name.clone(), value.to_string())).unzip();
    let none = |why: &str| ParameterError::new(names.join(", "), values.join(", "), why);
    let (answer, verdict) = channel();
    // Node and caller decide by it which of them is first: the one to answer, the other to give up.
    let claim = Claim::default();
    let request = ParameterRequest { changes, answer, claim: claim.clone() };
    if !(port.request)(request) {
        return Err(none("the node is ending, or has too many requests; try again"));
    }
    let ended = |_| none("the node ended while it applied the value; see its log");
    let first = match verdict.recv_timeout(PATIENCE) {
        // From now on the node ignores the request.
        Err(RecvTimeoutError::Timeout) if claim.take() => {
            return Err(none("the node did not answer within 10 s; the value is unchanged"));
        }
        // The node is applying it at this moment, so its answer counts.
        Err(_) => verdict.recv().map_err(ended)?,
        Ok(answer) => answer,
    };
    let last = match first {
        ParameterAnswer::Loading => verdict.recv_timeout(LOADING),
        done @ ParameterAnswer::Done(_) => Ok(done),
    };
    match last {
        Ok(ParameterAnswer::Done(answers)) => Ok(answers),
        Ok(ParameterAnswer::Loading) | Err(RecvTimeoutError::Timeout) => Err(none(
            "the node is still loading what this needs; the value takes effect when that is done, unless it fails: \
             its topic ~/state and its log say so",
        )),
        Err(RecvTimeoutError::Disconnected) => Err(ended(RecvError)),
    }
}

fn describe(name: &str, descriptor: Option<&Descriptor>) -> ParameterDescriptor {
    let Some(descriptor) = descriptor else {
        return ParameterDescriptor { name: name.to_owned(), ..Default::default() };
    };
    let mut ros = ParameterDescriptor {
        name: descriptor.name.to_owned(),
        r#type: to_ros(Some(&descriptor.default)).r#type,
        // ROS 2 has no field for it.
        description: format!("{} (default {})", descriptor.description, descriptor.default.to_yaml()),
        read_only: descriptor.read_only,
        ..Default::default()
    };
    match &descriptor.allowed {
        Allowed::Any => {}
        Allowed::Words(_) => ros.additional_constraints = descriptor.allowed.to_string(),
        // In ROS 2, a step of 0 means every value of the range.
        Allowed::Integers(range) => {
            let (from_value, to_value) = (*range.start(), *range.end());
            ros.integer_range = vec![IntegerRange { from_value, to_value, step: 0 }];
        }
        Allowed::Doubles(range) => {
            let (from_value, to_value) = (*range.start(), *range.end());
            ros.floating_point_range = vec![FloatingPointRange { from_value, to_value, step: 0.0 }];
        }
    }
    ros
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sample::Set;
    use modulo_msgs::rcl_interfaces::{ParameterType, ParameterValue};
    use modulo_runtime::{ParameterSet as _, Parameters};
    use std::sync::{Arc, Mutex};

    /// A port whose node applies what it is asked, in a thread of its own.
    fn port() -> ParameterPort {
        let set = Parameters::declare(Set::descriptors());
        let set = Arc::new(Mutex::new(set));
        let (requests, inbox) = channel::<ParameterRequest>();
        let applied = set.clone();
        std::thread::spawn(move || {
            for request in inbox {
                let mut set = applied.lock().expect("not poisoned");
                let apply = |values: &Vec<_>| set.with(values, true).map(|next| *set = next);
                let answers = request.changes.iter().map(apply).collect();
                request.answer.send(ParameterAnswer::Done(answers)).expect("the caller waits");
            }
        });
        let read = Box::new(move || set.lock().expect("not poisoned").clone());
        ParameterPort { read, request: Box::new(move |request| requests.send(request).is_ok()) }
    }

    fn parameter(name: &str, value: Value) -> Parameter {
        Parameter { name: name.into(), value: to_ros(Some(&value)) }
    }

    fn call<Q: Serialize, R: DeserializeOwned>(port: &ParameterPort, service: Service, request: &Q) -> R {
        let request = cdr::to_vec(request).expect("encodes");
        cdr::from_slice(&service.answer(&request, port).expect("readable")).expect("decodes")
    }

    #[test]
    fn set_answers_each_and_changes_only_what_is_possible() {
        let port = port();
        let parameters =
            vec![parameter("angle", Value::Double(0.0)), parameter("engine", Value::String("ort".into()))];
        let results = call::<_, SetParametersResponse>(
            &port,
            Service::SetParameters,
            &SetParametersRequest { parameters },
        )
        .results;
        assert!(!results[0].successful && results[0].reason.contains("0.001 to 1024"), "{:?}", results[0]);
        assert!(results[1].successful);
        assert_eq!((port.read)().get("engine"), Some(&Value::String("ort".into())));
        assert_eq!((port.read)().get("angle"), Some(&Value::Double(4.0)));
    }

    /// A detector takes one request after each frame: a dump of 30 parameters took longer than its caller waited.
    #[test]
    fn many_parameters_are_one_request() {
        let (requests, inbox) = channel::<ParameterRequest>();
        let request = Box::new(move |request| requests.send(request).is_ok());
        let read = Box::new(|| Parameters::declare(Set::descriptors()));
        let answering = std::thread::spawn(move || {
            let request = inbox.recv().expect("a request");
            request
                .answer
                .send(ParameterAnswer::Done(vec![Ok(()); request.changes.len()]))
                .expect("the caller waits");
            assert!(inbox.recv().is_err(), "a second request");
        });
        let port = ParameterPort { read, request };
        let parameters = vec![parameter("bits", Value::Integer(8)), parameter("loop", Value::Bool(true))];
        let request = SetParametersRequest { parameters };
        let results = call::<_, SetParametersResponse>(&port, Service::SetParameters, &request).results;
        assert!(results.len() == 2 && results.iter().all(|result| result.successful), "{results:?}");
        drop(port);
        answering.join().expect("one request");
    }

    #[test]
    fn atomically_is_all_or_nothing() {
        let port = port();
        let parameters = vec![parameter("angle", Value::Integer(3)), parameter("gamma", Value::Bool(true))];
        let result = call::<_, SetParametersAtomicallyResponse>(
            &port,
            Service::SetParametersAtomically,
            &SetParametersAtomicallyRequest { parameters },
        )
        .result;
        assert!(!result.successful && result.reason.contains("gamma"));
        assert_eq!((port.read)().get("angle"), Some(&Value::Double(4.0)));
    }

    #[test]
    fn list_get_and_describe_tell_what_was_declared() {
        let port = port();
        let request = ListParametersRequest::default();
        let listed = call::<_, ListParametersResponse>(&port, Service::ListParameters, &request).result.names;
        assert_eq!(listed, ["angle", "bits", "engine", "wait_for", "model", "loop", "share"]);

        let values = call::<_, GetParametersResponse>(
            &port,
            Service::GetParameters,
            &GetParametersRequest { names: vec!["angle".into(), "nix".into()] },
        )
        .values;
        assert_eq!((values[0].double_value, values[1].r#type), (4.0, ParameterType::PARAMETER_NOT_SET));

        let described = call::<_, DescribeParametersResponse>(
            &port,
            Service::DescribeParameters,
            &DescribeParametersRequest { names: listed },
        )
        .descriptors;
        assert_eq!(described[0].floating_point_range[0].to_value, 1024.0);
        assert_eq!(described[0].description, "A double. (default 4.0)");
    }

    #[test]
    fn a_broken_request_is_an_error() {
        assert!(Service::SetParameters.answer(&[0, 1, 0, 0, 255, 255, 255, 255], &port()).is_err());
    }

    /// `ros2 param set /detector classes "[]"` sends an array of bools. A full array of a wrong type is refused by name.
    #[test]
    fn an_empty_array_of_any_type_is_an_empty_list() {
        let port = port();
        let set = |name: &str, value: Value| {
            let request = SetParametersRequest { parameters: vec![parameter(name, value)] };
            call::<_, SetParametersResponse>(&port, Service::SetParameters, &request).results.remove(0)
        };
        for empty in [Value::Bytes(vec![]), Value::Bools(vec![]), Value::Doubles(vec![])] {
            assert!(set("wait_for", Value::String("camera".into())).successful);
            assert!(set("wait_for", empty).successful);
            assert_eq!((port.read)().get("wait_for"), Some(&Value::Strings(Vec::new())));
        }
        for (name, value, why) in [
            (
                "wait_for",
                Value::Integers(vec![1, 2]),
                "= [1, 2]: is of type integer_array, must be of type string_array",
            ),
            ("angle", Value::Bools(vec![]), "= []: is of type bool_array, must be of type double"),
            ("angle", Value::Bytes(vec![7]), "= [7]: is of type byte_array, must be of type double"),
        ] {
            let result = set(name, value);
            assert!(!result.successful && result.reason.contains(why), "{result:?}");
        }
        assert_eq!(from_ros(ParameterValue { r#type: 77, ..ParameterValue::default() }), None);
        for value in [
            Value::Bytes(vec![1]),
            Value::Bools(vec![true]),
            Value::Integers(vec![1]),
            Value::Doubles(vec![1.0]),
        ] {
            assert_eq!(from_ros(to_ros(Some(&value))), Some(value));
        }
    }
}
