//! The header: magic line, compression, offset of the table of contents, and the streams in DV's XML.

use super::flatbuffer::Flatbuffer;
use crate::error::{Error, Result};

/// What the file begins with.
pub(super) const MAGIC: &[u8] = b"#!AER-DAT4.0\r\n";

/// What a stream holds, of those that are read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// `EVTS`.
    Events,
    /// `FRME`.
    Frames,
    /// `IMUS`.
    Imu,
    /// `TRIG`.
    Triggers,
}

impl Kind {
    fn of(identifier: &str) -> Option<Self> {
        Some(match identifier {
            "EVTS" => Self::Events,
            "FRME" => Self::Frames,
            "IMUS" => Self::Imu,
            "TRIG" => Self::Triggers,
            _ => return None,
        })
    }
}

/// A stream as the header describes it.
pub(super) struct Stream {
    number: i32,
    /// None where it holds something else.
    kind: Option<Kind>,
    /// Width and height of its sensor, both above 0.
    pub(super) size: Option<(u32, u32)>,
    /// The camera.
    pub(super) source: String,
}

pub(super) struct Header {
    pub(super) length: usize,
    /// 0 none, 1 and 2 LZ4, 3 and 4 Zstandard.
    pub(super) compression: i32,
    /// Where the packets end, if a table of contents was written.
    pub(super) table_offset: Option<usize>,
    /// By their numbers.
    pub(super) streams: Vec<Stream>,
}

impl Header {
    /// Returns the header at the beginning of `bytes`, once it is there.
    pub(super) fn parse(bytes: &[u8]) -> Result<Option<Self>> {
        let known = bytes.len().min(MAGIC.len());
        if bytes[..known] != MAGIC[..known] {
            return Err(Error::at_byte("not an AEDAT 4.0 file: it must begin with #!AER-DAT4.0", 0));
        }
        let Some((size, _)) = bytes.get(MAGIC.len()..).and_then(|rest| rest.split_first_chunk()) else {
            return Ok(None);
        };
        let size = u32::from_le_bytes(*size) as usize;
        // Room for the description of many streams; a size beyond that is damage, and not waited for.
        if size > 1 << 24 {
            return Err(Error::at_byte(
                format!("the header must have less than 16 MiB, not {size} bytes"),
                MAGIC.len(),
            ));
        }
        let length = MAGIC.len() + 4 + size;
        let Some(header) = bytes.get(MAGIC.len()..length) else { return Ok(None) };
        Self::of_flatbuffer(header, length)
            .ok_or_else(|| Error::at_byte("the header must be an IOHE flatbuffer", MAGIC.len()))?
            .map(Some)
    }

    fn of_flatbuffer(bytes: &[u8], length: usize) -> Option<Result<Self>> {
        let buffer = Flatbuffer::with_size(bytes)?;
        if buffer.identifier()? != b"IOHE" {
            return None;
        }
        let root = buffer.root()?;
        let compression = buffer.field(root, 0).map_or(Some(0), |offset| buffer.i32(offset))?;
        let table_offset = buffer.field(root, 1).map_or(Some(-1), |offset| buffer.i64(offset))?;
        let xml = std::str::from_utf8(buffer.vector(buffer.field(root, 2)?, 1)?).ok()?;
        if !(0..=4).contains(&compression) {
            let rule = format!("compression must be 0 (none), 1, 2 (LZ4), 3 or 4 (Zstandard), not {compression}");
            return Some(Err(Error::at_byte(rule, MAGIC.len())));
        }
        // An offset that lies not behind the header means, like -1, that there is none.
        let table_offset = usize::try_from(table_offset).ok().filter(|&offset| offset >= length);
        Some(streams(xml).map(|streams| Self { length, compression, table_offset, streams }))
    }

    /// Returns the first stream of a kind.
    pub(super) fn stream(&self, kind: Kind) -> Option<&Stream> {
        self.streams.iter().find(|stream| stream.kind == Some(kind))
    }

    /// Returns the stream that tells of the camera: that of its events or, without any, of its frames.
    pub(super) fn camera(&self) -> Option<&Stream> {
        self.stream(Kind::Events).or_else(|| self.stream(Kind::Frames))
    }

    pub(super) fn announces(&self, number: i32) -> bool {
        self.streams.iter().any(|stream| stream.number == number)
    }

    /// Returns the kind of a stream that is read: one that is the first of its kind.
    pub(super) fn kind_of(&self, number: i32) -> Option<Kind> {
        let kind = self.streams.iter().find(|stream| stream.number == number)?.kind?;
        self.stream(kind).is_some_and(|first| first.number == number).then_some(kind)
    }
}

/// Returns the streams, by their numbers.
fn streams(xml: &str) -> Result<Vec<Stream>> {
    let wrong = |rule: &str| Error::at_byte(rule, MAGIC.len());
    let document = roxmltree::Document::parse(xml).map_err(|error| wrong(&format!("the header's XML: {error}")))?;
    let node = |parent: roxmltree::Node<'_, '_>, name: &str| {
        parent.children().find(|child| child.attribute("name") == Some(name)).map(|child| child.id())
    };
    let text = |parent: roxmltree::Node<'_, '_>, key: &str| {
        let attribute = parent.children().find(|child| child.attribute("key") == Some(key));
        attribute.and_then(|attribute| attribute.text()).map(|text| text.trim().to_owned())
    };
    let out_info = node(document.root_element(), "outInfo").and_then(|id| document.get_node(id));
    let out_info = out_info.ok_or_else(|| wrong("the header's XML must have a node outInfo"))?;
    let mut streams = Vec::new();
    for stream in out_info.children().filter(roxmltree::Node::is_element) {
        let Some(number) = stream.attribute("name").and_then(|name| name.parse().ok()) else { continue };
        let kind = text(stream, "typeIdentifier").as_deref().and_then(Kind::of);
        let info = node(stream, "info").and_then(|id| document.get_node(id));
        let pixels = |key| info.and_then(|info| text(info, key)).and_then(|pixels| pixels.parse().ok());
        let size = pixels("sizeX").zip(pixels("sizeY")).filter(|&(width, height)| width > 0 && height > 0);
        let source = info.and_then(|info| text(info, "source")).unwrap_or_default();
        streams.push(Stream { number, kind, size, source });
    }
    streams.sort_by_key(|stream| stream.number);
    Ok(streams)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn deep_xml_takes_no_stack() {
        let deep = format!("{}{}", "<n>".repeat(1 << 20), "</n>".repeat(1 << 20));
        assert!(streams(&deep).is_err_and(|error| error.to_string().contains("outInfo")));
    }
}
