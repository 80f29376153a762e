//! [`Axis`]: values to places along one side, and the ticks.

/// One side of a panel.
#[derive(Clone, Debug, PartialEq)]
pub struct Axis {
    /// What it shows, with its unit.
    pub label: String,
    /// How values are spread.
    pub scale: Scale,
    /// How ticks are written.
    pub unit: Unit,
    /// Where large values are.
    pub direction: Direction,
}

/// How values are spread along an axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Scale {
    /// Evenly, between these two.
    Linear {
        /// At the beginning.
        from: f64,
        /// At the end.
        to: f64,
    },
    /// By powers of ten around the data; zeros have a place of their own before the smallest.
    Log,
}

/// How a tick is written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Unit {
    /// The value.
    Plain,
    /// A share of 0 to 1 as 0 to 100 %.
    Percent,
}

/// Where large values are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Direction {
    /// Right or above.
    Up,
    /// Left or below.
    Down,
}

/// Room beyond the first and the last tick, as a share of the length.
const PAD: f64 = 0.05;
/// Room of the zeros, in powers of ten.
const ZERO: f64 = 0.8;

/// An axis that knows its data.
pub struct Ruler {
    from: f64,
    to: f64,
    /// Smallest power of ten, and its logarithm for zeros; none on a linear axis.
    zero: Option<f64>,
    direction: Direction,
    /// Values and texts.
    pub ticks: Vec<(f64, String)>,
}

impl Axis {
    /// Plain numbers by powers of ten, such as durations; large values are right or above.
    pub fn log(label: impl Into<String>) -> Self {
        Self { label: label.into(), scale: Scale::Log, unit: Unit::Plain, direction: Direction::Up }
    }

    /// Shares from 0 to `most` as percent, evenly; large values are right or above.
    pub fn percent(label: impl Into<String>, most: f64) -> Self {
        let scale = Scale::Linear { from: 0.0, to: most };
        Self { scale, unit: Unit::Percent, ..Self::log(label) }
    }

    /// Fits the axis to finite `values`.
    pub fn ruler(&self, values: impl Iterator<Item = f64> + Clone) -> Ruler {
        let (from, to, zero, ticks) = match self.scale {
            Scale::Linear { from, to } => (from, to, None, linear_ticks(from, to)),
            Scale::Log => log_range(values),
        };
        let pad = (to - from).max(1e-9) * PAD;
        let ticks = ticks.into_iter().map(|value| (value, self.unit.text(value))).collect();
        Ruler { from: from - pad, to: to + pad, zero, direction: self.direction, ticks }
    }
}

impl Ruler {
    /// 0 at the left or at the bottom, 1 at the other end; clamped.
    pub fn place(&self, value: f64) -> f32 {
        let value = match self.zero {
            Some(zero) if value <= 0.0 => zero,
            Some(_) => value.log10(),
            None => value,
        };
        let share = ((value - self.from) / (self.to - self.from)).clamp(0.0, 1.0) as f32;
        match self.direction {
            Direction::Up => share,
            Direction::Down => 1.0 - share,
        }
    }
}

impl Unit {
    fn text(self, value: f64) -> String {
        match self {
            Self::Plain => format!("{}", rounded(value)),
            Self::Percent => format!("{} %", rounded(100.0 * value)),
        }
    }
}

/// Without the last digits that come of counting in binary.
fn rounded(value: f64) -> f64 {
    format!("{value:.9e}").parse().expect("a number that was just written")
}

/// Multiples of 1, 2 or 5 times a power of ten, about five of them.
fn linear_ticks(from: f64, to: f64) -> Vec<f64> {
    let rough = ((to - from).abs() / 5.0).max(f64::MIN_POSITIVE);
    let power = 10f64.powf(rough.log10().floor());
    let step = [1.0, 2.0, 5.0, 10.0].into_iter().map(|m| m * power).find(|step| *step >= rough * 0.999);
    let step = step.unwrap_or(rough);
    let (first, last) = ((from / step).ceil() as i64, (to / step + 1e-9).floor() as i64);
    (first..=last).map(|n| n as f64 * step).collect()
}

