//! [`sentence`]: which streams have the highest accuracy, which of the others the figures tell from it, and how many objects a modulo sensor
//! adds to those that a normal camera finds.

use std::collections::BTreeMap;

use modulo_ap::average::{Sample, mean};

use crate::labels;
use crate::metric::bootstrap::Units;
use crate::pictures::LEAST_SHOWN;
use crate::results::Point;

/// What a verdict is based on: a cell with the matched boxes of each group, and the units of the bootstrap.
pub struct Judged {
    /// The cell.
    pub point: Point,
    /// The boxes of each group that is scored.
    pub samples: BTreeMap<String, Sample>,
    /// The units that are drawn.
    pub units: Units,
    /// Number of scored frames.
    pub frames: usize,
}

impl Judged {
    /// The mean AP50 of the groups of frames that come so many `times`. `None` if no object is scored.
    pub fn ap50(&self, times: &[u64]) -> Option<f64> {
        mean(self.samples.values().filter_map(|sample| sample.ap(times)))
    }

    fn once(&self) -> f64 {
        self.ap50(&vec![1; self.frames]).unwrap_or_default()
    }

    /// Whether more than chance lies between this cell and `other`, whose frames are the same.
    fn is_above(&self, other: &Self) -> bool {
        let lead = |times: &[u64]| Some(self.ap50(times)? - other.ap50(times)?);
        self.units.interval(lead).is_some_and(|[low, _]| low > 0.0)
    }

    /// The number of objects of all groups that are found in each frame with a score at which boxes are drawn.
    fn found(&self) -> Vec<u64> {
        let mut found = vec![0; self.frames];
        for sample in self.samples.values() {
            found.iter_mut().zip(sample.found(LEAST_SHOWN)).for_each(|(sum, more)| *sum += more);
        }
        found
    }
}

/// Says in how many frames the sensor, shown in the way that suits each frame where that was evaluated, finds more objects than a normal camera
/// with a fixed exposure, and what one with automatic exposure finds. `None` where one of the two is missing.
fn worth(cells: &[&Judged]) -> Option<String> {
    let of = |stream: &str| cells.iter().find(|cell| cell.point.is(stream));
    let (normal, modulo) = (of("saturated")?, of("metered").or_else(|| of("recovered"))?);
    let without = normal.found();
    // In frames with more, and in frames with fewer.
    let against = |other: &Judged| {
        let pairs: Vec<(u64, u64)> = other.found().into_iter().zip(without.iter().copied()).collect();
        let sum = |of: fn((u64, u64)) -> u64| pairs.iter().copied().map(of).sum::<u64>();
        let frames = pairs.iter().filter(|(with, without)| with > without).count();
        (
            frames,
            sum(|(with, without)| with.saturating_sub(without)),
            sum(|(with, without)| without.saturating_sub(with)),
        )
    };
    let (frames, more, fewer) = against(modulo);
    let objects: usize = modulo.samples.values().map(Sample::objects).sum();
    let [normal_name, name] = [normal, modulo].map(|cell| labels::stream(&cell.point));
    let fewer = if fewer > 0 { format!(", and {fewer} fewer in others") } else { String::new() };
    let rival = of("auto_exposed")
        .map(|rival| format!("; a normal camera with automatic exposure finds {} more", against(rival).1));
    Some(format!(
        "In {frames} of {} frames, {name} finds more objects than {normal_name}: {more} more of {objects}{fewer}{}",
        modulo.frames,
        rival.unwrap_or_default()
    ))
}

