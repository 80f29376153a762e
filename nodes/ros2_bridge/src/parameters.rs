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
use r2r::rcl_interfaces::srv;
use r2r::{QosProfile, ServiceRequest, WrappedServiceTypeSupport};

/// A node answers between two frames; `ros2 param` waits longer than this.
const PATIENCE: Duration = Duration::from_secs(10);

/// Offers the six services of `suite_node` to the DDS graph.
pub fn offer(suite_node: &str, transport: &Arc<ZenohTransport>, node: &mut r2r::Node) -> anyhow::Result<()> {
    for &service in Service::ALL {
        match service {
            Service::DescribeParameters => {
                pass::<srv::DescribeParameters::Service>(service, suite_node, transport, node)
            }
            Service::GetParameterTypes => {
                pass::<srv::GetParameterTypes::Service>(service, suite_node, transport, node)
            }
            Service::GetParameters => {
                pass::<srv::GetParameters::Service>(service, suite_node, transport, node)
            }
            Service::ListParameters => {
                pass::<srv::ListParameters::Service>(service, suite_node, transport, node)
            }
            Service::SetParameters => {
                pass::<srv::SetParameters::Service>(service, suite_node, transport, node)
            }
            Service::SetParametersAtomically => {
                pass::<srv::SetParametersAtomically::Service>(service, suite_node, transport, node)
            }
        }?;
    }
    Ok(())
}

fn pass<S: WrappedServiceTypeSupport + 'static>(
    service: Service,
    suite_node: &str,
    transport: &Arc<ZenohTransport>,
    node: &mut r2r::Node,
) -> anyhow::Result<()> {
    let (name, ros_type) = service.name_and_type();
    let name = format!("{suite_node}/{name}");
    let requests = node
        .create_service::<S>(&name, QosProfile::services_default())
        .with_context(|| format!("service {name}"))?;
    let transport = transport.clone();
    // A thread a service: a call waits for the frame at hand.
    thread::spawn(move || {
        block_on(requests.for_each(|request: ServiceRequest<S>| {
            let answer = call::<S>(&transport, &name, ros_type, &request.message);
            // Without an answer the caller waits in vain, as it would for a node that is not there.
            if let Err(why) = answer.and_then(|answer| Ok(request.respond(answer)?)) {
                tracing::warn!("{name}: {why:#}");
            }
            futures::future::ready(())
        }));
    });
    Ok(())
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
