//! Skies as glossy surfaces see them: an environment map in colour, and coarser copies of it.
//!
//! A direction of a lobe stands for a cone of directions. So the sky is looked up where its texels are about as wide as
//! the cone (Krivanek and Colbert 2008, Real-time Shading with Filtered Importance Sampling). Directions are mapped to a
//! square by the octahedral map, as in [`sky`](crate::render::light::sky).
//!
//! What must not break: the mean over all directions is the same on each level.

use std::f64::consts::PI;

use super::number::{Number, Triple, add, scale};
use crate::error::{Error, Result};

/// The largest side of the finest level.
const LARGEST_SIDE: usize = 1 << 12;

/// An environment map, from fine to coarse.
#[derive(Clone, Debug)]
pub(crate) struct SkyLevels {
    /// The number of its light, by whose factor it is multiplied.
    pub(crate) light: u32,
    levels: Vec<Level>,
}

/// One resolution.
#[derive(Clone, Debug)]
struct Level {
    side: usize,
    /// Radiance, red, green and blue, row by row.
    texels: Vec<[f32; 3]>,
}

impl SkyLevels {
    /// Takes the finest level; its side is a power of two.
    ///
    /// # Errors
    ///
    /// [`Error::Argument`] for another side, or texels that are too few, negative or not finite.
    pub(crate) fn new(light: u32, side: usize, texels: &[[f32; 3]]) -> Result<Self> {
        let fits = side.is_power_of_two() && side <= LARGEST_SIDE && texels.len() == side * side;
        if !fits || !texels.iter().flatten().all(|x| x.is_finite() && *x >= 0.0) {
            return Err(Error::Argument(format!(
                "a sky of glossy surfaces has a side that is a power of two up to {LARGEST_SIDE} and side^2 texels that \
                 are finite and not negative, got a side of {side} and {} texels",
                texels.len()
            )));
        }
        let mut levels = vec![Level { side, texels: texels.to_vec() }];
        let mut angles: Vec<f64> = (0..side * side).map(|number| solid_angle(number, side)).collect();
        while let Some(last) = levels.last().filter(|level| level.side > 1) {
            let (coarser, theirs) = last.halved(&angles);
            levels.push(coarser);
            angles = theirs;
        }
        Ok(Self { light, levels })
    }

    /// Returns the radiance from a direction, as the mean over about so large a solid angle (steradians).
    #[allow(clippy::cast_precision_loss, reason = "a side has at most 2^12 texels")]
    pub(crate) fn along<N: Number>(&self, towards: Triple<N>, angle: N) -> Triple<N> {
        let at = octahedral(towards);
        let texel = 4.0 * PI / (self.levels[0].side * self.levels[0].side) as f64;
        let mut ratio = angle.scaled(1.0 / texel);
        let mut level = 0;
        while ratio.value() > 4.0 && level + 2 < self.levels.len() {
            ratio = ratio.scaled(0.25);
            level += 1;
        }
        if ratio.value() <= 1.0 || level + 1 >= self.levels.len() {
            return self.levels[level].at(at);
        }
        // From one level to the next a texel is four times as large.
        let past = (ratio.at_most(4.0) - N::constant(1.0)).scaled(1.0 / 3.0);
        let (fine, coarse) = (self.levels[level].at(at), self.levels[level + 1].at(at));
        add(scale(fine, N::constant(1.0) - past), scale(coarse, past))
    }
}

impl Level {
    /// Returns the next coarser level, and the solid angles of its texels: means of four texels by theirs.
    #[allow(clippy::cast_possible_truncation, reason = "float64 is rounded to float32")]
    fn halved(&self, angles: &[f64]) -> (Self, Vec<f64>) {
        let side = self.side / 2;
        let (mut texels, mut sums) = (vec![], vec![]);
        for number in 0..side * side {
            let (mut sum, mut angle) = ([0.0; 3], 0.0);
            for (row, column) in [(0, 0), (0, 1), (1, 0), (1, 1)] {
                let at = (2 * (number / side) + row) * self.side + 2 * (number % side) + column;
                angle += angles[at];
                for (sum, texel) in sum.iter_mut().zip(self.texels[at]) {
                    *sum += angles[at] * f64::from(texel);
                }
            }
            texels.push(sum.map(|x| (x / angle) as f32));
            sums.push(angle);
        }
        (Self { side, texels }, sums)
    }

