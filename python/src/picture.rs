//! Radiance as an image of 8 bits, with or without the blur of the lens.

use modulo_core::{Deblur, Frame, FrameError, Range, tone};
use modulo_runtime::SensorModel;
use ndarray::{Array3, ArrayRef3};
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::image::{Image, Pixels, frame_to_numpy, value_error};
use crate::parameters::parse;

/// Returns the image of 8 bits of the radiance, deblurred on request.
#[pyfunction]
pub fn picture<'py>(
    py: Python<'py>,
    radiance: &Bound<'py, PyAny>,
    parameters: &Bound<'py, PyDict>,
    deblur: bool,
) -> PyResult<Bound<'py, PyAny>> {
    let parameters = parse(parameters)?;
    let sensor = SensorModel::from(&parameters);
    let range = sensor.range().map_err(value_error)?;
    let lens = deblur.then(|| sensor.psf());
    let (x, is_flat) = floats(radiance)?;
    let frame = py.detach(|| shown(&x, &sensor, lens.map(Deblur::new), range)).map_err(value_error)?;
    Ok(frame_to_numpy(py, frame, is_flat))
}

/// Returns the argument `radiance` as floats, and whether it has no axis of channels.
fn floats(radiance: &Bound<'_, PyAny>) -> PyResult<(Array3<f32>, bool)> {
    let Image { pixels, is_flat } = Image::new("radiance", radiance)?;
    let x = match pixels {
        Pixels::F32(x) => x.as_array().to_owned(),
        codes => codes.to_frame().map_err(value_error)?.to_f32(),
    };
    Ok((x, is_flat))
}

/// Returns the radiance `x` (H x W x C, code units) as the node `unwrap` shows it.
fn shown(
    x: &ArrayRef3<f32>,
    sensor: &SensorModel,
    deblur: Option<Deblur>,
    range: Range,
) -> Result<Frame, FrameError> {
    let colours: Option<Array3<f32>> = match sensor.mosaic {
        None => None,
        Some(mosaic) => {
            let (height, width, channels) = x.dim();
            if channels != 1 || height.min(width) < 2 {
                return Err(FrameError::Mosaic(height, width, channels, 16));
            }
            Some(mosaic.demosaic(x.view()))
        }
    };
    let x = colours.as_ref().map_or(x, |colours| colours);
    match deblur {
        None => tone::picture(x, range, sensor.transfer),
        Some(deblur) => deblur.picture(x, range, sensor.transfer),
    }
}
