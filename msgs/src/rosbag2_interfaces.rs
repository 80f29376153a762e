//! `rosbag2_interfaces`: how a player is driven while it plays, as in ROS 2 Jazzy.

use serde::{Deserialize, Serialize};

use crate::builtin::Time;
use crate::interface::interfaces;

/// `rosbag2_interfaces/srv/Pause_Request`
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct PauseRequest;

/// `rosbag2_interfaces/srv/Pause_Response`
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct PauseResponse;

/// `rosbag2_interfaces/srv/Resume_Request`
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct ResumeRequest;

/// `rosbag2_interfaces/srv/Resume_Response`
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct ResumeResponse;

/// `rosbag2_interfaces/srv/TogglePaused_Request`
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct TogglePausedRequest;

/// `rosbag2_interfaces/srv/TogglePaused_Response`
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct TogglePausedResponse;

/// `rosbag2_interfaces/srv/IsPaused_Request`
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct IsPausedRequest;

/// `rosbag2_interfaces/srv/IsPaused_Response`
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct IsPausedResponse {
    /// Whether the replay stands still.
    pub paused: bool,
}

/// `rosbag2_interfaces/srv/SetRate_Request`
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct SetRateRequest {
    /// Speed: 2 is twice as fast; finite and above 0.
    pub rate: f64,
}

/// `rosbag2_interfaces/srv/SetRate_Response`
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct SetRateResponse {
    /// Whether the rate is a possible one.
    pub success: bool,
}

/// `rosbag2_interfaces/srv/GetRate_Request`
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct GetRateRequest;

/// `rosbag2_interfaces/srv/GetRate_Response`
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct GetRateResponse {
    /// Speed.
    pub rate: f64,
}

/// `rosbag2_interfaces/srv/PlayNext_Request`
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct PlayNextRequest;

/// `rosbag2_interfaces/srv/PlayNext_Response`
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct PlayNextResponse {
    /// Whether a message was played: only while paused.
    pub success: bool,
}

/// `rosbag2_interfaces/srv/Burst_Request`
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct BurstRequest {
    /// How many messages to play at once; 0: all that are left.
    pub num_messages: u64,
}

/// `rosbag2_interfaces/srv/Burst_Response`
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct BurstResponse {
    /// How many messages were played: none unless paused.
    pub actually_burst: u64,
}

/// `rosbag2_interfaces/srv/Seek_Request`
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct SeekRequest {
    /// Where in the bag to go on.
    pub time: Time,
}

/// `rosbag2_interfaces/srv/Seek_Response`
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct SeekResponse {
    /// Whether the bag has that time.
    pub success: bool,
}

interfaces! {
    PauseRequest = "rosbag2_interfaces/srv/Pause_Request",
    PauseResponse = "rosbag2_interfaces/srv/Pause_Response",
    ResumeRequest = "rosbag2_interfaces/srv/Resume_Request",
    ResumeResponse = "rosbag2_interfaces/srv/Resume_Response",
    TogglePausedRequest = "rosbag2_interfaces/srv/TogglePaused_Request",
    TogglePausedResponse = "rosbag2_interfaces/srv/TogglePaused_Response",
    IsPausedRequest = "rosbag2_interfaces/srv/IsPaused_Request",
    IsPausedResponse = "rosbag2_interfaces/srv/IsPaused_Response",
    SetRateRequest = "rosbag2_interfaces/srv/SetRate_Request",
    SetRateResponse = "rosbag2_interfaces/srv/SetRate_Response",
    GetRateRequest = "rosbag2_interfaces/srv/GetRate_Request",
    GetRateResponse = "rosbag2_interfaces/srv/GetRate_Response",
    PlayNextRequest = "rosbag2_interfaces/srv/PlayNext_Request",
    PlayNextResponse = "rosbag2_interfaces/srv/PlayNext_Response",
    BurstRequest = "rosbag2_interfaces/srv/Burst_Request",
    BurstResponse = "rosbag2_interfaces/srv/Burst_Response",
    SeekRequest = "rosbag2_interfaces/srv/Seek_Request",
    SeekResponse = "rosbag2_interfaces/srv/Seek_Response",
}
