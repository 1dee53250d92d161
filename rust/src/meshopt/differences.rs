//! Differences of four bytes of elements, and the numbers that they are added to.

/// A channel is so many bytes of an element.
pub(super) const CHANNEL: usize = 4;

/// What the differences of four bytes are.
#[derive(Clone, Copy)]
enum Mode {
    /// Of four numbers of 8 bits.
    Bytes,
    /// Of two numbers of 16 bits.
    Shorts,
    /// The bits that change in one number of 32 bits, turned to the left by so many.
    Bits(u32),
}

/// Four bytes of the elements.
pub(super) struct Channel {
    mode: Mode,
    /// What they were in the last element.
    last: [u8; CHANNEL],
}

impl Channel {
    /// Returns a channel by its mode in the stream; None where there is no such mode.
    pub(super) fn new(mode: u8, last: [u8; CHANNEL]) -> Option<Self> {
        let mode = match (mode & 15, mode >> 4) {
            (0, 0) => Mode::Bytes,
            (1, 0) => Mode::Shorts,
            (2, turn) => Mode::Bits(u32::from(turn)),
            _ => return None,
        };
        Some(Self { mode, last })
    }

    /// Fills in the channel of so many elements, `stride` bytes apart, from the planes of their differences.
    pub(super) fn apply<const N: usize>(
        &mut self,
        planes: &[[u8; N]; CHANNEL],
        size: usize,
        block: &mut [u8],
        stride: usize,
    ) {
        match self.mode {
            Mode::Bytes => self.each(planes, size, block, stride, |last, deltas| {
                [0, 1, 2, 3].map(|byte| last[byte].wrapping_add(deltas[byte] >> 1 ^ (deltas[byte] & 1).wrapping_neg()))
            }),
            Mode::Shorts => self.each(planes, size, block, stride, |last, deltas| {
                let (last, deltas) = (last.as_chunks::<2>().0, deltas.as_chunks::<2>().0);
                let [low, high] = [0, 1].map(|short| {
                    let (last, delta) = (u16::from_le_bytes(last[short]), u16::from_le_bytes(deltas[short]));
                    last.wrapping_add(delta >> 1 ^ (delta & 1).wrapping_neg()).to_le_bytes()
                });
                [low[0], low[1], high[0], high[1]]
            }),
            Mode::Bits(turn) => self.each(planes, size, block, stride, |last, deltas| {
                (u32::from_le_bytes(last) ^ u32::from_le_bytes(deltas).rotate_right(turn)).to_le_bytes()
            }),
        }
    }

    fn each<const N: usize>(
        &mut self,
        planes: &[[u8; N]; CHANNEL],
        size: usize,
        block: &mut [u8],
        stride: usize,
        next: impl Fn([u8; CHANNEL], [u8; CHANNEL]) -> [u8; CHANNEL],
    ) {
        for (number, element) in block.chunks_mut(stride).take(size).enumerate() {
            self.last = next(self.last, [0, 1, 2, 3].map(|byte: usize| planes[byte][number]));
            element[..CHANNEL].copy_from_slice(&self.last);
        }
    }
}
