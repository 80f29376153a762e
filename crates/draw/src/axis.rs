/// An axis of a panel. It maps values to positions along one side of the panel, and chooses the ticks.
#[derive(Clone, Debug, PartialEq)]
pub struct Axis {
    /// Quantity and unit.
    pub label: String,
    /// The scale.
    pub scale: Scale,
}

/// Scale of an axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Scale {
    /// Linear for shares from 0 to 1, whose ticks are in percent.
    Share,
    /// Logarithmic around the data, of which only positive values have a position of their own.
    Log,
    /// The distinct values of the data at equal distances, each with a tick. Points of several series at one value are drawn
    /// side by side, so that none covers another.
    Settings,
}

/// Margin beyond the first and the last tick, as a share of the length.
const PAD: f64 = 0.05;

pub struct FittedAxis {
    from: f64,
    to: f64,
    scale: Scale,
    /// Value and text of each tick, in ascending order.
    pub ticks: Vec<(f64, String)>,
}

impl Axis {
    /// An axis of this scale, which `label` describes.
    pub fn new(scale: Scale, label: impl Into<String>) -> Self {
        Self { label: label.into(), scale }
    }

    /// Fits the axis to finite `values`.
    pub fn fit(&self, values: impl Iterator<Item = f64> + Clone) -> FittedAxis {
        let ticks = match self.scale {
            Scale::Share => vec![0.0, 0.2, 0.4, 0.6, 0.8, 1.0],
            Scale::Log => log_ticks(values),
            Scale::Settings => ascending(values),
        };
        let (from, to) = match self.scale {
            Scale::Settings => (-0.5, ticks.len() as f64 - 0.5),
            Scale::Log => (ticks[0].log10(), ticks[ticks.len() - 1].log10()),
            Scale::Share => (ticks[0], ticks[ticks.len() - 1]),
        };
        // An axis whose data have one value would have no length, and every position would be a division by zero.
        let pad = (to - from).max(1e-9) * PAD;
        let text = |value| match self.scale {
            Scale::Share => format!("{} %", rounded(100.0 * value)),
            Scale::Log | Scale::Settings => rounded(value).to_string(),
        };
        let ticks = ticks.into_iter().map(|value| (value, text(value))).collect();
        FittedAxis { from: from - pad, to: to + pad, scale: self.scale, ticks }
    }
}

impl FittedAxis {
    /// Position of a value: 0 at the left or bottom, 1 at the other end. Values outside are clamped.
    pub fn place(&self, value: f64) -> f32 {
        let value = match self.scale {
            Scale::Log => value.max(0.0).log10(),
            Scale::Share => value,
            Scale::Settings => self.ticks.partition_point(|(setting, _)| *setting < value) as f64,
        };
        ((value - self.from) / (self.to - self.from)).clamp(0.0, 1.0) as f32
    }

    /// Distance of two neighbouring settings as a share of the length. 0 on an axis of another scale.
    pub fn step(&self) -> f32 {
        if self.scale == Scale::Settings { (1.0 / (self.to - self.from)) as f32 } else { 0.0 }
    }
}

/// The distinct values in the order of their first appearance.
pub fn distinct<T: PartialEq>(values: impl Iterator<Item = T>) -> Vec<T> {
    let mut found = Vec::new();
    for value in values {
        if !found.contains(&value) {
            found.push(value);
        }
    }
    found
}

/// The distinct numbers in ascending order.
pub fn ascending(values: impl Iterator<Item = f64>) -> Vec<f64> {
    let mut values = distinct(values);
    values.sort_by(f64::total_cmp);
    values
}

/// Removes the last digits that result from binary fractions.
fn rounded(value: f64) -> f64 {
    format!("{value:.9e}").parse().expect("a number that was just written")
}

/// The values of the ticks of a logarithmic axis, which enclose the positive values.
fn log_ticks(values: impl Iterator<Item = f64>) -> Vec<f64> {
    let positive = values.filter(|value| *value > 0.0);
    let (least, most) = positive.fold((f64::INFINITY, 0.0), |(a, b): (f64, f64), v| (a.min(v), b.max(v)));
    // Without positive data the axis still needs a range, so that the panel can be drawn.
    let (low, high) = if most > 0.0 { (least.log10(), most.log10()) } else { (-2.0, 0.0) };
    let (first, last) = (low.floor() as i32, (high.ceil() as i32).max(low.floor() as i32 + 1));
    // Over few powers of ten, ticks at the powers alone would leave most of the panel without one. Over many, the steps
    // in between would cover each other.
    let steps: &[f64] = if last - first <= 3 { &[1.0, 2.0, 5.0] } else { &[1.0] };
    let ticks: Vec<f64> =
        (first..=last).flat_map(|power| steps.iter().map(move |m| m * 10f64.powi(power))).collect();
    // Only the ticks that enclose the data are kept.
    let start = ticks.iter().rposition(|tick| tick.log10() <= low + 1e-9).unwrap_or(0);
    let end = ticks.iter().position(|tick| tick.log10() >= high - 1e-9).unwrap_or(ticks.len() - 1);
    ticks[start..=end.max(start)].to_vec()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn axis(scale: Scale) -> Axis {
        Axis::new(scale, "")
    }

    fn texts(fitted: &FittedAxis) -> Vec<&str> {
        fitted.ticks.iter().map(|(_, text)| text.as_str()).collect()
    }

    #[test]
    fn ticks_enclose_the_data() {
        let log = axis(Scale::Log);
        assert_eq!(texts(&log.fit([3.1, 42.0].into_iter())), ["2", "5", "10", "20", "50"]);
        assert_eq!(
            texts(&log.fit([0.02, 90.0, 1500.0].into_iter())),
            ["0.01", "0.1", "1", "10", "100", "1000", "10000"]
        );
        let settings = axis(Scale::Settings);
        assert_eq!(texts(&settings.fit([4.0, 0.0, 1.5, 4.0].into_iter())), ["0", "1.5", "4"]);
        let share = axis(Scale::Share);
        assert_eq!(texts(&share.fit(std::iter::empty())), ["0 %", "20 %", "40 %", "60 %", "80 %", "100 %"]);
    }

    #[test]
    fn places_rise_with_values_and_stay_on_the_axis() {
        for data in [vec![], vec![5.0], vec![1e-6, 0.3], vec![1e-12, 1e12], vec![7.0, 7.0]] {
            for scale in [Scale::Log, Scale::Settings] {
                let fitted = axis(scale).fit(data.iter().copied());
                let places: Vec<f32> = fitted.ticks.iter().map(|(value, _)| fitted.place(*value)).collect();
                assert!(places.windows(2).all(|pair| pair[0] < pair[1]), "{data:?}: {places:?}");
                assert!(places.iter().all(|place| (0.0..=1.0).contains(place)), "{data:?}: {places:?}");
                assert!(data.iter().all(|value| (0.01..=0.99).contains(&fitted.place(*value))), "{data:?}");
            }
        }
    }
}
