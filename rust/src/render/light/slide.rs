//! Slides: pictures that lights at a position throw on surfaces (projectors, and spots with a texture).
//!
//! What a slide sends to a place is looked up by the place's direction from the light. Where that is in the slide is
//! written once, for numbers of every kind: rays of the camera take it in float32, glossy surfaces and derivatives in
//! float64, with rates or without, and bakes in float32. Texels are looked up as those of surfaces, for many rays at once
//! or for one.
//!
//! What must not break: luma and rate come from the same steps, and values with and without rates have the same bits.

use multiversion::multiversion;

use super::lookup::Positions;
use super::texture::{Clamp, Fold, Mirror, Repeat, Sampler, Texture, Wrap, checked_layouts, paired, parted};
use crate::error::{Error, Result};
use crate::render::geometry::vector::Vector;
use crate::render::gloss::lookup::{around, mixed};
use crate::render::gloss::number::{Number, RatedSingle, Triple, dot, rated};
use crate::render::lanes::{Lanes, Rays};

/// What a slide is made of.
#[derive(Clone, Debug)]
pub struct SlideTables {
    /// Vectors of the world for u, v and depth: a place `away` from the light has u = (`rows[0]` . away) / (`rows[2]` .
    /// away), and v likewise. The last one is the unit vector along which the light looks.
    pub rows: [[f64; 3]; 3],
    /// From (u, v, 1) to the coordinates of the texture.
    pub uv_map: [[f64; 3]; 2],
    /// Whether it is a projector's: it ends where u or v leave 0..=1, and shines on a plane in front of it as strongly at
    /// the edge as in the middle.
    pub projected: bool,
    /// Whether the nearest texel is taken, not a mix of four.
    pub nearest: bool,
    /// Width, height and wrap mode (0 repeat, 1 clamp, 2 mirror).
    pub layout: [i64; 3],
    /// One plane of texels in a frame of one texel, or three: red, green and blue.
    pub texels: Vec<f32>,
}

/// A slide that was checked.
#[derive(Debug)]
pub struct Slide {
    rows: [Vector; 3],
    uv_map: [[f64; 3]; 2],
    projected: bool,
    nearest: bool,
    texture: Texture,
    /// Of each plane, each with the one after it.
    planes: Vec<Vec<u64>>,
}

impl Slide {
    /// Checks a slide.
    ///
    /// # Errors
    ///
    /// [`Error::Argument`] for numbers or texels that are not finite, for negative texels, and for another number of
    /// texels than the layout has.
    pub fn new(tables: SlideTables) -> Result<Self> {
        let SlideTables { rows, uv_map, projected, nearest, layout: [width, height, wrap], texels } = tables;
        let texture = checked_layouts(&[[0, width, height, wrap]], None, 1)?.remove(0);
        let each = (texture.width as usize + 2) * (texture.height as usize + 2);
        if ![each, 3 * each].contains(&texels.len()) {
            return Err(Error::Argument(format!(
                "a slide of {width} x {height} texels has {each} in a frame, once or three times, got {}",
                texels.len()
            )));
        }
        if !(rows.iter().chain(&uv_map).flatten().all(|x| x.is_finite())
            && texels.iter().all(|x| x.is_finite() && *x >= 0.0))
        {
            return Err(Error::Argument("a slide is finite, and its texels are not negative".to_owned()));
        }
        let planes = texels.chunks_exact(each).map(|plane| paired(plane.iter())).collect();
        Ok(Self { rows, uv_map, projected, nearest, texture, planes })
    }

    /// Returns how many planes of texels it has: one, or one for each of red, green and blue.
    pub(crate) fn planes(&self) -> usize {
        self.planes.len()
    }

    /// Returns its rows as they turn: `turned` gives a vector of the world in the axes that are wanted, and its rate.
    pub(crate) fn rows(&self, turned: impl Fn(Vector) -> [Vector; 2]) -> SlideRows {
        SlideRows(self.rows.map(turned))
    }

    /// Returns its rows as they are.
    pub(crate) fn rows_at_rest(&self) -> SlideRows {
        self.rows(|row| [row, [0.0; 3]])
    }

    /// Returns the coordinates of the texture at a place `away` from the light, and by what they are multiplied: 0 where
    /// the slide sends nothing.
    #[inline(always)]
    #[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
    fn at<N: Number>(&self, rows: &[Triple<N>; 3], away: Triple<N>) -> ([N; 2], N) {
        let (zero, one) = (N::constant(0.0), N::constant(1.0));
        let depth = dot(rows[2], away);
        let in_front = depth.value() > 0.0;
        let per_depth = one / if in_front { depth } else { one };
        let (u, v) = (dot(rows[0], away) * per_depth, dot(rows[1], away) * per_depth);
        let sees = in_front && (!self.projected || is_fraction(u) && is_fraction(v));
        let (u, v) = if sees { (u, v) } else { (zero, zero) };
        let slant = if self.projected { dot(away, away).sqrt() * per_depth } else { one };
        let along = |map: &[f64; 3]| u.scaled(map[0]) + v.scaled(map[1]) + N::constant(map[2]);
        let [u_map, v_map] = &self.uv_map;
        ([along(u_map), along(v_map)], if sees { slant * slant * slant } else { zero })
    }

