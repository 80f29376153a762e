//! Speaks with the shipped binary as a ROS 2 of other authors: hiroz, with its own
//! graph, definitions, hashes and CDR, and nothing of this project. They meet at a
//! router, as nodes of rmw_zenoh do: such nodes do not gossip among themselves.
//!
//!     cd tests/peers/hiroz && cargo run --locked -- ../../../target/debug/modulo
//!
//! Fails when hiroz does not find, understand or reach something of ours.

use std::path::Path;
use std::process::{Child, Command};
use std::sync::Arc;
use std::time::{Duration, Instant};

use hiroz::config::RouterConfigBuilder;
use hiroz::context::ZContextBuilder;
use hiroz::entity::{EndpointKind, Entity};
use hiroz::node::ZNode;
use hiroz::parameter::{Parameter, ParameterClient, ParameterTarget, ParameterValue};
use hiroz::qos::{QosHistory, QosProfile, QosReliability};
use hiroz::{Builder as _, Result};
use hiroz_msgs::builtin_interfaces::Time;
use hiroz_msgs::sensor_msgs::Image;
use hiroz_msgs::std_msgs::Header;
use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;
use tokio::time::timeout;
use zenoh_buffers::buffer::SplitBuffer as _;

const DOMAIN: usize = 138;
/// Not ROS 2's 7447, where somebody may be at work.
const ROUTER: &str = "tcp/127.0.0.1:17585";
const PATIENCE: Duration = Duration::from_secs(60);

/// A command of the shipped binary; ended with SIGINT.
struct Suite(Child);

impl Suite {
    fn start(binary: &Path, arguments: &[&str]) -> Result<Self> {
        let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../..");
        let mut command = Command::new(binary);
        command.args(arguments).current_dir(root).env("ROS_DOMAIN_ID", DOMAIN.to_string());
        command.env("ZENOH_CONFIG_OVERRIDE", format!("connect/endpoints=[\"{ROUTER}\"]"));
        Ok(Self(command.spawn()?))
    }

    async fn end(mut self) -> Result<()> {
        kill(Pid::from_raw(self.0.id().try_into()?), Signal::SIGINT)?;
        until("the end", || matches!(self.0.try_wait(), Ok(Some(_)))).await;
        let status = self.0.wait()?;
        assert!(matches!(status.code(), Some(0 | 3)), "{status}");
        Ok(())
    }
}

