//! Textures: bilinear lookup at the points that rays hit, and its rate of change.
//!
//! Each texel is stored next to the one after it, so that one load fetches both, and each texture has a frame of one
//! texel, so that lookups at its border need no branch.
//!
//! What must not break: the order of the mix (in both rows, then between them), and the check that all texels lie in
//! the buffer.

use std::ops::Range;

use crate::error::{Error, Result};
use crate::render::lanes::{Lanes, MOST, Pairs};

/// A float32 that is added to small whole numbers, whose last bits are then these numbers.
const WHOLE: f32 = 8_388_608.0;

const LARGEST_SIDE: i64 = 1 << 22;

/// So many texels are looked at together.
const AT_ONCE: usize = 1 << 12;

/// What a texture shows beyond its edges.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Wrap {
    Repeat,
    Clamp,
    Mirror,
}

/// Where a texture's texels lie in a buffer, in a frame of one texel around it.
#[derive(Clone, Debug)]
pub(crate) struct Texture {
    pub(crate) first: usize,
    pub(crate) width: u32,
    pub(crate) height: u32,
    pub(crate) wrap: Wrap,
}

impl Texture {
    /// Returns whether it is of one texel, and so the same everywhere.
    pub(crate) fn is_constant(&self) -> bool {
        self.width == 1 && self.height == 1
    }

    /// Returns where its texels are, those of its frame of one texel among them.
    pub(crate) fn all(&self) -> Range<usize> {
        self.first..self.first + (self.width as usize + 2) * (self.height as usize + 2)
    }
}

/// Returns the textures of a scene, each in a frame of one texel; `groups` has the texels of each light colour.
pub(crate) fn checked<'a, T: ExactSizeIterator<Item = &'a f32>>(
    layouts: &[[i64; 4]],
    groups: impl Iterator<Item = T>,
) -> Result<Vec<Texture>> {
    let mut length = None;
    for texels in groups {
        // All of them, because a loop without an exit is vector code.
        let finite = |texels: T| texels.fold(true, |all, texel| all & texel.is_finite());
        if *length.get_or_insert(texels.len()) != texels.len() || !finite(texels) {
            return Err(Error::Argument("the texels of all light colours must be finite and equally many".to_owned()));
        }
    }
    checked_layouts(layouts, length, 1)
}

/// Returns the textures that these layouts place, each in a frame of so many texels; all lie within `length` texels, if
/// that is given.
pub(crate) fn checked_layouts(layouts: &[[i64; 4]], length: Option<usize>, frame: i64) -> Result<Vec<Texture>> {
    let mut textures = vec![];
    for (number, &[first, width, height, wrap]) in layouts.iter().enumerate() {
        let refuse = || Err(misplaced(number, &layouts[number], length.unwrap_or(0)));
        let side = 1..=LARGEST_SIDE;
        let end = side
            .contains(&width)
            .then(|| (width + 2 * frame).checked_mul(height + 2 * frame)?.checked_add(first))
            .flatten();
        let fits =
            length.is_none_or(|length| end.is_some_and(|end| usize::try_from(end).is_ok_and(|end| end <= length)));
        let (Ok(first), Ok(columns), Ok(rows)) = (usize::try_from(first), u32::try_from(width), u32::try_from(height))
        else {
            return refuse();
        };
        if !side.contains(&height) || end.is_none_or(|end| end > i64::from(i32::MAX)) || !fits {
            return refuse();
        }
        let wrap = match wrap {
            0 => Wrap::Repeat,
            1 => Wrap::Clamp,
            2 => Wrap::Mirror,
            _ => return refuse(),
        };
        textures.push(Texture { first, width: columns, height: rows, wrap });
    }
    Ok(textures)
}

