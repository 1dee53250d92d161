//! The finest level of KTX2 files to texels: blocks of Basis Universal, and plain bytes.
//!
//! `container` finds the parts of a file, `descriptor` and `arrangement` read what it says of its texels. These are
//! blocks (`basis`, by the crate `basisu`), or stored as they are (`plain`).
//!
//! What must not break: sizes are known before anything is decoded, and all sizes and offsets are checked here, so that
//! the crate sees none that the file made up.
//!
//! Source: Khronos Group, KTX File Format Specification 2.0; `KHR_texture_basisu`.

mod arrangement;
mod basis;
mod container;
mod descriptor;
mod plain;

use std::borrow::Cow;

use crate::error::{Error, Result};

pub use descriptor::Transfer;

use basis::Blocks;
use container::Container;
use plain::Plain;

/// The most texels of an image: what they decode to has 1 GiB.
const MOST_TEXELS: u64 = 1 << 28;
const REMEDY: &str = "export the image as Basis Universal (ETC1S or UASTC), PNG or JPEG";

/// How texels are stored.
enum Storage {
    Blocks(Blocks),
    Plain(Plain),
}

/// A file whose parts have been found, and nothing decoded.
pub struct Ktx2<'a> {
    file: Container<'a>,
    storage: Storage,
}

impl<'a> Ktx2<'a> {
    /// Finds the parts of a file.
    ///
    /// # Errors
    ///
    /// [`Error::Format`] for a file that breaks a rule, or whose texels are in a format that is not read.
    pub fn read(data: &'a [u8]) -> Result<Self> {
        let file = Container::read(data)?;
        let texels = u64::from(file.width) * u64::from(file.height);
        if texels > MOST_TEXELS {
            let size = format!("{} x {}", file.width, file.height);
            return Err(Error::at_byte(format!("an image may have {MOST_TEXELS} texels, got {size}"), 20));
        }
        let storage = match file.format {
            0 => Blocks::of(file.descriptor.model).map(Storage::Blocks),
            format => Plain::of(format).map(Storage::Plain),
        };
        let storage = storage.ok_or_else(|| {
            let kind = kind(file.format, file.descriptor.model);
            Error::at_byte(format!("texels in {kind} are not read: {REMEDY}"), 12)
        })?;
        match (&storage, file.scheme) {
            (Storage::Blocks(Blocks::Etc1s), 1) | (Storage::Blocks(Blocks::Uastc) | Storage::Plain(_), 0 | 2) => {}
            (_, scheme) => {
                let rule =
                    format!("levels of such texels that are compressed by scheme {scheme} are not read: {REMEDY}");
                return Err(Error::at_byte(rule, 44));
            }
        }
        Ok(Self { file, storage })
    }

    /// Returns the width and the height of the image.
    #[must_use]
    pub fn size(&self) -> (u32, u32) {
        (self.file.width, self.file.height)
    }

    /// Returns what the numbers of texels stand for.
    #[must_use]
    pub fn transfer(&self) -> Transfer {
        self.file.descriptor.transfer
    }

    /// Decodes the texels: red, green, blue and opacity of each, from the upper left, row by row.
    ///
    /// # Errors
    ///
    /// [`Error::Format`] for a level that breaks a rule, [`Error::Memory`] if there is not enough.
    pub fn rgba(&self) -> Result<Vec<u8>> {
        let (width, height) = self.size();
        let mut texels = match self.storage {
            Storage::Blocks(Blocks::Etc1s) => Blocks::Etc1s.rgba(&self.file, self.file.level)?,
            Storage::Blocks(blocks) => blocks.rgba(&self.file, &self.level(Blocks::bytes(width, height))?)?,
            Storage::Plain(plain) => plain.rgba(&self.level(width as usize * height as usize * plain.bytes)?),
        };
        self.file.arrangement.apply(&mut texels, width as usize);
        Ok(texels)
    }

    /// Returns the finest level as it was before it was compressed once more, which must have so many bytes.
    fn level(&self, size: usize) -> Result<Cow<'a, [u8]>> {
        let (stored, at) = (self.file.level, self.file.level_at);
        let wrong = |got: &str| Error::at_byte(format!("the finest level must have {size} bytes, got {got}"), at);
        if self.file.scheme == 0 {
            return if stored.len() == size { Ok(stored.into()) } else { Err(wrong(&stored.len().to_string())) };
        }
        let mut level = Vec::new();
        level
            .try_reserve_exact(size)
            .map_err(|_| Error::Memory(format!("a level of {size} bytes needs more memory than there is")))?;
        level.resize(size, 0);
        match zstd::bulk::decompress_to_buffer(stored, &mut level) {
            Ok(got) if got == size => Ok(level.into()),
            Ok(got) => Err(wrong(&got.to_string())),
            Err(error) => Err(wrong(&format!("a frame of Zstandard that cannot be unpacked to it: {error}"))),
        }
    }
}

/// Returns what texels are called that are not read.
fn kind(format: u32, model: u8) -> String {
    let name = match format {
        0 => return format!("the colour model {model}"),
        131..=146 => "BC",
        147..=156 => "ETC2",
        157..=184 | 1_000_066_000..=1_000_066_013 => "ASTC",
        1_000_054_000..=1_000_054_007 => "PVRTC",
        _ => return format!("Vulkan's format {format}"),
    };
    format!("{name} (Vulkan's format {format})")
}