    /// Returns what factor of the light's intensity a plane sends to a place `away` from the light.
    pub(crate) fn sent<N: Number>(&self, plane: usize, rows: &[Triple<N>; 3], away: Triple<N>) -> N {
        let (coordinates, factor) = self.at(rows, away);
        let texels = &self.planes[plane];
        let (corners, past) =
            around(&self.texture, self.texture.wrap, coordinates, |texel| [f64::from(parted(texels[texel])[0])]);
        let [value] = mixed(corners, if self.nearest { past.map(nearest) } else { past });
        value * factor
    }

    /// Takes from the light that falls from a position, and from its rate, what a plane does not send to where rays hit.
    #[inline(always)]
    #[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
    #[allow(clippy::cast_possible_truncation, reason = "float32 is kept as float64")]
    fn take<const RATE: bool, const FULL: bool, F: Fold>(
        &self,
        seen: &SeenSlide,
        (position, position_rate): ([f32; 3], [f32; 3]),
        rays: &Rays<'_, FULL>,
        (depth, depth_rate): (&Lanes, &Lanes),
        (light, light_rate): (&mut Lanes, &mut Lanes),
    ) {
        let n = rays.count();
        let sampler = Sampler::new(&self.texture, &self.planes[seen.plane]);
        let (rows, moving) = (seen.rows.numbers::<f32>(), seen.rows.numbers::<RatedSingle>());
        let mut positions = Positions::NONE;
        let (mut factor, mut factor_rate) = (Lanes::ZERO, Lanes::ZERO);
        for i in 0..n {
            let (x, y, z) = (rays.x[i], rays.y[i], depth[i]);
            let away = [x * z - position[0], y * z - position[1], z - position[2]];
            if RATE {
                let dz = depth_rate[i];
                let change = [x * dz - position_rate[0], y * dz - position_rate[1], dz - position_rate[2]];
                let number = |k: usize| RatedSingle::new(f64::from(away[k]), f64::from(change[k]));
                let ([u, v], by) = self.at(&moving, [number(0), number(1), number(2)]);
                let parts = |number: RatedSingle| (number.value() as f32, number.rate() as f32);
                positions.set::<RATE, F>(i, &sampler, [parts(u), parts(v)]);
                (factor[i], factor_rate[i]) = parts(by);
            } else {
                let ([u, v], by) = self.at(&rows, away);
                positions.set::<RATE, F>(i, &sampler, [(u, 0.0), (v, 0.0)]);
                factor[i] = by;
            }
        }
        if self.nearest {
            positions.snap(n);
        }
        let corners = sampler.corners(&positions.taps, n);
        for i in 0..n {
            let (value, rate) = positions.mixed::<RATE>(i, [parted(corners[0][i]), parted(corners[1][i])]);
            let sent = value * factor[i];
            if RATE {
                let sent_rate = rate * factor[i] + value * factor_rate[i];
                light_rate[i] = light_rate[i] * sent + light[i] * sent_rate;
            }
            light[i] *= sent;
        }
    }
}

/// Returns whether a coordinate is from 0 to 1.
#[inline(always)]
#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
fn is_fraction<N: Number>(coordinate: N) -> bool {
    coordinate.value() >= 0.0 && coordinate.value() <= 1.0
}

/// Returns where the nearest texel lies between a texel (0) and the next one (1).
fn nearest<N: Number>(past: N) -> N {
    N::constant(if past.value() < 0.5 { 0.0 } else { 1.0 })
}

/// The rows of a slide in some axes, each with its rate.
#[derive(Clone, Copy, Debug)]
pub(crate) struct SlideRows([[Vector; 2]; 3]);

impl SlideRows {
    /// Returns them as numbers.
    #[inline(always)]
    #[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
    pub(crate) fn numbers<N: Number>(&self) -> [Triple<N>; 3] {
        let [[a, a_rate], [b, b_rate], [c, c_rate]] = self.0;
        [rated(a, a_rate), rated(b, b_rate), rated(c, c_rate)]
    }
}

/// A plane of a scene's slide, before a light that is seen.
#[derive(Clone, Copy, Debug)]
pub(crate) struct SeenSlide {
    /// Its number in the scene.
    pub(crate) number: usize,
    pub(crate) plane: usize,
    pub(crate) rows: SlideRows,
}