    #[allow(clippy::cast_possible_truncation, clippy::cast_precision_loss, reason = "within the square")]
    fn at<N: Number>(&self, at: [N; 2]) -> Triple<N> {
        let along = at.map(|x| x.scaled(self.side as f64) - N::constant(0.5));
        let cell = along.map(|x| x.value().floor());
        let past = [0, 1].map(|k| along[k] - N::constant(cell[k]));
        let texel = |right: i64, below: i64| {
            self.folded(cell[0] as i64 + right, cell[1] as i64 + below).map(|x| N::constant(f64::from(x)))
        };
        let mixed =
            |a: Triple<N>, b: Triple<N>, by: N| -> Triple<N> { std::array::from_fn(|i| a[i] + (b[i] - a[i]) * by) };
        mixed(mixed(texel(0, 0), texel(1, 0), past[0]), mixed(texel(0, 1), texel(1, 1), past[0]), past[1])
    }

    /// Returns a texel; beyond an edge lies what is on the other half of that edge.
    #[allow(
        clippy::cast_possible_wrap,
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "a side has at most 2^12 texels"
    )]
    fn folded(&self, mut column: i64, mut row: i64) -> [f32; 3] {
        let last = self.side as i64 - 1;
        if column < 0 || column > last {
            (column, row) = (if column < 0 { -1 - column } else { 2 * last + 1 - column }, last - row);
        }
        if row < 0 || row > last {
            (row, column) = (if row < 0 { -1 - row } else { 2 * last + 1 - row }, last - column);
        }
        self.texels[row.clamp(0, last) as usize * self.side + column.clamp(0, last) as usize]
    }
}

/// Returns a number in proportion to the solid angle of a texel.
#[allow(clippy::cast_precision_loss, reason = "small numbers")]
fn solid_angle(number: usize, side: usize) -> f64 {
    let [x, y] = [number % side, number / side].map(|at| (2.0 * (at as f64 + 0.5) / side as f64 - 1.0).abs());
    // Below the equator the square is folded; distances from the octahedron's centre are the same there.
    let [x, y] = if x + y > 1.0 { [1.0 - y, 1.0 - x] } else { [x, y] };
    let z = 1.0 - x - y;
    let squared = x * x + y * y + z * z;
    1.0 / (squared * squared.sqrt())
}

/// Returns where a direction lies in the unit square.
fn octahedral<N: Number>(towards: Triple<N>) -> [N; 2] {
    let magnitude = |x: N| if x.value() < 0.0 { -x } else { x };
    let signed = |size: N, x: N| if x.value() < 0.0 { -size } else { size };
    let [x, y, z] = towards;
    let length = magnitude(x) + magnitude(y) + magnitude(z);
    let [a, b] = [x / length, y / length];
    let one = N::constant(1.0);
    let at = if z.value() < 0.0 { [signed(one - magnitude(b), a), signed(one - magnitude(a), b)] } else { [a, b] };
    at.map(|x| (x + one).scaled(0.5))
}

#[cfg(test)]
#[allow(clippy::cast_precision_loss, clippy::cast_possible_truncation, reason = "small numbers")]
mod tests {
    use super::super::number::{Rated, rated, values};
    use super::*;

    /// Returns a sky that is the cube of 1.5 + the direction's cosine to an axis.
    fn smooth(side: usize, axis: [f64; 3]) -> SkyLevels {
        let texel = |number: usize| {
            let towards = direction([number % side, number / side], side);
            let cosine: f64 = (0..3).map(|k| axis[k] * towards[k]).sum();
            [(1.5 + cosine).powi(3) as f32, 1.0, 0.0]
        };
        SkyLevels::new(0, side, &(0..side * side).map(texel).collect::<Vec<_>>()).unwrap()
    }

