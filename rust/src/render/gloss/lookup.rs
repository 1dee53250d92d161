//! Bilinear lookup in textures and light maps at single points, and slopes of textures there, with rates.
//!
//! It is [`texture`](crate::render::light::texture)'s rule, for paths that are followed one by one.
//!
//! What must not break: what is not finite leads to no texel outside of the texture.

use super::frame_axes::at_map;
use super::number::{Number, Triple};
use crate::render::light::texture::{Texture, Wrap};

/// Looks up a texture at a point, by the affine maps to its coordinates; `texel` gives each texel of the buffer.
pub(crate) fn looked_up<N: Number, const CHANNELS: usize>(
    texture: &Texture,
    wrap: Wrap,
    maps: [&[f64; 4]; 2],
    point: Triple<N>,
    texel: impl Fn(usize) -> [f64; CHANNELS],
) -> [N; CHANNELS] {
    if texture.is_constant() {
        let only = texel(texture.first);
        let mut values = [N::constant(0.0); CHANNELS];
        for i in 0..CHANNELS {
            values[i] = N::constant(only[i]);
        }
        return values;
    }
    let (corners, past) = around(texture, wrap, [at_map(maps[0], point), at_map(maps[1], point)], texel);
    mixed(corners, past)
}

/// Mixes four texels, two of a row and the two below, by how far a point is past the first.
pub(crate) fn mixed<N: Number, const CHANNELS: usize>(
    [a, b, c, d]: [[f64; CHANNELS]; 4],
    [x, y]: [N; 2],
) -> [N; CHANNELS] {
    let mut values = [N::constant(0.0); CHANNELS];
    for i in 0..CHANNELS {
        let upper = N::constant(a[i]) + x.scaled(b[i] - a[i]);
        let lower = N::constant(c[i]) + x.scaled(d[i] - c[i]);
        values[i] = upper + (lower - upper) * y;
    }
    values
}

/// Returns how a texture of single numbers grows with u and with v at a point, as its bilinear lookup does.
pub(crate) fn slopes<N: Number>(
    texture: &Texture,
    wrap: Wrap,
    maps: [&[f64; 4]; 2],
    point: Triple<N>,
    texel: impl Fn(usize) -> f64,
) -> [N; 2] {
    let ([a, b, c, d], [x, y]) = around(texture, wrap, [at_map(maps[0], point), at_map(maps[1], point)], texel);
    let grown = |map: &[f64; 4], size: u32| f64::from(size) * direction(at_map(map, point).value(), wrap);
    let along_u = N::constant(b - a) + y.scaled((d - c) - (b - a));
    let along_v = N::constant(c - a) + x.scaled((d - b) - (c - a));
    [along_u.scaled(grown(maps[0], texture.width)), along_v.scaled(grown(maps[1], texture.height))]
}

/// Returns the four texels around texture coordinates, two of a row and the two below, and how far these are past the
/// first.
pub(crate) fn around<N: Number, T>(
    texture: &Texture,
    wrap: Wrap,
    [u, v]: [N; 2],
    texel: impl Fn(usize) -> T,
) -> ([T; 4], [N; 2]) {
    let (column, x) = before(folded(u, wrap), texture.width);
    let (row, y) = before(folded(v, wrap), texture.height);
    let stride = texture.width as usize + 2;
    let first = texture.first + row * stride + column;
    ([first, first + 1, first + stride, first + stride + 1].map(texel), [x, y])
}

/// Returns how a coordinate that is folded back grows with the one that is not.
fn direction(coordinate: f64, wrap: Wrap) -> f64 {
    match wrap {
        Wrap::Repeat => 1.0,
        Wrap::Clamp if (0.0..1.0).contains(&coordinate) => 1.0,
        Wrap::Clamp => 0.0,
        Wrap::Mirror if coordinate - 2.0 * (coordinate * 0.5).floor() < 1.0 => 1.0,
        Wrap::Mirror => -1.0,
    }
}

/// Folds a coordinate back into the texture.
fn folded<N: Number>(coordinate: N, wrap: Wrap) -> N {
    let value = coordinate.value();
    match wrap {
        Wrap::Repeat => coordinate - N::constant(value.floor()),
        Wrap::Clamp => coordinate.at_least(0.0).at_most(1.0),
        Wrap::Mirror => {
            let period = coordinate - N::constant(2.0 * (value * 0.5).floor());
            if period.value() < 1.0 { period } else { N::constant(2.0) - period }
        }
    }
}

/// Returns the texel at or before a coordinate, counted from the frame around the texture, and how far it is past it.
#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to the texture")]
fn before<N: Number>(inside: N, size: u32) -> (usize, N) {
    let along = inside.scaled(f64::from(size)) - N::constant(0.5);
    let whole = along.value().floor();
    let number = (whole + 1.0).max(0.0).min(f64::from(size));
    (number as usize, along - N::constant(whole))
}
