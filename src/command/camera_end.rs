//! `camera_end`: a process that ends when the camera of its namespace has sent its last frame, and not when it crashes. Launch
//! files give it `on_exit: shutdown`: `ros2 launch` cannot tell the two ends of a process apart.

use std::sync::mpsc::{RecvTimeoutError, channel};
use std::thread::sleep;
use std::time::Duration;

use modulo_middleware::graph::diagnostics::ENDED;
use modulo_middleware::transport::zenoh::ZenohTransport;
use modulo_middleware::transport::{Incoming, Transport as _};
use modulo_runtime::ros_args::RosArgs;
use modulo_runtime::{Address, Message, MessageKind, Qos, Topic, Urgency};

use super::{open_session, start_log, stop_on_signals, usage};
use crate::{Ended, Failure};

/// Name of the executable, and of the node.
pub const NAME: &str = "camera_end";
/// Topic of the camera's state, relative to the namespace.
const STATE: &str = "modulo_camera/state";
const GLANCE: Duration = Duration::from_millis(250);
/// Number of glances within which the camera must have left the graph. Together with [`LAST_BREATH`] it stays below the
/// `respawn_delay` of `launch/sensor.launch.yaml`.
const GLANCES: u32 = 2;
/// A process ends within this time after its node has left the graph.
const LAST_BREATH: Duration = Duration::from_millis(250);

/// Waits for the last frame of the camera, or for a request to end.
pub fn run(arguments: &[String]) -> Result<Ended, Failure> {
    let (ros, own) = RosArgs::parse(arguments).map_err(usage)?;
    if own.iter().any(|argument| argument == "--help" || argument == "-h") {
        say!("{NAME}: ends when the camera of its namespace has sent its last frame");
        return Ok(Ended::Done);
    }
    if let Some(argument) = own.first() {
        return Err(usage(anyhow::anyhow!("{NAME}: '{argument}' is unknown; it takes --ros-args only")));
    }
    let node_name = ros.node_name(NAME).map_err(usage)?;
    start_log("info");
    let stop = stop_on_signals()?;
    let (_clock, transport) = open_session()?;
    let state = Topic { qos: Qos::Latched, ..Topic::new(STATE, MessageKind::Diagnostics) };
    let address = Address::resolve(&node_name, &state).map_err(usage)?;
    let (states, arrived) = channel();
    let deliver = Box::new(move |incoming| drop(states.send(incoming)));
    let _subscription = transport.subscribe(&node_name, &address, deliver)?;
    let _announced = transport.announce(&node_name)?;
    while stop.urgency() == Urgency::None {
        match arrived.recv_timeout(GLANCE) {
            Ok(incoming) => {
                if tells_end(incoming) {
                    wait_for_departure(&transport, address.topic.trim_end_matches("/state"));
                    break;
                }
            }
            Err(RecvTimeoutError::Timeout) => {}
            Err(RecvTimeoutError::Disconnected) => break,
        }
    }
    Ok(Ended::Done)
}

/// Waits until the camera's process has ended by itself: a process that ends in the moment in which `ros2 launch` sends it a signal
/// is reported as crashed by Python 3.12 (cpython issue 87744).
fn wait_for_departure(transport: &ZenohTransport, camera: &str) {
    let mut glances = 0;
    while transport.is_ready(camera) && glances < GLANCES {
        sleep(GLANCE);
        glances += 1;
    }
    sleep(LAST_BREATH);
}

fn tells_end(incoming: Incoming) -> bool {
    let Ok(Message::Diagnostics(state)) = incoming.open(MessageKind::Diagnostics) else { return false };
    let mut values = state.status.iter().flat_map(|status| &status.values);
    values.any(|value| value.key == ENDED && value.value == "true")
}
