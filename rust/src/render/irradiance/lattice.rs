//! Points in the unit square at which light is sampled, and the directions that they stand for.
//!
//! The points are a rank-1 lattice, shifted for each point (Cranley and Patterson, 1976). They are folded by the baker's
//! transform, so that a point which leaves the square on one side does not jump to the other (Hickernell, "Obtaining
//! O(N^(-2+e)) convergence for lattice quadrature rules", 2002).
//!
//! What must not break: the trigonometry is plain arithmetic, because the C library's differs between processors.

use std::f32::consts::FRAC_PI_4;

use crate::render::geometry::bvh::index;

const GOLDEN: f64 = 0.618_033_988_749_894_9;

/// The square is ordered by cells of which it has two to the power of this along a side.
const CELL_BITS: u32 = 5;

/// The largest float32 below 1.
pub(crate) const BELOW_ONE: f32 = 1.0 - f32::EPSILON / 2.0;

/// So many points in the unit square. Neighbours follow each other, so that their rays take similar ways.
#[derive(Debug)]
pub(crate) struct Lattice {
    pub(crate) points: [Vec<f32>; 2],
    /// Which point of the sequence each is.
    pub(crate) numbers: Vec<u32>,
}

impl Lattice {
    #[allow(clippy::cast_possible_truncation, clippy::cast_precision_loss, reason = "fractions of few points")]
    #[allow(clippy::cast_sign_loss, reason = "fractions are not negative")]
    pub(crate) fn new(samples: usize) -> Self {
        let point = |i: usize| [(i as f64 + 0.5) / samples as f64, (i as f64 * GOLDEN).fract()];
        let mut numbers: Vec<usize> = (0..samples).collect();
        let cell = |x: f64| (x * f64::from(1 << CELL_BITS)) as u32;
        numbers.sort_by_key(|&i| {
            let [x, y] = point(i).map(cell);
            (0..CELL_BITS).fold(0, |code, bit| code | (x >> bit & 1) << (2 * bit + 1) | (y >> bit & 1) << (2 * bit))
        });
        Self {
            points: [0, 1].map(|axis| numbers.iter().map(|&i| point(i)[axis] as f32).collect()),
            numbers: numbers.iter().map(|&i| index(i)).collect(),
        }
    }

    /// Returns how many points there are.
    pub(crate) fn len(&self) -> usize {
        self.numbers.len()
    }

    /// Returns a point, shifted and folded.
    #[inline(always)]
    #[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
    pub(crate) fn shifted(&self, at: usize, shift: [f32; 2]) -> [f32; 2] {
        [folded(self.points[0][at], shift[0]), folded(self.points[1][at], shift[1])]
    }

    /// Sets the directions of all points by the cosine of their angle to a normal.
    #[inline(always)]
    #[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
    pub(crate) fn directions(
        &self,
        shift: [f32; 2],
        frame: &[[f32; 3]; 2],
        normal: &[f32; 3],
        directions: &mut [Vec<f32>; 3],
    ) {
        let n = self.len();
        let (us, vs) = (&self.points[0][..n], &self.points[1][..n]);
        let [xs, ys, zs] = directions;
        let (xs, ys, zs) = (&mut xs[..n], &mut ys[..n], &mut zs[..n]);
        for i in 0..n {
            let local = cosine_direction([folded(us[i], shift[0]), folded(vs[i], shift[1])]);
            let towards = in_frame(frame, normal, local);
            (xs[i], ys[i], zs[i]) = (towards[0], towards[1], towards[2]);
        }
    }
}

/// Returns a coordinate of a point, shifted and folded.
#[inline(always)]
#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
fn folded(coordinate: f32, shift: f32) -> f32 {
    let sum = coordinate + shift;
    let past = if sum >= 1.0 { sum - 1.0 } else { sum };
    let twice = 2.0 * past - 1.0;
    let folded = 1.0 - if twice < 0.0 { -twice } else { twice };
    if folded < BELOW_ONE { folded } else { BELOW_ONE }
}

/// Takes a point of the unit square to a unit vector around z, by the cosine of its angle to z. Neighbours stay
/// neighbours (Shirley and Chiu, "A low distortion map between disk and square", 1997).
#[inline(always)]
#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
pub(crate) fn cosine_direction([x, y]: [f32; 2]) -> [f32; 3] {
    let (a, b) = (2.0 * x - 1.0, 2.0 * y - 1.0);
    let (size_a, size_b) = (if a < 0.0 { -a } else { a }, if b < 0.0 { -b } else { b });
    let steep = size_b > size_a;
    let (radius, along) = if steep { (b, a) } else { (a, b) };
    let radius_or_one = if radius == 0.0 { 1.0 } else { radius };
    let [sine, cosine] = sine_cosine(FRAC_PI_4 * (along / radius_or_one));
    let (far, aside) = (radius * cosine, radius * sine);
    let up = 1.0 - radius * radius;
    let up = if up > 0.0 { up } else { 0.0 };
    if steep { [aside, far, up.sqrt()] } else { [far, aside, up.sqrt()] }
}

