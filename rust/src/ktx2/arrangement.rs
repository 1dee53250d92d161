//! Where texels and their channels are to be found: the metadata `KTXorientation` and `KTXswizzle`.

use crate::error::{Error, Result};

/// What a channel of a texel is taken from.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Source {
    Channel(usize),
    Number(u8),
}

const AS_IT_IS: [Source; 4] = [Source::Channel(0), Source::Channel(1), Source::Channel(2), Source::Channel(3)];

/// How the texels of a file become those of an image whose first row is the upper edge.
#[derive(Clone, Copy)]
pub(super) struct Arrangement {
    leftwards: bool,
    upwards: bool,
    channels: [Source; 4],
}

impl Arrangement {
    /// Reads the metadata, which begin at byte `start` of the file.
    pub(super) fn read(metadata: &[u8], start: usize) -> Result<Self> {
        let mut found = Self { leftwards: false, upwards: false, channels: AS_IT_IS };
        let mut at = 0;
        while let Some(length) = metadata.get(at..).and_then(|rest| rest.first_chunk::<4>()) {
            let (first, length) = (at + 4, u32::from_le_bytes(*length) as usize);
            let Some(entry) = metadata[first..].get(..length) else {
                return Err(Error::at_byte("an entry of the metadata reaches beyond their end", start + at));
            };
            let end = entry.iter().position(|&byte| byte == 0).unwrap_or(length);
            let value = entry.get(end + 1..).unwrap_or_default().split(|&byte| byte == 0).next().unwrap_or_default();
            found.take(&entry[..end], value).map_err(|rule| Error::at_byte(rule, start + first))?;
            at = first + length.next_multiple_of(4);
        }
        Ok(found)
    }

    /// Takes one entry; others are no matter of texels.
    fn take(&mut self, key: &[u8], value: &[u8]) -> std::result::Result<(), &'static str> {
        match key {
            b"KTXorientation" => {
                let [across @ (b'r' | b'l'), down @ (b'd' | b'u')] = value else {
                    return Err("KTXorientation must be one of rd, ru, ld, lu");
                };
                (self.leftwards, self.upwards) = (*across == b'l', *down == b'u');
            }
            b"KTXswizzle" => {
                let rule = "KTXswizzle must be four of the letters r, g, b, a, 0 and 1";
                let letters: [u8; 4] = value.try_into().map_err(|_| rule)?;
                for (channel, letter) in self.channels.iter_mut().zip(letters) {
                    *channel = match letter {
                        b'0' => Source::Number(0),
                        b'1' => Source::Number(255),
                        _ => Source::Channel(b"rgba".iter().position(|&other| other == letter).ok_or(rule)?),
                    };
                }
            }
            _ => {}
        }
        Ok(())
    }

    /// Rearranges texels of four bytes in place.
    pub(super) fn apply(self, texels: &mut [u8], width: usize) {
        let texels = texels.as_chunks_mut::<4>().0;
        if self.channels != AS_IT_IS {
            for texel in texels.iter_mut() {
                let given = *texel;
                *texel = self.channels.map(|source| match source {
                    Source::Channel(channel) => given[channel],
                    Source::Number(number) => number,
                });
            }
        }
        if self.leftwards {
            texels.chunks_exact_mut(width).for_each(<[_]>::reverse);
        }
        if self.upwards {
            let mut rows = texels.chunks_exact_mut(width);
            while let (Some(upper), Some(lower)) = (rows.next(), rows.next_back()) {
                upper.swap_with_slice(lower);
            }
        }
    }
}
