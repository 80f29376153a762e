//! One node of hiroz: each command prints what it has found as JSON, for `tests/peers/hiroz.py`.

use std::sync::Arc;
use std::thread::sleep;
use std::time::{Duration, Instant};
use std::{env, fs};

use hiroz::attachment::Attachment;
use hiroz::context::{ZContext, ZContextBuilder};
use hiroz::entity::{EndpointKind, Entity};
use hiroz::msg::ZMessage as _;
use hiroz::node::ZNode;
use hiroz::parameter::{
    Parameter, ParameterClient, ParameterDescriptor, ParameterTarget, ParameterType, ParameterValue,
};
use hiroz::qos::{QosDurability, QosHistory, QosProfile, QosReliability};
use hiroz::{Builder as _, Result, ZBuf};
use hiroz_msgs::geometry_msgs::TwistStamped;
use hiroz_msgs::sensor_msgs::Image;
use serde_json::{Value, json};

const PATIENCE: Duration = Duration::from_secs(20);

fn main() -> Result<()> {
    let words: Vec<String> = env::args().skip(1).collect();
    let words: Vec<&str> = words.iter().map(String::as_str).collect();
    let context = context()?;
    let runtime = tokio::runtime::Builder::new_multi_thread().enable_all().build()?;
    let found = match words[..] {
        ["list"] => list(&context)?,
        ["receive", topic, count, idle] => receive(&context, topic, count.parse()?, idle.parse()?)?,
        ["send", topic, images, count, rate] => send(&context, topic, images, count.parse()?, rate.parse()?)?,
        ["talk"] => talk(&context)?,
        ["describe", topic] => runtime.block_on(describe(&context, topic))?,
        ["get", node, ref names @ ..] => runtime.block_on(get(&context, node, names))?,
        ["set", node, name, value] => runtime.block_on(set(&context, node, name, value))?,
        _ => return Err(format!("unknown command: {words:?}").into()),
    };
    println!("{found}");
    // What was sent last must leave.
    sleep(Duration::from_millis(300));
    context.shutdown()
}

/// A session that meets the nodes of the suite without a router: by the port of the domain, and by gossip among peers.
fn context() -> Result<ZContext> {
    let domain: usize = env::var("ROS_DOMAIN_ID")?.parse()?;
    ZContextBuilder::default()
        .with_mode("peer")
        .disable_multicast_scouting()
        .with_domain_id(domain)
        .with_connect_endpoints([format!("tcp/127.0.0.1:{}", 7450 + domain)])
        .with_listen_endpoints(["tcp/127.0.0.1:0"])
        .with_json(
            "scouting/gossip/target",
            json!({ "router": ["router", "peer"], "peer": ["router", "peer"] }),
        )
        .build()
}

fn sensor_data() -> QosProfile {
    let history = QosHistory::from_depth(300);
    QosProfile {
        reliability: QosReliability::BestEffort,
        durability: QosDurability::Volatile,
        history,
        ..Default::default()
    }
}

/// The graph with another node, after it has not changed for a second.
fn list(context: &ZContext) -> Result<Value> {
    let _node = context.create_node("hiroz_list").build()?;
    let (graph, mut before, mut calm, since) = (context.graph(), Value::Null, 0, Instant::now());
    while calm < 10 || (graph.get_node_names().len() < 2 && since.elapsed() < PATIENCE) {
        sleep(Duration::from_millis(100));
        let now = json!(graph.snapshot(0))["topics"].clone();
        calm = if now == before { calm + 1 } else { 0 };
        before = now;
    }
    let mut ends = Vec::new();
    for (topic, _) in graph.get_topic_names_and_types() {
        for kind in [EndpointKind::Publisher, EndpointKind::Subscription] {
            for entity in graph.get_entities_by_topic(kind, &topic) {
                let Entity::Endpoint(end) = &*entity else { continue };
                let (node, kind_of) = (end.node.as_ref().map(|node| &node.name), end.type_info.as_ref());
                let hash = kind_of.map(|kind_of| kind_of.hash.to_rihs_string());
                ends.push(json!([
                    topic,
                    format!("{kind:?}"),
                    node,
                    kind_of.map(|kind_of| &kind_of.name),
                    hash,
                    end.qos.encode()
                ]));
            }
        }
    }
    let mut found = json!(graph.snapshot(0));
    found["ends"] = ends.into();
    Ok(found)
}

/// Receives images until there are `count`, or none has come for `idle` seconds: of each image the sequence number, the stamp, what
/// describes it, and the last three bytes.
fn receive(context: &ZContext, topic: &str, count: usize, idle: u64) -> Result<Value> {
    let node = context.create_node("hiroz_receive").build()?;
    let reader = node.create_sub::<Image>(topic).with_qos(sensor_data()).build()?;
    let mut images = Vec::new();
    // The first one may take longer.
    while images.len() < count {
        let patience = if images.is_empty() { PATIENCE } else { Duration::from_secs(idle) };
        let Ok(sample) = reader.recv_serialized_timeout(patience) else { break };
        let bytes = sample.payload().to_bytes();
        let image = Image::deserialize(&bytes).map_err(|why| why.to_string())?;
        let number = Attachment::try_from(sample.attachment().ok_or("no attachment")?)?.sequence_number;
        let (stamp, frame) = (image.header.stamp.sec, image.header.frame_id);
        images.push(json!([
            number,
            stamp,
            frame,
            image.width,
            image.height,
            image.encoding,
            image.step,
            bytes[bytes.len() - 3..]
        ]));
    }
    Ok(images.into())
}

