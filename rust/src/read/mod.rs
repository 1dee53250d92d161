//! Bytes to events: one push decoder a format, and the one reader that feeds them from a source.

mod aedat4;
mod ecf;
mod evt;
mod evt2;
mod evt21;
mod evt3;
mod reader;
#[cfg(test)]
mod testing;
mod text;

pub use aedat4::{
    Aedat4Decoder, Aedat4Frame, Aedat4Imu, Aedat4Kind, Aedat4Piece, Aedat4Recording, Aedat4Trigger, MAX_PACKET_BYTES,
};
pub use ecf::decode_ecf;
pub use evt2::Evt2Decoder;
pub use evt3::Evt3Decoder;
pub use evt21::Evt21Decoder;
pub use reader::{Block, Decode, DecoderState, EventReader};
pub use text::TextDecoder;
