//! `builtin_interfaces`: points in time and durations.

use crate::interface::messages;

const NS: i64 = 1_000_000_000;

messages! {
    /// A point in time since the Unix epoch.
    #[derive(Copy, Eq, Hash)]
    Time = "builtin_interfaces/msg/Time" {
        /// Whole seconds.
        sec: i32,
        /// Nanoseconds of the second, in 0 to 999,999,999.
        nanosec: u32,
    }
    /// A signed duration.
    #[derive(Copy, Eq, Hash)]
    Duration = "builtin_interfaces/msg/Duration" {
        /// Whole seconds, rounded down.
        sec: i32,
        /// Nanoseconds to add, in 0 to 999,999,999.
        nanosec: u32,
    }
}

impl Time {
    /// The last time that the message can hold; it is in the year 2038.
    pub const MAX: Self = Self { sec: i32::MAX, nanosec: 999_999_999 };

    /// Returns the time `ns` nanoseconds after the epoch, at most [`Time::MAX`].
    pub fn from_ns(ns: u64) -> Self {
        let nanosec = (ns % NS as u64) as u32;
        i32::try_from(ns / NS as u64).map_or(Self::MAX, |sec| Self { sec, nanosec })
    }

    /// Returns the nanoseconds since the epoch; times before it give 0.
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
