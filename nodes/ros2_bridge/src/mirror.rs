//! [`Mirror`]: a node in the DDS graph, which carries the topics and parameter services of one node of the suite. Each call of
//! a service is passed on and its answer passed back.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::thread;
use std::time::Duration;

use anyhow::Context as _;
use futures::StreamExt as _;
use futures::executor::block_on;
use modulo_middleware::parameter::service::Service;
use modulo_middleware::transport::zenoh::ZenohTransport;
use modulo_msgs::cdr;
use modulo_runtime::wire::keys::EntityKind;
use modulo_runtime::{NodeName, Stop, Urgency};
use r2r::rcl_interfaces::msg::SetParametersResult;
use r2r::rcl_interfaces::srv;
use r2r::{QosProfile, ServiceRequest, WrappedServiceTypeSupport};

use crate::plan::{BridgePlan, Route, RouteDirection};
use crate::topics;
use crate::topics::Forwarding;

/// Time between two looks at the graph of the suite, and the longest wait for a message of the DDS graph.
const GLANCE: Duration = Duration::from_millis(50);

/// A node of the DDS graph: the mirror of a node of the suite, or the node of the bridge itself.
pub struct Mirror<'a> {
    /// Fully qualified name of the node of the suite; `None` for the bridge's own node.
    suite_node: Option<&'a str>,
    /// Name on the DDS side.
    name: NodeName,
    plan: &'a BridgePlan,
    bridge: &'a NodeName,
    transport: &'a Arc<ZenohTransport>,
    dds: &'a r2r::Context,
}

impl<'a> Mirror<'a> {
    /// Prepares the mirror of `suite_node`, or with `None` the bridge's own node; nothing is created yet.
    pub fn new(
        suite_node: Option<&'a str>,
        plan: &'a BridgePlan,
        bridge: &'a NodeName,
        transport: &'a Arc<ZenohTransport>,
        dds: &'a r2r::Context,
    ) -> anyhow::Result<Self> {
        let name = match suite_node {
            None => bridge.clone(),
            Some(full) => {
                let (namespace, name) =
                    full.rsplit_once('/').with_context(|| format!("{full} is not absolute"))?;
                NodeName::new(name, if namespace.is_empty() { "/" } else { namespace }, &[])?
            }
        };
        Ok(Self { suite_node, name, plan, bridge, transport, dds })
    }

    /// Keeps the node in the DDS graph while the node of the suite is alive, until `stop`.
    pub fn run(&self, stop: &Stop) -> anyhow::Result<()> {
        while stop.urgency() == Urgency::None {
            if self.is_alive() { self.live(stop)? } else { thread::sleep(GLANCE) }
        }
        Ok(())
    }

    fn is_alive(&self) -> bool {
        self.suite_node.is_none_or(|node| self.transport.graph().has_node(node))
    }

    /// One life: from the appearance of the node of the suite to its end.
    fn live(&self, stop: &Stop) -> anyhow::Result<()> {
        let name = self.name.fully_qualified();
        let mut node = r2r::Node::create(self.dds.clone(), &self.name.name, &self.name.namespace)
            .with_context(|| format!("node {name} on DDS"))?;
        if let Some(suite_node) = self.suite_node {
            offer_parameters(suite_node, self.transport, &mut node)?;
        }
        tracing::info!("{name} is on DDS");
        // The guards go before the node does, so that no thread publishes on a node that is gone.
        let mut open: BTreeMap<&str, Forwarding> = BTreeMap::new();
        while stop.urgency() == Urgency::None && self.is_alive() {
            for route in &self.plan.routes {
                if !open.contains_key(route.topic.as_str()) && self.carries(route, &node)? {
                    let forwarding =
                        topics::forward(route, self.bridge, self.transport, &mut node, self.owner())?;
                    tracing::info!("{} [{}] on {name}: {:?}", route.topic, route.ros_type, route.direction);
                    open.insert(&route.topic, forwarding);
                }
            }
            node.spin_once(GLANCE);
        }
        drop(open);
        tracing::info!("{name} is no longer on DDS");
        Ok(())
    }

