//! What is wrong with a stream.

use crate::error::Error;

/// Returns the error of a rule that is broken at a byte of the data.
#[cold]
pub(super) fn fault(rule: impl Into<String>, byte: usize) -> Error {
    Error::Format { message: rule.into(), line: None, byte }
}
