//! [`SentImages`]: the images of a topic that a client was sent, whose pixels it can ask for.

use std::collections::VecDeque;
use std::sync::Arc;

use modulo_core::{Frame, Samples};
use modulo_msgs::std_msgs::Time;
use modulo_runtime::{LightScale, StampedFrame, StreamScale};

use crate::streams::drop_oldest;

/// Bytes of the images that are kept.
const KEPT_BYTES: usize = 16 << 20;

/// The newest images, and what their samples mean.
#[derive(Default)]
pub struct SentImages {
    images: VecDeque<(Arc<StampedFrame>, Option<StreamScale>)>,
}

impl SentImages {
    pub fn push(&mut self, image: Arc<StampedFrame>, scale: Option<StreamScale>) {
        self.images.push_back((image, scale));
        let samples = |f: &Frame| f.height() * f.width() * f.channels() * usize::from(f.depth()) / 8;
        drop_oldest(&mut self.images, KEPT_BYTES, |(image, _)| samples(&image.frame));
    }

    pub fn image(&self, stamp: Time) -> Option<&(Arc<StampedFrame>, Option<StreamScale>)> {
        self.images.iter().rfind(|(image, _)| image.header.stamp == stamp)
    }

    /// Returns the samples of the image of `stamp` at column `u` and row `v`, and their radiance where the stream has one. `None` where
    /// the image is no longer kept or has no such pixel.
    pub fn pixel(&self, stamp: Time, u: usize, v: usize) -> Option<(Vec<f32>, Vec<f64>)> {
        let (image, scale) = self.image(stamp)?;
        let is_inside = v < image.frame.height() && u < image.frame.width();
        let samples = is_inside.then(|| samples_at(&image.frame, v, u))?;
        let light = scale.and_then(|scale| Some((scale.most, scale.light?)));
        let radiance = |(most, light): (f64, LightScale)| {
            samples.iter().map(|&sample| light.radiance(f64::from(sample) / most)).collect()
        };
        let radiance = light.map_or_else(Vec::new, radiance);
        Some((samples, radiance))
    }
}

/// Returns the samples of the pixel in row `v` and column `u`, which must be inside of `frame`.
fn samples_at(frame: &Frame, v: usize, u: usize) -> Vec<f32> {
    let channels = 0..frame.channels();
    match frame.samples() {
        Samples::U8(codes) => channels.map(|c| f32::from(codes[[v, u, c]])).collect(),
        Samples::U16(codes) => channels.map(|c| f32::from(codes[[v, u, c]])).collect(),
        Samples::F32(values) => channels.map(|c| values[[v, u, c]]).collect(),
    }
}

#[cfg(test)]
mod tests {
    use modulo_msgs::std_msgs::Header;
    use modulo_runtime::{SensorModel, StreamKind};
    use ndarray::Array3;

    use super::*;

    #[test]
    fn a_pixel_is_that_of_the_image_that_is_asked_for() {
        let mut sent = SentImages::default();
        let sensor = SensorModel { alpha: 4.0, headroom: 1.0, ..SensorModel::default() };
        let scale = StreamScale::of(Some(StreamKind::Recovered), 8, Some(&sensor), 0);
        // A row more than a quarter of what is kept.
        let size = (1025, 4096, 1);
        for ns in 1..=4 {
            let frame = Frame::from_u8(Array3::from_elem(size, 51 * ns as u8)).expect("a frame");
            let header = Header { stamp: Time::from_ns(ns), frame_id: String::new() };
            sent.push(Arc::new(StampedFrame { header, frame }), scale);
        }
        let pixel = |u, ns| sent.pixel(Time::from_ns(ns), u, 1024);
        assert_eq!(pixel(4095, 2), Some((vec![102.0], vec![4.0 * 102.0 / 255.0])));
        assert_eq!(pixel(4096, 2), None, "right of the image");
        assert_eq!(pixel(0, 1), None, "no longer kept");
        assert_eq!(pixel(0, 5), None, "not yet sent");
    }
}
