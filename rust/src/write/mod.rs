//! Events to bytes: one file a format, and the one writer that hands their bytes to a sink.

mod limits;
mod text;
mod writer;

pub use limits::Limits;
pub use text::TextEncoder;
pub use writer::{Encode, EventWriter};
