//! [`LiveOutput`]: a topic that a live node writes. A topic of images NAME has a compressed variant NAME/compressed, after the
//! convention of ROS's `image_transport`: PNG or JPEG files, which are made only while the variant has a reader.

use std::rc::Rc;
use std::sync::Arc;

use modulo_images::FileFormat;
use modulo_msgs::image::{encoding_of, restore};
use modulo_msgs::sensor_msgs::CompressedImage;
use modulo_runtime::topic::ImageCompression;
use modulo_runtime::{Address, Message, MessageKind, NodeName, Parameters, StampedFrame, Topic};

use crate::driver::RunError;
use crate::graph::overridden;
use crate::transport::{Publisher, Transport};

/// A topic with its publisher, and with its compressed variant if it has one.
pub(super) struct LiveOutput {
    pub address: Address,
    pub publisher: Rc<dyn Publisher>,
    variant: Option<(Address, Box<dyn Publisher>)>,
    compression: ImageCompression,
}

impl LiveOutput {
    /// Declares the publishers of `topic`, with the quality of service that `parameters` may give it.
    pub fn advertise(
        topic: &Topic,
        node: &NodeName,
        parameters: &Parameters,
        transport: &dyn Transport,
    ) -> Result<Self, RunError> {
        let mut address = Address::resolve(node, topic)?;
        address.profile = overridden(&address.topic, parameters);
        let publisher = transport.advertise(node, &address)?.into();
        let variant = match topic.compression {
            ImageCompression::None => None,
            ImageCompression::Lossless | ImageCompression::Any => {
                let address = compressed(&address);
                let publisher = transport.advertise(node, &address)?;
                Some((address, publisher))
            }
        };
        Ok(Self { address, publisher, variant, compression: topic.compression })
    }

    /// Returns whether the topic or its compressed variant has a reader now.
    pub fn wanted(&self) -> bool {
        self.publisher.wanted() || self.variant.as_ref().is_some_and(|(_, variant)| variant.wanted())
    }

    /// Returns the topic and its compressed variant, with their publishers.
    pub fn publishers(&self) -> impl Iterator<Item = (&str, &dyn Publisher)> {
        let variant = self.variant.iter().map(|(address, publisher)| (&*address.topic, &**publisher));
        std::iter::once((&*self.address.topic, &*self.publisher)).chain(variant)
    }

    /// Returns whether messages leave on `topic`.
    pub fn publishes(&self, topic: &str) -> bool {
        let variant = self.variant.as_ref().map(|(address, _)| &address.topic);
        self.address.topic == topic || variant.is_some_and(|variant| variant == topic)
    }

    /// Returns the topic on which a message of `kind` leaves, and its publisher.
    pub fn route(&self, kind: MessageKind) -> (&str, &dyn Publisher) {
        match &self.variant {
            Some((address, publisher)) if kind == MessageKind::CompressedImage => {
                (&address.topic, &**publisher)
            }
            _ => (&self.address.topic, &*self.publisher),
        }
    }

    /// Returns the compressed variant of `message`, if it is an image and the variant has a reader.
    pub fn compress(
        &self,
        message: &Message,
        format: impl FnOnce() -> FileFormat,
    ) -> Option<Result<Message, String>> {
        let (Message::Image(image), Some((_, variant))) = (message, &self.variant) else { return None };
        if !variant.wanted() {
            return None;
        }
        // JPEG has 8 bits and changes values, in a mosaic those of one colour by those of the others.
        let keeps = image.frame.depth() > 8
            || image.frame.mosaic().is_some()
            || self.compression == ImageCompression::Lossless;
        let format = if keeps { FileFormat::Png } else { format() };
        Some(compress(image, format).map(|file| Message::CompressedImage(Arc::new(file))))
    }
}

pub(super) fn compressed(address: &Address) -> Address {
    let topic = format!("{}/compressed", address.topic);
    Address { topic, kind: MessageKind::CompressedImage, ..address.clone() }
}

