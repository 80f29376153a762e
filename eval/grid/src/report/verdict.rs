//! The verdict of a report: what recovery keeps of the accuracy of the ideal image, and what a clipped image has.

use std::cmp::Reverse;

use crate::labels::{self, distinct};
use crate::results::{Cell, Results, Stream};

/// A sentence for the group with the most objects, at the largest alpha of the first model and lens. There is none where a stream is
/// missing.
pub fn sentence(results: &Results) -> Option<String> {
    let first = results.cells.first()?;
    let (model, conditions) =
        (labels::model(&first.point), labels::all_conditions(&results.cells).into_iter().next()?);
    let own = |cell: &&Cell| labels::model(&cell.point) == model && labels::belongs(&cell.point, &conditions);
    let cells: Vec<&Cell> = results.cells.iter().filter(own).collect();
    let of = |stream: Stream| cells.iter().filter(move |cell| cell.point.stream == stream);
    let alpha = of(Stream::Recovered).map(|cell| cell.point.sensor.alpha).fold(0.0, f64::max);
    let at = |stream: Stream| of(stream).find(|cell| cell.point.sensor.alpha == alpha);
    let [recovered, ideal, saturated] = [at(Stream::Recovered)?, at(Stream::Ideal)?, at(Stream::Saturated)?];
    let groups = distinct(recovered.objects.keys());
    let group = groups.into_iter().min_by_key(|group| Reverse(recovered.objects[*group]))?;
    let objects = recovered.objects[group];
    let [kept, all, clipped] = [recovered, ideal, saturated].map(|cell| labels::percent(cell.ap50_of(group)));
    let [[low, _], [_, high]] = [recovered.interval_of(group)?, saturated.interval_of(group)?];
    let doubt =
        if low > high { "" } else { " The intervals overlap: there are too few objects to rank these two." };
    Some(format!(
        "At alpha {alpha}, the recovered image keeps {kept} of the {all} % AP50 that the ideal image has for the group {group}; a saturated \
         image has {clipped} % ({objects} objects).{doubt}"
    ))
}
