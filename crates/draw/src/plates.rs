//! [`place`]: places the labels of boxes so that they cover neither each other nor, if possible, objects.

use crate::primitives::{Area, Position};

/// Rings of places around a box, each half the height of a label farther away than the last.
const RINGS: u8 = 16;
/// Cost of a place that does not touch the box, and of each ring; 1 is the cost of a covered object.
const APART: f32 = 0.3;
const RING: f32 = 0.08;
/// Cost of a label that the line between a label and its box crosses.
const CROSSED: f32 = 0.2;

/// Places the label of each box, that of the first box first. `sizes` are width and height of the labels in px, `(width,
/// height)` is the size of the image. `None` if the label has no place within the image that is free of other labels.
///
/// The cost of a place is the covered part of each box (or of the label, if that is smaller), plus the distance, plus
/// the labels that the line to the box crosses.
pub fn place(boxes: &[Area], sizes: &[(f32, f32)], image: (f32, f32)) -> Vec<Option<Area>> {
    let mut placed: Vec<Option<Area>> = Vec::new();
    for (index, &size) in sizes.iter().enumerate() {
        let candidates = (0..=RINGS).flat_map(|ring| around(boxes[index], size, ring));
        let mut best: Option<(f32, Area)> = None;
        for (least, area) in candidates {
            if best.is_some_and(|(cost, _)| cost <= least) {
                break;
            }
            let Some(area) = within(area, image) else { break };
            if placed.iter().flatten().any(|other| shared(*other, area) > 0.0) {
                continue;
            }
            let lowest = best.map_or(f32::INFINITY, |(cost, _)| cost);
            let mut cost = least + covered(boxes, index, area, lowest - least);
            if cost < lowest {
                cost += crossed(&placed, boxes[index], area);
            }
            if cost < lowest {
                best = Some((cost, area));
            }
        }
        placed.push(best.map(|(_, area)| area));
    }
    placed
}

/// The ends of the line that connects a label to its box, if they do not touch.
pub fn connection(of: Area, label: Area) -> Option<(Position, Position)> {
    let middle = ((label.0 + label.2) / 2.0, (label.1 + label.3) / 2.0);
    let at_box = nearest(middle, of);
    let at_label = nearest(at_box, label);
    ((at_box.0 - at_label.0).abs().max((at_box.1 - at_label.1).abs()) > 1.0).then_some((at_box, at_label))
}

/// The places of a ring with their least costs, which rise from ring to ring. Ring 0 touches the box: above, below, inside,
/// right and left of it.
fn around((left, top, right, bottom): Area, (width, height): (f32, f32), ring: u8) -> Vec<(f32, Area)> {
    let corner = |(x, y): (f32, f32)| (x, y, x + width, y + height);
    if ring == 0 {
        let ends = (right - width, bottom - height);
        let places = [
            (left, top - height),
            (ends.0, top - height),
            (left, bottom),
            (ends.0, bottom),
            (left, top),
            (ends.0, top),
            (left, ends.1),
            (right, top),
            (left - width, top),
            (right, ends.1),
            (left - width, ends.1),
        ];
        return (0u8..).zip(places).map(|(rank, at)| (0.01 * f32::from(rank), corner(at))).collect();
    }
    let far = 0.5 * height * f32::from(ring);
    let columns = [left, right - width, (left + right - width) / 2.0, left - width - far, right + far];
    let rows = [top, bottom - height, (top + bottom - height) / 2.0];
    let above = columns.map(|x| (x, top - height - far));
    let below = columns.map(|x| (x, bottom + far));
    let sides = rows.map(|y| [(right + far, y), (left - width - far, y)]);
    let cost = APART + RING * f32::from(ring);
    above.into_iter().chain(below).chain(sides.into_iter().flatten()).map(|at| (cost, corner(at))).collect()
}

/// The label moved into the image. `None` if it is larger.
fn within((left, top, right, bottom): Area, image: (f32, f32)) -> Option<Area> {
    let (width, height) = (right - left, bottom - top);
    if width > image.0 || height > image.1 {
        return None;
    }
    let (x, y) = (left.clamp(0.0, image.0 - width), top.clamp(0.0, image.1 - height));
    Some((x, y, x + width, y + height))
}

