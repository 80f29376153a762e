//! The unwrapping of modulo images.

use modulo_core::unwrap::{QualityMetrics, Recovered, Scene, of_gains};
use modulo_runtime::SensorModel;
use modulo_unwrap::UnwrapParameters;
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::image::{Image, frame_to_numpy, to_numpy, value_error};
use crate::parameters::parse;

/// Residues, steep, clamped, jumps and defects.
type Quality = (f32, f32, f32, f32, f32);

/// The method used, whether it trusts its result, the reason why not, the evidence for the offset, the quality metrics, and the confidence
/// image.
type Report<'py> = (
    &'static str,
    Option<bool>,
    Option<&'static str>,
    Option<&'static str>,
    Option<Quality>,
    Option<Bound<'py, PyAny>>,
);

/// Returns the radiance, the wrap counts, and the report of the method.
#[pyfunction]
pub fn unwrap<'py>(
    py: Python<'py>,
    codes: &Bound<'py, PyAny>,
    parameters: &Bound<'py, PyDict>,
    confidence: bool,
) -> PyResult<(Bound<'py, PyAny>, Bound<'py, PyAny>, Report<'py>)> {
    let parameters = parse(parameters)?;
    let sensor = SensorModel::from(&parameters);
    let (mosaic, range, gains) =
        (sensor.mosaic, sensor.range().map_err(value_error)?, sensor.gains().map_err(value_error)?);
    let options = UnwrapParameters::from(&parameters);
    let mut method = match of_gains(gains) {
        Some(method) => method,
        None => options.method().map_err(value_error)?,
    };
    // Nothing waits for a single image, so that the work has no limit.
    let scene = Scene { lens: sensor.lens(), noise: sensor.noise(), ..Scene::from(range) };
    let Image { pixels, is_flat } = Image::new("codes", codes)?;
    let mut frame = pixels.to_frame().map_err(value_error)?;
    if let Some(mosaic) = mosaic {
        frame = frame.with_mosaic(mosaic).map_err(value_error)?;
    }
    let (recovered, confidence) = py.detach(|| -> PyResult<_> {
        let mut recovered = Recovered::default();
        method.unwrap(&frame, &scene, &mut recovered).map_err(value_error)?;
        let confidence = confidence.then(|| recovered.confidence(mosaic, range));
        Ok((recovered, confidence))
    })?;
    let Recovered { x, k, report, .. } = recovered;
    let confidence = confidence.map(|frame| frame_to_numpy(py, frame, true));
    Ok((to_numpy(py, x, is_flat), to_numpy(py, k, is_flat), fields(&report, confidence)))
}

fn fields<'py>(report: &modulo_core::unwrap::Report, confidence: Option<Bound<'py, PyAny>>) -> Report<'py> {
    let quality = report.quality.map(|quality| {
        let QualityMetrics { residues, steep, clamped, jumps, defects } = quality;
        (residues, steep, clamped, jumps, defects)
    });
    (report.method, report.trust.claim(), report.reason(), report.offset_evidence(), quality, confidence)
}
