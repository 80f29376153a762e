//! The table of encodings that can be read.
//!
//! Source: `sensor_msgs/image_encodings.hpp`.

/// Size of one sample.
#[derive(Clone, Copy)]
pub(super) enum Depth {
    U8,
    U16,
    F32,
}

/// The channels of one pixel, in order.
#[derive(Clone, Copy)]
pub(super) enum Channels {
    Mono,
    Rgb,
    Bgr,
    Rgba,
    Bgra,
}

/// The form of the bytes of a pixel.
#[derive(Clone, Copy)]
pub(super) struct Encoding {
    pub(super) depth: Depth,
    pub(super) channels: Channels,
}

const ENCODINGS: [(&str, Depth, Channels); 14] = [
    ("rgb8", Depth::U8, Channels::Rgb),
    ("bgr8", Depth::U8, Channels::Bgr),
    ("mono8", Depth::U8, Channels::Mono),
    ("rgba8", Depth::U8, Channels::Rgba),
    ("bgra8", Depth::U8, Channels::Bgra),
    ("rgb16", Depth::U16, Channels::Rgb),
    ("bgr16", Depth::U16, Channels::Bgr),
    ("mono16", Depth::U16, Channels::Mono),
    ("8UC1", Depth::U8, Channels::Mono),
    ("8UC3", Depth::U8, Channels::Bgr),
    ("16UC1", Depth::U16, Channels::Mono),
    ("16UC3", Depth::U16, Channels::Bgr),
    ("32FC1", Depth::F32, Channels::Mono),
    ("32FC3", Depth::F32, Channels::Bgr),
];

impl Encoding {
    pub(super) fn of(name: &str) -> Option<Self> {
        let found = ENCODINGS.iter().find(|(known, ..)| *known == name);
        found.map(|&(_, depth, channels)| Self { depth, channels })
    }

    /// Returns the number of bytes of one pixel.
    pub(super) fn pixel(self) -> u64 {
        let sample = match self.depth {
            Depth::U8 => 1,
            Depth::U16 => 2,
            Depth::F32 => 4,
        };
        let samples = match self.channels {
            Channels::Mono => 1,
            Channels::Rgb | Channels::Bgr => 3,
            Channels::Rgba | Channels::Bgra => 4,
        };
        sample * samples
    }
}

pub(super) fn names() -> String {
    ENCODINGS.map(|(name, ..)| name).join(", ")
}
