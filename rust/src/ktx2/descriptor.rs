//! What the data format descriptor says of texels.
//!
//! Source: Khronos Group, Khronos Data Format Specification 1.3, section 5 (basic descriptor block).

use crate::error::{Error, Result};

/// Bytes of a descriptor before its samples, with its size in front.
pub(super) const HEAD: usize = 28;
/// Bytes of a sample.
pub(super) const SAMPLE: usize = 16;

/// What the numbers of texels stand for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Transfer {
    /// The file does not say.
    Unsaid,
    /// They are proportional to what they mean.
    Linear,
    /// They are encoded as sRGB.
    Srgb,
}

/// The parts of a descriptor that are read.
pub(super) struct Descriptor {
    pub(super) model: u8,
    pub(super) transfer: Transfer,
    /// The channels of the samples, in their order.
    pub(super) channels: Vec<u8>,
}

impl Descriptor {
    /// Reads the first block of a descriptor, which begins at byte `start` of the file.
    pub(super) fn read(bytes: &[u8], start: usize) -> Result<Self> {
        let broken = || Error::at_byte("a KTX2 file must have a basic descriptor with a sample", start);
        let (head, samples) = bytes.split_at_checked(HEAD).ok_or_else(broken)?;
        let stated = usize::from(u16::from_le_bytes([head[10], head[11]])).saturating_sub(HEAD - 4) / SAMPLE;
        let samples = samples.as_chunks::<SAMPLE>().0.get(..stated).filter(|samples| !samples.is_empty());
        let samples = samples.filter(|_| head[4..8] == [0; 4]).ok_or_else(broken)?;
        let transfer = match head[14] {
            0 => Transfer::Unsaid,
            1 => Transfer::Linear,
            2 => Transfer::Srgb,
            other => {
                let rule = format!("texels must be linear or in sRGB, got the transfer function {other}");
                return Err(Error::at_byte(rule, start + 14));
            }
        };
        if head[15] & 1 == 1 {
            let rule = "colours are multiplied by the opacity: export them as they are (straight alpha)";
            return Err(Error::at_byte(rule, start + 15));
        }
        // The low half of the byte is the channel, the high one how its numbers are stored.
        let channels = samples.iter().map(|sample| sample[3] & 15).collect();
        Ok(Self { model: head[12], transfer, channels })
    }
}
