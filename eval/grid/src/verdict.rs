//! [`sentence`]: which streams have the highest accuracy, and which of the others the figures tell from it.

use std::collections::BTreeMap;

use modulo_ap::average::{Sample, mean};

use crate::labels;
use crate::metric::bootstrap::Units;
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
    (!text.is_empty()).then(|| format!("{at}{name} has the highest AP50; it {}", text.join(", and ")))
}

fn list(cells: &[&Judged]) -> String {
    cells.iter().map(|cell| labels::stream(&cell.point)).collect::<Vec<_>>().join(", ")
}
