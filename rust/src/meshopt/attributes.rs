//! Elements of vertices: in blocks, byte by byte, as differences to the element before.

use super::differences::{CHANNEL, Channel};
use crate::error::{Error, Result};

const BLOCK_BYTES: usize = 8192;
const MOST_IN_BLOCK: usize = 256;
/// Elements whose differences are stored alike.
const GROUP: usize = 16;

/// Decodes elements of `stride` bytes, and appends them to `elements`.
pub(super) fn decode(data: &[u8], count: usize, stride: usize, elements: &mut Vec<u8>) -> Result<()> {
    let layout = data.first().and_then(|&first| Layout::of(first, stride));
    let end = layout.and_then(|layout| data.len().checked_sub(layout.tail)).filter(|&end| end > 0);
    let Some((layout, end)) = layout.zip(end) else {
        return Err(Error::at_byte("attributes must begin with the byte 0xa0 or 0xa1 and end with an element", 0));
    };
    let (last, modes) = data[data.len() - stride - layout.modes..].split_at(stride);
    let mut channels = Vec::with_capacity(stride / CHANNEL);
    for (number, last) in last.as_chunks::<CHANNEL>().0.iter().enumerate() {
        let mode = modes.get(number).copied().unwrap_or(0);
        channels.push(Channel::new(mode, *last).ok_or_else(|| {
            let byte = data.len() - layout.modes + number;
            Error::at_byte(format!("attributes must have channels of mode 0, 1 or 2, got {mode:#04x}"), byte)
        })?);
    }
    let mut groups = Groups { data: &data[..end], at: 1 };
    let most = (BLOCK_BYTES / stride / GROUP * GROUP).min(MOST_IN_BLOCK);
    let (mut block, mut planes) = ([0; BLOCK_BYTES], [[0; MOST_IN_BLOCK]; CHANNEL]);
    for first in (0..count).step_by(most) {
        let size = most.min(count - first);
        let controls = if layout.controlled { groups.take(stride / CHANNEL, "block")? } else { &[] };
        for (number, channel) in channels.iter_mut().enumerate() {
            for (byte, plane) in planes.iter_mut().enumerate() {
                let control = controls.get(number).map(|control| control >> (2 * byte) & 3);
                groups.plane(control, plane, size)?;
            }
            channel.apply(&planes, size, &mut block[CHANNEL * number..], stride);
        }
        elements.extend_from_slice(&block[..size * stride]);
    }
    match end - groups.at {
        0 => Ok(()),
        left => Err(Error::at_byte(format!("{left} bytes of attributes are left over"), groups.at)),
    }
}

/// What differs between the versions of the stream.
#[derive(Clone, Copy)]
struct Layout {
    /// The data end with so many bytes, of which the last are an element, and the modes of its channels.
    tail: usize,
    modes: usize,
    /// Whether blocks begin with how each byte of the elements is stored.
    controlled: bool,
}

impl Layout {
    fn of(first: u8, stride: usize) -> Option<Self> {
        let modes = stride / CHANNEL;
        match first {
            0xa0 => Some(Self { tail: stride.max(32), modes: 0, controlled: false }),
            0xa1 => Some(Self { tail: (stride + modes).max(24), modes, controlled: true }),
            _ => None,
        }
    }
}

/// Reads groups of differences one after the other.
struct Groups<'a> {
    data: &'a [u8],
    at: usize,
}

impl Groups<'_> {
    /// Fills in the differences of one byte of a block's elements; `control` says how they are stored, where there is
    /// a choice.
    fn plane(&mut self, control: Option<u8>, plane: &mut [u8; MOST_IN_BLOCK], size: usize) -> Result<()> {
        let groups = &mut plane[..size.next_multiple_of(GROUP)];
        match control {
            None => self.groups([0, 2, 4, 8], groups),
            Some(0) => self.groups([0, 1, 2, 4], groups),
            Some(1) => self.groups([1, 2, 4, 8], groups),
            Some(2) => {
                groups.fill(0);
                Ok(())
            }
            Some(_) => {
                plane[..size].copy_from_slice(self.take(size, "block")?);
                Ok(())
            }
        }
    }

    /// Fills in whole groups, four to a byte that says which of the numbers of `bits` each has.
    fn groups(&mut self, bits: [u8; 4], groups: &mut [u8]) -> Result<()> {
        let kinds = self.take((groups.len() / GROUP).div_ceil(4), "block")?;
        for (number, group) in groups.as_chunks_mut::<GROUP>().0.iter_mut().enumerate() {
            match bits[usize::from(kinds[number / 4] >> (2 * (number % 4)) & 3)] {
                0 => group.fill(0),
                1 => self.short::<1>(group)?,
                2 => self.short::<2>(group)?,
                4 => self.short::<4>(group)?,
                _ => group.copy_from_slice(self.take(GROUP, "group")?),
            }
        }
        Ok(())
    }

    /// Fills in a group of differences of so few bits, the high ones first, but single ones the low ones first; those of
    /// ones alone are bytes that follow.
    fn short<const BITS: usize>(&mut self, group: &mut [u8; GROUP]) -> Result<()> {
        let (packed, whole) = (self.take(BITS * GROUP / 8, "group")?, (1 << BITS) - 1);
        for (number, delta) in group.iter_mut().enumerate() {
            let bit = BITS * number;
            let shift = if BITS == 1 { bit % 8 } else { 8 - BITS - bit % 8 };
            *delta = packed[bit / 8] >> shift & whole;
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
            return Err(Error::at_byte(format!("attributes end within a {within}"), self.data.len()));
        };
        self.at += count;
        Ok(bytes)
    }
}