/// Returns the texels of a texture, row by row, in a frame of one texel around it, which its wrap mode says.
pub(crate) fn framed<T: Copy>(texels: &[T], width: usize, wrap: Wrap) -> Vec<T> {
    // The texel before the first, and the one after the last, by their numbers along a side.
    let around = |length: usize| if wrap == Wrap::Repeat { (length - 1, 0) } else { (0, length - 1) };
    let height = texels.len() / width;
    let ((before, after), (above, below)) = (around(width), around(height));
    let mut framed = Vec::with_capacity((width + 2) * (height + 2));
    for row in [above].into_iter().chain(0..height).chain([below]) {
        let row = &texels[row * width..][..width];
        framed.push(row[before]);
        framed.extend_from_slice(row);
        framed.push(row[after]);
    }
    framed
}

/// Pairs each texel with the one after it: a row of two is then fetched at once.
///
/// Zeros are not written: most texels of what surfaces emit are zero, and memory that nobody wrote to takes none.
pub(crate) fn paired<'a>(texels: impl ExactSizeIterator<Item = &'a f32> + Clone) -> Vec<u64> {
    let mut pairs = vec![0; texels.len()];
    pair_up(&mut pairs, texels);
    pairs
}

/// Returns what [`paired`] does, and soon where most texels are zero.
pub(crate) fn paired_in_a_row(texels: &[f32]) -> Vec<u64> {
    let mut pairs = vec![0; texels.len()];
    for (number, pairs) in pairs.chunks_mut(AT_ONCE).enumerate() {
        let rest = &texels[number * AT_ONCE..];
        let needed = &rest[..rest.len().min(pairs.len() + 1)];
        if needed.iter().fold(0, |any, texel| any | texel.to_bits()) != 0 {
            pair_up(pairs, needed.iter());
        }
    }
    pairs
}

fn pair_up<'a>(pairs: &mut [u64], texels: impl Iterator<Item = &'a f32> + Clone) {
    let after = texels.clone().skip(1).chain([&0.0]);
    for (pair, (one, next)) in pairs.iter_mut().zip(texels.zip(after)) {
        let bits = u64::from(one.to_bits()) | u64::from(next.to_bits()) << 32;
        if bits != 0 {
            *pair = bits;
        }
    }
}

/// Returns a texel and the one after it.
#[inline(always)]
#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
#[allow(clippy::cast_possible_truncation, reason = "a half each")]
pub(crate) fn parted(pair: u64) -> [f32; 2] {
    [f32::from_bits(pair as u32), f32::from_bits((pair >> 32) as u32)]
}

fn misplaced(number: usize, layout: &[i64; 4], length: usize) -> Error {
    Error::Argument(format!(
        "texture {number} must have a side of 1..2^22 texels, a wrap mode of 0..2, and lie within {length} texels \
         together with its frame, got {layout:?}"
    ))
}

/// How a wrap mode folds a coordinate back into the texture: where to, and in which direction it goes on there.
pub(crate) trait Fold {
    fn fold(coordinate: f32) -> (f32, f32);
}

pub(crate) struct Repeat;
pub(crate) struct Clamp;
pub(crate) struct Mirror;

#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
impl Fold for Repeat {
    #[inline(always)]
    fn fold(u: f32) -> (f32, f32) {
        (u - u.floor(), 1.0)
    }
}

#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
impl Fold for Clamp {
    #[inline(always)]
    fn fold(u: f32) -> (f32, f32) {
        let inside = if u > 0.0 { u } else { 0.0 };
        let inside = if inside < 1.0 { inside } else { 1.0 };
        (inside, if inside == u { 1.0 } else { 0.0 })
    }
}

#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
impl Fold for Mirror {
    #[inline(always)]
    fn fold(u: f32) -> (f32, f32) {
        let period = u - 2.0 * (u * 0.5).floor();
        let back = 2.0 - period;
        if period < back { (period, 1.0) } else { (back, -1.0) }
    }
}

/// A texture under lights of one colour.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Sampler<'a> {
    /// Each with the one after it.
    texels: &'a [u64],
    /// As many as there are texels.
    count: u32,
    /// Texels from one row to the next.
    stride: u32,
    size: [f32; 2],
}

