//! [`Knees`]: companded codes, as automotive sensors send them, to linear values.

use std::fmt;
use std::str::FromStr;

/// The knee points of companded codes: the linear value of a code lies on the straight line between the two points beside it. The first line
/// begins at code 0 and value 0.
///
/// ```
/// use modulo_images::Knees;
///
/// // A sensor that sends 16 linear bits in codes of 12 bits.
/// let knees: Knees = "1023:1023, 2559:4095, 3455:32767, 3967:65535".parse()?;
/// assert_eq!(knees.end(), (3967.0, 65535.0));
/// assert_eq!((knees.linear(500.0), knees.linear(1023.0), knees.linear(1024.0)), (500.0, 1023.0, 1025.0));
/// assert!("1023:1023, 900:4095".parse::<Knees>().is_err(), "codes must rise");
/// # Ok::<(), String>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct Knees {
    /// (code, linear value), both rising; at least one point.
    points: Vec<(f32, f32)>,
}

/// The largest linear value: the end of 24 bits, up to which `f32` is exact.
const MOST: f32 = 16_777_216.0;

impl Knees {
    /// Returns the code and the linear value of full scale, which are those of the last point.
    pub fn end(&self) -> (f32, f32) {
        *self.points.last().expect("there is a point")
    }

    /// Returns the linear value of a code of at least 0; beyond the last point, the value of the last point.
    pub fn linear(&self, code: f32) -> f32 {
        let right = self.points.partition_point(|(knee, _)| *knee < code);
        let Some(&(code_right, right_value)) = self.points.get(right) else { return self.end().1 };
        let (code_left, left_value) = right.checked_sub(1).map_or((0.0, 0.0), |left| self.points[left]);
        left_value + (code - code_left) / (code_right - code_left) * (right_value - left_value)
    }
}

impl FromStr for Knees {
    type Err = String;

    /// Reads `CODE:VALUE, CODE:VALUE, ...`, as data sheets list the knee points.
    fn from_str(text: &str) -> Result<Self, String> {
        let point = |pair: &str| {
            let (code, value) = pair.split_once(':')?;
            let number = |text: &str| text.trim().parse::<f32>().ok();
            Some((number(code)?, number(value)?))
        };
        // The comparisons are false for NaN, too.
        let rises = |pair: &[(f32, f32)]| pair[0].0 < pair[1].0 && pair[0].1 < pair[1].1;
        let is_curve = |points: &Vec<(f32, f32)>| {
            let fits = |(code, value): &(f32, f32)| *code <= f32::from(u16::MAX) && *value <= MOST;
            points.iter().all(fits) && [&[(0.0, 0.0)], &points[..]].concat().windows(2).all(rises)
        };
        let points = text.split(',').map(point).collect::<Option<Vec<_>>>().filter(is_curve);
        points.map(|points| Self { points }).ok_or_else(|| {
            format!(
                "must list CODE:VALUE points with rising codes up to 65535 and rising values up to {MOST}, such as \
                 1023:1023, 2559:4095, 3455:32767, 3967:65535"
            )
        })
    }
}

impl fmt::Display for Knees {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let points: Vec<_> = self.points.iter().map(|(code, value)| format!("{code}:{value}")).collect();
        f.write_str(&points.join(", "))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn codes_rise_to_the_last_point_and_stay_there() {
        let knees: Knees = "1023:1023,2559:4095, 3455:32767,3967:65535".parse().expect("knee points");
        let all: Vec<f32> = (0..=4095).map(|code| knees.linear(code as f32)).collect();
        assert!(all[..3968].windows(2).all(|pair| pair[0] < pair[1]));
        assert_eq!(
            [all[0], all[1023], all[2559], all[2560], all[3967]],
            [0.0, 1023.0, 4095.0, 4127.0, 65535.0]
        );
        assert!(all[3967..].iter().all(|value| *value == 65535.0));
        assert_eq!(knees.to_string().parse(), Ok(knees));
    }

    #[test]
    fn points_that_are_no_curve_are_refused_with_an_example() {
        for text in [
            "",
            "1023",
            "1023:x",
            "1023:1023:5",
            "0:5",
            "9:5,9:7",
            "9:5,10:5",
            "NaN:5",
            "5:NaN",
            "70000:9",
            "9:2e7",
        ] {
            let why = text.parse::<Knees>().expect_err(text);
            assert!(why.contains("3967:65535"), "{text}: {why}");
        }
    }
}