    fn direction(at: [usize; 2], side: usize) -> [f64; 3] {
        let [x, y] = at.map(|at| 2.0 * (at as f64 + 0.5) / side as f64 - 1.0);
        let z = 1.0 - x.abs() - y.abs();
        let [x, y] = if z < 0.0 { [(1.0 - y.abs()) * x.signum(), (1.0 - x.abs()) * y.signum()] } else { [x, y] };
        let length = (x * x + y * y + z * z).sqrt();
        [x / length, y / length, z / length]
    }

    #[test]
    fn the_finest_level_is_the_sky_and_the_coarsest_its_mean() {
        let axis = [0.6, -0.64, 0.48];
        let sky = smooth(128, axis);
        for towards in [axis, [0.0, 0.0, -1.0], [-0.8, 0.0, -0.6], [0.999, 0.04, 0.01], [-0.7, 0.7, -0.1]] {
            let length = towards.iter().map(|x| x * x).sum::<f64>().sqrt();
            let cosine: f64 = (0..3).map(|k| axis[k] * towards[k] / length).sum();
            let [red, green, blue] = sky.along(towards, 0.0);
            assert!((red - (1.5 + cosine).powi(3)).abs() < 0.02, "{towards:?}: {red}");
            assert!((green - 1.0).abs() < 1e-6 && blue == 0.0);
            // The mean of (1.5 + c)^3 is 1.5^3 + 1.5; a quarter of the sphere is still far from it.
            let whole = sky.along(towards, 4.0 * PI);
            assert!((whole[0] - 4.875).abs() < 0.01, "{whole:?}");
        }
        let (fine, coarse) = (sky.along(axis, 0.01)[0], sky.along(axis, 1.0)[0]);
        assert!(fine > coarse && coarse > 6.0, "{fine} {coarse}");
        // Continuous where the square is folded.
        let coarse = smooth(8, axis);
        for seam in [[-0.8, 0.0, -0.6], [0.0, 0.6, -0.8], [0.3, 0.0, -0.9], [0.0, -0.7, -0.2]] {
            let [one, other] =
                [1e-9, -1e-9_f64].map(|by| coarse.along(seam.map(|x| if x == 0.0 { by } else { x }), 0.0)[0]);
            assert!((one - other).abs() < 1e-6, "{seam:?}: {one} {other}");
        }
        // Continuous from level to level.
        let texel = 4.0 * PI / 128.0 / 128.0;
        for edge in [1.0, 2.0, 4.0, 8.0, 16.0, 64.0] {
            let [before, after] = [0.999, 1.001].map(|by| sky.along([0.1, 0.5, -0.8], by * edge * texel)[0]);
            assert!((before - after).abs() < 2e-3 * before, "{edge}: {before} {after}");
        }
    }

    #[test]
    fn rates_are_derivatives() {
        let sky = smooth(32, [0.6, 0.0, 0.8]);
        let (towards, rate) = ([0.31, -0.52, -0.44], [0.7, 0.2, -0.3]);
        let (angle, angle_rate) = (0.05, 0.04);
        let moved = |t: f64| sky.along(std::array::from_fn(|i| towards[i] + t * rate[i]), angle + t * angle_rate)[0];
        let both = sky.along(rated::<Rated>(towards, rate), Rated::new(angle, angle_rate));
        let difference = (moved(1e-6) - moved(-1e-6)) / 2e-6;
        assert!((both[0].rate() - difference).abs() < 1e-5, "{both:?} {difference}");
        assert_eq!(values(both)[0], moved(0.0));
    }

    #[test]
    fn skies_that_make_no_sense_are_refused() {
        assert!(SkyLevels::new(0, 3, &[[1.0; 3]; 9]).is_err());
        assert!(SkyLevels::new(0, 4, &[[1.0; 3]; 15]).is_err());
        for wrong in [-1.0, f32::NAN, f32::INFINITY] {
            assert!(SkyLevels::new(0, 2, &[[1.0, 1.0, wrong]; 4]).is_err());
        }
    }
}
