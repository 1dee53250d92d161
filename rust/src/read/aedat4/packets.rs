//! From the bytes of a file to its packets: the part that all readers of AEDAT 4.0 share.

use super::header::{Header, Kind, MAGIC};
use super::unpack::{above, unpack};
use crate::error::{Error, Result};

/// Compressors add less than this many bytes to data that they cannot compress (LZ4: a 255th).
const OVERHEAD: usize = 64;

/// Takes bytes in any split, and hands out packet by packet.
pub(super) struct Packets {
    pub(super) header: Option<Header>,
    /// Where the bytes that come next are in the file.
    pub(super) offset: usize,
    /// No packets follow.
    pub(super) over: bool,
    /// What a packet may unpack to.
    pub(super) limit: usize,
    body: Vec<u8>,
}

impl Packets {
    pub(super) fn new(limit: usize) -> Self {
        Self { header: None, offset: 0, over: false, limit, body: Vec::new() }
    }

    /// Hands out the whole packets in `bytes`, those of kinds that are `wanted` unpacked, of others their offset alone;
    /// returns how many bytes are used.
    pub(super) fn push(
        &mut self,
        bytes: &[u8],
        wanted: &[Kind],
        mut take: impl FnMut(Option<(Kind, &[u8])>) -> std::result::Result<(), String>,
    ) -> Result<usize> {
        let mut at = 0;
        if self.header.is_none() {
            match Header::parse(bytes)? {
                Some(header) => {
                    at = header.length;
                    self.offset = at;
                    self.header = Some(header);
                }
                None => return Ok(0),
            }
        }
        while let Some(header) = &self.header {
            self.over |= header.table_offset.is_some_and(|table| self.offset >= table);
            let Some((stream, size)) = packet_header(&bytes[at..]) else { break };
            // A stream that was not announced: a table of contents that was being written when its writer ended.
            self.over |= header.table_offset.is_none() && !header.announces(stream);
            if self.over {
                break;
            }
            let offset = self.offset;
            let fault = |message: String| Error::Format { message, line: None, byte: offset };
            let size =
                usize::try_from(size).map_err(|_| fault(format!("a packet's size must be positive, not {size}")))?;
            if size > self.limit.saturating_add(self.limit / 255 + OVERHEAD) {
                return Err(fault(above(self.limit)));
            }
            if header.table_offset.is_some_and(|table| offset + 8 + size > table) {
                return Err(fault(format!("a packet of {size} bytes must end before the table of contents")));
            }
            let Some(body) = bytes[at + 8..].get(..size) else { break };
            let packet = match header.kind_of(stream).filter(|kind| wanted.contains(kind)) {
                Some(kind) if header.compression == 0 => Some((kind, body)),
                Some(kind) => {
                    self.body.clear();
                    unpack(body, header.compression, self.limit, &mut self.body)
                        .map_err(|error| fault(format!("a packet must be a compressed frame: {error}")))?;
                    Some((kind, &self.body[..]))
                }
                None => None,
            };
            take(packet).map_err(|rule| fault(format!("stream {stream}: {rule}")))?;
            at += 8 + size;
            self.offset += 8 + size;
        }
        // What comes behind the last packet is passed over.
        Ok(if self.over { bytes.len() } else { at })
    }

    /// Refuses an input that ends before its header does.
    pub(super) fn end(&self, bytes: &[u8]) -> Result<()> {
        if self.header.is_none() {
            let message = if bytes.starts_with(MAGIC) { "the header is cut off" } else { "not an AEDAT 4.0 file" };
            return Err(Error::Format { message: message.into(), line: None, byte: 0 });
        }
        Ok(())
    }
}

/// Returns stream and size of the packet that begins here.
fn packet_header(bytes: &[u8]) -> Option<(i32, i32)> {
    let (stream, rest) = bytes.split_first_chunk()?;
    Some((i32::from_le_bytes(*stream), i32::from_le_bytes(*rest.first_chunk()?)))
}