/// Logarithms of the ends, that of zeros, and the ticks as values.
fn log_range(values: impl Iterator<Item = f64> + Clone) -> (f64, f64, Option<f64>, Vec<f64>) {
    let positive = || values.clone().filter(|value| *value > 0.0);
    let least = positive().fold(f64::INFINITY, f64::min);
    let most = positive().fold(0.0, f64::max);
    let (low, high) = if most > 0.0 { (least.log10(), most.log10()) } else { (-2.0, 0.0) };
    let (first, last) = (low.floor() as i32, (high.ceil() as i32).max(low.floor() as i32 + 1));
    let steps: &[f64] = if last - first <= 3 { &[1.0, 2.0, 5.0] } else { &[1.0] };
    let mut ticks: Vec<f64> =
        (first..=last).flat_map(|power| steps.iter().map(move |m| m * 10f64.powi(power))).collect();
    // The ticks that enclose the data are enough.
    let start = ticks.iter().rposition(|tick| tick.log10() <= low + 1e-9).unwrap_or(0);
    let end = ticks.iter().position(|tick| tick.log10() >= high - 1e-9).unwrap_or(ticks.len() - 1);
    ticks = ticks[start..=end.max(start)].to_vec();
    let (from, to) = (ticks[0].log10(), ticks[ticks.len() - 1].log10());
    if values.clone().any(|value| value <= 0.0) {
        ticks.insert(0, 0.0);
        return (from - ZERO, to, Some(from - ZERO), ticks);
    }
    (from, to, Some(from), ticks)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn axis(scale: Scale, unit: Unit) -> Axis {
        Axis { scale, unit, ..Axis::log("") }
    }

    fn texts(ruler: &Ruler) -> Vec<&str> {
        ruler.ticks.iter().map(|(_, text)| text.as_str()).collect()
    }

    #[test]
    fn ticks_enclose_the_data() {
        let log = axis(Scale::Log, Unit::Plain);
        assert_eq!(texts(&log.ruler([3.1, 42.0].into_iter())), ["2", "5", "10", "20", "50"]);
        assert_eq!(
            texts(&log.ruler([0.02, 90.0, 1500.0].into_iter())),
            ["0.01", "0.1", "1", "10", "100", "1000", "10000"]
        );
        let share = axis(Scale::Log, Unit::Percent);
        assert_eq!(
            texts(&share.ruler([0.0, 0.00002, 0.6].into_iter())),
            ["0 %", "0.001 %", "0.01 %", "0.1 %", "1 %", "10 %", "100 %"]
        );
        let linear = axis(Scale::Linear { from: 0.0, to: 1.0 }, Unit::Percent);
        assert_eq!(
            texts(&linear.ruler(std::iter::empty())),
            ["0 %", "20 %", "40 %", "60 %", "80 %", "100 %"]
        );
    }

    #[test]
    fn places_rise_with_values_and_stay_on_the_axis() {
        for data in [vec![], vec![0.0], vec![5.0], vec![0.0, 1e-6, 0.3], vec![1e-12, 1e12], vec![7.0, 7.0]] {
            for direction in [Direction::Up, Direction::Down] {
                let ruler = Axis { direction, ..axis(Scale::Log, Unit::Plain) }.ruler(data.iter().copied());
                let mut places: Vec<f32> = ruler.ticks.iter().map(|(value, _)| ruler.place(*value)).collect();
                if direction == Direction::Down {
                    places.reverse();
                }
                assert!(places.windows(2).all(|pair| pair[0] < pair[1]), "{data:?}: {places:?}");
                assert!(places.iter().all(|place| (0.0..=1.0).contains(place)), "{data:?}: {places:?}");
                assert!(data.iter().all(|value| (0.01..=0.99).contains(&ruler.place(*value))), "{data:?}");
            }
        }
    }
}
