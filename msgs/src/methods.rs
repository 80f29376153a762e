//! What messages can do beside carrying their fields.

use crate::builtin_interfaces::Time;
use crate::diagnostic_msgs::{DiagnosticArray, DiagnosticStatus, Header, KeyValue};

const NS: i64 = 1_000_000_000;

impl Time {
    /// The last time that the message can hold; it is in the year 2038.
    pub const MAX: Self = Self { sec: i32::MAX, nanosec: 999_999_999 };

    /// Returns the time `ns` nanoseconds after the epoch, at most [`Time::MAX`].
    pub fn from_ns(ns: u64) -> Self {
        // 32 bits of seconds end in the year 2038: a later time becomes the last one, and never an early one.
        let nanosec = (ns % NS as u64) as u32;
        i32::try_from(ns / NS as u64).map_or(Self::MAX, |sec| Self { sec, nanosec })
    }

    /// Returns the nanoseconds since the epoch; times before it give 0.
    pub fn as_ns(self) -> u64 {
        // The message allows more nanoseconds than one second has, so that both fields are added before the clamp.
        let ns = i64::from(self.sec) * NS + i64::from(self.nanosec);
        u64::try_from(ns).unwrap_or(0)
    }
}

impl KeyValue {
    /// Returns the measurements `pairs` of (name, value).
    pub fn all<K: Into<String>>(pairs: impl IntoIterator<Item = (K, String)>) -> Vec<Self> {
        pairs.into_iter().map(|(key, value)| Self { key: key.into(), value }).collect()
    }
}

impl From<Time> for Header {
    /// Returns the header of a message with this stamp that belongs to no coordinate frame.
    fn from(stamp: Time) -> Self {
        Self { stamp, ..Self::default() }
    }
}

impl DiagnosticArray {
    /// Returns a message with one status.
    pub fn of(header: impl Into<Header>, status: DiagnosticStatus) -> Self {
        Self { header: header.into(), status: vec![status] }
    }

    /// Returns the first measurement called `key`.
    pub fn value(&self, key: &str) -> Option<&str> {
        let mut values = self.status.iter().flat_map(|status| &status.values);
        values.find(|value| value.key == key).map(|value| value.value.as_str())
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
