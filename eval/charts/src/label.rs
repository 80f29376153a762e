//! Where labels go: near their points, on nothing else.

use crate::canvas::Spot;
use crate::style::RADIUS;

/// left, top, right, bottom, px.
pub type Area = (f32, f32, f32, f32);

/// Air around a label, px.
const AIR: f32 = 2.0;

/// A label to be placed.
pub struct Wanted {
    pub spot: Spot,
    pub width: f32,
    pub height: f32,
}

/// What labels keep off.
pub struct Crowd {
    /// The panel, which they do not leave.
    pub within: Area,
    /// Markers and labels.
    pub taken: Vec<Area>,
    /// Ends of lines, of series and from labels to points, which they avoid if they can.
    pub lines: Vec<(Spot, Spot)>,
}

impl Crowd {
    /// Keeps off a marker.
    pub fn mark(&mut self, (x, y): Spot) {
        let reach = RADIUS + 1.0;
        self.taken.push((x - reach, y - reach, x + reach, y + reach));
    }

    /// The cheapest free area around the spot, which is taken from then on; `None`: the panel is full.
    pub fn place(&mut self, wanted: &Wanted) -> Option<Area> {
        let candidates = (0..24).flat_map(|ring| (0..16).map(move |angle| (ring, angle)));
        let mut best: Option<(f32, Area)> = None;
        for (ring, angle) in candidates {
            let far = RADIUS + 4.0 + 7.0 * ring as f32;
            if best.is_some_and(|(cost, _)| cost <= far) {
                break;
            }
            let area = around(wanted, far, std::f32::consts::TAU * angle as f32 / 16.0);
            if !self.is_free(area) {
                continue;
            }
            let cost = far + self.disorder(wanted.spot, area);
            if best.is_none_or(|(least, _)| cost < least) {
                best = Some((cost, area));
            }
        }
        let (_, area) = best?;
        self.taken.push(area);
        self.lines.push((wanted.spot, nearest(wanted.spot, area)));
        Some(area)
    }

    /// What a label there costs beside its distance, px: lines under it, and labels under the line to its point.
    fn disorder(&self, spot: Spot, area: Area) -> f32 {
        let under = self.lines.iter().filter(|(a, b)| crosses(*a, *b, area)).count();
        let edge = nearest(spot, area);
        let apart =
            |other: &Area| !(spot.0 > other.0 && spot.0 < other.2 && spot.1 > other.1 && spot.1 < other.3);
        let over = self.taken.iter().filter(|other| apart(other) && crosses(spot, edge, **other)).count();
        20.0 * (under + over) as f32
    }

    fn is_free(&self, area: Area) -> bool {
        let (left, top, right, bottom) = self.within;
        let inside = area.0 >= left && area.1 >= top && area.2 <= right && area.3 <= bottom;
        inside && !self.taken.iter().any(|other| overlap(*other, area))
    }
}

/// The place of `area` that is nearest to `spot`.
pub fn nearest(spot: Spot, (left, top, right, bottom): Area) -> Spot {
    (spot.0.clamp(left, right), spot.1.clamp(top, bottom))
}

fn overlap(a: Area, b: Area) -> bool {
    a.0 < b.2 + AIR && b.0 < a.2 + AIR && a.1 < b.3 + AIR && b.1 < a.3 + AIR
}

/// The area whose nearest point to the spot is about `far` away in the direction of `angle`.
fn around(wanted: &Wanted, far: f32, angle: f32) -> Area {
    let (dx, dy) = (angle.cos(), -angle.sin());
    let x = wanted.spot.0 + dx * (far + wanted.width / 2.0) - wanted.width / 2.0;
    let y = wanted.spot.1 + dy * (far + wanted.height / 2.0) - wanted.height / 2.0;
    (x, y, x + wanted.width, y + wanted.height)
}

/// Whether the line from `a` to `b` passes the area: looked at every few px.
fn crosses(a: Spot, b: Spot, area: Area) -> bool {
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
        let mut crowd = Crowd { within, taken: vec![], lines: vec![((0.0, 20.0), (500.0, 20.0))] };
        (0..30).for_each(|i| crowd.mark((240.0 + (i % 3) as f32, 20.0)));
        let marks = crowd.taken.len();
        for i in 0..30 {
            let wanted = Wanted { spot: (240.0 + (i % 3) as f32, 20.0), width: 48.0, height: 12.0 };
            let placed = crowd.place(&wanted);
            assert!(placed.is_some_and(|area| area.1 >= 0.0 && area.2 <= 500.0), "label {i}: {placed:?}");
        }
        for (i, a) in crowd.taken.iter().enumerate().skip(marks) {
            assert!(crowd.taken[..i].iter().all(|b| !overlap(*a, *b)), "label {i}");
        }
    }

    #[test]
    fn a_full_panel_has_no_place() {
        let within = (0.0, 0.0, 50.0, 40.0);
        let mut crowd = Crowd { within, taken: vec![within], lines: vec![] };
        assert_eq!(crowd.place(&Wanted { spot: (20.0, 20.0), width: 10.0, height: 10.0 }), None);
    }
}
