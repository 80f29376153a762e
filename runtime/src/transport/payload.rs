//! [`Payload`]: the bytes of a sample, where the carrier left them.

use std::fmt;
use std::ops::Deref;
use std::sync::Arc;

/// Bytes that somebody keeps; cheap to clone, read as a slice.
#[derive(Clone)]
pub struct Payload(Arc<dyn AsRef<[u8]> + Send + Sync>);

impl Payload {
    /// The bytes of `keeper`.
    pub fn new(keeper: impl AsRef<[u8]> + Send + Sync + 'static) -> Self {
        Self(Arc::new(keeper))
    }
}

impl Deref for Payload {
    type Target = [u8];

    fn deref(&self) -> &[u8] {
        (*self.0).as_ref()
    }
}

impl fmt::Debug for Payload {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} bytes", self.len())
    }
}
