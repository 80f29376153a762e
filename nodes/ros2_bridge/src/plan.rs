//! The plan of the bridge: its parameters, and the routes that they describe. This file knows neither of the two
//! transports, so that its tests (`tests/suite/bridge.rs`) need no ROS 2.
//!
//! A topic is forwarded in one direction only, so that the bridge never reads on one side the messages that it
//! publishes there.

use std::collections::BTreeMap;

use modulo_msgs::{dds_name, rihs};
use modulo_runtime::wire::keys::{self, Endpoint};
use modulo_runtime::{MessageKind, NodeName, ParameterError, Qos};

/// Direction in which a topic is forwarded.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RouteDirection {
    /// The topic is forwarded from the DDS graph to the suite.
    DdsToZenoh,
    /// The topic is forwarded from the suite to the DDS graph.
    ZenohToDds,
}

/// A topic that is forwarded.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Route {
    /// Absolute name, the same on both sides.
    pub topic: String,
    /// ROS name of the type, such as `sensor_msgs/msg/Image`.
    pub ros_type: String,
    /// Hash of that type.
    pub type_hash: String,
    /// Direction of the topic.
    pub direction: RouteDirection,
    /// Quality of service on both sides.
    pub qos: Qos,
}

/// Everything that is forwarded.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct BridgePlan {
    /// The topics to forward.
    pub routes: Vec<Route>,
    /// Nodes of the suite, fully qualified, whose parameter services the DDS graph can call.
    pub nodes: Vec<String>,
}

modulo_runtime::parameters! {
    /// The parameters of the bridge.
    pub struct BridgeParameters {
        /// Topics of the suite that the DDS graph gets, each as topic:type, such as /recovered:sensor_msgs/msg/Image.
        zenoh_to_dds: Vec<String> = Vec::new(); fixed,
        /// Topics of the DDS graph that the suite gets, each as topic:type.
        dds_to_zenoh: Vec<String> = Vec::new(); fixed,
        /// Nodes of the suite that appear on DDS under their own names with their parameters, such as /detector.
        parameters_of: Vec<String> = Vec::new(); fixed,
    }
}

impl BridgePlan {
    /// Returns the plan of a bridge `node_name`.
    /// An entry is refused that is no `topic:type`, has a type that the suite does not know, or would go both ways.
    pub fn new(parameters: &BridgeParameters, node_name: &NodeName) -> Result<Self, ParameterError> {
        let mut routes = Vec::new();
        let mut known: BTreeMap<String, &str> = BTreeMap::new();
        for (list, entries, direction) in [
            ("zenoh_to_dds", &parameters.zenoh_to_dds, RouteDirection::ZenohToDds),
            ("dds_to_zenoh", &parameters.dds_to_zenoh, RouteDirection::DdsToZenoh),
        ] {
            for entry in entries {
                let route = route(list, entry, direction, node_name)?;
                // Compared by their resolved names, since a remapping may send two entries to one topic.
                if let Some(other) = known.insert(route.topic.clone(), list) {
                    let why = if other == list {
                        "is there twice".to_owned()
                    } else {
                        format!("is in {other} too: a topic that goes both ways never ends")
                    };
                    return Err(ParameterError::new(list, entry, why));
                }
                routes.push(route);
            }
        }
        let resolve = |node: &String| {
            node_name.resolve(node).map_err(|why| ParameterError::new("parameters_of", node, why.to_string()))
        };
        let nodes = parameters.parameters_of.iter().map(resolve);
        Ok(Self { routes, nodes: nodes.collect::<Result<_, _>>()? })
    }
}

fn route(
    list: &str,
    entry: &str,
    direction: RouteDirection,
    node_name: &NodeName,
) -> Result<Route, ParameterError> {
    let refuse = |why: String| ParameterError::new(list, entry, why);
    let (topic, ros_type) = entry
        .split_once(':')
        .ok_or_else(|| refuse("must be topic:type, such as /recovered:sensor_msgs/msg/Image".to_owned()))?;
    let topic = node_name.resolve(topic.trim()).map_err(|why| refuse(why.to_string()))?;
    let ros_type = ros_type.trim();
    // Services have hashes as well, but a topic cannot carry them.
    let type_hash = rihs::type_hash(ros_type).filter(|_| ros_type.contains("/msg/")).ok_or_else(|| {
        let known = modulo_msgs::interface::names().filter(|name| name.contains("/msg/"));
        refuse(format!("the type is unknown, known are {}", known.collect::<Vec<_>>().join(", ")))
    })?;
    // The QoS of the suite's own topics of that type.
    let qos = MessageKind::from_type_name(ros_type).map_or(Qos::Results, Qos::usual);
    Ok(Route { topic, ros_type: ros_type.to_owned(), type_hash, direction, qos })
}

impl Route {
    /// Returns the endpoint on the suite's side.
    pub fn endpoint(&self) -> Endpoint {
        Endpoint {
            topic: self.topic.clone(),
            dds_type: dds_name(&self.ros_type),
            type_hash: self.type_hash.clone(),
            qos: keys::qos_string(self.qos).to_owned(),
        }
    }
}
