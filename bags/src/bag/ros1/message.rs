//! Images of ROS 1 as CDR. ROS 1 packs fields without padding, has strings
//! without a closing zero, and a sequence number in the header.

use modulo_msgs::builtin::Time;
use modulo_msgs::cdr;
use modulo_msgs::sensor_msgs::{CameraInfo, CompressedImage, Image, RegionOfInterest};
use modulo_msgs::std_msgs::Header;

/// From a payload of ROS 1 to CDR with its encapsulation; an error says what is
/// wrong.
pub(super) type Convert = fn(&[u8]) -> Result<Vec<u8>, String>;

/// A type that is converted.
pub(super) struct Known {
    ros1: &'static str,
    /// Of the definition in ROS 1: another one is another layout.
    pub(super) md5: &'static str,
    /// Its name in ROS 2.
    pub(super) ros2: &'static str,
    pub(super) convert: Convert,
}

const KNOWN: [Known; 3] = [
    Known {
        ros1: "sensor_msgs/Image",
        md5: "060021388200f6f0f447d0fcd9c64743",
        ros2: "sensor_msgs/msg/Image",
        convert: |bytes| converted(bytes, image),
    },
    Known {
        ros1: "sensor_msgs/CompressedImage",
        md5: "8f7a12909da2c9d3332d540a0977563f",
        ros2: "sensor_msgs/msg/CompressedImage",
        convert: |bytes| converted(bytes, compressed_image),
    },
    Known {
        ros1: "sensor_msgs/CameraInfo",
        md5: "c9a58c1b0b154e0e6da7578cb991d214",
        ros2: "sensor_msgs/msg/CameraInfo",
        convert: |bytes| converted(bytes, camera_info),
    },
];

/// The type `name` of ROS 1, if it is converted.
pub(super) fn known(name: &str) -> Option<&'static Known> {
    KNOWN.iter().find(|known| known.ros1 == name)
}

/// Names of the types that are converted.
pub(super) fn known_names() -> String {
    KNOWN.map(|known| known.ros1).join(", ")
}

fn converted<T: serde::Serialize>(
    bytes: &[u8],
    read: fn(&mut Packed<'_>) -> Option<T>,
) -> Result<Vec<u8>, String> {
    let mut packed = Packed(bytes);
    let message = read(&mut packed).ok_or_else(|| format!("a message of {} bytes is cut", bytes.len()))?;
    if !packed.0.is_empty() {
        return Err(format!("{} of {} bytes of a message are left over", packed.0.len(), bytes.len()));
    }
    cdr::to_vec(&message).map_err(|e| e.to_string())
}

/// What is not read yet of a message.
struct Packed<'a>(&'a [u8]);

impl<'a> Packed<'a> {
    fn array<const N: usize>(&mut self) -> Option<[u8; N]> {
        let (array, rest) = self.0.split_first_chunk::<N>()?;
        self.0 = rest;
        Some(*array)
    }

    fn byte(&mut self) -> Option<u8> {
        self.array::<1>().map(|[byte]| byte)
    }

    fn u32(&mut self) -> Option<u32> {
        self.array().map(u32::from_le_bytes)
    }

    fn f64(&mut self) -> Option<f64> {
        self.array().map(f64::from_le_bytes)
    }

    fn f64s<const N: usize>(&mut self) -> Option<[f64; N]> {
        let mut all = [0.0; N];
        for value in &mut all {
            *value = self.f64()?;
        }
        Some(all)
    }

    fn bytes(&mut self) -> Option<&'a [u8]> {
        let length = usize::try_from(self.u32()?).ok()?;
        let (bytes, rest) = self.0.split_at_checked(length)?;
        self.0 = rest;
        Some(bytes)
    }

    /// ROS 1 does not say how strings are encoded, and CDR has no zero in one.
    fn string(&mut self) -> Option<String> {
        Some(String::from_utf8_lossy(self.bytes()?).replace('\0', ""))
    }
}

fn header(packed: &mut Packed<'_>) -> Option<Header> {
    let _sequence = packed.u32()?;
    let (sec, nanosec) = (packed.u32()?, packed.u32()?);
    let stamp = i32::try_from(sec).map_or(Time::MAX, |sec| Time { sec, nanosec });
    Some(Header { stamp, frame_id: packed.string()? })
}

fn image(packed: &mut Packed<'_>) -> Option<Image> {
    Some(Image {
        header: header(packed)?,
        height: packed.u32()?,
        width: packed.u32()?,
        encoding: packed.string()?,
        is_bigendian: packed.byte()?,
        step: packed.u32()?,
        data: packed.bytes()?.to_vec(),
    })
}

fn compressed_image(packed: &mut Packed<'_>) -> Option<CompressedImage> {
    let (header, format) = (header(packed)?, packed.string()?);
    Some(CompressedImage { header, format, data: packed.bytes()?.to_vec() })
}

fn camera_info(packed: &mut Packed<'_>) -> Option<CameraInfo> {
    Some(CameraInfo {
        header: header(packed)?,
        height: packed.u32()?,
        width: packed.u32()?,
        distortion_model: packed.string()?,
        d: (0..packed.u32()?).map(|_| packed.f64()).collect::<Option<_>>()?,
        k: packed.f64s()?,
        r: packed.f64s()?,
        p: packed.f64s()?,
        binning_x: packed.u32()?,
        binning_y: packed.u32()?,
        roi: RegionOfInterest {
            x_offset: packed.u32()?,
            y_offset: packed.u32()?,
            height: packed.u32()?,
            width: packed.u32()?,
            do_rectify: packed.byte()? != 0,
        },
    })
}
