//! Patterns: which directions of a lobe, and which points of the lamps, each of a pixel's rays follows.
//!
//! The rays of a pixel share one pattern, so that few directions a ray are many a pixel. It is the same for every pixel
//! and at every time, so that reflections have no noise.
//!
//! What must not break: a pattern depends on the number of rays a pixel alone, so single pixels have the bits of
//! frames.

/// How many directions, and as many points of lamps, a pixel has at least.
const LEAST: usize = 8;

/// Per golden ratio: a Fibonacci lattice has this second coordinate.
const GOLDEN: f64 = 0.618_033_988_749_894_9;

/// So many rays a pixel, or more, are shaded by halves, and so many of them at least.
const BY_HALVES: usize = 64;
const FIRST: usize = 16;

/// Every second bit.
const ALTERNATE: usize = 0x5555;

/// The fraction of the plastic number, which is to three dimensions what the golden section is to two.
const PLASTIC: f64 = 0.324_717_957_244_746;

/// By the number of rays: a ray's point has the ray's number times the first of these, and that of its path's next rough
/// surface times the second, see [`Pattern::after`]. Then where a ray is in its pixel says nothing of the directions that it
/// follows. Else the error at blurred edges of reflections would be the same with any number of rays. Found by the errors of
/// half spaces over the pixel and the disks together, the first also for the first halves.
const SHUFFLES: [(usize, [usize; 2]); 5] =
    [(64, [17, 9]), (128, [57, 75]), (256, [81, 95]), (512, [379, 415]), (1024, [505, 987])];

/// The second coordinate of a rank-1 lattice whose halves, quarters and so on are good lattices themselves: found by their
/// least distances, for all powers of two up to 512.
const NESTED: f64 = 283.0;

/// A point of the unit disk, for a lobe, and one of the unit square, for the lamps.
#[derive(Clone, Copy, Debug)]
pub(crate) struct PatternPoint {
    pub(crate) disk: [f64; 2],
    pub(crate) square: [f64; 2],
}

/// The points that the rays of a pixel follow.
#[derive(Clone, Debug)]
pub(crate) struct Pattern {
    points: Vec<PatternPoint>,
    rays: usize,
    /// See [`SHUFFLES`]: none has a common divisor with the number of points.
    shuffles: [usize; 2],
    /// See [`Self::turns`] and [`Self::first`].
    turns: Vec<usize>,
    first: usize,
}

impl Pattern {
    /// Makes that of pixels with so many rays.
    #[allow(clippy::cast_precision_loss, reason = "small numbers")]
    pub(crate) fn new(rays: usize) -> Self {
        let rays = rays.max(1);
        let count = rays * LEAST.div_ceil(rays);
        let by_halves = rays.is_power_of_two() && rays >= BY_HALVES;
        let second = if by_halves { NESTED / rays as f64 } else { GOLDEN };
        let point = |number: usize| {
            let square = [(number as f64 + 0.5) / count as f64, (number as f64 * second).fract()];
            let (radius, angle) = (square[0].sqrt(), std::f64::consts::TAU * square[1]);
            PatternPoint { disk: [radius * libm::cos(angle), radius * libm::sin(angle)], square }
        };
        // Reversed bits part the rays into halves. Every second bit turned over, halves are not all on one side.
        let halved =
            |number: usize| (number.reverse_bits() >> (usize::BITS - rays.trailing_zeros())) ^ (ALTERNATE % rays);
        let turn = |number: usize| if by_halves { halved(number) } else { number };
        Self {
            points: (0..count).map(point).collect(),
            rays,
            shuffles: SHUFFLES
                .iter()
                .find(|known| known.0 == rays)
                .map_or_else(|| [PLASTIC, GOLDEN].map(|fraction| coprime(fraction, count)), |known| known.1),
            turns: (0..rays).map(turn).collect(),
            first: if by_halves { FIRST } else { rays },
        }
    }

    /// Returns the numbers of a pixel's rays in the order in which they are shaded.
    pub(crate) fn turns(&self) -> &[usize] {
        &self.turns
    }