/// Sends each of the images in a file of JSON (encoding, width, height, step, data as hexadecimal digits) `count` times, with the
/// stamps 1, 2 and so on, from the moment on at which the topic has a reader.
fn send(context: &ZContext, topic: &str, file: &str, count: usize, rate: f64) -> Result<Value> {
    let images: Vec<(String, u32, u32, u32, String)> = serde_json::from_str(&fs::read_to_string(file)?)?;
    let node = context.create_node("hiroz_send").build()?;
    let publisher = node.create_pub::<Image>(topic).with_qos(sensor_data()).build()?;
    let since = Instant::now();
    while context.graph().count(EndpointKind::Subscription, topic) == 0 && since.elapsed() < PATIENCE {
        sleep(Duration::from_millis(20));
    }
    sleep(Duration::from_millis(500));
    for (sec, (encoding, width, height, step, digits)) in (1..).zip(&images) {
        let byte = |at: usize| u8::from_str_radix(&digits[at..at + 2], 16);
        let data: Vec<u8> = (0..digits.len()).step_by(2).map(byte).collect::<std::result::Result<_, _>>()?;
        for _ in 0..count {
            let (encoding, data) = (encoding.clone(), ZBuf::from(data.clone()));
            let mut image =
                Image { height: *height, width: *width, encoding, step: *step, data, ..Default::default() };
            image.header.stamp.sec = sec;
            image.header.frame_id = "hiroz".into();
            publisher.publish(&image)?;
            sleep(Duration::from_secs_f64(1.0 / rate));
        }
    }
    Ok(json!(images.len() * count))
}

/// A node with a topic of a type that the suite does not know, the description of that type, and parameters; for a minute.
fn talk(context: &ZContext) -> Result<Value> {
    let node =
        context.create_node("hiroz_talk").with_namespace("/far").with_type_description_service().build()?;
    let publisher = node.create_pub::<TwistStamped>("/cmd").build()?;
    for (name, value, kind) in [
        ("speed", ParameterValue::Double(0.5), ParameterType::Double),
        ("names", ParameterValue::StringArray(vec!["a".into()]), ParameterType::StringArray),
    ] {
        node.declare_parameter(name, value, ParameterDescriptor::new(name, kind))?;
    }
    let mut message = TwistStamped::default();
    message.twist.linear.x = 1.5;
    for _ in 0..600 {
        publisher.publish(&message)?;
        sleep(Duration::from_millis(100));
    }
    Ok(Value::Null)
}

/// The fields of a topic's type, as its publisher describes them.
async fn describe(context: &ZContext, topic: &str) -> Result<Value> {
    let node = context.create_node("hiroz_describe").build()?;
    sleep(Duration::from_secs(1));
    let found = node.discover_topic_schema(topic, PATIENCE).await?;
    let fields: Vec<_> = found.schema.fields.iter().map(|field| field.name.clone()).collect();
    Ok(json!({ "type": found.schema.type_name, "hash": found.type_hash, "fields": fields }))
}

async fn client(context: &ZContext, node: &str) -> Result<(Arc<ZNode>, ParameterClient)> {
    let own = Arc::new(context.create_node("hiroz_parameters").build()?);
    let target = ParameterTarget::from_fqn(node).ok_or("not a node name")?;
    let client = ParameterClient::new(own.clone(), target)?;
    sleep(Duration::from_secs(1));
    Ok((own, client))
}

async fn get(context: &ZContext, node: &str, names: &[&str]) -> Result<Value> {
    let (_own, client) = client(context, node).await?;
    let listed = client.list(&[] as &[&str], None).await?;
    let values = client.get(names).await?.iter().map(|value| format!("{value:?}")).collect::<Vec<_>>();
    let described = client.describe(names).await?.iter().map(|one| format!("{one:?}")).collect::<Vec<_>>();
    Ok(json!({ "listed": format!("{listed:?}"), "values": values, "described": described }))
}

/// Sets a parameter: to a double where the text is one, else to a string.
async fn set(context: &ZContext, node: &str, name: &str, text: &str) -> Result<Value> {
    let (_own, client) = client(context, node).await?;
    let value = text.parse().map_or_else(|_| ParameterValue::String(text.into()), ParameterValue::Double);
    let results = client.set(&[Parameter::new(name, value)]).await?;
    let results = results.iter().map(|result| json!([result.successful, result.reason]));
    Ok(results.collect())
}