/// Returns sine and cosine of an angle within a quarter of pi, by their series, to within float32's rounding.
#[inline(always)]
#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
fn sine_cosine(angle: f32) -> [f32; 2] {
    let x = angle * angle;
    let sine = angle * (1.0 + x * (-1.0 / 6.0 + x * (1.0 / 120.0 + x * (-1.0 / 5040.0 + x / 362_880.0))));
    let cosine = 1.0 + x * (-0.5 + x * (1.0 / 24.0 + x * (-1.0 / 720.0 + x / 40_320.0)));
    [sine, cosine]
}

/// Two unit vectors across a unit vector (Duff et al., "Building an orthonormal basis, revisited", JCGT 6(1), 2017).
#[inline(always)]
#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
pub(crate) fn across([x, y, z]: [f32; 3]) -> [[f32; 3]; 2] {
    let sign = if z < 0.0 { -1.0 } else { 1.0 };
    let a = -1.0 / (sign + z);
    let b = x * y * a;
    [[1.0 + sign * x * x * a, sign * b, -sign * x], [b, sign + y * y * a, -y]]
}

/// Takes a vector in a frame to the axes of its vectors.
#[inline(always)]
#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
pub(crate) fn in_frame([s, t]: &[[f32; 3]; 2], n: &[f32; 3], v: [f32; 3]) -> [f32; 3] {
    let mut turned = [0.0; 3];
    for i in 0..3 {
        turned[i] = s[i] * v[0] + t[i] * v[1] + n[i] * v[2];
    }
    turned
}

#[cfg(test)]
#[allow(clippy::cast_precision_loss, reason = "small numbers")]
mod tests {
    use super::*;

    /// Every point of the sequence is there once, and neighbours in the order lie next to each other.
    #[test]
    fn a_lattice_has_every_point_once() {
        let lattice = Lattice::new(256);
        let mut numbers = lattice.numbers.clone();
        numbers.sort_unstable();
        assert_eq!(numbers, (0..256).collect::<Vec<u32>>());
        let [x, y] = &lattice.points;
        for (at, &number) in lattice.numbers.iter().enumerate() {
            assert!((x[at] - (number as f32 + 0.5) / 256.0).abs() < 1e-6);
            assert!((f64::from(y[at]) - (f64::from(number) * GOLDEN).fract()).abs() < 1e-6);
        }
        let steps: f32 = (1..256).map(|i| (x[i] - x[i - 1]).abs() + (y[i] - y[i - 1]).abs()).sum();
        assert!(steps / 255.0 < 0.15, "{}", steps / 255.0);
    }

    /// The square's corners and edges stay within it; the fold is a tent: 0 to 0, a half to 1.
    #[test]
    fn points_are_folded_into_the_square() {
        let lattice = Lattice::new(64);
        for at in 0..64 {
            for shift in [0.0, 0.25, 0.5, 0.999_999_9] {
                let [x, y] = lattice.shifted(at, [shift, shift]);
                assert!((0.0..1.0).contains(&x) && (0.0..1.0).contains(&y));
                let past = (lattice.points[0][at] + shift).fract();
                let tent = if past < 0.5 { 2.0 * past } else { 2.0 - 2.0 * past };
                assert!((x - tent).abs() < 1e-6, "{x} {tent}");
            }
        }
    }

    /// Directions are unit vectors; mean z is 2/3 and mean z^2 is 1/2, as for light that follows the cosine, and all
    /// sides are alike.
    #[test]
    fn directions_follow_the_cosine() {
        let lattice = Lattice::new(4096);
        let mut moments = [0f64; 5];
        for at in 0..4096 {
            let [x, y, z] = cosine_direction(lattice.shifted(at, [0.1, 0.2])).map(f64::from);
            assert!((x * x + y * y + z * z - 1.0).abs() < 1e-6);
            assert!(z >= 0.0);
            for (moment, value) in moments.iter_mut().zip([z, z * z, x, y, x * y]) {
                *moment += value / 4096.0;
            }
        }
        for (moment, expected) in moments.iter().zip([2.0 / 3.0, 0.5, 0.0, 0.0, 0.0]) {
            assert!((moment - expected).abs() < 1e-3, "{moments:?}");
        }
        for point in [[0.5, 0.5], [0.0, 0.0], [BELOW_ONE, 0.5]] {
            assert!(cosine_direction(point).iter().all(|x| x.is_finite()));
        }
    }

    #[test]
    fn a_frame_is_orthonormal() {
        for n in [[0.0, 0.0, 1.0], [0.0, 0.0, -1.0], [0.6, -0.64, 0.48], [1.0, 0.0, 0.0]] {
            let frame = across(n);
            let [s, t] = frame;
            let dot = |a: [f32; 3], b: [f32; 3]| a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
            for (a, b, expected) in [(s, s, 1.0), (t, t, 1.0), (s, t, 0.0), (s, n, 0.0), (t, n, 0.0)] {
                assert!((dot(a, b) - expected).abs() < 1e-6);
            }
            assert_eq!(in_frame(&frame, &n, [0.0, 0.0, 1.0]), n);
            assert_eq!(in_frame(&frame, &n, [1.0, 0.0, 0.0]), s);
        }
    }
}
