//! A frame of the active pixels (APS), as the decoder gives it and the encoder takes it.
//!
//! A pixel has ten bits, which lie in the upper bits of 16 ([`PIXEL_SHIFT`]). Decoder and encoder share the constants
//! here, so that decoding an encoded frame gives back its ten bits.

/// A part of the image: of columns `x..x + width` and rows `y..y + height`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Region {
    /// First column.
    pub x: u16,
    /// First row.
    pub y: u16,
    /// Columns.
    pub width: u16,
    /// Rows.
    pub height: u16,
}

impl Region {
    /// Returns the number of pixels.
    #[must_use]
    pub const fn pixels(self) -> usize {
        self.width as usize * self.height as usize
    }
}

/// An intensity image with its times in microseconds.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Frame {
    /// When the camera began with it.
    pub t_start: i64,
    /// When the exposure began.
    pub t_exposure_start: i64,
    /// When the exposure ended.
    pub t_exposure_end: i64,
    /// When its last sample was read.
    pub t_end: i64,
    /// Where in the image it lies.
    pub region: Region,
    /// Whether all pixels were exposed at once (global shutter) or column by column (rolling).
    pub global_shutter: bool,
    /// The exposure as the camera states it, in cycles of the converter's clock; 0 if it did not.
    pub exposure_cycles: u32,
    /// Intensity, row by row: ten bits, in the upper ones of 16.
    pub pixels: Vec<u16>,
}

/// The ten bits of a pixel's value are shifted up by this, into the upper ones of 16.
pub(super) const PIXEL_SHIFT: u32 = 6;

/// The brightest value.
pub(super) const WHITE: u16 = 1023;

/// A reset sample below this means that the pixel did not reset, because the light is too strong: it is white.
pub(super) const MIN_RESET: u16 = 384;
