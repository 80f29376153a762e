//! The parameters of the `modulo_camera` node, and what they mean.

use std::time::Duration;

use modulo_core::sensor::{Sensor, SensorConfig};
use modulo_runtime::{Allowed, Descriptor, Parameters, Refusal, Value, imaging};

/// The node's parameters.
pub fn declare() -> Vec<Descriptor> {
    let double = |name, default, to, text| {
        Descriptor::new(name, Value::Double(default), Allowed::Doubles { from: 0.0, to }, text)
    };
    let integer = |name, default, from, to, text| {
        Descriptor::new(name, Value::Integer(default), Allowed::Integers { from, to }, text)
    };
    let mut declared = vec![
        Descriptor::new(
            "source",
            Value::String(String::new()),
            Allowed::Any,
            "where frames come from: a folder of images (png, jpg, exr, hdr), one image, a KITTI folder, a bag, \
             scene://NAME, or topic:NAME for an Image topic of a running stack",
        )
        .fixed(),
        Descriptor::new(
            "source_topic",
            Value::String(String::new()),
            Allowed::Any,
            "image topic to read when source is a bag with several; empty: the only one",
        )
        .fixed(),
        double("white", 0.0, 1e12, "linear radiance that maps to the peak, for EXR and HDR images; 0: the brightest \
             value of the first one")
            .fixed(),
        double("read_noise", 0.0, 65536.0, "sigma of the read noise in code units"),
        double("shot_noise", 0.0, 65536.0, "shot noise has sigma sqrt(shot_noise * x) in code units"),
        integer("seed", 0, 0, i64::MAX, "seed of the noise"),
        double("rate", 10.0, 10_000.0, "frames per second; 0: as fast as they can be made"),
        Descriptor::new("loop", Value::Bool(false), Allowed::Any, "start again when the source is over").fixed(),
        integer("frames", 0, 0, i64::MAX, "frames to send before ending; 0: all"),
    ];
    declared.extend(imaging::declare_range());
    declared.extend(imaging::declare_lens());
    declared
}

/// The sensor that the parameters describe.
pub fn sensor(parameters: &Parameters) -> Result<Sensor, Refusal> {
    let config = SensorConfig {
        bits: imaging::bits(parameters),
        alpha: parameters.double("alpha"),
        psf: imaging::psf(parameters),
        read_noise: parameters.double("read_noise"),
        shot_noise: parameters.double("shot_noise"),
    };
    Sensor::new(config).map_err(|why| imaging::refuse(parameters, &why))
}

/// Seed of the noise.
pub fn seed(parameters: &Parameters) -> u64 {
    parameters.integer("seed").unsigned_abs()
}

/// Time between two frames; zero: as fast as they can be made.
pub fn period(parameters: &Parameters) -> Duration {
    match parameters.double("rate") {
        0.0 => Duration::ZERO,
        rate => Duration::from_secs_f64(1.0 / rate.max(1e-6)),
    }
}

/// Frames to send, if not all.
pub fn limit(parameters: &Parameters) -> Option<u64> {
    match parameters.integer("frames").unsigned_abs() {
        0 => None,
        frames => Some(frames),
    }
}