/// How much of the boxes the label covers; the sum ends where it exceeds `most`. The own box counts less, as the label
/// belongs to it.
fn covered(boxes: &[Area], own: usize, label: Area, most: f32) -> f32 {
    let size = |area: Area| (area.2 - area.0) * (area.3 - area.1);
    let mut sum = 0.0;
    for (index, area) in boxes.iter().enumerate() {
        let common = shared(*area, label);
        if common > 0.0 {
            let weight = if index == own { 0.5 } else { 1.0 };
            sum += weight * common / size(*area).min(size(label)).max(1.0);
            if sum > most {
                break;
            }
        }
    }
    sum
}

/// The cost of the labels between a label and its box.
fn crossed(placed: &[Option<Area>], of: Area, label: Area) -> f32 {
    let Some((from, to)) = connection(of, label) else { return 0.0 };
    let near = |other: &&Area| {
        let (x, y) = ((from.0.min(to.0), from.0.max(to.0)), (from.1.min(to.1), from.1.max(to.1)));
        x.0 < other.2 && x.1 > other.0 && y.0 < other.3 && y.1 > other.1
    };
    let between = placed.iter().flatten().filter(near).filter(|other| crosses(from, to, **other));
    CROSSED * between.count() as f32
}

fn nearest(spot: Position, (left, top, right, bottom): Area) -> Position {
    (spot.0.clamp(left, right), spot.1.clamp(top, bottom))
}

/// Whether the line from `a` to `b` crosses the area, checked every 3 px.
fn crosses(a: Position, b: Position, area: Area) -> bool {
    let length = (b.0 - a.0).hypot(b.1 - a.1);
    let steps = (length / 3.0).ceil().clamp(1.0, 1000.0);
    (0..=steps as u16).any(|step| {
        let share = f32::from(step) / steps;
        let (x, y) = (a.0 + share * (b.0 - a.0), a.1 + share * (b.1 - a.1));
        x > area.0 && x < area.2 && y > area.1 && y < area.3
    })
}

fn shared(a: Area, b: Area) -> f32 {
    (a.2.min(b.2) - a.0.max(b.0)).max(0.0) * (a.3.min(b.3) - a.1.max(b.1)).max(0.0)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const IMAGE: (f32, f32) = (640.0, 192.0);

    fn disjoint(places: &[Option<Area>]) {
        for (index, place) in places.iter().enumerate() {
            let Some((left, top, right, bottom)) = *place else { continue };
            assert!(left >= 0.0 && top >= 0.0 && right <= IMAGE.0 && bottom <= IMAGE.1, "{place:?}");
            let others = places[..index].iter().flatten();
            others.for_each(|other| assert!(shared(*other, (left, top, right, bottom)) == 0.0, "{places:?}"));
        }
    }

    fn boxes(most: usize) -> impl Strategy<Value = Vec<Area>> {
        let one = (0.0f32..630.0, 0.0f32..180.0, 1.0f32..300.0, 1.0f32..150.0);
        let one = one.prop_map(|(x, y, w, h)| (x, y, (x + w).min(IMAGE.0), (y + h).min(IMAGE.1)));
        proptest::collection::vec(one, 0..most)
    }

    proptest! {
        #[test]
        fn labels_are_inside_and_apart(boxes in boxes(60), width in 1.0f32..700.0, height in 1.0f32..60.0) {
            disjoint(&place(&boxes, &vec![(width, height); boxes.len()], IMAGE));
        }

        #[test]
        fn twelve_labels_always_have_room(boxes in boxes(12)) {
            let places = place(&boxes, &vec![(90.0, 16.0); boxes.len()], IMAGE);
            prop_assert!(places.iter().all(Option::is_some), "{:?}", places);
            disjoint(&places);
        }
    }

    #[test]
    fn a_label_avoids_objects_and_prefers_the_place_above() {
        let alone = [(100.0, 100.0, 200.0, 150.0)];
        assert_eq!(place(&alone, &[(60.0, 16.0)], IMAGE), [Some((100.0, 84.0, 160.0, 100.0))]);
        let with_object_above = [alone[0], (100.0, 60.0, 200.0, 98.0)];
        let places = place(&with_object_above, &[(60.0, 16.0)], IMAGE);
        assert_eq!(places, [Some((100.0, 150.0, 160.0, 166.0))], "below");
    }

    #[test]
    fn a_label_in_a_crowd_is_connected_to_its_box() {
        let own = (300.0, 90.0, 310.0, 100.0);
        assert_eq!(connection(own, (300.0, 74.0, 360.0, 90.0)), None);
        assert_eq!(connection(own, (300.0, 40.0, 360.0, 56.0)), Some(((310.0, 90.0), (310.0, 56.0))));
    }
}
