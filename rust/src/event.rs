//! The event: the one type in which every source and every consumer meet.

/// A brightness change at one pixel, in 16 bytes.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct Event {
    /// Microseconds from the start of the sequence.
    pub t: i64,
    /// Column, to the right from 0.
    pub x: u16,
    /// Row, down from 0.
    pub y: u16,
    /// Polarity: 1 = ON (brighter), 0 = OFF (darker).
    pub p: u8,
    /// Padding written out, so that equal events are equal bytes.
    padding: [u8; 3],
}

impl Event {
    /// Returns an event at `t` microseconds in pixel (`x`, `y`); `on` is its polarity.
    #[must_use]
    pub const fn new(t: i64, x: u16, y: u16, on: bool) -> Self {
        Self { t, x, y, p: on as u8, padding: [0; 3] }
    }

    /// Returns the same event at another time.
    pub(crate) const fn at(self, t: i64) -> Self {
        Self { t, ..self }
    }

    /// Returns an event at `t` microseconds, of the bytes of its other fields, first one lowest: made of two words, it
    /// is stored as two words.
    #[inline]
    pub(crate) const fn from_words(t: i64, fields: u64) -> Self {
        let [x0, x1, y0, y1, p, padding @ ..] = fields.to_le_bytes();
        Self { t, x: u16::from_le_bytes([x0, x1]), y: u16::from_le_bytes([y0, y1]), p, padding }
    }

    /// Returns the row-major index of its pixel.
    #[inline]
    pub(crate) fn pixel(&self, size: SensorSize) -> usize {
        usize::from(self.y) * usize::from(size.width) + usize::from(self.x)
    }
}

/// Width and height of a sensor in pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SensorSize {
    /// Columns.
    pub width: u16,
    /// Rows.
    pub height: u16,
}

impl SensorSize {
    /// Returns the number of pixels.
    #[must_use]
    pub const fn pixels(self) -> usize {
        self.width as usize * self.height as usize
    }

    /// Returns (x, y) of a pixel by its row-major index.
    #[must_use]
    #[allow(clippy::cast_possible_truncation, reason = "the quotient and remainder fit the sensor's u16 sides")]
    pub const fn xy(self, index: usize) -> (u16, u16) {
        let width = self.width as usize;
        ((index % width) as u16, (index / width) as u16)
    }
}
