//! The order of files by their names, in which numbers count by their value.

use std::ffi::OsStr;

/// The number of digits of a time: seconds since 1970 have ten, and a date with a time of day has more.
const TIME: usize = 10;

/// Returns a key that sorts names without their extensions: `2` comes before `10`. Digits behind a point are a fraction, so that `3.81` comes
/// before `3.9`, where a decimal number is the whole name, and where the text before the point has the digits of a time, as in
/// `cam0_1403636579.81` and `2026-11-27T12:00:00.5`.
pub(super) fn by_number(stem: &OsStr) -> Vec<u8> {
    let name = stem.as_encoded_bytes();
    let is_number = |text: &[u8]| {
        let parts: Vec<_> = text.splitn(2, |byte| *byte == b'.').collect();
        parts.iter().all(|part| !part.is_empty() && digits(part) == part.len())
    };
    match name.strip_prefix(b"-") {
        // The further below zero, the earlier.
        Some(number) if is_number(number) => {
            [b'-'].into_iter().chain(key(number).into_iter().chain([0]).map(|byte| !byte)).collect()
        }
        _ => key(name),
    }
}

fn key(name: &[u8]) -> Vec<u8> {
    let (mut key, mut at) = (Vec::new(), 0);
    for run in name.chunk_by(|a, b| a.is_ascii_digit() && b.is_ascii_digit()) {
        let before = &name[..at];
        at += run.len();
        if !run[0].is_ascii_digit() {
            key.extend(run);
        } else if is_fraction(before, &name[at..]) {
            let zeros = run.iter().rev().take_while(|digit| **digit == b'0').count();
            // The end of a fraction comes before any digit that could go on with it.
            key.extend([&run[..run.len() - zeros], &[0]].concat());
        } else {
            let zeros = run.iter().take_while(|digit| **digit == b'0').count();
            let number = &run[zeros..];
            // Of two numbers without leading zeros the one with more digits is larger.
            key.extend([b"0", &(number.len() as u64).to_be_bytes()[..], number].concat());
        }
    }
    key
}

/// Returns whether digits between `before` and `after` are a fraction.
fn is_fraction(before: &[u8], after: &[u8]) -> bool {
    before.strip_suffix(b".").is_some_and(|whole| {
        let count = digits(whole);
        let is_name = count == whole.len() && after.is_empty();
        whole.last().is_some_and(u8::is_ascii_digit) && (is_name || count >= TIME)
    })
}

fn digits(text: &[u8]) -> usize {
    text.iter().filter(|byte| byte.is_ascii_digit()).count()
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn key_of(name: &str) -> Vec<u8> {
        by_number(OsStr::new(name))
    }

    #[test]
    fn numbers_come_by_their_value() {
        for names in [
            &["1403636579.763555556", "1403636579.81", "1403636579.8635", "1403636579.9", "1403636580"][..],
            &["-2", "-1.5", "-1.25", "-1", "-0.5", "0", "0.05", "0.5", "1", "12", "12.5", "100.25"],
            &["1305031102.175304", "1305031102.211214", "1305031103.011215"],
            &["cam0_1403636579.763", "cam0_1403636579.81", "cam0_1403636579.9", "cam1_1403636579.1"],
            &[
                "2026-11-27T12:00:00",
                "2026-11-27T12:00:00.25",
                "2026-11-27T12:00:00.5",
                "2026-11-27T12:00:01",
            ],
            &["1403636579.25_left", "1403636579.25_right", "1403636579.5_left"],
            // Two counters, not a decimal number.
            &["frame_1.5", "frame_1.10", "v2.9.1", "v2.10.0"],
            &["000001", "000002", "000010", "a2", "a010", "a10", "b1_9", "b1_10", "b2"],
        ] {
            assert!(names.is_sorted_by_key(|name| key_of(name)), "{names:?}");
        }
        assert_eq!(key_of("1.50"), key_of("01.5"), "one value");
    }

    proptest! {
        /// Names with random digits, among them long ones that a float would round.
        #[test]
        fn decimal_names_come_as_their_values(numbers in prop::collection::vec((-9_i64..9, 0_u64..1_000_000_000_000, 1_usize..13), 2..9)) {
            let named = |&(whole, parts, width): &(i64, u64, usize)| {
                let fraction = &format!("{parts:012}")[..width];
                let sign = if whole < 0 { -1 } else { 1 };
                let value = whole * 1_000_000_000_000 + sign * format!("{fraction:0<12}").parse::<i64>().expect("digits");
                (format!("{whole}.{fraction}"), value)
            };
            let mut names: Vec<(String, i64)> = numbers.iter().map(named).collect();
            names.sort_by_key(|(name, _)| key_of(name));
            prop_assert!(names.is_sorted_by_key(|(_, value)| *value), "{names:?}");
        }

        /// Names of all kinds in one folder: whatever comes first, they end in one order.
        #[test]
        fn the_order_is_total(mut names in prop::collection::vec("-?[0-9]{0,12}[._a-]?[0-9]{0,3}[.a_]?[0-9]{0,2}", 2..9)) {
            let order = |names: &mut Vec<String>| names.sort_by_cached_key(|name| (key_of(name), name.clone()));
            let mut turned: Vec<String> = names.iter().rev().cloned().collect();
            order(&mut names);
            order(&mut turned);
            prop_assert_eq!(names, turned);
        }
    }
}