#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
impl<'a> Sampler<'a> {
    #[inline(always)]
    #[allow(clippy::cast_precision_loss, reason = "a side has at most 2^22 texels")]
    pub(crate) fn new(texture: &Texture, buffer: &'a [u64]) -> Self {
        let (stride, rows) = (texture.width + 2, texture.height + 2);
        let count = stride * rows;
        let texels = &buffer[texture.first..][..count as usize];
        Self { texels, count, stride, size: [texture.width as f32, texture.height as f32] }
    }

    /// Returns the reflectance of a texture that is the same everywhere.
    #[inline(always)]
    pub(crate) fn only(&self) -> f32 {
        parted(self.texels[0])[0]
    }

    /// Returns the texel at or before each point and the next one, and the two in the row below.
    ///
    /// One after the other, so that many of them are on their way from memory at once.
    #[inline(always)]
    pub(crate) fn corners(&self, taps: &Taps, n: usize) -> [Pairs; 2] {
        let mut corners = [Pairs::ZERO; 2];
        for (corner, offset) in corners.iter_mut().zip([0, self.stride]) {
            for i in 0..n {
                corner[i] = self.pair(taps.texel[i] + offset);
            }
        }
        corners
    }

    /// Returns the texel at or before each point, the next one, and the two in the row below, of a buffer of single texels.
    #[inline(always)]
    pub(crate) fn four(&self, taps: &Taps, n: usize) -> [Pairs; 4] {
        let mut corners = [Pairs::ZERO; 4];
        for (corner, offset) in corners.iter_mut().zip([0, 1, self.stride, self.stride + 1]) {
            for i in 0..n {
                corner[i] = self.pair(taps.texel[i] + offset);
            }
        }
        corners
    }

    /// Returns texels by their indices. A texel that is not there cannot be asked for; said so, this becomes a gather.
    /// Numbers below 2^31 are those that it takes as they are.
    #[inline(always)]
    fn pair(&self, at: u32) -> u64 {
        let at = at & (u32::MAX >> 1);
        if at < self.count { self.texels[at as usize] } else { 0 }
    }
}

/// Where rays hit a texture: for each the texel at or before the point, and how far it is past it in x and in y.
#[derive(Debug)]
pub(crate) struct Taps {
    texel: [u32; MOST],
    pub(crate) x: Lanes,
    pub(crate) y: Lanes,
}

#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
impl Taps {
    pub(crate) const NONE: Self = Self { texel: [0; MOST], x: Lanes::ZERO, y: Lanes::ZERO };

    /// Sets that of a ray which hits the texture at (u, v). Gives texels per unit of u and of v there.
    #[inline(always)]
    pub(crate) fn set<F: Fold>(&mut self, ray: usize, sampler: &Sampler, u: f32, v: f32) -> [f32; 2] {
        let (column, x, by_u) = before::<F>(u, sampler.size[0]);
        let (row, y, by_v) = before::<F>(v, sampler.size[1]);
        self.texel[ray] = row * sampler.stride + column;
        (self.x[ray], self.y[ray]) = (x, y);
        [by_u, by_v]
    }
}

/// Returns, for a coordinate along one side, the texel at or before it, counted from the frame around the texture, how
/// far the coordinate is past it, and texels per unit.
#[inline(always)]
#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
fn before<F: Fold>(coordinate: f32, size: f32) -> (u32, f32, f32) {
    let (inside, direction) = F::fold(coordinate);
    let at = inside * size - 0.5;
    let whole = at.floor();
    // What is not finite must not lead outside of the texture.
    let number = whole + 1.0;
    let number = if number > 0.0 { number } else { 0.0 };
    let number = if number < size { number } else { size };
    ((number + WHOLE).to_bits() - WHOLE.to_bits(), at - whole, direction * size)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pairs_are_the_same_however_many_texels_are_zero() {
        for nonzero in [vec![], vec![0], vec![AT_ONCE - 1], vec![AT_ONCE], vec![3, 2 * AT_ONCE], vec![2 * AT_ONCE + 4]]
        {
            let mut texels = vec![0.0f32; 2 * AT_ONCE + 5];
            for &at in &nonzero {
                texels[at] = 1.5;
            }
            assert_eq!(paired_in_a_row(&texels), paired(texels.iter()), "{nonzero:?}");
        }
    }
}
