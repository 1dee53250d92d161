//! The header: magic line, compression, place of the table of contents, and the streams in DV's XML.

use super::flatbuffer::Flatbuffer;
use crate::error::{Error, Result};

/// What the file begins with.
pub(super) const MAGIC: &[u8] = b"#!AER-DAT4.0\r\n";

pub(super) struct Header {
    pub(super) length: usize,
    /// 0 none, 1 and 2 LZ4, 3 and 4 Zstandard.
    pub(super) compression: i32,
    /// Where the packets end, if a table of contents was written.
    pub(super) table_place: Option<usize>,
    pub(super) streams: Vec<i32>,
    /// The one that is read.
    pub(super) event_stream: i32,
    pub(super) size: Option<(u32, u32)>,
}

impl Header {
    /// The header at the beginning of `bytes`, once it is there.
    pub(super) fn parse(bytes: &[u8]) -> Result<Option<Self>> {
        let known = bytes.len().min(MAGIC.len());
        if bytes[..known] != MAGIC[..known] {
            return Err(fault("not an AEDAT 4.0 file: it must begin with #!AER-DAT4.0", 0));
        }
        let Some((size, _)) = bytes.get(MAGIC.len()..).and_then(|rest| rest.split_first_chunk()) else {
            return Ok(None);
        };
        let size = u32::from_le_bytes(*size) as usize;
        // Room for the description of many streams; a size beyond that is damage, and not waited for.
        if size > 1 << 24 {
            return Err(fault(&format!("the header must have less than 16 MiB, not {size} bytes"), MAGIC.len()));
        }
        let length = MAGIC.len() + 4 + size;
        let Some(header) = bytes.get(MAGIC.len()..length) else { return Ok(None) };
        Self::of_flatbuffer(header, length)
            .ok_or_else(|| fault("the header must be an IOHE flatbuffer", MAGIC.len()))?
            .map(Some)
    }

    fn of_flatbuffer(bytes: &[u8], length: usize) -> Option<Result<Self>> {
        let buffer = Flatbuffer::with_size(bytes)?;
        if buffer.identifier()? != b"IOHE" {
            return None;
        }
        let root = buffer.root()?;
        let compression = buffer.field(root, 0).map_or(Some(0), |place| buffer.i32(place))?;
        let table_place = buffer.field(root, 1).map_or(Some(-1), |place| buffer.i64(place))?;
        let xml = std::str::from_utf8(buffer.vector(buffer.field(root, 2)?, 1)?).ok()?;
        if !(0..=4).contains(&compression) {
            let rule = format!("compression must be 0 (none), 1, 2 (LZ4), 3 or 4 (Zstandard), not {compression}");
            return Some(Err(fault(&rule, MAGIC.len())));
        }
        let table_place = usize::try_from(table_place).ok();
        Some(streams(xml).map(|(streams, event_stream, size)| Self {
            length,
            compression,
            table_place,
            streams,
            event_stream,
            size,
        }))
    }
}

/// The streams' numbers, that of the first one of events, and its sensor's size.
#[allow(clippy::type_complexity, reason = "named by its one user")]
fn streams(xml: &str) -> Result<(Vec<i32>, i32, Option<(u32, u32)>)> {
    let wrong = |rule: &str| fault(rule, MAGIC.len());
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
    let (mut all, mut events) = (Vec::new(), None);
    for stream in out_info.children().filter(roxmltree::Node::is_element) {
        let Some(number) = stream.attribute("name").and_then(|name| name.parse().ok()) else { continue };
        all.push(number);
        if events.is_none() && text(stream, "typeIdentifier").as_deref() == Some("EVTS") {
            let info = node(stream, "info").and_then(|id| document.get_node(id));
            let side = |key| info.and_then(|info| text(info, key)).and_then(|side| side.parse().ok());
            events = Some((number, side("sizeX").zip(side("sizeY"))));
        }
    }
    let (number, size) = events.ok_or_else(|| wrong("the file has no stream of events (EVTS)"))?;
    Ok((all, number, size))
}

fn fault(rule: &str, byte: usize) -> Error {
    Error::Format { message: rule.to_owned(), line: None, byte }
}
