//! Textures: bilinear lookup at the places that rays hit, and its rate of change.

use crate::error::{Error, Result};

/// A float32 that is added to small whole numbers, whose last bits are then these numbers.
const WHOLE: f32 = 8_388_608.0;

const LARGEST_SIDE: i64 = 1 << 22;

/// What a texture shows beyond its edges.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Wrap {
    Repeat,
    Clamp,
    Mirror,
}

/// Where a texture's texels lie in a buffer, in a frame of one texel around it.
#[derive(Clone, Debug)]
pub(super) struct Texture {
    pub(super) first: usize,
    pub(super) width: u32,
    pub(super) height: u32,
    pub(super) wrap: Wrap,
}

impl Texture {
    pub(super) fn texels<'a>(&self, buffer: &'a [f32]) -> &'a [f32] {
        &buffer[self.first..][..(self.width as usize + 2) * (self.height as usize + 2)]
    }

    /// Whether it is of one texel, and so the same everywhere.
    pub(super) fn is_constant(&self) -> bool {
        self.width == 1 && self.height == 1
    }
}

/// The textures of a scene, each in a frame of one texel.
pub(super) fn checked(layouts: &[[i64; 4]], texels: &[Vec<f32>]) -> Result<Vec<Texture>> {
    let length = texels.first().map_or(0, Vec::len);
    if texels.iter().any(|group| group.len() != length || !group.iter().all(|t| t.is_finite())) {
        return Err(Error::Argument("the texels of all light colours must be finite and equally many".to_owned()));
    }
    let mut textures = vec![];
    for (number, &[first, width, height, wrap]) in layouts.iter().enumerate() {
        let side = 1..=LARGEST_SIDE;
        let end = side.contains(&width).then(|| (width + 2).checked_mul(height + 2)?.checked_add(first)).flatten();
        let fits = texels.is_empty() || end.is_some_and(|end| usize::try_from(end).is_ok_and(|end| end <= length));
        let (Ok(first), Ok(columns), Ok(rows)) = (usize::try_from(first), u32::try_from(width), u32::try_from(height))
        else {
            return Err(misplaced(number, &layouts[number], length));
        };
        if !side.contains(&height) || end.is_none_or(|end| end > i64::from(u32::MAX)) || !fits {
            return Err(misplaced(number, &layouts[number], length));
        }
        let wrap = match wrap {
            0 => Wrap::Repeat,
            1 => Wrap::Clamp,
            2 => Wrap::Mirror,
            _ => return Err(misplaced(number, &layouts[number], length)),
        };
        textures.push(Texture { first, width: columns, height: rows, wrap });
    }
    Ok(textures)
}

fn misplaced(number: usize, layout: &[i64; 4], length: usize) -> Error {
    Error::Argument(format!(
        "texture {number} must have a side of 1..2^22 texels, a wrap mode of 0..2, and lie within {length} texels \
         together with its frame, got {layout:?}"
    ))
}

/// Where rays hit a texture: for each the texel at or before the place, and how far it is past it in x and in y.
pub(super) struct Taps<const L: usize> {
    texel: [u32; L],
    x: [f32; L],
    y: [f32; L],
    /// Texels per unit of u and of v there, where rates are wanted.
    slopes: [[f32; L]; 2],
}

#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
impl<const L: usize> Taps<L> {
    #[inline(always)]
    pub(super) fn new<const RATE: bool>(texture: &Texture, u: &[f32; L], v: &[f32; L]) -> Self {
        let (column, x, by_u) = texels_before::<L, RATE>(u, texture.width, texture.wrap);
        let (row, y, by_v) = texels_before::<L, RATE>(v, texture.height, texture.wrap);
        let stride = texture.width + 2;
        Self { texel: std::array::from_fn(|i| row[i] * stride + column[i]), x, y, slopes: [by_u, by_v] }
    }

    /// Reflectance as luma; with the rates of u and v its own rate.
    #[inline(always)]
    pub(super) fn look_up<const RATE: bool>(
        &self,
        texels: &[f32],
        stride: usize,
        rates: &[[f32; L]; 2],
    ) -> ([f32; L], [f32; L]) {
        // A texel that is not there cannot be asked for; said so, this becomes one gather each.
        let texel = |at: usize| if at < texels.len() { texels[at] } else { 0.0 };
        let mut corners = [[0f32; L]; 4];
        for i in 0..L {
            corners[0][i] = texel(self.texel[i] as usize);
        }
        for i in 0..L {
            corners[1][i] = texel(self.texel[i] as usize + 1);
        }
        for i in 0..L {
            corners[2][i] = texel(self.texel[i] as usize + stride);
        }
        for i in 0..L {
            corners[3][i] = texel(self.texel[i] as usize + stride + 1);
        }
        let [p, q, r, s] = corners;
        let (mut value, mut rate) = ([0f32; L], [0f32; L]);
        for i in 0..L {
            let (upper, lower) = (q[i] - p[i], s[i] - r[i]);
            let (a, b) = (p[i] + upper * self.x[i], r[i] + lower * self.x[i]);
            value[i] = a + (b - a) * self.y[i];
            if RATE {
                let along_x = upper + (lower - upper) * self.y[i];
                let (x_rate, y_rate) = (self.slopes[0][i] * rates[0][i], self.slopes[1][i] * rates[1][i]);
                rate[i] = along_x * x_rate + (b - a) * y_rate;
            }
        }
        (value, rate)
    }
}

/// For coordinates along one side: the texel at or before each, counted from the frame around the texture, how far the
/// coordinate is past it, and texels per unit.
#[inline(always)]
#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
fn texels_before<const L: usize, const RATE: bool>(
    coordinates: &[f32; L],
    size: u32,
    wrap: Wrap,
) -> ([u32; L], [f32; L], [f32; L]) {
    match wrap {
        Wrap::Repeat => before::<L, RATE>(coordinates, size, |u| (u - u.floor(), 1.0)),
        Wrap::Clamp => before::<L, RATE>(coordinates, size, |u| {
            let inside = if u > 0.0 { u } else { 0.0 };
            let inside = if inside < 1.0 { inside } else { 1.0 };
            (inside, if inside == u { 1.0 } else { 0.0 })
        }),
        Wrap::Mirror => before::<L, RATE>(coordinates, size, |u| {
            let period = u - 2.0 * (u * 0.5).floor();
            let back = 2.0 - period;
            if period < back { (period, 1.0) } else { (back, -1.0) }
        }),
    }
}

#[inline(always)]
#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
fn before<const L: usize, const RATE: bool>(
    coordinates: &[f32; L],
    size: u32,
    fold: impl Fn(f32) -> (f32, f32),
) -> ([u32; L], [f32; L], [f32; L]) {
    #[allow(clippy::cast_precision_loss, reason = "a side has at most 2^22 texels")]
    let size = size as f32;
    let (mut texel, mut past, mut slope) = ([0u32; L], [0f32; L], [0f32; L]);
    for i in 0..L {
        let (inside, direction) = fold(coordinates[i]);
        let at = inside * size - 0.5;
        let whole = at.floor();
        past[i] = at - whole;
        // What is not finite must not lead outside of the texture.
        let number = whole + 1.0;
        let number = if number > 0.0 { number } else { 0.0 };
        let number = if number < size { number } else { size };
        texel[i] = (number + WHOLE).to_bits() - WHOLE.to_bits();
        if RATE {
            slope[i] = direction * size;
        }
    }
    (texel, past, slope)
}
