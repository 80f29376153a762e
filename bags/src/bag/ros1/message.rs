//! Images of ROS 1 as CDR. ROS 1 packs fields without padding, has strings without a closing zero, and a sequence
//! number in the header.

use modulo_msgs::builtin::Time;
use modulo_msgs::cdr;
use modulo_msgs::sensor_msgs::{CameraInfo, CompressedImage, Image, RegionOfInterest};
use modulo_msgs::std_msgs::Header;

/// Converts a payload of ROS 1 to CDR with its encapsulation. The error describes the fault.
pub(super) type Convert = fn(&[u8]) -> Result<Vec<u8>, String>;

/// A type that is converted.
pub(super) struct Conversion {
    ros1: &'static str,
    /// MD5 sum of the definition in ROS 1; another sum means another layout.
    pub(super) md5: &'static str,
    /// Its name in ROS 2.
    pub(super) ros2: &'static str,
    pub(super) convert: Convert,
}

const KNOWN: [Conversion; 3] = [
    Conversion {
        ros1: "sensor_msgs/Image",
        md5: "060021388200f6f0f447d0fcd9c64743",
        ros2: "sensor_msgs/msg/Image",
        convert: |bytes| converted(bytes, image),
    },
    Conversion {
        ros1: "sensor_msgs/CompressedImage",
        md5: "8f7a12909da2c9d3332d540a0977563f",
        ros2: "sensor_msgs/msg/CompressedImage",
        convert: |bytes| converted(bytes, compressed_image),
    },
    Conversion {
        ros1: "sensor_msgs/CameraInfo",
        md5: "c9a58c1b0b154e0e6da7578cb991d214",
        ros2: "sensor_msgs/msg/CameraInfo",
        convert: |bytes| converted(bytes, camera_info),
    },
];

/// Returns the type `name` of ROS 1, if it is converted.
pub(super) fn known(name: &str) -> Option<&'static Conversion> {
    KNOWN.iter().find(|known| known.ros1 == name)
}

/// Returns the names of the types that are converted.
pub(super) fn known_names() -> String {
    KNOWN.map(|known| known.ros1).join(", ")
}

fn converted<T: serde::Serialize>(
    bytes: &[u8],
    read: fn(&mut Ros1Reader<'_>) -> Option<T>,
) -> Result<Vec<u8>, String> {
    let mut reader = Ros1Reader(bytes);
    let message = read(&mut reader).ok_or_else(|| format!("a message of {} bytes is cut", bytes.len()))?;
    // Bytes that are left over mean another layout than the MD5 sum promises.
    if !reader.0.is_empty() {
        return Err(format!("{} of {} bytes of a message are left over", reader.0.len(), bytes.len()));
    }
    cdr::to_vec(&message).map_err(|e| e.to_string())
}

/// The unread bytes of a message.
struct Ros1Reader<'a>(&'a [u8]);

impl<'a> Ros1Reader<'a> {
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

    /// Reads a string. ROS 1 does not define the encoding of strings, and CDR allows no zero in one.
    fn string(&mut self) -> Option<String> {
        Some(String::from_utf8_lossy(self.bytes()?).replace('\0', ""))
    }
}

fn header(reader: &mut Ros1Reader<'_>) -> Option<Header> {
    let _sequence = reader.u32()?;
    let (sec, nanosec) = (reader.u32()?, reader.u32()?);
    // ROS 1 counts seconds without a sign, ROS 2 with one.
    let stamp = i32::try_from(sec).map_or(Time::MAX, |sec| Time { sec, nanosec });
    Some(Header { stamp, frame_id: reader.string()? })
}

fn image(reader: &mut Ros1Reader<'_>) -> Option<Image> {
    Some(Image {
        header: header(reader)?,
        height: reader.u32()?,
        width: reader.u32()?,
        encoding: reader.string()?,
        is_bigendian: reader.byte()?,
        step: reader.u32()?,
        data: reader.bytes()?.to_vec(),
    })
}

fn compressed_image(reader: &mut Ros1Reader<'_>) -> Option<CompressedImage> {
    let (header, format) = (header(reader)?, reader.string()?);
    Some(CompressedImage { header, format, data: reader.bytes()?.to_vec() })
}

fn camera_info(reader: &mut Ros1Reader<'_>) -> Option<CameraInfo> {
    Some(CameraInfo {
        header: header(reader)?,
        height: reader.u32()?,
        width: reader.u32()?,
        distortion_model: reader.string()?,
        // Collected one by one: a broken length ends at the first missing number, before memory is allocated for it.
        d: (0..reader.u32()?).map(|_| reader.f64()).collect::<Option<_>>()?,
        k: reader.f64s()?,
        r: reader.f64s()?,
        p: reader.f64s()?,
        binning_x: reader.u32()?,
        binning_y: reader.u32()?,
        roi: RegionOfInterest {
            x_offset: reader.u32()?,
            y_offset: reader.u32()?,
            height: reader.u32()?,
            width: reader.u32()?,
            do_rectify: reader.byte()? != 0,
        },
    })
}
