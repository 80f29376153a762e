//! The services of a player, as `rosbag2_player` has them: from a request's bytes to a [`PlayerAction`], from its
//! [`PlayerReply`] to a response's bytes.
//!
//! The replay itself carries an action out, between two messages.

use std::error::Error;
use std::sync::mpsc::{Sender, channel};

use modulo_msgs::cdr::{self, CdrError};
use modulo_msgs::rosbag2_interfaces::{
    BurstRequest, BurstResponse, GetRateResponse, IsPausedResponse, PauseResponse, PlayNextResponse,
    PlayResponse, ResumeResponse, SeekRequest, SeekResponse, SetRateRequest, SetRateResponse, StopResponse,
    TogglePausedResponse,
};

modulo_middleware::services! {
    /// The services of a player.
    pub enum Service in "rosbag2_interfaces" {
        Pause = "pause",
        Resume = "resume",
        TogglePaused = "toggle_paused",
        IsPaused = "is_paused",
        GetRate = "get_rate",
        SetRate = "set_rate",
        PlayNext = "play_next",
        Burst = "burst",
        Seek = "seek",
        Play = "play",
        Stop = "stop",
    }
}

/// A request to the replay.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum PlayerAction {
    /// Pause (`true`), or go on; `None`: the other of the two.
    Pause(Option<bool>),
    /// Only report the state.
    Tell,
    /// Change the speed.
    SetRate(f64),
    /// Play so many messages at once, while paused; `None`: all that are left.
    Step(Option<u64>),
    /// Go on at this log time, ns since the epoch.
    Seek(u64),
    /// End the replay.
    Stop,
}

/// The result of an action.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlayerReply {
    /// Whether it was possible.
    pub done: bool,
    /// Number of messages that were played at once.
    pub played: u64,
    /// Whether the replay is paused now.
    pub is_paused: bool,
    /// Current speed.
    pub rate: f64,
}

/// An action with the receiver of its reply.
#[derive(Debug)]
pub struct PlayerCommand {
    /// The requested action.
    pub action: PlayerAction,
    /// Receiver of the reply.
    pub answer: Sender<PlayerReply>,
}

impl Service {
    /// Hands `request` to the replay with `give`, which returns whether the replay took it, and waits for the answer.
    ///
    /// # Errors
    /// The reason when the request cannot be read, or the replay has ended.
    pub fn call(
        self,
        request: &[u8],
        give: &dyn Fn(PlayerCommand) -> bool,
    ) -> Result<Vec<u8>, Box<dyn Error>> {
        let (answer, answered) = channel();
        // Read before it is handed over, so that the replay never sees a broken request.
        let action = self.action(request)?;
        let reply = give(PlayerCommand { action, answer }).then(|| answered.recv().ok()).flatten();
        Ok(self.response(reply.ok_or("the replay has ended")?)?)
    }

    /// Returns the action that `request` asks for.
    ///
    /// # Errors
    /// [`CdrError`] when it cannot be read.
    pub fn action(self, request: &[u8]) -> Result<PlayerAction, CdrError> {
        Ok(match self {
            Self::Pause => PlayerAction::Pause(Some(true)),
            Self::Resume => PlayerAction::Pause(Some(false)),
            Self::TogglePaused => PlayerAction::Pause(None),
            // The node ends with its playback, so that a call of play always meets one that runs.
            Self::IsPaused | Self::GetRate | Self::Play => PlayerAction::Tell,
            Self::Stop => PlayerAction::Stop,
            Self::SetRate => PlayerAction::SetRate(cdr::from_slice::<SetRateRequest>(request)?.rate),
            Self::PlayNext => PlayerAction::Step(Some(1)),
            Self::Burst => {
                let number = cdr::from_slice::<BurstRequest>(request)?.num_messages;
                // 0 means all messages that are left, as in rosbag2.
                PlayerAction::Step((number > 0).then_some(number))
            }
            Self::Seek => PlayerAction::Seek(cdr::from_slice::<SeekRequest>(request)?.time.as_ns()),
        })
    }

    fn response(self, answer: PlayerReply) -> Result<Vec<u8>, CdrError> {
        let PlayerReply { done: success, played: actually_burst, is_paused, rate } = answer;
        match self {
            Self::Pause => cdr::to_vec(&PauseResponse::default()),
            Self::Resume => cdr::to_vec(&ResumeResponse::default()),
            Self::TogglePaused => cdr::to_vec(&TogglePausedResponse::default()),
            Self::IsPaused => cdr::to_vec(&IsPausedResponse { paused: is_paused }),
            Self::GetRate => cdr::to_vec(&GetRateResponse { rate }),
            Self::SetRate => cdr::to_vec(&SetRateResponse { success }),
            Self::PlayNext => cdr::to_vec(&PlayNextResponse { success }),
            Self::Burst => cdr::to_vec(&BurstResponse { actually_burst }),
            Self::Seek => cdr::to_vec(&SeekResponse { success }),
            Self::Play => cdr::to_vec(&PlayResponse { success: false }),
            Self::Stop => cdr::to_vec(&StopResponse::default()),
        }
    }
}
