//! The whole numbers of a stream: seven bits a byte, the low ones first.

use crate::error::{Error, Result};

/// Reads numbers one after the other.
pub(super) struct Numbers<'a> {
    data: &'a [u8],
    at: usize,
    /// The last index.
    pub(super) last: u32,
}

impl<'a> Numbers<'a> {
    /// Returns a reader of data from byte `at` to their end.
    pub(super) fn new(data: &'a [u8], at: usize) -> Self {
        Self { data, at, last: 0 }
    }

    pub(super) fn byte(&mut self) -> Result<u8> {
        let byte = *self.data.get(self.at).ok_or_else(|| Error::at_byte("indices end too early", self.at))?;
        self.at += 1;
        Ok(byte)
    }

    pub(super) fn number(&mut self) -> Result<u32> {
        let (start, mut value) = (self.at, 0);
        for shift in [0, 7, 14, 21, 28] {
            let byte = self.byte()?;
            value |= u32::from(byte & 127) << shift;
            if byte < 128 {
                return Ok(value);
            }
        }
        Err(Error::at_byte("a number of indices has more than 32 bits", start))
    }

    /// Returns an index, which is stored as its difference to the last one.
    pub(super) fn index(&mut self) -> Result<u32> {
        let value = self.number()?;
        self.last = self.last.wrapping_add(signed(value & 1 == 1, value >> 1));
        Ok(self.last)
    }

    /// Refuses data that are left over; `what` names them.
    pub(super) fn end(&self, what: &str) -> Result<()> {
        match self.data.len() - self.at {
            0 => Ok(()),
            left => Err(Error::at_byte(format!("{left} bytes of {what} are left over"), self.at)),
        }
    }
}

/// Returns a difference, of which the file has the size and whether it is negative, to be added with wrapping.
pub(super) fn signed(negative: bool, size: u32) -> u32 {
    if negative { !size } else { size }
}
