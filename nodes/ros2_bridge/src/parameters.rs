//! The parameter services of a node of the suite, offered to the DDS graph under the same names. Each call is passed on
//! and its answer passed back.

use std::sync::Arc;
use std::thread;
use std::time::Duration;

use anyhow::Context as _;
use futures::StreamExt as _;
use futures::executor::block_on;
use modulo_msgs::cdr;
use modulo_runtime::parameter::service::Service;
use modulo_runtime::transport::zenoh::ZenohTransport;
use r2r::rcl_interfaces::{msg::SetParametersResult, srv};
use r2r::{QosProfile, ServiceRequest, WrappedServiceTypeSupport};

/// A node answers between two frames; `ros2 param` waits longer than this.
const PATIENCE: Duration = Duration::from_secs(10);

/// Offers the six services of `suite_node` to the DDS graph.
///
/// # Errors
/// When the DDS side refuses a service.
pub fn offer(suite_node: &str, transport: &Arc<ZenohTransport>, node: &mut r2r::Node) -> anyhow::Result<()> {
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

/// A service of a node of the suite.
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
