//! `builtin_interfaces`: points and spans of time.

use serde::{Deserialize, Serialize};

use crate::interface::interfaces;

const NS: i64 = 1_000_000_000;

/// `builtin_interfaces/msg/Time`: a point in time since the Unix epoch.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct Time {
    /// Whole seconds.
    pub sec: i32,
    /// Nanoseconds of the second, 0 to 999,999,999.
    pub nanosec: u32,
}

/// `builtin_interfaces/msg/Duration`: a signed span of time.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct Duration {
    /// Whole seconds, rounded down.
    pub sec: i32,
    /// Nanoseconds to add, 0 to 999,999,999.
    pub nanosec: u32,
}

interfaces! {
    Time = "builtin_interfaces/msg/Time",
    Duration = "builtin_interfaces/msg/Duration",
}

impl Time {
    /// The last time that the message can hold, in the year 2038.
    pub const MAX: Self = Self { sec: i32::MAX, nanosec: 999_999_999 };

    /// `ns` nanoseconds after the epoch, [`Time::MAX`] at most.
    pub fn from_ns(ns: u64) -> Self {
        let nanosec = (ns % NS as u64) as u32;
        i32::try_from(ns / NS as u64).map_or(Self::MAX, |sec| Self { sec, nanosec })
    }

    /// Nanoseconds since the epoch; 0 for times before it.
    pub fn as_ns(self) -> u64 {
        let ns = i64::from(self.sec) * NS + i64::from(self.nanosec);
        u64::try_from(ns).unwrap_or(0)
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn saturates_at_both_ends() {
        assert_eq!(Time::from_ns(u64::MAX), Time::MAX);
        assert_eq!(Time::from_ns(Time::MAX.as_ns() + 1), Time::MAX);
        assert_eq!(Time { sec: -1, nanosec: 999_999_999 }.as_ns(), 0);
        assert_eq!(Time { sec: i32::MIN, nanosec: 0 }.as_ns(), 0);
        assert_eq!(Time { sec: -1, nanosec: 1_000_000_007 }.as_ns(), 7);
        assert_eq!(Time { sec: 1, nanosec: u32::MAX }.as_ns(), 5_294_967_295);
    }

    proptest! {
        #[test]
        fn nanoseconds_return(ns in 0..=2_147_483_647_999_999_999_u64) {
            let time = Time::from_ns(ns);
            prop_assert!(time.nanosec < 1_000_000_000);
            prop_assert_eq!(time.as_ns(), ns);
        }
    }
}
