//! Everything that the ROS graph sees of a node beside its topics: its services, `/diagnostics`, `/rosout`, `/clock`,
//! the level of its log and the descriptions of its types; and the graph itself, with the endpoints that do not fit together.

pub mod diagnostics;
pub mod discovery;
pub mod logger;
pub mod node_time;
pub mod rosout;
pub mod type_description;

pub use discovery::Graph;

use std::ops::RangeInclusive;

use modulo_runtime::name::{NameError, NodeName};
use modulo_runtime::parameter::typed::Rule;
use modulo_runtime::topic::{Durability, Profile, Reliability};
use modulo_runtime::wire::keys::qos_string;
use modulo_runtime::{Address, Allowed, Descriptor, Parameters, Topic, Value};

/// Words of the policies in parameters.
const RELIABILITIES: [(&str, Reliability); 2] =
    [("reliable", Reliability::Reliable), ("best_effort", Reliability::BestEffort)];
const DURABILITIES: [(&str, Durability); 2] =
    [("volatile", Durability::Volatile), ("transient_local", Durability::TransientLocal)];

const DEPTHS: RangeInclusive<usize> = 1..=10_000;

/// Returns the name of the parameter for a policy of the publishers of `topic`, as `rclcpp` has it.
fn override_name(topic: &str, policy: &str) -> String {
    format!("qos_overrides.{topic}.publisher.{policy}")
}

/// Declares the parameters with which a user overrides the quality of service of `outputs`, the topics that `node`
/// publishes: the policies that the transport honours. It never keeps all samples, so that `history` has one value.
///
/// # Errors
/// [`NameError`] when a topic has no valid name.
pub fn qos_overrides(node: &NodeName, outputs: &[Topic]) -> Result<Vec<Descriptor>, NameError> {
    let mut declared = Vec::new();
    for topic in outputs {
        let address = Address::resolve(node, topic)?;
        let Profile { reliability, durability, depth } = Profile::parse(qos_string(address.qos));
        for (policy, default, allowed) in [
            ("depth", DEPTHS.value(&depth), Rule::<usize>::allowed(&DEPTHS)),
            ("durability", DURABILITIES.value(&durability), DURABILITIES.allowed()),
            ("history", Value::String("keep_last".to_owned()), Allowed::Words(vec!["keep_last"])),
            ("reliability", RELIABILITIES.value(&reliability), RELIABILITIES.allowed()),
        ] {
            // A process declares a few of these names once, and a name lives as long as the process.
            let name = override_name(&address.topic, policy).leak();
            let description = "Quality of service of the publishers of this topic.";
            declared.push(Descriptor { name, default, allowed, read_only: true, description });
        }
    }
    Ok(declared)
}

/// Returns the profile that [`qos_overrides`] give the publishers of `topic`; `None` where they are not declared.
pub fn overridden(topic: &str, parameters: &Parameters) -> Option<Profile> {
    let value = |policy| parameters.get(&override_name(topic, policy));
    Some(Profile {
        reliability: RELIABILITIES.field(value("reliability")?)?,
        durability: DURABILITIES.field(value("durability")?)?,
        depth: DEPTHS.field(value("depth")?)?,
    })
}

/// Declares the services of a node: each variant is a ROS type in `package`, with a name below that of the node.
///
/// ```
/// modulo_middleware::services! {
///     /// The services of a lamp.
///     pub enum LampService in "std_srvs" {
///         SetBool = "set_light",
///     }
/// }
/// assert_eq!(LampService::SetBool.name_and_type(), ("set_light", "std_srvs/srv/SetBool"));
/// ```
#[macro_export]
macro_rules! services {
    ($(#[$about:meta])* pub enum $services:ident in $package:literal { $($type:ident = $name:literal,)+ }) => {
        $(#[$about])*
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        pub enum $services {
            $(#[doc = concat!("`~/", $name, "`")] $type,)+
        }

        impl $services {
            /// All services, in the order of their declaration.
            pub const ALL: &[Self] = &[$(Self::$type),+];

            /// Returns the name of the service below the name of its node, and its ROS type.
            pub fn name_and_type(self) -> (&'static str, &'static str) {
                match self { $(Self::$type => ($name, concat!($package, "/srv/", stringify!($type)))),+ }
            }
        }
    };
}
