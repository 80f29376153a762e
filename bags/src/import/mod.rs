//! Data sets to bags, one file a data set. The same input gives the same bytes.

mod kitti;

pub use kitti::{ImportError, ImportOptions, ImportReport, import_kitti};
