//! The module `modulo_camera._core`: the sensor, the unwrapping, the detector and the scores of the suite on numpy arrays.
//!
//! This crate converts arrays, parameters and results. The crates of the suite compute, while Python runs other threads. The package `modulo_camera`, in `package/modulo_camera`, gives these functions their types and documents them.

mod detector;
mod image;
mod parameters;
mod picture;
mod recording;
mod score;
mod sensor;
mod stability;
mod unwrap;

use pyo3::prelude::*;

/// The module that Python imports.
#[pymodule]
mod _core {
    #[pymodule_export]
    use super::detector::{Network, draw, read_image};
    #[pymodule_export]
    use super::parameters::declared;
    #[pymodule_export]
    use super::picture::picture;
    #[pymodule_export]
    use super::recording::{Bag, Source};
    #[pymodule_export]
    use super::score::average_precision;
    #[pymodule_export]
    use super::sensor::Sensor;
    #[pymodule_export]
    use super::stability::{ssim, stability_scene, stability_scenes};
    #[pymodule_export]
    use super::unwrap::unwrap;
    use super::*;

    #[pymodule_init]
    fn init(module: &Bound<'_, PyModule>) -> PyResult<()> {
        module.add("DEMO_LIMIT", modulo_detector::DEMO_LIMIT)?;
        module.add("METHODS", modulo_core::unwrap::METHODS.to_vec())?;
        module.add("__version__", env!("CARGO_PKG_VERSION"))
    }
}
