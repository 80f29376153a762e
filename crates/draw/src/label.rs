use crate::primitives::{Area, Position, RADIUS};

/// Margin around a label, px.
const AIR: f32 = 2.0;

/// The areas that labels must not cover. It places labels near their points, one after the other.
pub struct LabelLayout {
    /// The panel. Labels stay inside it.
    pub within: Area,
    /// Areas of markers and labels.
    pub occupied: Vec<Area>,
    /// Lines (of series, and from labels to points) that labels avoid if possible.
    pub lines: Vec<(Position, Position)>,
}

impl LabelLayout {
    /// Adds the area of a marker.
    pub fn mark(&mut self, (x, y): Position) {
        let reach = RADIUS + 1.0;
        self.occupied.push((x - reach, y - reach, x + reach, y + reach));
    }

    /// Occupies the free area of lowest cost around `spot` for a label of this width and height. `None` if the panel is full.
    pub fn place(&mut self, spot: Position, size: (f32, f32)) -> Option<Area> {
        // Positions on rings around the point, the nearest ring first. The search is greedy: a label that is placed
        // stays. A chart has a few dozen labels, for which this is good enough, fast, and the same on every run.
        let candidates = (0..24).flat_map(|ring| (0..16).map(move |angle| (ring, angle)));
        let (left, top, right, bottom) = self.within;
        let mut best: Option<(f32, Area)> = None;
        for (ring, angle) in candidates {
            let far = RADIUS + 4.0 + 7.0 * ring as f32;
            // The cost is at least the distance: no position farther out can be better.
            if best.is_some_and(|(cost, _)| cost <= far) {
                break;
            }
            let area = around(spot, size, far, std::f32::consts::TAU * angle as f32 / 16.0);
            let is_inside = area.0 >= left && area.1 >= top && area.2 <= right && area.3 <= bottom;
            if !is_inside || self.occupied.iter().any(|other| overlap(*other, area)) {
                continue;
            }
            let cost = far + self.disorder(spot, area);
            if best.is_none_or(|(least, _)| cost < least) {
                best = Some((cost, area));
            }
        }
        let (_, area) = best?;
        self.occupied.push(area);
        // Later labels also avoid the line from this label to its point.
        self.lines.push((spot, nearest(spot, area)));
        Some(area)
    }

    /// Cost of an area in addition to its distance, px: lines below it, and labels below the line to its point.
    fn disorder(&self, spot: Position, area: Area) -> f32 {
        let under = self.lines.iter().filter(|(a, b)| crosses(*a, *b, area)).count();
        let edge = nearest(spot, area);
        // An area around the point itself, such as its marker, is crossed from every side: it decides nothing.
        let apart =
            |other: &Area| !(spot.0 > other.0 && spot.0 < other.2 && spot.1 > other.1 && spot.1 < other.3);
        let over = self.occupied.iter().filter(|other| apart(other) && crosses(spot, edge, **other)).count();
        20.0 * (under + over) as f32
    }
}

pub fn nearest(spot: Position, (left, top, right, bottom): Area) -> Position {
    (spot.0.clamp(left, right), spot.1.clamp(top, bottom))
}

fn overlap(a: Area, b: Area) -> bool {
    a.0 < b.2 + AIR && b.0 < a.2 + AIR && a.1 < b.3 + AIR && b.1 < a.3 + AIR
}

/// The area of this width and height that is about `far` px away from `spot`, in the direction of `angle`.
fn around(spot: Position, (width, height): (f32, f32), far: f32, angle: f32) -> Area {
    let x = spot.0 + angle.cos() * (far + width / 2.0) - width / 2.0;
    let y = spot.1 - angle.sin() * (far + height / 2.0) - height / 2.0;
    (x, y, x + width, y + height)
}

/// Whether the line from `a` to `b` crosses the area, checked every 3 px.
pub fn crosses(a: Position, b: Position, area: Area) -> bool {
    let length = (b.0 - a.0).hypot(b.1 - a.1);
    let steps = (length / 3.0).ceil().clamp(1.0, 1000.0);
    (0..=steps as u16).any(|step| {
        let share = f32::from(step) / steps;
        let (x, y) = (a.0 + share * (b.0 - a.0), a.1 + share * (b.1 - a.1));
        x > area.0 && x < area.2 && y > area.1 && y < area.3
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_crowd_of_equal_points_has_labels_side_by_side() {
        let within = (0.0, 0.0, 500.0, 400.0);
        let mut layout = LabelLayout { within, occupied: vec![], lines: vec![((0.0, 20.0), (500.0, 20.0))] };
        (0..30).for_each(|i| layout.mark((240.0 + (i % 3) as f32, 20.0)));
        let markers = layout.occupied.len();
        for i in 0..30 {
            let placed = layout.place((240.0 + (i % 3) as f32, 20.0), (48.0, 12.0));
            assert!(placed.is_some_and(|area| area.1 >= 0.0 && area.2 <= 500.0), "label {i}: {placed:?}");
        }
        for (i, a) in layout.occupied.iter().enumerate().skip(markers) {
            assert!(layout.occupied[..i].iter().all(|b| !overlap(*a, *b)), "label {i}");
        }
    }

    #[test]
    fn a_full_panel_has_no_place() {
        let within = (0.0, 0.0, 50.0, 40.0);
        let mut layout = LabelLayout { within, occupied: vec![within], lines: vec![] };
        assert_eq!(layout.place((20.0, 20.0), (10.0, 10.0)), None);
    }
}