    /// Returns how many of them are shaded at least. Where these are not all, so many are spread over the pixel and over
    /// the pattern, and so are twice as many, and so on: of a rank-1 lattice every second point, every fourth, and so on.
    pub(crate) fn first(&self) -> usize {
        self.first
    }

    /// Returns how many points a pixel has.
    pub(crate) fn len(&self) -> usize {
        self.points.len()
    }

    /// Returns the point of a number, counted from 0 and again from there after the last.
    pub(crate) fn point(&self, number: usize) -> &PatternPoint {
        &self.points[number % self.points.len()]
    }

    /// Returns the numbers of the points of one of a pixel's rays.
    pub(crate) fn of_ray(&self, ray: usize) -> impl ExactSizeIterator<Item = usize> + use<> {
        let ([shuffle, _], count) = (self.shuffles, self.points.len());
        (ray % self.rays..count).step_by(self.rays).map(move |number| number * shuffle % count)
    }

    /// Returns the number of the point that a path follows on its next rough surface, which followed another on the last
    /// one. Paths of all points follow all of them there, too, and in another order.
    pub(crate) fn after(&self, number: usize) -> usize {
        let [_, shuffle] = self.shuffles;
        (number * shuffle + shuffle / 2) % self.points.len()
    }
}

/// Returns the number next to a fraction of a count that has no common divisor with it.
#[allow(
    clippy::cast_precision_loss,
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "small numbers"
)]
fn coprime(fraction: f64, count: usize) -> usize {
    let next = (count as f64 * fraction) as usize;
    (next..=count).find(|&number| greatest_common_divisor(number, count) == 1).unwrap_or(1)
}

fn greatest_common_divisor(a: usize, b: usize) -> usize {
    if b == 0 { a } else { greatest_common_divisor(b, a % b) }
}

#[cfg(test)]
#[allow(clippy::cast_precision_loss, reason = "small numbers")]
mod tests {
    use super::*;

    #[test]
    fn the_rays_of_a_pixel_share_all_points() {
        for (rays, count) in [(1, 8), (2, 8), (5, 10), (8, 8), (16, 16), (20, 20), (64, 64)] {
            let pattern = Pattern::new(rays);
            assert_eq!(pattern.len(), count);
            let mut taken: Vec<f64> =
                (0..rays).flat_map(|ray| pattern.of_ray(ray).map(|number| pattern.point(number).square[0])).collect();
            taken.sort_by(f64::total_cmp);
            let all: Vec<f64> = (0..count).map(|i| (i as f64 + 0.5) / count as f64).collect();
            assert_eq!(taken, all);
            assert!((0..rays).all(|ray| pattern.of_ray(ray).len() == count / rays));
        }
    }

    /// Returns the largest error of the mean of x, y, x^2 and y^2 over some points of the disk.
    fn error(points: &[&PatternPoint]) -> f64 {
        let mean =
            |of: &dyn Fn(&PatternPoint) -> f64| points.iter().map(|point| of(point)).sum::<f64>() / points.len() as f64;
        [0, 1]
            .map(|k| mean(&|p| p.disk[k]).abs().max((mean(&|p| p.disk[k] * p.disk[k]) - 0.25).abs()))
            .into_iter()
            .fold(0.0, f64::max)
    }

    #[test]
    fn points_lie_evenly_on_the_disk() {
        for (rays, least) in [(20, 0.04), (64, 0.02), (100, 0.01), (128, 0.01), (512, 0.003), (1024, 0.002)] {
            let pattern = Pattern::new(rays);
            let error = error(&pattern.points.iter().collect::<Vec<_>>());
            assert!(error < least, "{rays} rays: {error}");
        }
    }

