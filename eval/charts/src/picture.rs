//! [`Picture`]: an image with boxes.

use std::sync::Arc;

use crate::ChartError;

/// An image with boxes.
#[derive(Clone, Debug, PartialEq)]
pub struct Picture {
    pub(crate) width: u32,
    pub(crate) height: u32,
    pub(crate) rgb: Arc<[u8]>,
    pub(crate) boxes: Vec<([f32; 4], usize)>,
}

impl Picture {
    /// An image of `height` rows and `width` columns. `rgb` has red, green and blue of each pixel, row by row. A box is
    /// left, top, right and bottom in px of the image, and the index of its colour.
    ///
    /// # Errors
    /// [`ChartError::Picture`] if the number of samples does not fit.
    pub fn new(
        width: u32,
        height: u32,
        rgb: Vec<u8>,
        boxes: Vec<([f32; 4], usize)>,
    ) -> Result<Self, ChartError> {
        let needed = 3 * u64::from(width) * u64::from(height);
        if needed == 0 || rgb.len() as u64 != needed {
            return Err(ChartError::Picture(width, height, rgb.len()));
        }
        Ok(Self { width, height, rgb: rgb.into(), boxes })
    }
}
