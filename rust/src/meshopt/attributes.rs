//! Elements of vertices: in blocks, byte by byte, as differences to the element before.

use super::fault::fault;
use crate::error::Result;

const BLOCK_BYTES: usize = 8192;
const MOST_IN_BLOCK: usize = 256;
/// Elements whose differences are stored alike.
const GROUP: usize = 16;
/// The data end with one element, and with at least so many bytes.
const LEAST_TAIL: usize = 32;

/// Decodes elements of `stride` bytes, and appends them to `elements`.
pub(super) fn decode(data: &[u8], count: usize, stride: usize, elements: &mut Vec<u8>) -> Result<()> {
    let end = data.len().checked_sub(stride.max(LEAST_TAIL)).filter(|&end| end > 0 && data[0] == 0xa0);
    let Some(end) = end else {
        return Err(fault("attributes must begin with the byte 0xa0 and end with an element", 0));
    };
    let mut last = [0; MOST_IN_BLOCK];
    last[..stride].copy_from_slice(&data[data.len() - stride..]);
    let mut groups = Groups { data: &data[..end], at: 1 };
    let most = (BLOCK_BYTES / stride / GROUP * GROUP).min(MOST_IN_BLOCK);
    let (mut block, mut deltas) = ([0; BLOCK_BYTES], [0; MOST_IN_BLOCK]);
    for first in (0..count).step_by(most) {
        let size = most.min(count - first);
        for (byte, last) in last[..stride].iter_mut().enumerate() {
            groups.plane(&mut deltas[..size.next_multiple_of(GROUP)])?;
            for (element, delta) in block.chunks_exact_mut(stride).zip(&deltas[..size]) {
                *last = last.wrapping_add(delta >> 1 ^ (delta & 1).wrapping_neg());
                element[byte] = *last;
            }
        }
        elements.extend_from_slice(&block[..size * stride]);
    }
    match end - groups.at {
        0 => Ok(()),
        left => Err(fault(format!("{left} bytes of attributes are left over"), groups.at)),
    }
}

/// Reads groups of differences one after the other.
struct Groups<'a> {
    data: &'a [u8],
    at: usize,
}

impl Groups<'_> {
    /// Fills in the differences of one byte of a block's elements: whole groups, four to a byte that says their kinds.
    fn plane(&mut self, deltas: &mut [u8]) -> Result<()> {
        let kinds = self.take((deltas.len() / GROUP).div_ceil(4), "block")?;
        for (number, group) in deltas.as_chunks_mut::<GROUP>().0.iter_mut().enumerate() {
            match kinds[number / 4] >> (2 * (number % 4)) & 3 {
                0 => group.fill(0),
                1 => self.short::<2>(group)?,
                2 => self.short::<4>(group)?,
                _ => group.copy_from_slice(self.take(GROUP, "group")?),
            }
        }
        Ok(())
    }

    /// Fills in a group of differences of so few bits, the high ones first; those of ones alone are bytes that follow.
    fn short<const BITS: usize>(&mut self, group: &mut [u8; GROUP]) -> Result<()> {
        let (packed, whole) = (self.take(BITS * GROUP / 8, "group")?, (1 << BITS) - 1);
        for (number, delta) in group.iter_mut().enumerate() {
            let bit = BITS * number;
            *delta = packed[bit / 8] >> (8 - BITS - bit % 8) & whole;
        }
        let bytes = self.take(group.iter().map(|delta| usize::from(*delta == whole)).sum(), "group")?;
        for (delta, byte) in group.iter_mut().filter(|delta| **delta == whole).zip(bytes) {
            *delta = *byte;
        }
        Ok(())
    }
}

impl<'a> Groups<'a> {
    fn take(&mut self, count: usize, within: &str) -> Result<&'a [u8]> {
        let Some(bytes) = self.data[self.at..].get(..count) else {
            return Err(fault(format!("attributes end within a {within}"), self.data.len()));
        };
        self.at += count;
        Ok(bytes)
    }
}