/// Says in a sentence which of the streams of one sensor and model finds the most objects, and which of the others the figures tell from it: those
/// of the first model and lens, at the largest alpha. `None` for a single stream.
pub fn sentence(cells: &[Judged]) -> Option<String> {
    let scored: Vec<&Judged> = cells.iter().filter(|cell| !cell.samples.is_empty()).collect();
    let first = scored.iter().find(|cell| !cell.point.is_sharp_ideal()).or(scored.first())?;
    let conditions = labels::conditions_of(&first.point);
    let is_own = |cell: &&Judged| {
        labels::model(&cell.point) == labels::model(&first.point) && labels::belongs(&cell.point, &conditions)
    };
    let own: Vec<&Judged> = scored.iter().copied().filter(is_own).collect();
    let alpha = own.iter().map(|cell| cell.point.sensor.alpha).fold(0.0, f64::max);
    let is_single = own.iter().all(|cell| cell.point.sensor.alpha == alpha);
    let own: Vec<&Judged> = own.into_iter().filter(|cell| cell.point.sensor.alpha == alpha).collect();
    let best =
        own.iter().copied().reduce(|best, next| if next.once() > best.once() { next } else { best })?;
    let others = || own.iter().copied().filter(|cell| cell.point != best.point && cell.frames == best.frames);
    let is_same = |cell: &&Judged| cell.once() == best.once();
    let (below, near): (Vec<_>, Vec<_>) =
        others().filter(|cell| !is_same(cell)).partition(|other| best.is_above(other));
    let objects: usize = best.samples.values().map(Sample::objects).sum();
    let chance = match best.units.interval(|times| best.ap50(times)) {
        Some(_) => format!("with {objects} objects, the 95 % interval of the difference contains 0"),
        None => "a single frame gives no interval".to_owned(),
    };
    let same: Vec<_> = others().filter(is_same).collect();
    let same = (!same.is_empty()).then(|| format!("has the same as {}, to the last digit", list(&same)));
    let above = (!below.is_empty()).then(|| format!("is above {}, by more than chance", list(&below)));
    let near = (!near.is_empty()).then(|| format!("cannot be ranked against {}: {chance}", list(&near)));
    let text: Vec<String> = [same, above, near].into_iter().flatten().collect();
    let at = if is_single { String::new() } else { format!("At alpha {alpha}, ") };
    let name = labels::stream(&best.point);
    let ranked =
        (!text.is_empty()).then(|| format!("{at}{name} has the highest AP50; it {}", text.join(", and ")))?;
    Some([Some(ranked), worth(&own)].into_iter().flatten().collect::<Vec<_>>().join(". "))
}

fn list(cells: &[&Judged]) -> String {
    cells.iter().map(|cell| labels::stream(&cell.point)).collect::<Vec<_>>().join(", ")
}

#[cfg(test)]
mod tests {
    use modulo_ap::matching::{ImageBoxes, ObjectRole};
    use modulo_core::BBox;

    use super::*;

    /// A cell of three frames with three objects each, of which so many are found with these scores.
    fn cell(stream: &str, found: [(usize, f32); 3]) -> Judged {
        let bbox = |place: usize| BBox {
            x1: 20.0 * place as f32,
            y1: 0.0,
            x2: 20.0 * place as f32 + 10.0,
            y2: 10.0,
        };
        let images = found.map(|(count, score)| ImageBoxes {
            truth: (0..3).map(|place| (bbox(place), ObjectRole::Counts)).collect(),
            found: (0..count).map(|place| (bbox(place), score)).collect(),
            least_height: 0.0,
        });
        let samples = BTreeMap::from([("vehicle".to_owned(), Sample::new(&images, 0.5))]);
        let point = Point { stream: stream.to_owned(), ..Point::default() };
        Judged { point, samples, units: Units::new(&[None, None, None], 1), frames: 3 }
    }

    #[test]
    fn a_verdict_counts_the_objects_that_a_modulo_sensor_adds() {
        let cells = [
            cell("saturated", [(0, 0.9), (1, 0.9), (3, 0.9)]),
            cell("auto_exposed", [(2, 0.9), (1, 0.9), (3, 0.9)]),
            cell("metered", [(3, 0.9), (3, 0.2), (2, 0.9)]),
        ];
        let verdict = sentence(&cells).expect("a verdict");
        // Boxes below the score with which they are drawn do not count.
        assert!(
            verdict.ends_with(
                "In 1 of 3 frames, metered finds more objects than saturated: 3 more of 9, and 2 fewer in others; a normal \
                 camera with automatic exposure finds 2 more"
            ),
            "{verdict}"
        );
        let without = sentence(&cells[1..]).expect("a verdict");
        assert!(!without.contains("frames"), "{without}");
    }
}
