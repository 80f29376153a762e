//! [`Recovery`]: what `unwrap` says of one recovered image, on [`RECOVERY_TOPIC`](crate::topic::RECOVERY_TOPIC). The
//! status has the stamp of the image.

use modulo_msgs::diagnostic_msgs::DiagnosticArray;

/// The method of one recovered image, and its claim.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Recovery<'a> {
    /// The method that was used; empty where the status does not say it.
    pub method_used: &'a str,
    /// Whether the method claims that the wrap counts are right; `None` where it makes no claim, or the status has none
    /// that is understood.
    pub trusted: Option<bool>,
}

impl<'a> Recovery<'a> {
    /// The key of [`Recovery::trusted`].
    pub const TRUSTED: &'static str = "trusted";
    /// The key of [`Recovery::method_used`].
    pub const METHOD_USED: &'static str = "method_used";

    /// Reads the status of one image.
    pub fn of(status: &'a DiagnosticArray) -> Self {
        Self {
            method_used: status.value(Self::METHOD_USED).unwrap_or_default(),
            trusted: status.value(Self::TRUSTED).and_then(|claim| claim.parse().ok()),
        }
    }
}
