//! The plan of the bridge to ROS 2 on DDS: the crate of the bridge builds only where a ROS 2 is sourced, but its plan anywhere.

use std::collections::BTreeSet;

use modulo_runtime::{NodeName, Qos};
use proptest::prelude::*;

use plan::{BridgeParameters, BridgePlan, RouteDirection};

#[path = "../../nodes/ros2_bridge/src/plan.rs"]
mod plan;

const IMAGE: &str = "sensor_msgs/msg/Image";

fn plan(outward: &[&str], inward: &[&str], nodes: &[&str]) -> Result<BridgePlan, String> {
    let list = |items: &[&str]| items.iter().map(|item| (*item).to_owned()).collect();
    let parameters = BridgeParameters {
        zenoh_to_dds: list(outward),
        dds_to_zenoh: list(inward),
        parameters_of: list(nodes),
    };
    let node_name = NodeName::new("ros2_bridge", "/car", &[("old".into(), "/new".into())]).expect("valid");
    BridgePlan::new(&parameters, &node_name).map_err(|why| why.to_string())
}

#[test]
fn topics_have_one_direction_and_the_quality_of_their_type() {
    let out = format!("recovered:{IMAGE}");
    let plan =
        plan(&[&out], &["/tf_is_not:rosgraph_msgs/msg/Clock", "old:std_msgs/msg/String"], &["/detector"])
            .expect("valid");
    let found: Vec<_> = plan.routes.iter().map(|r| (r.topic.as_str(), r.direction, r.qos)).collect();
    let expected = [
        ("/car/recovered", RouteDirection::ZenohToDds, Qos::Images),
        ("/tf_is_not", RouteDirection::DdsToZenoh, Qos::Clock),
        ("/new", RouteDirection::DdsToZenoh, Qos::Results),
    ];
    assert_eq!(found, expected);
    assert_eq!(plan.nodes, ["/detector"]);
    let endpoint = plan.routes[0].endpoint();
    assert_eq!(endpoint.dds_type, "sensor_msgs::msg::dds_::Image_");
    assert!(endpoint.type_hash.starts_with("RIHS01_"), "{endpoint:?}");
}

#[test]
fn refusals_name_the_entry_and_the_remedy() {
    for (outward, inward, why) in [
        (&["/a"][..], &[][..], "'zenoh_to_dds' = /a: must be topic:type"),
        (&["/a:b/msg/C"], &[], "the type is unknown, known are "),
        (&["/a:std_srvs/srv/SetBool"], &[], "the type is unknown"),
        (&["a b:std_msgs/msg/String"], &[], "is not a ROS name"),
        (&["/a:std_msgs/msg/String", "/a:std_msgs/msg/String"], &[], "is there twice"),
        (&["/a:std_msgs/msg/String"], &["/a:std_msgs/msg/String"], "is in zenoh_to_dds too"),
        (&["/new:std_msgs/msg/String"], &["old:std_msgs/msg/String"], "is in zenoh_to_dds too"),
    ] {
        let error = plan(outward, inward, &[]).expect_err(why);
        assert!(error.contains(why), "{error}");
    }
    assert!(plan(&[], &[], &["1st"]).is_err());
}

proptest! {
    /// On no side does the bridge read what it publishes there.
    #[test]
    fn nothing_goes_round(outward in topics(), inward in topics()) {
        let entries = |topics: Vec<String>| topics.iter().map(|t| format!("{t}:{IMAGE}")).collect::<Vec<_>>();
        let (outward, inward) = (entries(outward), entries(inward));
        let outward: Vec<&str> = outward.iter().map(String::as_str).collect();
        let inward: Vec<&str> = inward.iter().map(String::as_str).collect();
        if let Ok(plan) = plan(&outward, &inward, &[]) {
            let topics: BTreeSet<_> = plan.routes.iter().map(|route| &route.topic).collect();
            prop_assert_eq!(topics.len(), outward.len() + inward.len());
        }
    }
}

fn topics() -> impl Strategy<Value = Vec<String>> {
    prop::collection::vec("(/car/)?(a|b|old)|/new|~/a", 0..3)
}
