//! The time of a frame by stages: a bar for each stream, method and model.

use modulo_charts::{Bar, Bars, Body};

use super::{NamedChart, suffix};
use crate::labels::{self, Conditions, SENSE, STAGES};
use crate::results::{Cell, Results};

/// One chart at the alpha nearest to 4.
pub fn charts(results: &Results, conditions: Conditions) -> Vec<NamedChart> {
    let mut cells = super::cells(results, conditions);
    cells.retain(|cell| labels::frame_ms(cell).is_some());
    let cells = labels::nearest_to_four(&cells);
    let Some(alpha) = cells.first().map(|cell| cell.point.alpha) else { return Vec::new() };
    let rows = cells.iter().map(|cell| bar(cell)).collect();
    let footer = "Medians over the frames of a cell, stage by stage. The capture and the simulation of the sensor are \
                 not in it.";
    let title = format!("Where the time of a frame goes, alpha {alpha}, {}", labels::conditions(conditions));
    let body = Body::Bars(Bars { label: "time a frame, ms".to_owned(), rows });
    let name = format!("latency_{}", suffix(conditions));
    vec![NamedChart::new(name, title, results, footer.to_owned(), body)]
}

fn bar(cell: &Cell) -> Bar {
    let label = format!("{}, {}", labels::stream(&cell.point), labels::model(&cell.point));
    let timed = |stage: &&str| Some(((*stage).to_owned(), cell.latency_ms.get(*stage)?.p50));
    let parts = STAGES.iter().filter(|stage| **stage != SENSE).filter_map(timed).collect();
    let note = labels::frame_ms(cell).map_or(String::new(), |ms| format!("{ms:.1} ms"));
    Bar { label, parts, note }
}
