//! The scenes of the stability suite, and SSIM, by which methods of any origin are compared in Python.

use modulo_core::{Exposure, Recovered, metric};
use modulo_eval::stability::{self, Case};
use modulo_eval::up_to_offset;
use pyo3::prelude::*;

use crate::image::{eight_bits, frame_to_numpy, to_numpy, value_error};

/// Returns the mean structural similarity of two images of `uint8`; `None` for those that are smaller than its window.
#[pyfunction]
pub fn ssim(py: Python<'_>, left: &Bound<'_, PyAny>, right: &Bound<'_, PyAny>) -> PyResult<Option<f64>> {
    let (left, right) = (eight_bits("left", left)?, eight_bits("right", right)?);
    py.detach(|| metric::ssim(&left, &right)).map_err(value_error)
}

/// A method of the suite with its share of exact counts, that share up to an offset for each channel, and its trust.
type Own = (&'static str, f64, f64, Option<bool>);

/// The name, the family, the description, the bits, alpha, whether k is observable, the codes, the wrap counts, and what the methods of
/// the suite recover.
type Scene<'py> =
    (String, &'static str, String, u8, f64, bool, Bound<'py, PyAny>, Bound<'py, PyAny>, Vec<Own>);

/// Returns the number of scenes of the stability suite.
#[pyfunction]
pub fn stability_scenes() -> usize {
    stability::cases().len()
}

/// Returns a scene of the stability suite, by its number from 0.
#[pyfunction]
pub fn stability_scene(py: Python<'_>, number: usize) -> PyResult<Scene<'_>> {
    let examined = py.detach(|| {
        let cases = stability::cases();
        let most = cases.len();
        let case = cases.into_iter().nth(number).ok_or_else(|| {
            value_error(format!(
                "scene {number} does not exist; the scenes have the numbers 0 to {}",
                most - 1
            ))
        })?;
        let exposure = case.expose().map_err(value_error)?;
        let own = of_suite(case, &exposure)?;
        let described = (case.name.clone(), case.family.as_str(), case.what.clone(), case.is_observable());
        Ok::<_, PyErr>((described, exposure, own))
    });
    let ((name, family, what, observable), exposure, own) = examined?;
    let (bits, alpha) = (exposure.range().bits(), exposure.range().alpha());
    let (y, wraps) = (frame_to_numpy(py, exposure.modulo(), true), to_numpy(py, exposure.wraps(), true));
    Ok((name, family, what, bits, alpha, observable, y, wraps, own))
}

fn of_suite(case: &Case, exposure: &Exposure) -> PyResult<Vec<Own>> {
    let y = exposure.modulo();
    let own = case.methods().map_err(value_error)?.into_iter().map(|mut method| {
        let mut out = Recovered::default();
        method.unwrap(&y, &exposure.range().into(), &mut out).map_err(value_error)?;
        let exact = exposure.exact_share(&out.k).expect("a method keeps the shape of its image");
        Ok((method.name(), exact, up_to_offset(exposure, &out.k), out.report.trust.claim()))
    });
    own.collect()
}
