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

/// Appends words as their bytes.
fn push_words<T: Copy, const N: usize>(words: &[T], bytes: impl Fn(T) -> [u8; N], out: &mut Vec<u8>) {
    out.extend(words.iter().flat_map(|&word| bytes(word)));
}
