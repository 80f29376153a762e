//! The simulated sensor.

use std::sync::{Mutex, PoisonError};

use modulo_camera::CameraParameters;
use modulo_core::{AutoExposure, Frame};
use modulo_images::{Coding, White};
use ndarray::Array3;
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::image::{Image, Pixels, frame_to_numpy, to_numpy, value_error};
use crate::parameters::parse;

/// A simulated modulo sensor.
#[pyclass(frozen, module = "modulo_camera._core")]
pub struct Sensor {
    sensor: modulo_core::Sensor,
    auto_exposure: Mutex<AutoExposure>,
    seed: u64,
    coding: Coding,
    has_mosaic: bool,
}

/// A copy of the samples that `expose` was given.
enum Given {
    /// Radiance relative to full scale.
    Radiance(Array3<f32>),
    /// The codes of a picture.
    Codes(Frame),
}

#[pymethods]
impl Sensor {
    #[new]
    fn new(parameters: &Bound<'_, PyDict>) -> PyResult<Self> {
        let parameters = CameraParameters::from(&parse(parameters)?);
        let sensor = parameters.sensor.simulated().map_err(value_error)?;
        let auto_exposure = Mutex::new(parameters.sensor.auto_exposure().map_err(value_error)?);
        let coding = parameters.coding().map_err(value_error)?;
        let has_mosaic = parameters.sensor.mosaic.is_some();
        Ok(Self { sensor, auto_exposure, seed: parameters.seed.unsigned_abs(), coding, has_mosaic })
    }

    /// Returns the images modulo, saturated and ideal, and the true wrap counts.
    fn expose<'py>(&self, py: Python<'py>, radiance: &Bound<'py, PyAny>) -> PyResult<[Bound<'py, PyAny>; 4]> {
        let (given, is_flat) = self.given(radiance)?;
        let (modulo, saturated, ideal, wraps) = py.detach(|| -> PyResult<_> {
            let radiance = self.radiance(given)?;
            let exposure = self.sensor.expose(radiance.view(), self.seed).map_err(value_error)?;
            Ok((exposure.modulo(), exposure.saturated(), exposure.ideal(), exposure.wraps()))
        })?;
        let image = |frame| frame_to_numpy(py, frame, is_flat);
        Ok([image(modulo), image(saturated), image(ideal), to_numpy(py, wraps, is_flat)])
    }

    /// Returns the next image of the camera with automatic exposure, and its exposure.
    fn auto_expose<'py>(
        &self,
        py: Python<'py>,
        radiance: &Bound<'py, PyAny>,
    ) -> PyResult<(Bound<'py, PyAny>, f64)> {
        let (given, is_flat) = self.given(radiance)?;
        let (image, exposure) = py.detach(|| -> PyResult<_> {
            let radiance = self.radiance(given)?;
            let mut camera = self.auto_exposure.lock().unwrap_or_else(PoisonError::into_inner);
            let image = camera.expose(radiance.view(), self.seed).map_err(value_error)?;
            Ok((image, camera.exposure().expect("a frame was exposed")))
        })?;
        Ok((frame_to_numpy(py, image, is_flat), exposure))
    }
}

impl Sensor {
    /// Copies the samples, and returns whether the images are H x W.
    fn given(&self, radiance: &Bound<'_, PyAny>) -> PyResult<(Given, bool)> {
        let Image { pixels, is_flat } = Image::new("radiance", radiance)?;
        let Coding { white, black, ref knees, .. } = self.coding;
        let is_relative = white == 0.0 && black == 0.0 && knees.is_none();
        let given = match pixels {
            Pixels::F32(radiance) if is_relative => Given::Radiance(radiance.as_array().to_owned()),
            codes => Given::Codes(codes.to_frame().map_err(value_error)?),
        };
        Ok((given, is_flat || self.has_mosaic))
    }

    fn radiance(&self, given: Given) -> PyResult<Array3<f32>> {
        match given {
            Given::Radiance(radiance) => Ok(radiance),
            Given::Codes(frame) => {
                let mut coding = self.coding.clone();
                // Floats are fractions of full scale, and none is looked for.
                if frame.depth() == 32 && coding.knees.is_none() && coding.white == 0.0 {
                    coding.white = 1.0;
                }
                let mut white = White::new(coding).map_err(value_error)?;
                white.radiance(&frame, "radiance").map_err(value_error)
            }
        }
    }
}
