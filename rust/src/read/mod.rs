//! Bytes to events: one push decoder a format, and the one reader that feeds them from a source.

mod reader;
mod text;

pub use reader::{Decode, EventReader};
pub use text::TextDecoder;
