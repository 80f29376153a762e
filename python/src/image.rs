//! numpy arrays as images of the core, and back.

use std::fmt::Display;

use modulo_core::{Frame, FrameError, Samples};
use ndarray::{Array3, Axis};
use numpy::{
    Element, IntoPyArray, PyArray3, PyArrayDescrMethods as _, PyArrayMethods, PyReadonlyArray3,
    PyUntypedArray, PyUntypedArrayMethods,
};
use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;

/// The largest number of samples of an image. On an image of noise, `gradient_tree` was measured to need 200 bytes of memory for each
/// of them, and the other methods 7 to 65.
const MOST_SAMPLES: usize = 1 << 27;

/// Returns the `ValueError` with the text of an error of the suite.
pub fn value_error(why: impl Display) -> PyErr {
    PyValueError::new_err(why.to_string())
}

/// An image that Python has given.
pub struct Image<'py> {
    /// Its samples, H x W x C in standard layout.
    pub pixels: Pixels<'py>,
    /// Whether the array was H x W, as the results shall be.
    pub is_flat: bool,
}

/// The samples of an [`Image`], which lie in the memory of numpy: another thread may write them as soon as the lock of Python is
/// released, so that a function copies what it reads without the lock.
pub enum Pixels<'py> {
    U8(PyReadonlyArray3<'py, u8>),
    U16(PyReadonlyArray3<'py, u16>),
    F32(PyReadonlyArray3<'py, f32>),
}

impl<'py> Image<'py> {
    /// Reads the array `given`, H x W or H x W x C, of the argument `name`. It is copied only if its layout is not the standard one.
    ///
    /// # Errors
    /// `TypeError` for what is no array, `ValueError` for another shape or type of samples.
    pub fn new(name: &str, given: &Bound<'py, PyAny>) -> PyResult<Self> {
        let array = given.cast::<PyUntypedArray>().map_err(|_| {
            let kind = given.get_type();
            PyTypeError::new_err(format!("{name} is of type {kind}, a numpy array is needed (numpy.asarray)"))
        })?;
        let (dim, is_flat) = match *array.shape() {
            [height, width] => ([height, width, 1], true),
            [height, width, channels] => ([height, width, channels], false),
            _ => {
                return Err(value_error(format!(
                    "{name} has {} dimensions, height x width or height x width x channels is needed",
                    array.ndim()
                )));
            }
        };
        let samples = dim.iter().try_fold(1usize, |samples, &side| samples.checked_mul(side));
        // Checked before anything is copied: an array may claim any size without having the memory for it.
        if samples.is_none_or(|samples| samples > MOST_SAMPLES) {
            let [height, width, channels] = dim;
            return Err(value_error(format!(
                "{name} has {height} x {width} x {channels} samples, at most {MOST_SAMPLES} are possible; cut it into tiles"
            )));
        }
        // numpy gives an empty array strides that ndarray does not take.
        match dim {
            [_, _, 0] => return Err(value_error(FrameError::Channels(0))),
            [height, width, _] if height * width == 0 => {
                return Err(value_error(FrameError::Empty(height, width)));
            }
            _ => {}
        }
        let pixels = Pixels::new(name, array, dim)?;
        Ok(Self { pixels, is_flat })
    }
}

/// Returns a copy of the array `given` of the argument `name`, an image of 8 bits.
///
/// # Errors
/// Those of [`Image::new`], and `ValueError` for other samples.
pub fn eight_bits(name: &str, given: &Bound<'_, PyAny>) -> PyResult<Array3<u8>> {
    match Image::new(name, given)?.pixels {
        Pixels::U8(pixels) => Ok(pixels.as_array().to_owned()),
        Pixels::U16(_) | Pixels::F32(_) => {
            Err(value_error(format!("{name} is no image of uint8; use tone_map")))
        }
    }
}

impl<'py> Pixels<'py> {
    fn new(name: &str, array: &Bound<'py, PyUntypedArray>, dim: [usize; 3]) -> PyResult<Self> {
        // `require` makes a plain array in order and aligned, and copies only what is not; `reshape` after it copies nothing.
        let numpy = array.py().import("numpy")?;
        // numpy's own type of floats is float64, which is rounded.
        let is_float = array.dtype().kind() == b'f';
        let sample = is_float.then(|| numpy::dtype::<f32>(array.py()));
        let required = numpy.call_method1("require", (array, sample, ["C", "A", "E"]))?;
        let cube = required.call_method1("reshape", (dim,))?;
        if let Ok(pixels) = cube.cast::<PyArray3<u8>>() {
            return Ok(Self::U8(pixels.try_readonly().map_err(value_error)?));
        }
        if let Ok(pixels) = cube.cast::<PyArray3<u16>>() {
            return Ok(Self::U16(pixels.try_readonly().map_err(value_error)?));
        }
        if let Ok(pixels) = cube.cast::<PyArray3<f32>>() {
            return Ok(Self::F32(pixels.try_readonly().map_err(value_error)?));
        }
        Err(value_error(format!(
            "{name} has samples of type {}, uint8, uint16 or float32 of this machine's byte order is needed (astype)",
            array.dtype()
        )))
    }

    /// Returns a copy as a frame.
    ///
    /// # Errors
    /// [`FrameError`] for what is no image.
    pub fn to_frame(&self) -> Result<Frame, FrameError> {
        match self {
            Self::U8(pixels) => Frame::from_u8(pixels.as_array().to_owned()),
            Self::U16(pixels) => Frame::from_u16(pixels.as_array().to_owned()),
            Self::F32(pixels) => Frame::from_f32(pixels.as_array().to_owned()),
        }
    }
}

/// Returns the array for Python without a copy. A flat one of a single channel is H x W, any other H x W x C.
pub fn to_numpy<T: Element>(py: Python<'_>, pixels: Array3<T>, is_flat: bool) -> Bound<'_, PyAny> {
    if is_flat && pixels.len_of(Axis(2)) == 1 {
        return pixels.index_axis_move(Axis(2), 0).into_pyarray(py).into_any();
    }
    pixels.into_pyarray(py).into_any()
}

/// Returns the samples of a frame for Python without a copy, as [`to_numpy`] does.
pub fn frame_to_numpy(py: Python<'_>, frame: Frame, is_flat: bool) -> Bound<'_, PyAny> {
    match frame.into_samples() {
        Samples::U8(pixels) => to_numpy(py, pixels, is_flat),
        Samples::U16(pixels) => to_numpy(py, pixels, is_flat),
        Samples::F32(pixels) => to_numpy(py, pixels, is_flat),
    }
}
