//! `~/get_logger_levels` and `~/set_logger_levels`: the services that read and change the level of a node's log, with the
//! meaning that they have for a node of `rclcpp` or `rclpy` with `enable_logger_service`. It knows no transport.

use std::sync::{Mutex, PoisonError};

use modulo_msgs::cdr::{self, CdrError};
use modulo_msgs::rcl_interfaces::{
    GetLoggerLevelsRequest, GetLoggerLevelsResponse, Log, LoggerLevel, SetLoggerLevelsRequest,
    SetLoggerLevelsResponse, SetLoggerLevelsResult,
};
use modulo_runtime::NodeName;

crate::services! {
    /// The services of the level of the log.
    pub enum LoggerService in "rcl_interfaces" {
        GetLoggerLevels = "get_logger_levels",
        SetLoggerLevels = "set_logger_levels",
    }
}

/// The codes of levels with their words in `tracing`. No line of the suite has the level FATAL.
const LEVELS: [(u8, &str); 5] = [
    (Log::DEBUG, "debug"),
    (Log::INFO, "info"),
    (Log::WARN, "warn"),
    (Log::ERROR, "error"),
    (Log::FATAL, "off"),
];

/// Applies a level by its word in `tracing`: `debug`, `info`, `warn`, `error` or `off`.
pub type ApplyLevel = Box<dyn Fn(&'static str) + Send + Sync>;

/// The logger of a node, whose level may change while the node runs.
pub struct Logger {
    name: String,
    level: Mutex<u32>,
    apply: ApplyLevel,
}

impl Logger {
    /// Creates the logger of `node_name`, which has the level `level` (a word in `tracing`) until a caller changes it.
    pub fn new(node_name: &NodeName, level: &str, apply: ApplyLevel) -> Self {
        let code = LEVELS.iter().find(|(_, word)| *word == level).map_or(Log::INFO, |(code, _)| *code);
        Self { name: name_of(node_name), level: Mutex::new(code.into()), apply }
    }

    /// Answers one request of `service`, which is CDR with its encapsulation header.
    ///
    /// # Errors
    /// [`CdrError`] when the request cannot be read.
    pub fn answer(&self, service: LoggerService, request: &[u8]) -> Result<Vec<u8>, CdrError> {
        match service {
            LoggerService::GetLoggerLevels => {
                let GetLoggerLevelsRequest { names } = cdr::from_slice(request)?;
                let levels = names.into_iter().map(|name| self.get(name)).collect();
                cdr::to_vec(&GetLoggerLevelsResponse { levels })
            }
            LoggerService::SetLoggerLevels => {
                let SetLoggerLevelsRequest { levels } = cdr::from_slice(request)?;
                let results =
                    levels.iter().map(|level| self.set(level)).map(|refused| SetLoggerLevelsResult {
                        successful: refused.is_none(),
                        reason: refused.unwrap_or_default(),
                    });
                cdr::to_vec(&SetLoggerLevelsResponse { results: results.collect() })
            }
        }
    }

    fn get(&self, name: String) -> LoggerLevel {
        // 0 stands for a logger whose level is not known, as in `rclcpp`.
        let level =
            if self.is(&name) { *self.level.lock().unwrap_or_else(PoisonError::into_inner) } else { 0 };
        LoggerLevel { name, level }
    }

    /// Sets a level; returns the reason of a refusal.
    fn set(&self, wanted: &LoggerLevel) -> Option<String> {
        let LoggerLevel { name, level } = wanted;
        if !self.is(name) {
            return Some(format!("logger '{name}' is unknown; the logger of this node is '{}'", self.name));
        }
        let Some((_, word)) = LEVELS.iter().find(|(code, _)| u32::from(*code) == *level) else {
            return Some(format!(
                "level {level} is unknown; 10, 20, 30, 40 and 50 are possible (debug to fatal)"
            ));
        };
        let mut current = self.level.lock().unwrap_or_else(PoisonError::into_inner);
        (self.apply)(word);
        *current = *level;
        None
    }

    /// Returns whether `name` means this logger: an empty name means all loggers of a process, and this is the only one.
    fn is(&self, name: &str) -> bool {
        name.is_empty() || name == self.name
    }
}

/// Returns the name of a node's logger, as rcl makes it: `front.unwrap` for the node `/front/unwrap`.
pub fn name_of(node_name: &NodeName) -> String {
    node_name.fully_qualified().trim_matches('/').replace('/', ".")
}

#[cfg(test)]
mod tests {
    use std::sync::mpsc::channel;

    use super::*;

    #[test]
    fn levels_are_read_and_set_by_the_name_of_the_logger() {
        let (sender, applied) = channel();
        let apply = Box::new(move |word| sender.send(word).expect("the test listens"));
        let logger = Logger::new(&NodeName::new("unwrap", "/front", &[]).expect("a name"), "info", apply);
        let get = |name: &str| {
            let request = cdr::to_vec(&GetLoggerLevelsRequest { names: vec![name.into()] }).expect("short");
            let answer = logger.answer(LoggerService::GetLoggerLevels, &request).expect("readable");
            cdr::from_slice::<GetLoggerLevelsResponse>(&answer).expect("a response").levels.remove(0).level
        };
        let set = |name: &str, level| {
            let levels = vec![LoggerLevel { name: name.into(), level }];
            let request = cdr::to_vec(&SetLoggerLevelsRequest { levels }).expect("short");
            let answer = logger.answer(LoggerService::SetLoggerLevels, &request).expect("readable");
            cdr::from_slice::<SetLoggerLevelsResponse>(&answer).expect("a response").results.remove(0)
        };
        assert_eq!((get("front.unwrap"), get(""), get("rcl")), (20, 20, 0));
        for (level, word) in [(10, "debug"), (50, "off"), (30, "warn")] {
            assert!(set("front.unwrap", level).successful);
            assert_eq!((applied.try_recv(), get("front.unwrap")), (Ok(word), level));
        }
        for (name, level, why) in [("rcl", 10, "'front.unwrap'"), ("front.unwrap", 11, "level 11")] {
            let result = set(name, level);
            assert!(!result.successful && result.reason.contains(why), "{result:?}");
        }
        assert_eq!((applied.try_recv().is_err(), get("front.unwrap")), (true, 30));
    }
}