    /// Whether `route` has a publisher now and belongs to this node: a topic of the suite to the node that publishes it
    /// if that is mirrored, every other one to the bridge's own node.
    fn carries(&self, route: &Route, node: &r2r::Node) -> anyhow::Result<bool> {
        if route.direction == RouteDirection::DdsToZenoh {
            return Ok(self.suite_node.is_none()
                && !node.get_publishers_info_by_topic(&route.topic, false)?.is_empty());
        }
        let graph = self.transport.graph();
        let mut publishers =
            graph.endpoints(EntityKind::Publisher, &route.topic).map(|token| token.node_name());
        let belongs = self.owner();
        Ok(publishers.any(|publisher| belongs(&publisher)))
    }

    /// Tells whether what a node of the suite publishes belongs to this node of the DDS graph.
    fn owner(&self) -> impl Fn(&str) -> bool + Send + Sync + 'static {
        let (own, mirrored) = (self.suite_node.map(str::to_owned), self.plan.nodes.clone());
        move |publisher| match &own {
            Some(own) => publisher == own,
            None => !mirrored.iter().any(|node| node == publisher),
        }
    }
}

/// A node answers between two frames; `ros2 param` waits longer than this.
const PATIENCE: Duration = Duration::from_secs(10);

/// Offers the six services of `suite_node` to the DDS graph.
fn offer_parameters(
    suite_node: &str,
    transport: &Arc<ZenohTransport>,
    node: &mut r2r::Node,
) -> anyhow::Result<()> {
    for &service in Service::ALL {
        let target = Target { service, suite_node, transport };
        match service {
            // These answers have no field for a reason: without the node there is nothing to tell.
            Service::DescribeParameters => {
                target.pass::<srv::DescribeParameters::Service>(node, |_, _| Default::default())
            }
            Service::GetParameterTypes => {
                target.pass::<srv::GetParameterTypes::Service>(node, |_, _| Default::default())
            }
            Service::GetParameters => {
                target.pass::<srv::GetParameters::Service>(node, |_, _| Default::default())
            }
            Service::ListParameters => {
                target.pass::<srv::ListParameters::Service>(node, |_, _| Default::default())
            }
            Service::SetParameters => target.pass::<srv::SetParameters::Service>(node, |request, reason| {
                let results = request.parameters.iter().map(|_| refusal(reason)).collect();
                srv::SetParameters::Response { results }
            }),
            Service::SetParametersAtomically => target
                .pass::<srv::SetParametersAtomically::Service>(node, |_, reason| {
                    srv::SetParametersAtomically::Response { result: refusal(reason) }
                }),
        }?;
    }
    Ok(())
}

fn refusal(reason: &str) -> SetParametersResult {
    SetParametersResult { successful: false, reason: reason.to_owned() }
}

struct Target<'a> {
    service: Service,
    suite_node: &'a str,
    transport: &'a Arc<ZenohTransport>,
}

impl Target<'_> {
    /// Passes the calls of this service on; `refuse` makes the answer when the node of the suite gives none.
    fn pass<S: WrappedServiceTypeSupport + 'static>(
        self,
        node: &mut r2r::Node,
        refuse: fn(&S::Request, &str) -> S::Response,
    ) -> anyhow::Result<()> {
        let (name, ros_type) = self.service.name_and_type();
        let name = format!("{}/{name}", self.suite_node);
        let requests = node
            .create_service::<S>(&name, QosProfile::services_default())
            .with_context(|| format!("service {name} on DDS"))?;
        let transport = self.transport.clone();
        // A thread a service: a call waits for the frame at hand.
        thread::spawn(move || {
            block_on(requests.for_each(|request: ServiceRequest<S>| {
                let answer = call::<S>(&transport, &name, ros_type, &request.message).unwrap_or_else(|why| {
                    tracing::warn!("{name}: {why:#}");
                    refuse(&request.message, &format!("{why:#}"))
                });
                if let Err(why) = request.respond(answer) {
                    tracing::warn!("{name}: the caller gets no answer: {why}");
                }
                futures::future::ready(())
            }));
        });
        Ok(())
    }
}

/// r2r's structs have the fields of ROS 2 in order, so our CDR reads and writes them.
fn call<S: WrappedServiceTypeSupport>(
    transport: &ZenohTransport,
    name: &str,
    ros_type: &str,
    request: &S::Request,
) -> anyhow::Result<S::Response> {
    let answer = transport.call(name, ros_type, cdr::to_vec(request)?, PATIENCE)?;
    Ok(cdr::from_slice(&answer)?)
}
