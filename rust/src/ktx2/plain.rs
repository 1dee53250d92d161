//! Texels that are stored as they are: one to four bytes each.

/// What texels of a plain format consist of.
#[derive(Clone, Copy)]
pub(super) struct Plain {
    /// Bytes of a texel.
    pub(super) bytes: usize,
    /// Whether blue comes first.
    reversed: bool,
}

impl Plain {
    /// Returns a format by its number in Vulkan; None for formats that are not plain bytes.
    pub(super) fn of(format: u32) -> Option<Self> {
        // Of each kind, the first holds numbers as they are, the second colours in sRGB.
        let (bytes, reversed) = match format {
            9 | 15 => (1, false),
            16 | 22 => (2, false),
            23 | 29 => (3, false),
            30 | 36 => (3, true),
            37 | 43 => (4, false),
            44 | 50 => (4, true),
            _ => return None,
        };
        Some(Self { bytes, reversed })
    }

    /// Returns texels as red, green, blue and opacity; what is not there is 0, and the opacity 255.
    pub(super) fn rgba(self, texels: &[u8]) -> Vec<u8> {
        let mut rgba = Vec::with_capacity(texels.len() / self.bytes * 4);
        for given in texels.chunks_exact(self.bytes) {
            let mut texel = [0, 0, 0, 255];
            texel[..self.bytes].copy_from_slice(given);
            if self.reversed {
                texel.swap(0, 2);
            }
            rgba.extend_from_slice(&texel);
        }
        rgba
    }
}
