//! [`ChartError`]: why a chart could not be drawn.

/// Why there is no chart.
#[derive(Debug, thiserror::Error)]
pub enum ChartError {
    /// The embedded font.
    #[error("the font of the charts cannot be read: {0}")]
    Font(#[from] ttf_parser::FaceParsingError),
    /// More pixels than fit.
    #[error("a chart of {width} x {height} px cannot be painted")]
    Size {
        /// Columns.
        width: u32,
        /// Rows.
        height: u32,
    },
    /// Samples and size do not fit.
    #[error("a picture of {width} x {height} px has {found} samples, three a pixel are needed")]
    Picture {
        /// Columns.
        width: u32,
        /// Rows.
        height: u32,
        /// Samples found.
        found: usize,
    },
    /// The encoder refused.
    #[error("chart: {0}")]
    Encode(#[from] image::ImageError),
}
