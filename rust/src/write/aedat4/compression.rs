//! Frames of LZ4 and Zstandard.

use std::io::Write;

use lz4_flex::frame::{BlockMode, BlockSize, FrameEncoder, FrameInfo};
use zstd::zstd_safe::CParameter;

/// How the packets of a file are compressed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Compression {
    /// Not at all.
    None,
    /// LZ4 frames.
    Lz4,
    /// Zstandard frames, of this level; -4 steps by four bytes, which divide an event's 16.
    Zstd(i32),
}

impl Compression {
    /// Returns its number in the header.
    pub(super) fn code(self) -> i32 {
        match self {
            Self::None => 0,
            Self::Lz4 => 1,
            Self::Zstd(_) => 3,
        }
    }

    pub(super) fn name(self) -> &'static str {
        match self {
            Self::None => "NONE",
            Self::Lz4 => "LZ4",
            Self::Zstd(_) => "ZSTD",
        }
    }
}

pub(super) struct Compressor {
    pub(super) compression: Compression,
    zstd: Option<zstd::bulk::Compressor<'static>>,
    frame: Vec<u8>,
}

impl Compressor {
    pub(super) fn new(compression: Compression) -> Self {
        let zstd = match compression {
            Compression::Zstd(level) => {
                let mut zstd = zstd::bulk::Compressor::new(level).expect("memory for a compressor");
                if level < 0 {
                    // Fast levels take a small table, and miss what comes again after some hundred events.
                    zstd.set_parameter(CParameter::HashLog(14)).expect("a parameter within its range");
                }
                Some(zstd)
            }
            _ => None,
        };
        Self { compression, zstd, frame: Vec::new() }
    }

    /// Appends `bytes` as a frame, and returns its size.
    pub(super) fn compress(&mut self, bytes: &[u8], out: &mut Vec<u8>) -> i32 {
        let start = out.len();
        match (self.compression, &mut self.zstd) {
            (Compression::Lz4, _) => {
                let info = FrameInfo::new().block_mode(BlockMode::Independent).block_size(BlockSize::Max256KB);
                let mut encoder = FrameEncoder::with_frame_info(info, &mut *out);
                encoder.write_all(bytes).expect("a vector takes all");
                encoder.finish().expect("a vector takes all");
            }
            (_, Some(zstd)) => {
                self.frame.resize(zstd::zstd_safe::compress_bound(bytes.len()).max(self.frame.len()), 0);
                let length = zstd.compress_to_buffer(bytes, &mut self.frame[..]).expect("room for the worst case");
                out.extend_from_slice(&self.frame[..length]);
            }
            _ => out.extend_from_slice(bytes),
        }
        i32::try_from(out.len() - start).expect("a packet of at most 8192 events, or the table of less than 2 GB")
    }
}
