//! The annotated image: boxes, names and scores on an 8-bit copy.
//!
//! For people only; nothing reads a result from it.

use modulo_core::{Detection, Frame};
use ndarray::Array3;

use crate::classes::Classes;
use crate::font;
use crate::pre::eight_bit;

type Colour = [u8; 3];

/// Okabe and Ito's palette, which colour-blind people can tell apart, without
/// black and grey.
const PALETTE: [Colour; 7] = [
    [230, 159, 0],
    [86, 180, 233],
    [0, 158, 115],
    [240, 228, 66],
    [0, 114, 178],
    [213, 94, 0],
    [204, 121, 167],
];
/// Thickness of a line, px.
const LINE: isize = 2;
/// Images of at least this many columns get letters of twice the size.
const WIDE: usize = 640;

/// An RGB copy of `frame` with `found` drawn in; `bits` as in [`eight_bit`].
///
/// # Errors
/// As [`eight_bit`].
pub fn annotated(frame: &Frame, bits: u8, found: &[Detection], classes: &Classes) -> Result<Frame, String> {
    let mut canvas = Canvas::of(frame, bits)?;
    // The best are drawn last, over all others.
    for detection in found.iter().rev() {
        let colour = PALETTE[classes.position(&detection.class) % PALETTE.len()];
        canvas.outline(detection, colour);
        canvas.label(detection, colour);
    }
    Ok(Frame::from_u8(canvas.pixels).expect("the copy has the frame's size"))
}

struct Canvas {
    pixels: Array3<u8>,
    zoom: isize,
}

impl Canvas {
    fn of(frame: &Frame, bits: u8) -> Result<Self, String> {
        let (height, width, channels) = frame.dim();
        let samples = eight_bit(frame, bits)?;
        let samples = if channels == 1 {
            samples.iter().flat_map(|&sample| [sample; 3]).collect()
        } else {
            samples.into_owned()
        };
        let pixels = Array3::from_shape_vec((height, width, 3), samples).expect("three samples a pixel");
        Ok(Self { pixels, zoom: if width < WIDE { 1 } else { 2 } })
    }

    /// Fills columns `x..x + width`, rows `y..y + height` as far as they lie in
    /// the image.
    fn fill(&mut self, x: isize, y: isize, width: isize, height: isize, colour: Colour) {
        let (rows, columns, _) = self.pixels.dim();
        let inside = |from: isize, length: isize, limit: usize| {
            let end = from.saturating_add(length).clamp(0, limit as isize);
            from.clamp(0, end) as usize..end as usize
        };
        for row in inside(y, height, rows) {
            for column in inside(x, width, columns) {
                for (channel, value) in colour.into_iter().enumerate() {
                    self.pixels[[row, column, channel]] = value;
                }
            }
        }
    }

    fn outline(&mut self, detection: &Detection, colour: Colour) {
        let [x1, y1, x2, y2] = corners(detection);
        let (width, height) = (x2 - x1, y2 - y1);
        self.fill(x1, y1, width, LINE, colour);
        self.fill(x1, y2 - LINE, width, LINE, colour);
        self.fill(x1, y1, LINE, height, colour);
        self.fill(x2 - LINE, y1, LINE, height, colour);
    }

    /// Above the box where there is room, else inside it.
    fn label(&mut self, detection: &Detection, colour: Colour) {
        let [x, y, ..] = corners(detection);
        let text = format!("{} {:.2}", detection.class, detection.score);
        let height = (font::HEIGHT as isize + 2) * self.zoom;
        let advance = (font::WIDTH as isize + 1) * self.zoom;
        let top = if y >= height { y - height } else { y };
        self.fill(x, top, advance * text.chars().count() as isize + self.zoom, height, colour);
        let ink = ink_on(colour);
        for (place, letter) in (0..).zip(text.chars()) {
            let left = x + self.zoom + place * advance;
            for (column, row) in font::ink(letter) {
                let (dx, dy) = (column as isize * self.zoom, (row as isize + 1) * self.zoom);
                self.fill(left + dx, top + dy, self.zoom, self.zoom, ink);
            }
        }
    }
}

/// x1, y1, x2, y2 in whole pixels, far from overflow.
fn corners(detection: &Detection) -> [isize; 4] {
    let bbox = detection.bbox;
    [bbox.x1, bbox.y1, bbox.x2, bbox.y2].map(|at| at.round().clamp(-1e6, 1e6) as isize)
}

/// Black or white, whichever is read more easily (luma of ITU-R BT.601).
fn ink_on([red, green, blue]: Colour) -> Colour {
    let luma = 299 * u32::from(red) + 587 * u32::from(green) + 114 * u32::from(blue);
    if luma >= 128_000 { [0; 3] } else { [255; 3] }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use modulo_core::BBox;
    use proptest::prelude::*;

    use super::*;
    use crate::model::Names;

    fn classes() -> Classes {
        Classes::new(&Names::of(Path::new("none"), Some("{0: 'person', 1: 'car'}")), "", &[], None)
            .expect("all")
    }

    fn drawn(shape: (usize, usize, usize), bbox: BBox) -> Array3<u8> {
        let frame = Frame::from_u16(Array3::zeros(shape)).expect("a frame");
        let found = [Detection { bbox, score: 0.5, class: "car".into() }];
        let drawn = annotated(&frame, 0, &found, &classes()).expect("drawn");
        drawn.as_u8().expect("8 bits are for people").clone()
    }

    #[test]
    fn a_box_has_its_classes_colour_and_an_empty_middle() {
        let pixels = drawn((100, 200, 1), BBox { x1: 20.0, y1: 30.0, x2: 180.0, y2: 90.0 });
        let at = |y: usize, x: usize| [pixels[[y, x, 0]], pixels[[y, x, 1]], pixels[[y, x, 2]]];
        for (y, x) in [(31, 100), (88, 100), (60, 20), (60, 179)] {
            assert_eq!(at(y, x), PALETTE[1], "({y}, {x})");
        }
        for (y, x) in [(60, 100), (29, 190), (92, 100), (60, 18), (60, 181), (32, 100), (87, 100)] {
            assert_eq!(at(y, x), [0; 3], "({y}, {x})");
        }
        let label = pixels.slice(ndarray::s![20..30, 20..70, ..]);
        assert!(label.iter().any(|&sample| sample == 86) && label.iter().any(|&sample| sample == 0));
    }

    proptest! {
        #[test]
        fn nothing_panics_at_any_edge(
            height in 1usize..20, width in 1usize..20,
            x1 in any::<f32>(), y1 in any::<f32>(), x2 in any::<f32>(), y2 in any::<f32>(),
        ) {
            drawn((height, width, 3), BBox { x1, y1, x2, y2 });
        }
    }
}
