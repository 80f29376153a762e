//! `rosbag2_interfaces`: the services that control a running player, as in ROS 2 Jazzy.

use crate::builtin::Time;
use crate::interface::messages;

messages! {
    PauseRequest = "rosbag2_interfaces/srv/Pause_Request"
    PauseResponse = "rosbag2_interfaces/srv/Pause_Response"
    ResumeRequest = "rosbag2_interfaces/srv/Resume_Request"
    ResumeResponse = "rosbag2_interfaces/srv/Resume_Response"
    TogglePausedRequest = "rosbag2_interfaces/srv/TogglePaused_Request"
    TogglePausedResponse = "rosbag2_interfaces/srv/TogglePaused_Response"
    IsPausedRequest = "rosbag2_interfaces/srv/IsPaused_Request"
    IsPausedResponse = "rosbag2_interfaces/srv/IsPaused_Response" {
        /// Whether the player is paused.
        paused: bool,
    }
    SetRateRequest = "rosbag2_interfaces/srv/SetRate_Request" {
        /// Speed, finite and above 0; 2 is twice as fast as the recording.
        rate: f64,
    }
    SetRateResponse = "rosbag2_interfaces/srv/SetRate_Response" {
        /// Whether the rate is possible.
        success: bool,
    }
    GetRateRequest = "rosbag2_interfaces/srv/GetRate_Request"
    GetRateResponse = "rosbag2_interfaces/srv/GetRate_Response" {
        /// Speed; 2 is twice as fast as the recording.
        rate: f64,
    }
    PlayNextRequest = "rosbag2_interfaces/srv/PlayNext_Request"
    PlayNextResponse = "rosbag2_interfaces/srv/PlayNext_Response" {
        /// Whether a message was played, which is only possible while the player is paused.
        success: bool,
    }
    BurstRequest = "rosbag2_interfaces/srv/Burst_Request" {
        /// Number of messages to play at once; 0 plays all remaining messages.
        num_messages: u64,
    }
    BurstResponse = "rosbag2_interfaces/srv/Burst_Response" {
        /// Number of messages that were played; 0 when the player is not paused.
        actually_burst: u64,
    }
    SeekRequest = "rosbag2_interfaces/srv/Seek_Request" {
        /// Time in the bag at which the player continues.
        time: Time,
    }
    SeekResponse = "rosbag2_interfaces/srv/Seek_Response" {
        /// Whether the bag contains that time.
        success: bool,
    }
}
