//! The annotated image: boxes, names and scores on an 8-bit copy.
//!
//! The image is only for people; no result is read from it.

use modulo_charts::Picture;
use modulo_core::{Detection, Frame};
use ndarray::Array3;

use crate::classes::Classes;
use crate::pre::eight_bit;

/// Returns an RGB copy of `frame` with the detections `found` drawn in; `bits` as in [`eight_bit`].
///
/// # Errors
/// A message of one line when the pixels cannot be read or drawn on.
pub fn annotated(frame: &Frame, bits: u8, found: &[Detection], classes: &Classes) -> Result<Frame, String> {
    let (height, width, channels) = frame.dim();
    let samples = eight_bit(frame, bits)?;
    let rgb = match channels {
        1 => samples.iter().flat_map(|&sample| [sample; 3]).collect(),
        _ => samples.into_owned(),
    };
    // The best are drawn last, over all others.
    let found = || found.iter().rev();
    let corners = |d: &Detection| [d.bbox.x1, d.bbox.y1, d.bbox.x2, d.bbox.y2];
    let boxes = found().map(|d| (corners(d), classes.position(&d.class))).collect();
    let labels: Vec<String> = found().map(|d| format!("{} {:.2}", d.class, d.score)).collect();
    let side = |side: usize| u32::try_from(side).map_err(|_| format!("cannot draw on a side of {side} px"));
    let drawn = Picture::new(side(width)?, side(height)?, rgb, boxes).and_then(|p| p.annotated(&labels));
    let drawn = drawn.map_err(|error| error.to_string())?;
    let pixels = Array3::from_shape_vec((height, width, 3), drawn).expect("three samples a pixel");
    Ok(Frame::from_u8(pixels).expect("the copy has the frame's size"))
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use modulo_core::BBox;
    use proptest::prelude::*;

    use super::*;
    use crate::model::ClassNames;

    /// The second colour of the charts.
    const VERMILLION: [u8; 3] = [0xd5, 0x5e, 0];

    fn classes() -> Classes {
        Classes::new(&ClassNames::of(Path::new("none"), Some("{0: 'person', 1: 'car'}")), "", &[], None)
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
            assert_eq!(at(y, x), VERMILLION, "({y}, {x})");
        }
        for (y, x) in [(60, 100), (29, 190), (92, 100), (60, 18), (60, 181), (32, 100), (87, 100)] {
            assert_eq!(at(y, x), [0; 3], "({y}, {x})");
        }
        let blue = pixels.slice(ndarray::s![17..30, 20..60, 2]);
        let (ink, ground) = (blue.iter().filter(|blue| **blue > 200), blue.iter().filter(|blue| **blue == 0));
        let (ink, ground) = (ink.count(), ground.count());
        assert!(ink > 10 && ground > 200, "white letters on the colour of the class: {ink}, {ground}");
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
