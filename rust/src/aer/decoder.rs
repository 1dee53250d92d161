//! Decodes the camera's bytes word by word. The whole format is in this file.
//!
//! The upper bits of a word say what kind it is. [`Decoder::word`] sends each word to the module that keeps the state
//! of its kind: the clock, the addresses, the open inertial sample or the open frame. Words without a payload go to
//! [`Decoder::mark`], words with a byte as payload to [`Decoder::byte`]. The state is split in this way because each
//! kind has its own rules for malformed streams, which can then be read in one place.
//!
//! Runs of plain words (times, addresses, frame samples) are nearly all of a stream. They take the
//! [`fast_path`](super::fast_path), which gives the same result sooner. [`Decoder::word`] is the definition that it is
//! tested against.
//!
//! What must not break:
//! - No input makes the decoder fail or panic. Between two pieces it keeps at most one frame and one inertial sample.
//! - Any split of the bytes decodes alike. A piece may end within a word, so half a word is kept.
//! - The fast path and [`Decoder::word`] agree on every stream, counters included. The property test below checks this.
//! - Where the vendor's drivers overflow their 31-bit time, they drop what is open. So does this decoder.

use super::addresses::Addresses;
use super::clock::Clock;
use super::decoded::Decoded;
use super::device::Device;
use super::fast_path::{count_columns, decode_plain_words};
use super::frame_assembler::{FrameAssembler, Read};
use super::imu::ImuAssembler;
use super::lanes::BLOCK;
use super::state::State;
use super::stats::Stats;
use super::trigger::{Trigger, TriggerKind};
use super::word;
use crate::error::Result;

/// Decodes the stream of a DAVIS, piece by piece.
///
/// Any split of the stream into pieces decodes alike. No input makes it fail; what it keeps between two pieces is at
/// most one frame and one inertial sample.
///
/// Times are microseconds since the stream began or the camera's clock was last reset; they are whole numbers of 64
/// bits and know no overflow.
pub struct Decoder {
    device: Device,
    /// The first byte of a word whose second has not come.
    half: Option<u8>,
    state: State,
    imu: ImuAssembler,
}

impl Decoder {
    /// Returns a decoder of what this camera sends from its start on.
    ///
    /// # Errors
    /// [`Error::Argument`](crate::Error::Argument) for sizes out of range.
    pub fn new(device: Device) -> Result<Self> {
        device.check()?;
        Ok(Self {
            half: None,
            state: State {
                clock: Clock::default(),
                addresses: Addresses::new(&device),
                frames: FrameAssembler::new(&device),
                stats: Stats::default(),
            },
            imu: ImuAssembler::default(),
            device,
        })
    }

    /// Returns the camera whose stream is decoded.
    #[must_use]
    pub fn device(&self) -> &Device {
        &self.device
    }

    /// Returns how often the stream was not what a camera sends.
    #[must_use]
    pub fn stats(&self) -> &Stats {
        &self.state.stats
    }

    /// Decodes the next bytes of the stream and appends what is complete by them to `decoded`.
    ///
    /// An odd byte at the end waits for the next piece.
    pub fn push(&mut self, bytes: &[u8], decoded: &mut Decoded) {
        let mut bytes = bytes;
        if let (Some(low), Some((&high, rest))) = (self.half, bytes.split_first()) {
            self.half = None;
            self.word(u16::from_le_bytes([low, high]), decoded);
            bytes = rest;
        }
        let (mut words, half) = bytes.as_chunks::<2>();
        if let [byte] = half {
            self.half = Some(*byte);
        }
        if decoded.events.capacity() - decoded.events.len() < words.len() {
            // Once for the piece: growing step by step would touch twice as much fresh memory, which is slow.
            decoded.events.reserve(count_columns(words) + BLOCK);
        }
        while !words.is_empty() {
            let plain = decode_plain_words(words, &mut self.state, &mut decoded.events);
            words = &words[plain..];
            if let Some((first, rest)) = words.split_first() {
                self.word(u16::from_le_bytes(*first), decoded);
                words = rest;
            }
        }
    }

    /// Decodes one word of any kind.
    fn word(&mut self, word: u16, decoded: &mut Decoded) {
        let State { clock, addresses, frames, stats } = &mut self.state;
        match word & !word::LOW_12 {
            0 => self.mark(word, decoded),
            word::ROW | word::COLUMN_OFF | word::COLUMN_ON => {
                addresses.address(word, clock.now, &mut decoded.events, stats);
            }
            word::SAMPLE => frames.samples(&[word.to_le_bytes()], stats),
            word::IMU_BYTE => self.byte(word),
            word::EXPOSURE if word & word::LOW_12 <= word::LOW_10 => frames.exposure_word(word, stats),
            word::EXPOSURE => stats.unknown_words += 1,
            _ => {
                if clock.advance(word, stats) {
                    // Where the drivers' 31 bits overflow they drop what is open. So does this decoder, to agree with
                    // them.
                    self.abandon();
                }
            }
        }
    }

