//! The mathematics of a modulo camera.
//!
//! Images are `H x W x C` [`ndarray::Array3`] in standard (row-major, interleaved) layout with `C` = 1 (mono) or
//! 3 (red, green, blue). Radiance is `f32` in *code units*: one unit is one step of the sensor's converter, the
//! peak is `2^bits`, and `x` lies in `[0, alpha * 2^bits)`.
//!
//! This crate reads no file, clock or environment, starts threads only when it is asked to, and does not know
//! messages and topics.

pub mod auto_exposure;
pub mod boxes;
pub mod candidates;
mod dct;
pub mod deblur;
pub mod display;
pub mod frame;
pub mod gains;
mod gains_mosaic;
pub mod gradient;
pub mod letterbox;
mod metering;
pub mod metric;
pub mod mosaic;
pub mod optics;
mod range;
mod reset_ramp;
pub mod sensor;
pub mod simd;
pub mod tone;
mod transfer;
pub mod unwrap;
mod workers;

pub use auto_exposure::{AutoExposure, ExposureControl};
pub use boxes::{BBox, Detection};
pub use deblur::Deblur;
pub use display::DisplayCurve;
pub use frame::{Frame, FrameError, SamplePosition, Samples};
pub use gains::{Gains, TwoGains};
pub use letterbox::Letterbox;
pub use metering::{Metering, exposed_anew};
pub use mosaic::Mosaic;
pub use optics::Psf;
pub use range::{Range, RangeError};
pub use reset_ramp::{RampError, ResetRamp, Resets};
pub use sensor::{Exposure, Sensor, SensorConfig, SensorError};
pub use transfer::Transfer;
pub use unwrap::{Recovered, Unwrap, UnwrapError};
pub use workers::{MAX_THREADS, WorkersError};
