//! Exposure after the capture: the counts of a frame that a browser was sent are recovered once more, shown with another exposure, and
//! looked at by the model of the detector.

use std::collections::BTreeMap;
use std::sync::Arc;

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use modulo_core::unwrap::{Method, Options, Recovered, Scene, of_gains};
use modulo_core::{Detection, Frame, exposed_anew, tone};
use modulo_images::FileFormat;
use modulo_runtime::{SensorModel, StampedFrame, StreamKind, StreamScale};
use ndarray::Array3;

use crate::protocol::{BoxView, ExposedView};
use crate::shown::ShownImage;
use crate::watch::Audience;

/// The work of `auto`, as `unwrap` has it by default.
const WORK: f64 = 225.0;
/// The largest change of the exposure, in stops.
const STOPS: f64 = 6.0;

/// Finds the objects in a picture by the model of the detector whose `~/state` has these values.
pub type FindBoxes = dyn FnMut(&BTreeMap<String, String>, &Frame) -> Result<Vec<Detection>, String> + Send;

/// What is known of a frame that is to be exposed anew.
pub(crate) struct Captured {
    pub modulo: Arc<StampedFrame>,
    pub sensor: SensorModel,
    /// The stream whose picture is shown.
    pub kind: StreamKind,
    /// The values of the detector, if there is one.
    pub detector: Option<BTreeMap<String, String>>,
}

pub(crate) struct Exposer {
    find: Box<FindBoxes>,
    /// The radiance of the last frame: a slider asks for it again and again.
    last: Option<(Arc<StampedFrame>, SensorModel, Array3<f32>)>,
}

impl Exposer {
    pub fn new(find: Box<FindBoxes>) -> Self {
        Self { find, last: None }
    }

    /// Returns the picture of `captured` with an exposure of so many `stops` more, and the boxes in it.
    pub fn expose(&mut self, captured: &Captured, stops: f64) -> Result<ExposedView, String> {
        let sensor = &captured.sensor;
        let picture = picture(self.radiance(captured)?, captured, stops)?;
        let scale = StreamScale::of(Some(captured.kind), picture.depth(), Some(sensor), 0);
        let shown = ShownImage::of(&picture, scale, Audience::Page);
        let jpeg = modulo_images::encode(&shown.frame, FileFormat::Jpeg).map_err(|why| why.to_string())?;
        let (boxes, why) = match &captured.detector {
            None => (None, String::new()),
            Some(values) => match (self.find)(values, &picture) {
                Ok(found) => (Some(found.into_iter().map(BoxView::from).collect()), String::new()),
                Err(why) => (None, why),
            },
        };
        Ok(ExposedView { jpeg: STANDARD.encode(jpeg), boxes, why })
    }

    fn radiance(&mut self, captured: &Captured) -> Result<&Array3<f32>, String> {
        let Captured { modulo, sensor, .. } = captured;
        let is_last =
            |(last, of, _): &(Arc<StampedFrame>, SensorModel, _)| Arc::ptr_eq(last, modulo) && of == sensor;
        if !self.last.as_ref().is_some_and(is_last) {
            self.last = Some((modulo.clone(), sensor.clone(), recovered(&modulo.frame, sensor)?));
        }
        Ok(&self.last.as_ref().expect("it was set above").2)
    }
}

/// Returns the radiance of a modulo image in code units, with three colours at each pixel of a mosaic.
fn recovered(modulo: &Frame, sensor: &SensorModel) -> Result<Array3<f32>, String> {
    let range = sensor.range().map_err(|why| why.to_string())?;
    let scene = Scene { range, lens: sensor.lens(), noise: sensor.noise(), work: WORK, radiance: true };
    let method = of_gains(sensor.gains().map_err(|why| why.to_string())?);
    let mut method =
        method.map_or_else(|| Method::Auto.build(&Options::default()), Ok).map_err(|why| why.to_string())?;
    let mut recovered = Recovered::default();
    method.unwrap(modulo, &scene, &mut recovered).map_err(|why| why.to_string())?;
    Ok(match modulo.mosaic() {
        None => recovered.x,
        Some(mosaic) => mosaic.demosaic(recovered.x.view()),
    })
}