    /// Decodes a word without a payload.
    fn mark(&mut self, mark: u16, decoded: &mut Decoded) {
        let State { clock, frames, stats, .. } = &mut self.state;
        let now = clock.now;
        match mark {
            word::IMU_START => self.imu.start(stats),
            word::IMU_END => decoded.imu.extend(self.imu.end(now, self.device.imu_flips, stats)),
            word::FRAME_START_GLOBAL => frames.start(now, true, stats),
            word::FRAME_START_ROLLING => frames.start(now, false, stats),
            word::FRAME_END => decoded.frames.extend(frames.end(now, stats)),
            word::RESET_COLUMN_START => frames.column_start(Read::Reset, stats),
            word::SIGNAL_COLUMN_START => frames.column_start(Read::Signal, stats),
            word::COLUMN_END => frames.column_end(stats),
            word::EXPOSURE_START => frames.exposure_start(now, stats),
            word::EXPOSURE_END => frames.exposure_end(now, stats),
            _ => match TriggerKind::of(mark) {
                Some(TriggerKind::TimestampReset) => {
                    *clock = Clock::default();
                    self.abandon();
                    decoded.triggers.push(Trigger::new(0, TriggerKind::TimestampReset));
                }
                Some(kind) => decoded.triggers.push(Trigger::new(now, kind)),
                None => stats.unknown_words += 1,
            },
        }
    }

    /// Decodes a word whose payload is a byte.
    fn byte(&mut self, word: u16) {
        let State { frames, stats, .. } = &mut self.state;
        let [byte, _] = word.to_le_bytes();
        match word & !0xFF {
            word::IMU_BYTE => self.imu.byte(byte, stats),
            word::IMU_SCALE => self.imu.scale(byte, stats),
            word::REGION_HIGH => frames.region_high(byte.into(), stats),
            word::REGION_LOW => frames.region_low(byte.into(), stats),
            _ => stats.unknown_words += 1,
        }
    }

    /// Drops the open inertial sample and the open frame.
    fn abandon(&mut self) {
        self.imu.abandon(&mut self.state.stats);
        self.state.frames.abandon(&mut self.state.stats);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::aer::Chip;
    use proptest::collection::vec;
    use proptest::prelude::*;

    /// Pieces of streams, long ones of plain words among them, good and bad.
    fn streams() -> impl Strategy<Value = Vec<u16>> {
        let plain = prop_oneof![
            4 => 0x8000u16..=0xFFFF,
            4 => 0x1000u16..0x100A,
            12 => 0x2000u16..0x2080,
            12 => 0x3000u16..0x3080,
            1 => 0x7000u16..0x7003,
        ];
        let samples = 0x4000u16..0x4400;
        let mixed = prop_oneof![plain.clone(), plain.clone(), samples.clone()];
        let frame = vec![9, 0x6001, 0x5100, 0x5200, 0x5200, 0x5204, 0x5263, 11];
        let pieces = prop_oneof![
            4 => vec(plain, 0..300),
            3 => vec(samples, 0..300),
            3 => vec(mixed, 0..300),
            2 => Just(frame),
            2 => vec(prop::sample::select(vec![10u16, 11, 12, 13, 14, 15]), 1..3),
            2 => vec(any::<u16>(), 0..5),
            1 => vec(Just(0x7FFFu16), 0..30),
            1 => vec(0u16..20, 0..3),
        ];
        vec(pieces, 0..12).prop_map(|pieces| pieces.concat())
    }

    proptest! {
        #[test]
        fn the_fast_path_decodes_as_word_by_word(words in streams(), swapped in any::<bool>()) {
            let mut device = Device::new(Chip::Davis128);
            device.dvs_swapped = swapped;
            let bytes: Vec<u8> = words.iter().flat_map(|word| word.to_le_bytes()).collect();
            let mut decoder = Decoder::new(device.clone()).unwrap();
            let mut output = Decoded::default();
            decoder.push(&bytes, &mut output);

            let mut slow = Decoder::new(device).unwrap();
            let mut expected = Decoded::default();
            for word in words {
                slow.word(word, &mut expected);
            }
            prop_assert_eq!(output, expected);
            prop_assert_eq!(decoder.stats(), slow.stats());
        }
    }

    #[test]
    fn the_clock_stops_before_its_bits_do() {
        let mut decoder = Decoder::new(Device::new(Chip::Davis128)).unwrap();
        decoder.state.clock.base = (1 << 62) - (1 << 35);
        let words: Vec<u8> =
            [[0x00, 0x10], [0x00, 0x30]].iter().chain([&[0xFF, 0x7F]; 1000]).flatten().copied().collect();
        let mut output = Decoded::default();
        decoder.push(&words, &mut output);
        decoder.push(&[0xFF, 0xFF, 0x00, 0x30], &mut output);
        assert_eq!(output.events.last().map(|event| event.t), Some((1 << 62) - 1));
        assert!(decoder.stats().times_not_increasing > 0);
    }
}
