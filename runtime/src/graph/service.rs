//! [`services!`](crate::services): the services of a node as an enum.

/// Declares the services of a node: each variant has the name of its ROS type in `package`, and a name below the name
/// of the node.
///
/// ```
/// modulo_runtime::services! {
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
