//! The container: where the finest level is, what describes it, and what else the file says.

use super::arrangement::Arrangement;
use super::descriptor::Descriptor;
use crate::error::{Error, Result};

/// What a file begins with.
pub(super) const MAGIC: &[u8] = b"\xabKTX 20\xbb\r\n\x1a\n";
/// Where the table of levels begins.
const TABLE: usize = 80;
/// Bytes of a level in that table.
const ENTRY: usize = 24;
/// A whole chain of levels down to one texel has no more.
const MOST_LEVELS: u32 = 32;

/// The parts of a file that its finest level needs.
pub(super) struct Container<'a> {
    /// The number of the format in Vulkan; 0 where the descriptor alone says what it is.
    pub(super) format: u32,
    pub(super) width: u32,
    pub(super) height: u32,
    /// How levels are compressed once more.
    pub(super) scheme: u32,
    /// How many levels there are.
    pub(super) levels: usize,
    pub(super) descriptor: Descriptor,
    pub(super) arrangement: Arrangement,
    /// What all levels share.
    pub(super) shared: &'a [u8],
    /// The finest level, and where it begins.
    pub(super) level: &'a [u8],
    pub(super) level_at: usize,
}

impl<'a> Container<'a> {
    /// Finds the parts of a file.
    pub(super) fn read(data: &'a [u8]) -> Result<Self> {
        if !data.starts_with(MAGIC) {
            return Err(Error::at_byte("a KTX2 file must begin with its magic bytes", 0));
        }
        let [format, _, width, height, depth, layers, faces, levels, scheme] =
            [12, 16, 20, 24, 28, 32, 36, 40, 44].map(|at| word(data, at));
        let (width, height) = (width?, height?);
        if width == 0 || height == 0 || depth? > 0 || layers? > 1 || faces? != 1 {
            return Err(Error::at_byte("a KTX2 file must have one image with a width and a height", 20));
        }
        let levels = levels?.max(1);
        if levels > MOST_LEVELS {
            return Err(Error::at_byte(format!("a KTX2 file may have {MOST_LEVELS} levels, got {levels}"), 40));
        }
        let described = part(data, word(data, 48)?.into(), word(data, 52)?.into(), "descriptor", 48)?;
        let said = part(data, word(data, 56)?.into(), word(data, 60)?.into(), "metadata", 56)?;
        let shared = part(data, long(data, 64)?, long(data, 72)?, "shared data", 64)?;
        // The table of levels must be there as a whole; the finest one comes first.
        long(data, TABLE + ENTRY * levels as usize - 8)?;
        let start = long(data, TABLE)?;
        let level = part(data, start, long(data, TABLE + 8)?, "finest level", TABLE)?;
        Ok(Self {
            format: format?,
            width,
            height,
            scheme: scheme?,
            levels: levels as usize,
            descriptor: Descriptor::read(described, word(data, 48)? as usize)?,
            arrangement: Arrangement::read(said, word(data, 56)? as usize)?,
            shared,
            level,
            level_at: usize::try_from(start).unwrap_or(usize::MAX),
        })
    }
}

/// Returns a part of the file; `stated` is the byte that says where it is.
fn part<'a>(data: &'a [u8], start: u64, length: u64, what: &str, stated: usize) -> Result<&'a [u8]> {
    let range = usize::try_from(start).ok().zip(usize::try_from(length).ok());
    let range = range.and_then(|(start, length)| Some(start..start.checked_add(length)?));
    range.and_then(|range| data.get(range)).ok_or_else(|| {
        Error::at_byte(format!("a KTX2 file of {} bytes has its {what} beyond its end", data.len()), stated)
    })
}

/// Returns a number of 32 bits.
pub(super) fn word(data: &[u8], at: usize) -> Result<u32> {
    Ok(u32::from_le_bytes(*bytes(data, at)?))
}

fn long(data: &[u8], at: usize) -> Result<u64> {
    Ok(u64::from_le_bytes(*bytes(data, at)?))
}

fn bytes<const N: usize>(data: &[u8], at: usize) -> Result<&[u8; N]> {
    let found = data.get(at..).and_then(|rest| rest.first_chunk());
    found.ok_or_else(|| Error::at_byte("a KTX2 file ends within its header", data.len()))
}
