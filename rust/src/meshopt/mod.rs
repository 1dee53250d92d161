//! Compressed buffer views of glTF files to bytes, by `KHR_meshopt_compression`, and by `EXT_meshopt_compression`, of
//! which it has all.
//!
//! `attributes` are the numbers of vertices, whose `differences` are stored, and to which one of the `filters` may
//! belong. `triangles` and `indices` name vertices, by the `numbers` of their streams.
//!
//! What must not break: nothing beyond the data is read, and nothing but the result grows with them.
//!
//! Source: Khronos Group, `KHR_meshopt_compression`, appendices A (bitstream) and B (filters).

mod attributes;
mod differences;
mod filters;
mod indices;
mod numbers;
mod triangles;

pub use filters::MeshoptFilter;

use crate::error::{Error, Result};

/// What a buffer view holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MeshoptMode {
    /// Elements of 4, 8 ... 256 bytes, and what they go through.
    Attributes(MeshoptFilter),
    /// Vertices of triangles, of 2 or 4 bytes each.
    Triangles,
    /// Vertices in any order, of 2 or 4 bytes each.
    Indices,
}

/// Decodes a buffer view of `count` elements of `stride` bytes; both must have been held to a limit.
///
/// # Errors
///
/// [`Error::Argument`] for a stride or a number of elements that the mode does not have, [`Error::Format`] for data that
/// break a rule of the stream, and [`Error::Memory`] if there is not enough.
pub fn decode_meshopt(data: &[u8], mode: MeshoptMode, count: usize, stride: usize) -> Result<Vec<u8>> {
    check(mode, count, stride)?;
    let size = count.saturating_mul(stride);
    let mut bytes = Vec::new();
    bytes
        .try_reserve_exact(size)
        .map_err(|_| Error::Memory(format!("{count} elements of {stride} bytes need more memory than there is")))?;
    match (mode, stride) {
        (MeshoptMode::Attributes(filter), _) => {
            attributes::decode(data, count, stride, &mut bytes)?;
            filter.apply(&mut bytes, stride);
        }
        (MeshoptMode::Triangles, 2) => triangles::decode(data, count / 3, |index| push_short(&mut bytes, index))?,
        (MeshoptMode::Triangles, _) => triangles::decode(data, count / 3, |index| push(&mut bytes, index))?,
        (MeshoptMode::Indices, 2) => indices::decode(data, count, |index| push_short(&mut bytes, index))?,
        (MeshoptMode::Indices, _) => indices::decode(data, count, |index| push(&mut bytes, index))?,
    }
    Ok(bytes)
}

/// Refuses elements that a mode does not have.
fn check(mode: MeshoptMode, count: usize, stride: usize) -> Result<()> {
    let (name, whole) = match mode {
        MeshoptMode::Attributes(filter) => {
            if !stride.is_multiple_of(4) || !(4..=256).contains(&stride) {
                let rule = format!("attributes must have a stride of 4, 8 ... 256 bytes, got {stride}");
                return Err(Error::Argument(rule));
            }
            return filter.check(stride);
        }
        MeshoptMode::Triangles => ("triangles", count.is_multiple_of(3)),
        MeshoptMode::Indices => ("indices", true),
    };
    if !matches!(stride, 2 | 4) || !whole {
        let rule = format!("{name} must have a stride of 2 or 4 bytes and be whole, got {count} of {stride}");
        return Err(Error::Argument(rule));
    }
    Ok(())
}

fn push(bytes: &mut Vec<u8>, index: u32) {
    bytes.extend_from_slice(&index.to_le_bytes());
}

#[allow(clippy::cast_possible_truncation, reason = "such a view has no larger ones")]
fn push_short(bytes: &mut Vec<u8>, index: u32) {
    bytes.extend_from_slice(&(index as u16).to_le_bytes());
}

#[cfg(test)]
mod tests {
    use super::*;

    const NONE: MeshoptMode = MeshoptMode::Attributes(MeshoptFilter::None);

    /// One plane of 60 bytes: four groups, each of another kind.
    const PLANE: [u8; 36] = [
        0xe4, 0x1b, 0x00, 0x00, 0xff, 9, 8, 7, 6, 5, 0x1f, 0xf0, 0, 0, 0, 0, 0, 1, 77, 78, 3, 3, 3, 3, 3, 3, 3, 3, 3,
        3, 3, 3, 3, 3, 3, 3,
    ];

    /// Elements of four bytes that change alike, after one of fives.
    fn view() -> Vec<u8> {
        [&[0xa0][..], &PLANE.repeat(4), &[5; 32]].concat()
    }

    #[test]
    fn each_kind_of_group_holds_differences() {
        let mut deltas = [0u8; 60];
        // What stands for the largest number of two bits, 3, is a byte that follows; so it is with four bits and 15.
        deltas[16..32].copy_from_slice(&[0, 1, 2, 9, 0, 0, 0, 0, 0, 0, 0, 0, 8, 7, 6, 5]);
        deltas[32..48].copy_from_slice(&[1, 77, 78, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 1]);
        deltas[48..].fill(3);
        let mut byte = 5u8;
        let bytes = deltas.map(|delta| {
            let half = delta / 2;
            byte = if delta % 2 == 0 { byte.wrapping_add(half) } else { byte.wrapping_sub(half + 1) };
            byte
        });
        let expected: Vec<u8> = bytes.iter().flat_map(|byte| [*byte; 4]).collect();
        assert_eq!(decode_meshopt(&view(), NONE, 60, 4).expect("a good view"), expected);
    }

    #[test]
    fn what_breaks_a_rule_is_told_with_its_byte() {
        let told = |data: &[u8], mode, count, stride| {
            decode_meshopt(data, mode, count, stride).expect_err("a bad view").to_string()
        };
        let view = view();
        let first_plane = [&view[..37], &[5; 32]].concat();
        assert_eq!(told(&first_plane, NONE, 60, 4), "attributes end within a block (byte 37)");
        assert_eq!(told(&view[..150], NONE, 60, 4), "attributes end within a group (byte 118)");
        assert_eq!(told(&view, NONE, 48, 4), "57 bytes of attributes are left over (byte 88)");
        let triangles = [&[0xe1, 0x0f, 0x80][..], &[0; 16]].concat();
        assert_eq!(told(&triangles, MeshoptMode::Triangles, 3, 4), "indices end too early (byte 3)");
        let long = [&[0xd1][..], &[0xff; 9]].concat();
        assert_eq!(told(&long, MeshoptMode::Indices, 1, 4), "a number of indices has more than 32 bits (byte 1)");
        let quaternions = MeshoptMode::Attributes(MeshoptFilter::Quaternion);
        assert_eq!(told(&view, quaternions, 60, 4), "the filter QUATERNION needs a stride of 8 bytes, got 4");
    }

    #[test]
    fn indices_of_two_bytes_are_cut() {
        let view = [&[0xd1, 0xfc, 0xff, 0xff, 0x7f][..], &[0; 4]].concat();
        let long = decode_meshopt(&view, MeshoptMode::Indices, 1, 4).expect("a good view");
        assert_eq!(decode_meshopt(&view, MeshoptMode::Indices, 1, 2).expect("a good view"), long[..2]);
    }
}
