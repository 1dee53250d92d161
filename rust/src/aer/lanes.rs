//! Four 16-bit words in one `u64`, a lane each (SIMD within a register), and forward fill across a block of them.
//!
//! [`super::block`] needs at every word the last timestamp and the last row before it. A loop that carries them along
//! would branch at every word. Here a lane without a value takes it from the lane before by a shift and a mask, four
//! lanes at a time.
//!
//! What must not break:
//! - A value has its top bit ([`TOP`]) set, and "no value" is 0. Only that bit tells the two apart.
//! - The functions are `inline(always)`, because they must become vector code of the caller's processor level.

/// Words that are decoded together: as many as a `u64` has bits, so that a flag of each fits into one number.
pub(super) const BLOCK: usize = u64::BITS as usize;

/// Numbers of four lanes in a block.
pub(super) const LANES: usize = BLOCK / 4;

/// The bit that tells a value from none. The payloads that are filled forward leave it free.
pub(super) const TOP: u16 = 0x8000;

/// [`TOP`] in every lane.
pub(super) const TOPS: u64 = splat(TOP);

/// Returns the same value in all four lanes.
pub(super) const fn splat(value: u16) -> u64 {
    0x0001_0001_0001_0001 * value as u64
}

/// Returns all bits of each lane whose top bit is set, no bit of the others.
#[inline(always)]
#[allow(clippy::inline_always, reason = "becomes its caller's vector code")]
pub(super) fn mask(lanes: u64) -> u64 {
    let tops = lanes & TOPS;
    (tops - (tops >> 15)) | tops
}

/// Sets the top bit of each lane in which any of the upper four bits is set. The other bits of the result mean nothing.
#[inline(always)]
#[allow(clippy::inline_always, reason = "becomes its caller's vector code")]
pub(super) fn any_of_upper_four(lanes: u64) -> u64 {
    lanes | lanes << 1 | lanes << 2 | lanes << 3
}

/// Fills forward: gives each lane without a value (0) the last value before it.
///
/// `before` is the value before the first lane. Returns, for each number, the value before its first lane, in all four
/// lanes; and the last value of the block.
#[inline(always)]
#[allow(clippy::inline_always, reason = "becomes its caller's vector code")]
#[allow(clippy::cast_possible_truncation, reason = "one lane of four")]
pub(super) fn forward_fill(values: &mut [u64; LANES], before: u16) -> ([u64; LANES], u16) {
    for lanes in values.iter_mut() {
        *lanes |= *lanes << 16 & !mask(*lanes);
        *lanes |= *lanes << 32 & !mask(*lanes);
    }
    let (mut held, mut last) = ([0; LANES], before);
    for (lanes, held) in values.iter().zip(&mut held) {
        *held = splat(last);
        let own = (lanes >> 48) as u16;
        last = if own < TOP { last } else { own };
    }
    for (lanes, held) in values.iter_mut().zip(&held) {
        *lanes |= held & !mask(*lanes);
    }
    (held, last)
}

/// Returns the lanes of a block, one word each, in order.
#[inline(always)]
#[allow(clippy::inline_always, reason = "becomes its caller's vector code")]
#[allow(clippy::cast_possible_truncation, reason = "one lane of four")]
pub(super) fn unpack(packed: &[u64; LANES]) -> [u16; BLOCK] {
    let mut words = [0; BLOCK];
    for (lanes, words) in packed.iter().zip(words.as_chunks_mut::<4>().0) {
        *words = [*lanes as u16, (lanes >> 16) as u16, (lanes >> 32) as u16, (lanes >> 48) as u16];
    }
    words
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_mask_covers_the_lanes_whose_top_bit_is_set() {
        assert_eq!(mask(0x8000_7FFF_FFFF_0001), 0xFFFF_0000_FFFF_0000);
        assert_eq!(any_of_upper_four(0x1FFF_0FFF_4000_0000) & TOPS, 0x8000_0000_8000_0000);
    }

    #[test]
    fn forward_fill_gives_each_lane_the_last_value_before_it() {
        // Values at these words of the block: the first lane of a number, an inner one, the last one.
        for indices in [&[][..], &[0], &[6], &[3, 4, 63], &[1, 2, 17, 40]] {
            let mut words = [0u16; BLOCK];
            for &index in indices {
                words[index] = TOP | u16::try_from(index).unwrap();
            }
            let mut packed: [u64; LANES] =
                std::array::from_fn(|i| (0..4).fold(0, |lanes, j| lanes | u64::from(words[4 * i + j]) << (16 * j)));
            let (before_each, last) = forward_fill(&mut packed, TOP | 0x63);
            let mut expected = TOP | 0x63;
            for (index, filled) in unpack(&packed).into_iter().enumerate() {
                if index % 4 == 0 {
                    assert_eq!(before_each[index / 4], splat(expected), "before word {index} of {indices:?}");
                }
                expected = if words[index] == 0 { expected } else { words[index] };
                assert_eq!(filled, expected, "word {index} of {indices:?}");
            }
            assert_eq!(last, expected);
        }
    }
}
