//! [`Interface`]: what every message here is called in ROS.

/// A message with a ROS name.
pub trait Interface {
    /// Such as `sensor_msgs/msg/Image` or `std_srvs/srv/SetBool_Request`.
    const NAME: &'static str;
}

/// Names the messages of one ROS package.
macro_rules! interfaces {
    ($($message:ident = $name:literal),+ $(,)?) => {
        $(impl $crate::interface::Interface for $message {
            const NAME: &'static str = $name;
        })+
    };
}
pub(crate) use interfaces;
