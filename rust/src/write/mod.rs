//! Events to bytes: one file a format, and the one writer that hands their bytes to a sink.

mod aedat4;
mod evt;
mod evt2;
mod evt3;
mod limits;
mod text;
mod writer;

pub use aedat4::{Aedat4Encoder, Compression};
pub use evt2::Evt2Encoder;
pub use evt3::Evt3Encoder;
pub use limits::Limits;
pub use text::TextEncoder;
pub use writer::{Encode, EventWriter};