/// Takes from the light at a position, and from its rate, what a slide does not send to where rays hit.
///
/// A function of its own, because few lights have one, and what luma needs of the stack would grow by it.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+avx512bw", "x86_64+avx2"))]
pub(super) fn take<const RATE: bool, const FULL: bool>(
    (slide, seen): (&Slide, &SeenSlide),
    position: ([f32; 3], [f32; 3]),
    rays: &Rays<'_, FULL>,
    depths: (&Lanes, &Lanes),
    light: (&mut Lanes, &mut Lanes),
) {
    match slide.texture.wrap {
        Wrap::Repeat => slide.take::<RATE, FULL, Repeat>(seen, position, rays, depths, light),
        Wrap::Clamp => slide.take::<RATE, FULL, Clamp>(seen, position, rays, depths, light),
        Wrap::Mirror => slide.take::<RATE, FULL, Mirror>(seen, position, rays, depths, light),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::render::geometry::vector::{cross, single};
    use crate::render::gloss::number::Rated;

    /// Two texels side by side, in a frame that repeats them outwards, which looks along z; texture coordinates are the
    /// tangents to both sides.
    fn tables() -> SlideTables {
        let row = [1.0, 1.0, 3.0, 3.0];
        SlideTables {
            rows: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
            uv_map: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]],
            projected: true,
            nearest: false,
            layout: [2, 1, 1],
            texels: [row; 3].concat(),
        }
    }

    fn sent(tables: SlideTables, away: Vector) -> f64 {
        let slide = Slide::new(tables).unwrap();
        slide.sent::<f64>(0, &slide.rows_at_rest().numbers(), away)
    }

    #[test]
    fn closed_forms() {
        let cube = |u: f64, v: f64| (1.0 + u * u + v * v).powf(1.5);
        for (u, v, value) in [(0.1, 0.2, 1.0), (0.5, 0.9, 2.0), (0.6, 0.0, 2.4), (1.0, 1.0, 3.0)] {
            for depth in [0.5, 2.0] {
                let away = [u * depth, v * depth, depth];
                assert!((sent(tables(), away) - value * cube(u, v)).abs() < 1e-12, "{u} {v}");
                let spot = SlideTables { projected: false, ..tables() };
                assert!((sent(spot, away) - value).abs() < 1e-12, "{u} {v}");
                let nearest = SlideTables { projected: false, nearest: true, ..tables() };
                assert_eq!(sent(nearest, away), if u < 0.5 { 1.0 } else { 3.0 });
                // The texture's coordinates are other ones, and the slide's edges stay.
                let mirrored = SlideTables { uv_map: [[-1.0, 0.0, 1.0], [0.0, 1.0, 0.0]], ..tables() };
                assert!((sent(mirrored, away) - (4.0 - value) * cube(u, v)).abs() < 1e-12, "{u} {v}");
            }
        }
        for away in [[-0.01, 0.5, 1.0], [1.01, 0.5, 1.0], [0.5, -0.01, 1.0], [0.5, 1.01, 1.0], [-0.5, -0.5, -1.0]] {
            assert_eq!(sent(tables(), away), 0.0, "{away:?}");
        }
        assert_eq!(sent(tables(), [0.0; 3]), 0.0);
        assert_eq!(sent(tables(), [f64::NAN; 3]), 0.0);
    }

    #[test]
    fn planes_are_told_apart() {
        let planes = [1.0f32, 2.0, 3.0].map(|factor| tables().texels.into_iter().map(move |x| factor * x));
        let texels: Vec<f32> = planes.into_iter().flatten().collect();
        let slide = Slide::new(SlideTables { texels, projected: false, ..tables() }).unwrap();
        assert_eq!(slide.planes(), 3);
        let rows = slide.rows_at_rest().numbers();
        for (plane, value) in [(0, 2.0), (1, 4.0), (2, 6.0)] {
            assert_eq!(slide.sent::<f64>(plane, &rows, [0.5, 0.5, 1.0]), value);
        }
    }

    #[test]
    fn rates_are_derivatives_and_values_keep_their_bits() {
        let slide = Slide::new(tables()).unwrap();
        let spin: Vector = [0.3, -0.4, 0.2];
        let turning = |row: Vector| cross(spin, row);
        let rows = slide.rows(|row| [row, turning(row)]);
        let (away, change): (Vector, Vector) = ([0.9, 0.7, 1.6], [0.2, -0.3, 0.5]);
        let both: Rated = slide.sent(0, &rows.numbers(), rated(away, change));
        assert_eq!(both.value(), slide.sent::<f64>(0, &rows.numbers(), away));
        let at = |h: f64| {
            let moved: Vector = std::array::from_fn(|i| away[i] + h * change[i]);
            let turned = rows.numbers::<Rated>().map(|row| row.map(|x| x.value() + h * x.rate()));
            slide.sent::<f64>(0, &turned, moved)
        };
        let difference = (at(1e-6) - at(-1e-6)) / 2e-6;
        assert!((both.rate() - difference).abs() < 1e-6 * difference.abs(), "{both:?} {difference}");
        let rounded: RatedSingle = slide.sent(0, &rows.numbers(), rated(away, change));
        assert_eq!(rounded.value(), f64::from(slide.sent::<f32>(0, &rows.numbers(), single(away))));
    }
}