/// Returns the picture of the radiance `x` as a detector gets it: what is brighter than its white clips.
fn picture(x: &Array3<f32>, captured: &Captured, stops: f64) -> Result<Frame, String> {
    let SensorModel { metering, metering_target, transfer, .. } = captured.sensor;
    let mut range = captured.sensor.range().map_err(|why| why.to_string())?;
    if captured.kind == StreamKind::Metered {
        range = exposed_anew(x, range, metering, metering_target);
    }
    // No white lies beyond the end of the range, so that a darker picture has darker samples.
    let gain = stops.clamp(-STOPS, STOPS).exp2();
    let headroom = range.white() / range.limit() / gain.max(1.0);
    let range =
        range.with_headroom(headroom).expect("a gain from 1 to 2^20 leaves a headroom above 0 and at most 1");
    tone::picture(&x.mapv(|x| x * gain.min(1.0) as f32), range, transfer).map_err(|why| why.to_string())
}

#[cfg(test)]
mod tests {
    use modulo_core::BBox;
    use modulo_msgs::std_msgs::Header;

    use super::*;

    fn captured(kind: StreamKind, detector: Option<BTreeMap<String, String>>) -> Captured {
        let sensor = SensorModel { alpha: 4.0, headroom: 1.0, ..SensorModel::default() };
        let codes = Array3::from_shape_fn((48, 128, 1), |(row, column, _)| ((row + 6 * column) % 256) as u8);
        let frame = Frame::from_u8(codes).expect("a frame");
        Captured {
            modulo: Arc::new(StampedFrame { header: Header::default(), frame }),
            sensor,
            kind,
            detector,
        }
    }

    /// The codes of the picture that a detector gets.
    fn codes(stops: f64, kind: StreamKind) -> Array3<f32> {
        let captured = captured(kind, None);
        let x = recovered(&captured.modulo.frame, &captured.sensor).expect("a sensor");
        picture(&x, &captured, stops).expect("a picture").to_f32()
    }

    #[test]
    fn a_stop_more_doubles_each_code_and_clips_and_one_less_halves_it() {
        let (less, same, more) = (
            codes(-1.0, StreamKind::Recovered),
            codes(0.0, StreamKind::Recovered),
            codes(1.0, StreamKind::Recovered),
        );
        assert!(
            same.iter().any(|code| *code > 180.0),
            "the counts are recovered: {:?}",
            same.iter().copied().fold(0.0, f32::max)
        );
        for ((less, same), more) in less.iter().zip(&same).zip(&more) {
            assert!(
                (less - same / 2.0).abs() <= 1.0 && (more - (2.0 * same).min(255.0)).abs() <= 1.5,
                "{less} {same} {more}"
            );
        }
        assert!(more.iter().any(|code| *code == 255.0));
        let (metered, brighter) = (codes(0.0, StreamKind::Metered), codes(2.0, StreamKind::Metered));
        assert!(
            metered.mean() >= same.mean() && brighter.mean() > metered.mean(),
            "from the exposure of the frame on"
        );
    }

    #[test]
    fn boxes_are_those_that_the_model_of_the_detector_finds_in_the_new_picture() {
        let find = |values: &BTreeMap<String, String>, picture: &Frame| {
            let model = values.get("model_path").ok_or("no model")?;
            let bbox = BBox { x1: 0.0, y1: 0.0, x2: picture.to_f32().mean().unwrap_or(0.0), y2: 1.0 };
            Ok(vec![Detection { bbox, score: 0.5, class: model.clone() }])
        };
        let mut exposer = Exposer::new(Box::new(find));
        let values = BTreeMap::from([("model_path".to_owned(), "demo".to_owned())]);
        let mut found = |stops, detector| {
            let exposed =
                exposer.expose(&captured(StreamKind::Recovered, detector), stops).expect("a picture");
            let jpeg = STANDARD.decode(&exposed.jpeg).expect("base64");
            assert!(jpeg.starts_with(&[0xff, 0xd8]));
            (exposed.boxes.map(|boxes| (boxes[0].class.clone(), boxes[0].edges[2])), exposed.why)
        };
        let [(dark, _), (bright, _)] = [-2.0, 2.0].map(|stops| found(stops, Some(values.clone())));
        let ((class, dark), (_, bright)) = (dark.expect("boxes"), bright.expect("boxes"));
        assert!(class == "demo" && bright > 4.0 * dark, "{dark} {bright}");
        assert_eq!(found(1.0, None), (None, String::new()));
        assert_eq!(found(1.0, Some(BTreeMap::new())), (None, "no model".to_owned()));
    }
}
