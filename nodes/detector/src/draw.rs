//! The annotated image: boxes, names and scores on an 8-bit copy.
//!
//! The image is only for people; no result is read from it.

use modulo_core::{Detection, Frame, tone};
use modulo_draw::{LabelledBox, Picture, class_colour};
use modulo_runtime::{LightScale, StreamScale};
use ndarray::Array3;

/// Returns an RGB copy of `frame`, whose samples have this `scale`, with the detections `found` drawn in. An image of radiance is shown as
/// a screen needs it ([`LightScale::shown`]); any other one as it is.
pub fn annotated(frame: &Frame, scale: StreamScale, found: &[Detection]) -> Result<Frame, String> {
    let (height, width, channels) = frame.dim();
    let frame = tone::eight_bits(frame, scale.most as f32);
    let samples = frame.as_u8().expect("8 bits");
    let shown = scale.light.map_or_else(|| std::array::from_fn(|code| code as u8), LightScale::shown);
    let repeated = if channels == 1 { 3 } else { 1 };
    let rgb = samples.iter().flat_map(|&sample| std::iter::repeat_n(shown[usize::from(sample)], repeated));
    let rgb = rgb.collect();
    let labelled = |d: &Detection| LabelledBox {
        corners: [d.bbox.x1, d.bbox.y1, d.bbox.x2, d.bbox.y2],
        colour: class_colour(&d.class),
        label: format!("{} {:.2}", d.class, d.score),
    };
    let boxes = found.iter().map(labelled).collect();
    let side = |side: usize| u32::try_from(side).map_err(|_| format!("cannot draw on a side of {side} px"));
    let picture = Picture::new(side(width)?, side(height)?, rgb, boxes).map_err(|error| error.to_string())?;
    let drawn = picture.annotated().map_err(|error| error.to_string())?.into_raw();
    let pixels = Array3::from_shape_vec((height, width, 3), drawn).expect("three samples a pixel");
    Ok(Frame::from_u8(pixels).expect("the copy has the frame's size"))
}

/// Returns an RGB copy of a picture of 8 bits, grey or red, green and blue, with the detections `found` drawn in. All other pixels are
/// those of the picture.
///
/// # Errors
/// A text for a picture that is too large to be drawn on.
pub fn drawn(picture: &Frame, found: &[Detection]) -> Result<Frame, String> {
    annotated(picture, StreamScale::of(None, 8, None, 0).expect("8 bits have a range"), found)
}

#[cfg(test)]
mod tests {
    use modulo_core::BBox;
    use modulo_runtime::{SensorModel, StreamKind};
    use proptest::prelude::*;

    use super::*;

    fn edge() -> impl Strategy<Value = f32> {
        prop_oneof![4 => -10.0..30.0_f32, 1 => any::<f32>()]
    }

    fn drawn(shape: (usize, usize, usize), bbox: BBox) -> Array3<u8> {
        let frame = Frame::from_u16(Array3::zeros(shape)).expect("a frame");
        let found = [Detection { bbox, score: 0.5, class: "car".into() }];
        let scale = StreamScale::of(None, 16, None, 0).expect("the encoding's");
        let drawn = annotated(&frame, scale, &found).expect("drawn");
        drawn.as_u8().expect("8 bits are for people").clone()
    }

    #[test]
    fn a_box_has_its_classes_colour_and_an_empty_middle() {
        let pixels = drawn((100, 200, 1), BBox { x1: 20.0, y1: 30.0, x2: 180.0, y2: 90.0 });
        let at = |y: usize, x: usize| [pixels[[y, x, 0]], pixels[[y, x, 1]], pixels[[y, x, 2]]];
        for (y, x) in [(30, 100), (31, 100), (88, 100), (60, 20), (60, 179)] {
            assert_eq!(at(y, x), class_colour("car"), "({y}, {x})");
        }
        for (y, x) in [(60, 100), (29, 190), (92, 100), (60, 18), (60, 181), (32, 100), (87, 100)] {
            assert_eq!(at(y, x), [0; 3], "({y}, {x})");
        }
        let red = pixels.slice(ndarray::s![14..30, 20..60, 0]);
        let (ink, plate) = (red.iter().filter(|red| **red < 60), red.iter().filter(|red| **red == 255));
        let (ink, plate) = (ink.count(), plate.count());
        assert!(ink > 30 && plate > 200, "black letters on the colour of the class: {ink}, {plate}");
    }

    #[test]
    fn an_image_of_radiance_is_brighter_than_what_the_detector_reads() {
        let frame = Frame::from_u8(Array3::from_elem((8, 8, 3), 40)).expect("a frame");
        let sensor = SensorModel { alpha: 4.0, headroom: 1.0, ..SensorModel::default() };
        let corner = |kind| {
            let scale = StreamScale::of(kind, 8, Some(&sensor), 0).expect("integers");
            annotated(&frame, scale, &[]).expect("drawn").as_u8().expect("8 bits")[[0, 0, 0]]
        };
        assert_eq!(corner(None), 40);
        // 0.627 of the peak: 255 * srgb(t^1.8) with t = (0.627 + 0.627^2 / 16) / 1.627.
        assert_eq!(corner(Some(StreamKind::Recovered)), 121);
    }

    proptest! {
        /// The image keeps its size. A box is drawn if a pixel of the image lies in it, and leaves no trace if it is beyond
        /// the image or has no place.
        #[test]
        fn a_box_is_seen_where_it_meets_the_image(
            height in 1usize..20, width in 1usize..20, x1 in edge(), y1 in edge(), x2 in edge(), y2 in edge(),
        ) {
            let pixels = drawn((height, width, 3), BBox { x1, y1, x2, y2 });
            prop_assert_eq!(pixels.dim(), (height, width, 3));
            let ends = [(x1, x2, width), (y1, y2, height)];
            let is_finite = [x1, y1, x2, y2].iter().all(|at| at.is_finite());
            let meets = |&(from, to, side): &(f32, f32, usize)| from.max(0.0) + 1.0 < to.min(side as f32);
            let misses = |&(from, to, side): &(f32, f32, usize)| to < from || to < -1.0 || from > side as f32 + 1.0;
            let is_drawn = pixels.iter().any(|&sample| sample > 0);
            if is_finite && ends.iter().all(meets) {
                prop_assert!(is_drawn);
            }
            if !is_finite || ends.iter().any(misses) {
                prop_assert!(!is_drawn);
            }
        }
    }
}