fn compress(image: &StampedFrame, format: FileFormat) -> Result<CompressedImage, String> {
    let StampedFrame { header, frame } = image;
    let data = modulo_images::encode(frame, format).map_err(|why| format!("cannot be compressed: {why}"))?;
    // As `compressed_image_transport` writes it: the encoding of the image, then the order of OpenCV's channels in the file.
    let channels = if frame.channels() == 3 { format!("bgr{}", frame.depth()) } else { String::new() };
    let format = format!("{}; {} compressed {channels}", encoding_of(frame), format.word());
    Ok(CompressedImage { header: header.clone(), format, data })
}

/// Returns the image in a file that came on the compressed variant of `topic`.
pub(super) fn decompress(file: &CompressedImage, topic: &Topic) -> Result<StampedFrame, String> {
    if topic.compression == ImageCompression::Lossless && file.data.starts_with(&JPEG) {
        return Err(
            "JPEG changes the values of a modulo image, which destroys its wraps; publish it as PNG".into()
        );
    }
    let frame = modulo_images::decode(&file.data, &file.format).map_err(|why| why.to_string())?;
    let frame = restore(frame, &file.format).map_err(|why| why.to_string())?;
    Ok(StampedFrame { header: file.header.clone(), frame })
}

/// The first bytes of a JPEG file.
const JPEG: [u8; 2] = [0xff, 0xd8];

#[cfg(test)]
mod tests {
    use modulo_core::{Frame, Mosaic};
    use modulo_msgs::std_msgs::{Header, Time};
    use ndarray::Array3;

    use super::*;

    #[test]
    fn an_image_comes_back_from_its_file() {
        let header = Header { stamp: Time::from_ns(7), frame_id: "camera_optical".into() };
        let ramp = |i: usize, j: usize, c: usize| 8 * i + 4 * j + 20 * c;
        let shape = |channels| (12, 16, channels);
        let eight = |channels| {
            Frame::from_u8(Array3::from_shape_fn(shape(channels), |(i, j, c)| ramp(i, j, c) as u8))
        };
        let deep = Frame::from_u16(Array3::from_shape_fn(shape(3), |(i, j, c)| 99 * ramp(i, j, c) as u16));
        for (frame, format, named) in [
            (eight(3), FileFormat::Png, "rgb8; png compressed bgr8"),
            (eight(1), FileFormat::Png, "mono8; png compressed "),
            (deep, FileFormat::Png, "rgb16; png compressed bgr16"),
            (
                eight(1).and_then(|frame| frame.with_mosaic(Mosaic::Grbg)),
                FileFormat::Png,
                "bayer_grbg8; png compressed ",
            ),
            (eight(3), FileFormat::Jpeg, "rgb8; jpeg compressed bgr8"),
        ] {
            let image = StampedFrame { header: header.clone(), frame: frame.expect("a frame") };
            let file = compress(&image, format).expect("a file");
            assert_eq!(file.format, named);
            let again = decompress(&file, &Topic::new("recovered", MessageKind::Image)).expect("an image");
            assert_eq!((&again.header, again.frame.mosaic()), (&header, image.frame.mosaic()));
            let apart = (again.frame.to_f32() - image.frame.to_f32()).mapv(f32::abs);
            let most = if format == FileFormat::Jpeg { 16.0 } else { 0.0 };
            assert!(apart.iter().all(|d| *d <= most), "{named}: {apart}");
            let modulo =
                Topic { compression: ImageCompression::Lossless, ..Topic::new("modulo", MessageKind::Image) };
            let refused = decompress(&file, &modulo).err();
            assert_eq!(refused.is_some_and(|why| why.contains("PNG")), format == FileFormat::Jpeg, "{named}");
        }
        let floats = Frame::from_f32(Array3::zeros((2, 2, 3))).expect("a frame");
        let why = compress(&StampedFrame { header, frame: floats }, FileFormat::Png)
            .expect_err("PNG has no floats");
        assert!(why.contains("cannot be compressed"), "{why}");
    }
}
