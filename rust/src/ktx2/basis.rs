//! Blocks of Basis Universal, ETC1S and UASTC: a small file of the finest level alone is made of parts that have been
//! checked, and the crate `basisu` decodes that.

use std::panic::catch_unwind;

use basisu::{DecodeFlags, TargetFormat, Transcoder};

use super::container::{Container, MAGIC, word};
use super::descriptor::{HEAD, SAMPLE};
use crate::error::{Error, Result};

/// Bytes of the counts that ETC1S blocks share, and of each image after them.
const IMAGE: usize = 20;
/// Bytes before the descriptor of a file with one level.
const HEADER: usize = 104;
/// Bytes of a UASTC block, which has 4 x 4 texels.
const BLOCK: usize = 16;

/// The kinds of blocks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Blocks {
    Etc1s,
    Uastc,
}

impl Blocks {
    /// Returns a kind by the colour model of a descriptor.
    pub(super) fn of(model: u8) -> Option<Self> {
        match model {
            163 => Some(Self::Etc1s),
            166 => Some(Self::Uastc),
            _ => None,
        }
    }

    /// Decodes the blocks of a file: `level` as it was before it was compressed once more.
    pub(super) fn rgba(self, file: &Container, level: &[u8]) -> Result<Vec<u8>> {
        let small = match self {
            Self::Etc1s => small_file(self, file, &shared_by_one(file)?, level),
            Self::Uastc => small_file(self, file, &[], level),
        };
        // The crate lets numbers wrap around, which is a panic in builds that check overflows.
        let decoded = catch_unwind(|| Transcoder::new(&small)?.transcode(0, TargetFormat::Rgba32, DecodeFlags::NONE));
        let Ok(Ok(mut texels)) = decoded else {
            return Err(Error::at_byte(format!("blocks of {self:?} break a rule of Basis Universal"), file.level_at));
        };
        if self.has_two_channels(&file.descriptor.channels) {
            for texel in texels.as_chunks_mut::<4>().0 {
                *texel = [texel[0], texel[3], 0, 255];
            }
        }
        Ok(texels)
    }

    /// Bytes of the blocks of an image.
    pub(super) fn bytes(width: u32, height: u32) -> usize {
        width.div_ceil(4) as usize * height.div_ceil(4) as usize * BLOCK
    }

    /// Whether the first channel is red, and what is decoded as opacity is green.
    fn has_two_channels(self, channels: &[u8]) -> bool {
        match self {
            Self::Etc1s => channels == [3, 4],
            Self::Uastc => channels == [5],
        }
    }
}

/// Returns what the blocks of an ETC1S file share, for the finest level alone.
fn shared_by_one(file: &Container) -> Result<Vec<u8>> {
    let short = || Error::at_byte("what ETC1S blocks share is cut short", 64);
    let (head, rest) = file.shared.split_at_checked(IMAGE).ok_or_else(short)?;
    let (images, codebooks) = rest.split_at_checked(IMAGE * file.levels).ok_or_else(short)?;
    let sizes = [4, 8, 12].map(|at| word(head, at));
    let mut needed = 0u64;
    for size in sizes {
        needed += u64::from(size?);
    }
    if needed > codebooks.len() as u64 {
        return Err(short());
    }
    let mut slices = vec![(word(images, 4)?, word(images, 8)?)];
    if file.descriptor.channels.len() == 2 {
        slices.push((word(images, 12)?, word(images, 16)?));
    }
    for (start, length) in slices {
        if length == 0 || u64::from(start) + u64::from(length) > file.level.len() as u64 {
            return Err(Error::at_byte("a slice of ETC1S blocks is empty, or beyond the end of its level", 64));
        }
    }
    // No image follows from another one: the flags of the first are left out.
    Ok([head, &[0; 4], &images[4..IMAGE], codebooks].concat())
}

/// Returns a file of one level.
fn small_file(blocks: Blocks, file: &Container, shared: &[u8], level: &[u8]) -> Vec<u8> {
    let channels = &file.descriptor.channels;
    let (scheme, model, samples, unpacked) = match blocks {
        Blocks::Etc1s => (1, 163, channels.len().min(2), 0),
        Blocks::Uastc => (0, 166, 1, level.len()),
    };
    #[allow(clippy::cast_possible_truncation, reason = "44 or 60 bytes")]
    let described = (HEAD + SAMPLE * samples) as u32;
    let start = HEADER + described as usize;
    let mut small = MAGIC.to_vec();
    // No format of Vulkan, sizes, depth, layers, faces, levels; where the descriptor is; no metadata.
    for number in [0, 1, file.width, file.height, 0, 0, 1, 1, scheme, 104, described, 0, 0] {
        small.extend(number.to_le_bytes());
    }
    for number in [start, shared.len(), start + shared.len(), level.len(), unpacked] {
        small.extend((number as u64).to_le_bytes());
    }
    // Blocks of 4 x 4 texels, in sRGB; the transfer function does not change what is decoded.
    for number in [described, 0, 2 | (described - 4) << 16, model | 1 << 8 | 2 << 16, 0x0303, 0, 0] {
        small.extend(number.to_le_bytes());
    }
    for &channel in &channels[..samples] {
        small.extend([[0, 0, 63, channel], [0; 4], [0; 4], [255; 4]].as_flattened());
    }
    [&small, shared, level].concat()
}