    /// Also of the first rays to be shaded.
    #[test]
    fn halves_lie_evenly_on_the_disk() {
        assert!([8, 16, 32, 100].iter().all(|&rays| Pattern::new(rays).first() == rays));
        for rays in [64, 128, 256, 512, 1024] {
            let pattern = Pattern::new(rays);
            let turns: Vec<&PatternPoint> = pattern
                .turns()
                .iter()
                .flat_map(|&ray| pattern.of_ray(ray))
                .map(|number| pattern.point(number))
                .collect();
            assert_eq!((turns.len(), pattern.first()), (rays, 16));
            for (count, least) in [(16, 0.06), (32, 0.03)] {
                assert!(error(&turns[..count]) < least, "{count} of {rays} rays: {}", error(&turns[..count]));
                // Nor do they all lie on one side.
                let middle = turns[..count].iter().map(|point| point.square[0]).sum::<f64>() / count as f64;
                assert!((middle - 0.5).abs() < 0.3 / count as f64, "{count} of {rays} rays: {middle}");
            }
        }
    }

    fn steps() -> impl Iterator<Item = f64> {
        (0..64).map(|i| (f64::from(i) + 0.5) / 64.0)
    }

    /// Returns which fraction of a pixel's square lies before an edge across a direction.
    fn of_pixel([sine, cosine]: [f64; 2], edge: f64) -> f64 {
        steps().map(|x| ((edge - cosine * (x - 0.5)) / sine + 0.5).clamp(0.0, 1.0)).sum::<f64>() / 64.0
    }

    /// Returns the same of a disk, across any direction.
    fn of_disk(edge: f64) -> f64 {
        let edge = edge.clamp(-1.0, 1.0);
        0.5 + (edge * (1.0 - edge * edge).sqrt() + edge.asin()) / std::f64::consts::PI
    }

    /// Returns the mean over a disk that is as wide, of what is left to an edge.
    fn blurred(width: f64, edge: f64, left: impl Fn(f64) -> f64) -> f64 {
        let disk = steps().flat_map(|r| steps().map(move |t| r.sqrt() * (std::f64::consts::TAU * t).cos()));
        disk.map(|along| left(edge - width * along)).sum::<f64>() / (64.0 * 64.0)
    }

    /// Edges that a pixel and a lobe blur together, a pixel and the next surface's lobe, and both lobes. The generators of the
    /// pixels' lattices are those of `rank1_lattice` in Python.
    #[test]
    fn blurred_edges_need_few_rays() {
        let angles = [0.4, 1.1, 1.9, 2.6].map(|angle: f64| [angle.sin(), angle.cos()]);
        let edges = [(0.3, 0.1), (1.0, -0.2), (1.0, 0.5), (3.0, 0.4)];
        let lattices = [(20, 3, 0.07), (32, 7, 0.05), (64, 19, 0.03), (100, 37, 0.03), (128, 23, 0.02)];
        let more = [(256, 71, 0.014), (512, 225, 0.009), (1024, 217, 0.007)];
        for (rays, generator, most) in lattices.into_iter().chain(more) {
            let pattern = Pattern::new(rays);
            let at = |number: usize| (number as f64 + 0.5) / rays as f64 - 0.5;
            let followed = |ray: usize| {
                let number = pattern.of_ray(ray).next().unwrap();
                let place = [at(ray), at(ray * generator % rays)];
                [place, pattern.point(number).disk, pattern.point(pattern.after(number)).disk]
            };
            for [first, second] in [[0, 1], [0, 2], [1, 2]] {
                let mut squares = vec![];
                for (own, (width, edge)) in angles.into_iter().flat_map(|own| edges.map(|edge| (own, edge))) {
                    let left = |edge| if first == 0 { of_pixel(own, edge) } else { of_disk(edge) };
                    let truth = blurred(width, edge, left);
                    for other in angles.into_iter().chain(angles.map(|angle| angle.map(|x| -x))) {
                        let along = |[sine, cosine]: [f64; 2], [x, y]: [f64; 2]| cosine * x + sine * y;
                        let before = |ray: &usize| {
                            let places = followed(*ray);
                            along(own, places[first]) + width * along(other, places[second]) < edge
                        };
                        let found = (0..rays).filter(before).count() as f64 / rays as f64;
                        squares.push((found - truth).powi(2));
                    }
                }
                let error = (squares.iter().sum::<f64>() / squares.len() as f64).sqrt();
                assert!(error < most, "{rays} rays, {first} and {second}: {error}");
            }
        }
    }
}
