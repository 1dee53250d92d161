//! Sizes of the parts of a message, in bytes; see [`super`] for the parts.

/// Bytes of one event.
pub(super) const EVENT: usize = 13;

/// Bytes before `frame_id`, and between it and the first event.
pub(super) const BEFORE_NAME: usize = 16;
pub(super) const AFTER_NAME: usize = 12;