impl Drop for Suite {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

async fn until(what: &str, mut done: impl FnMut() -> bool) {
    let end = Instant::now() + PATIENCE;
    while !done() {
        assert!(Instant::now() < end, "waited in vain: {what}");
        tokio::time::sleep(Duration::from_millis(100)).await;
    }
}

/// A node as hiroz configures it.
fn node() -> Result<Arc<ZNode>> {
    let context = ZContextBuilder::default().with_domain_id(DOMAIN).with_router_endpoint(ROUTER)?.build()?;
    Ok(Arc::new(context.create_node("hiroz_peer").build()?))
}

fn sensor_data() -> QosProfile {
    QosProfile {
        reliability: QosReliability::BestEffort,
        history: QosHistory::from_depth(5),
        ..QosProfile::default()
    }
}

/// Whether our node `name` has an endpoint of this kind on `topic`, with the type
/// and the hash that hiroz computes for `T`.
fn has<T: hiroz::MessageTypeInfo>(node: &ZNode, kind: EndpointKind, topic: &str, name: &str) -> bool {
    let expected = T::type_info();
    node.graph().get_entities_by_topic(kind, topic).iter().any(|entity| match entity.as_ref() {
        Entity::Endpoint(end) if end.node.as_ref().is_some_and(|n| n.name == name) => {
            assert_eq!(end.type_info.as_ref(), Some(&expected), "{topic}");
            true
        }
        _ => false,
    })
}

/// Our nodes, images and boxes arrive; the detector's parameters are read and set.
async fn receives_and_sets(binary: &Path) -> Result<()> {
    let scene = "source:=scene://glare?seed=3&frames=100000";
    let arguments = ["launch", "launch/recovered.launch.yaml", scene, "rate:=4", "engine:=rten"];
    let suite = Suite::start(binary, &arguments)?;
    let node = node()?;
    for name in ["modulo_camera", "unwrap", "detector"] {
        until(name, || node.graph().get_node_names().iter().any(|(n, space)| n == name && space == "/"))
            .await;
    }
    until("/recovered", || has::<Image>(&node, EndpointKind::Publisher, "/recovered", "unwrap")).await;

    let images = node.create_sub::<Image>("/recovered").with_qos(sensor_data()).build()?;
    let image = timeout(PATIENCE, images.async_recv()).await??;
    assert_eq!((image.encoding.as_str(), image.step), ("rgb8", 3 * image.width));
    assert_eq!(image.data.contiguous().len(), (image.height * image.step) as usize);
    println!("received {} x {} {}", image.width, image.height, image.encoding);

    // hiroz knows no vision_msgs: it asks our node what the type looks like.
    let boxes = node.create_dyn_sub_auto("/detector/detections", PATIENCE).await?;
    let found = loop {
        let message = timeout(PATIENCE, boxes.async_recv()).await??;
        let detections = message.get_dynamic("detections")?;
        if let Some([first, ..]) = detections.as_array() {
            break first.as_message().expect("a message").clone();
        }
    };
    let results = found.get_dynamic("results")?;
    let best = results.as_array().expect("a list")[0].as_message().expect("a message").clone();
    let (class, score): (String, f64) = (best.get("hypothesis.class_id")?, best.get("hypothesis.score")?);
    let width: f64 = found.get("bbox.size_x")?;
    assert!(!class.is_empty() && 0.0 < score && score <= 1.0 && width > 0.0, "{class} {score} {width}");
    println!("received boxes of {}: {class} {score:.3}", boxes.schema().expect("discovered").type_name);

    let detector = ParameterTarget::from_fqn("/detector").expect("a name");
    let parameters = ParameterClient::new(node.clone(), detector)?;
    let text = |value: &str| ParameterValue::String(value.to_owned());
    assert_eq!(parameters.get(&["input"]).await?, [text("recovered")]);
    let described = parameters.describe(&["score_threshold"]).await?;
    let range = described[0].floating_point_range.as_ref().expect("a range");
    assert_eq!((range.from_value, range.to_value), (0.0, 1.0));
    assert!(!has::<Image>(&node, EndpointKind::Subscription, "/modulo", "detector"));
    let answer = parameters.set(&[Parameter::new("input", text("modulo"))]).await?;
    assert!(answer[0].successful, "{answer:?}");
    until("the switch", || has::<Image>(&node, EndpointKind::Subscription, "/modulo", "detector")).await;
    let answer = parameters.set_atomically(&[Parameter::new("input", text("sideways"))]).await?;
    assert!(!answer.successful && answer.reason.contains("sideways"), "{answer:?}");
    assert_eq!(parameters.get(&["input"]).await?, [text("modulo")]);
    println!("set, refused: {}", answer.reason);
    suite.end().await
}

/// An image of hiroz' on the modulo topic is recovered exactly.
async fn is_received(binary: &Path) -> Result<()> {
    let suite = Suite::start(binary, &["run", "unwrap"])?;
    let node = node()?;
    let recovered = node.create_sub::<Image>("/hdr").with_qos(sensor_data()).build()?;
    let publisher = node.create_pub::<Image>("/modulo").with_qos(sensor_data()).build()?;
    until("the reader", || has::<Image>(&node, EndpointKind::Subscription, "/modulo", "unwrap")).await;
    until("the writer", || has::<Image>(&node, EndpointKind::Publisher, "/hdr", "unwrap")).await;
    tokio::time::sleep(Duration::from_secs(1)).await;

    let (width, height) = (320_u32, 96_u32);
    let ramp: Vec<u16> = (0..height * width).map(|i| (i / width + 2 * (i % width)) as u16).collect();
    publisher.publish(&Image {
        header: Header { stamp: Time { sec: 5, nanosec: 7 }, frame_id: "hiroz".to_owned() },
        height,
        width,
        encoding: "mono8".to_owned(),
        is_bigendian: 0,
        step: width,
        data: ramp.iter().map(|count| (count % 256) as u8).collect::<Vec<_>>().into(),
    })?;
    let image = timeout(PATIENCE, recovered.async_recv()).await??;
    assert_eq!((image.header.stamp.sec, image.header.stamp.nanosec), (5, 7));
    assert_eq!((image.header.frame_id.as_str(), image.encoding.as_str()), ("hiroz", "mono16"));
    let data = image.data.contiguous();
    let counts: Vec<u16> = data.chunks_exact(2).map(|b| u16::from_le_bytes([b[0], b[1]])).collect();
    // The image is known but for one offset of whole wraps.
    let offset = counts[0].wrapping_sub(ramp[0]);
    assert!(
        offset % 256 == 0 && counts.iter().zip(&ramp).all(|(c, r)| c.wrapping_sub(*r) == offset),
        "the ramp"
    );
    println!(
        "recovered a ramp of {} from 8 bits, without an error in {} samples",
        ramp[ramp.len() - 1],
        ramp.len()
    );
    suite.end().await
}

#[tokio::main]
async fn main() -> Result<()> {
    let binary = std::env::args().nth(1).expect("the binary: hiroz_peer target/debug/modulo");
    let binary = Path::new(&binary).canonicalize()?;
    let router = RouterConfigBuilder::new().with_listen_endpoint(ROUTER).build_config()?;
    let _router = zenoh::open(router).await?;
    receives_and_sets(&binary).await?;
    is_received(&binary).await?;
    println!("as hiroz has it");
    Ok(())
}
