//! Packets' bodies as they were before they were compressed, with a limit: a few bytes may unpack to any number.

use std::io::{self, Read};

/// What a packet may unpack to, unless told otherwise: recorders make one every few milliseconds.
pub const MAX_PACKET_BYTES: usize = 64 << 20;

/// Every decoder of Zstandard should have so much memory (RFC 8878).
const SMALLEST_WINDOW: usize = 8 << 20;

/// Appends what a compressed frame unpacks to, which may be `limit` bytes.
///
/// # Errors
/// Of the frame; [`io::ErrorKind::FileTooLarge`] as soon as it unpacks to more.
pub(super) fn unpack(frame: &[u8], compression: i32, limit: usize, out: &mut Vec<u8>) -> io::Result<()> {
    if compression <= 2 {
        take(lz4_flex::frame::FrameDecoder::new(frame), limit, out)
    } else {
        let mut decoder = zstd::stream::read::Decoder::with_buffer(frame)?;
        // The window, which a frame asks for before it holds anything.
        decoder.window_log_max(limit.max(SMALLEST_WINDOW).next_power_of_two().ilog2().min(31))?;
        take(decoder, limit, out).map_err(|error| match error.to_string() {
            message if message.contains("too much memory") => io::Error::new(io::ErrorKind::FileTooLarge, above(limit)),
            _ => error,
        })
    }
}

fn take(decoder: impl Read, limit: usize, out: &mut Vec<u8>) -> io::Result<()> {
    let before = out.len();
    decoder.take(limit as u64 + 1).read_to_end(out)?;
    if out.len() - before > limit {
        return Err(io::Error::new(io::ErrorKind::FileTooLarge, above(limit)));
    }
    Ok(())
}

/// Returns what is said of a packet that has more bytes than it may.
pub(super) fn above(limit: usize) -> String {
    format!("a packet may have {limit} bytes unpacked, this has more; max_packet_bytes (--max-packet-bytes) allows it")
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Write;

    #[test]
    fn a_frame_may_unpack_to_the_limit_and_no_byte_more() {
        let plain = vec![7; 100_000];
        let mut lz4 = lz4_flex::frame::FrameEncoder::new(Vec::new());
        lz4.write_all(&plain).unwrap();
        for (compression, frame) in [(1, lz4.finish().unwrap()), (3, zstd::stream::encode_all(&plain[..], 1).unwrap())]
        {
            let mut out = vec![1];
            unpack(&frame, compression, plain.len(), &mut out).unwrap();
            assert_eq!(out[1..], plain);
            let error = unpack(&frame, compression, plain.len() - 1, &mut Vec::new()).unwrap_err().to_string();
            assert!(error.contains("99999 bytes unpacked") && error.contains("max_packet_bytes"), "{error}");
        }
    }
}
