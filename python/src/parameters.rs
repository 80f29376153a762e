//! The parameters of the nodes as arguments of the functions: the declarations of the nodes give names, ranges and messages.

use modulo_camera::CameraParameters;
use modulo_detector::DetectorParameters;
use modulo_runtime::{Descriptor, ParameterError, ParameterSet as _, Parameters, SensorModel, Value};
use modulo_unwrap::UnwrapParameters;
use pyo3::IntoPyObjectExt as _;
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::image::value_error;

/// Returns the declarations of the nodes `modulo_camera`, `unwrap` and `detector`. What several have is declared as in the first: in Python
/// there is no sensor description that a value could be taken from. An array may be no image of a camera, and smaller than its black
/// columns: without a lens and such columns, nothing is assumed of it.
fn descriptors() -> Vec<Descriptor> {
    let mut all = CameraParameters::descriptors();
    for (declared, value) in SensorModel::unknown().declared() {
        all.iter_mut()
            .filter(|other| other.name == declared.name)
            .for_each(|other| other.default = value.clone());
    }
    for other in UnwrapParameters::descriptors().into_iter().chain(DetectorParameters::descriptors()) {
        if all.iter().all(|known| known.name != other.name) {
            all.push(other);
        }
    }
    all
}

/// The width of the lens, whose None stands for a lens that is not known.
const SIGMA: &str = "psf_sigma";

/// Returns the parameters with the values of `given`, and their defaults for all others.
///
/// # Errors
/// `ValueError` with the text that the node has for the value.
pub fn parse(given: &Bound<'_, PyDict>) -> PyResult<Parameters> {
    let changes: PyResult<Vec<_>> = given
        .iter()
        .filter(|(name, value)| !(value.is_none() && name.eq(SIGMA).unwrap_or(false)))
        .map(|(name, value)| {
            let name: String = name.extract()?;
            let value = to_value(&name, &value)?;
            Ok((name, value))
        })
        .collect();
    let mut changes = changes?;
    let is_unknown = given.get_item(SIGMA)?.is_none_or(|sigma| sigma.is_none());
    let gaussian = Value::String("gaussian".to_owned());
    for (_, shape) in
        changes.iter_mut().filter(|(name, shape)| is_unknown && name == "psf" && *shape == gaussian)
    {
        *shape = Value::String("unknown".to_owned());
    }
    Parameters::declare(descriptors()).with(&changes, false).map_err(value_error)
}

fn to_value(name: &str, given: &Bound<'_, PyAny>) -> PyResult<Value> {
    // A bool of Python is an integer, too, and an integer a float; numpy's scalars convert in the same way.
    let value = given.extract().map(Value::Bool);
    let value = value.or_else(|_| given.extract().map(Value::Integer));
    let value = value.or_else(|_| given.extract().map(Value::Double));
    value.or_else(|_| given.extract().map(Value::String)).map_err(|_: PyErr| {
        let shown = given.repr().map_or_else(|_| "?".to_owned(), |text| text.to_string());
        value_error(ParameterError::new(name, shown, "must be a number of 64 bits, a text or a bool"))
    })
}

/// The name, the default, the allowed values and the help of a parameter.
type Declaration<'py> = (&'static str, Bound<'py, PyAny>, String, &'static str);

/// Returns the declaration of each parameter.
#[pyfunction]
pub fn declared(py: Python<'_>) -> PyResult<Vec<Declaration<'_>>> {
    let row = |declared: Descriptor| {
        let default = match declared.default {
            Value::Bool(value) => value.into_bound_py_any(py),
            Value::Integer(value) => value.into_bound_py_any(py),
            Value::Double(value) => value.into_bound_py_any(py),
            Value::String(value) => value.into_bound_py_any(py),
            other => other.to_string().into_bound_py_any(py),
        };
        Ok((declared.name, default?, declared.allowed.to_string(), declared.description))
    };
    descriptors().into_iter().map(row).collect()
}
