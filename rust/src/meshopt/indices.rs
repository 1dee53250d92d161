//! Indices in any order: each is near one of the two that came last, each in a line of its own.

use super::numbers::{Numbers, signed};
use crate::error::{Error, Result};

/// The bytes after the numbers.
const TAIL: usize = 4;

/// Decodes indices, and hands each on.
pub(super) fn decode(data: &[u8], count: usize, mut push: impl FnMut(u32)) -> Result<()> {
    let Some(data) = data.len().checked_sub(TAIL).map(|end| &data[..end]).filter(|data| data.first() == Some(&0xd1))
    else {
        return Err(Error::at_byte("indices must begin with the byte 0xd1 and end with four bytes", 0));
    };
    let mut numbers = Numbers::new(data, 1);
    let mut last = [0u32; 2];
    for _ in 0..count {
        let value = numbers.number()?;
        let line = &mut last[usize::from(value & 1 == 1)];
        *line = line.wrapping_add(signed(value & 2 == 2, value >> 2));
        push(*line);
    }
    numbers.end("indices")
}
