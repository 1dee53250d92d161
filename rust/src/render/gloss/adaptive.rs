//! Shades as few of a pixel's rays on a glossy finish as their mean needs.
//!
//! What a ray sees is found for all of a pixel's rays, so edges are as sharp as ever. To shade a ray on a glossy surface
//! takes many times as long, because it follows mirror and shadow rays, and many pixels show a smooth reflection that few
//! rays tell. So rays are shaded by halves: 16, then 32, and so on. Where the newer half twice has the mean of the
//! older one, and rays differ little, those that are left get the mean of all.
//!
//! What must not break: which rays are shaded depends on the pixel alone, so single pixels have the bits of frames. More
//! rays a pixel also mean a smaller tolerance, so that luma converges.

use super::number::Number;

/// How far apart the means of two halves may be, relative to the pixel, times its number of rays. So far off may the mean
/// be, too, if rays were random.
const TOLERANCE: f64 = 1.28;

/// How much farther apart the halves may have been with half as many rays.
const BEFORE: f64 = 2.0;

/// A ray of a pixel that sees a glossy triangle.
#[derive(Clone, Copy, Debug)]
pub(crate) struct GlossyRay {
    /// Its number among all rays of the tile, and in its pixel.
    pub(crate) at: usize,
    pub(crate) number: usize,
    pub(crate) triangle: u32,
    /// The number of that triangle's finish.
    pub(crate) finish: u32,
}

/// Returns the rays of a pixel that see each finish, in their order.
pub(crate) fn parts(rays: &mut [GlossyRay]) -> impl Iterator<Item = &[GlossyRay]> {
    rays.sort_by_key(|ray| ray.finish);
    rays.chunk_by(|a, b| a.finish == b.finish)
}

/// What is known of the pixel that rays belong to.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Whole {
    /// How many rays the pixel has.
    pub(crate) rays: usize,
    /// How many rays of a part are shaded at first.
    pub(crate) first: usize,
    /// The sum over those rays that see no glossy surface.
    pub(crate) others: f64,
}

/// Computes luma of so many rays of a pixel, in an order of which each half is spread over all of them: `luma` gives that of
/// a ray, and `values` gets that of each; the mean of the others where a ray is not shaded.
#[allow(clippy::cast_precision_loss, reason = "a pixel has at most 1024 rays")]
pub(crate) fn shade_part<N: Number>(count: usize, whole: Whole, values: &mut Vec<N>, mut luma: impl FnMut(usize) -> N) {
    values.clear();
    let (mut end, mut before) = (whole.first.min(count), f64::INFINITY);
    loop {
        values.extend((values.len()..end).map(&mut luma));
        if end == count {
            return;
        }
        let (older, newer) = values.split_at(end / 2);
        let apart = (mean(older).value() - mean(newer).value()).abs();
        let mean = mean(values);
        let pixel = whole.others.abs() / count as f64 + mean.value().abs();
        let tolerated = TOLERANCE / whole.rays as f64 * pixel;
        if apart <= tolerated && before <= BEFORE * tolerated && standard_error(values, mean.value()) <= tolerated {
            values.resize(count, mean);
            return;
        }
        (end, before) = ((2 * end).min(count), apart);
    }
}

#[allow(clippy::cast_precision_loss, reason = "a pixel has at most 1024 rays")]
fn mean<N: Number>(values: &[N]) -> N {
    values.iter().fold(N::constant(0.0), |sum, &value| sum + value).scaled(1.0 / values.len() as f64)
}

/// Returns the standard error of a mean of random values.
#[allow(clippy::cast_precision_loss, reason = "a pixel has at most 1024 rays")]
fn standard_error<N: Number>(values: &[N], mean: f64) -> f64 {
    let squares: f64 = values.iter().map(|value| (value.value() - mean) * (value.value() - mean)).sum();
    squares.sqrt() / values.len() as f64
}

#[cfg(test)]
#[allow(clippy::cast_precision_loss, reason = "small numbers")]
mod tests {
    use super::*;
    use crate::render::gloss::number::Rated;
    use crate::render::gloss::pattern::Pattern;

    /// Shades rays by their place along one side of the pixel; returns how many, and the mean of all.
    fn shaded(rays: usize, others: f64, luma: impl Fn(f64) -> f64) -> (usize, f64) {
        let pattern = Pattern::new(rays);
        let (mut values, mut count) = (vec![], 0);
        shade_part(rays, Whole { rays, first: pattern.first(), others }, &mut values, |ray| {
            count += 1;
            luma((pattern.turns()[ray] as f64 + 0.5) / rays as f64)
        });
        assert_eq!(values.len(), rays);
        (count, mean(&values))
    }

    #[test]
    fn smooth_reflections_need_few_rays_and_edges_all() {
        let (count, mean) = shaded(128, 0.0, |_| 2.0);
        assert_eq!((count, mean), (32, 2.0));
        let (count, mean) = shaded(128, 0.0, |x| 1.0 + 0.1 * x);
        assert!(count <= 32 && (mean - 1.05).abs() < 2e-3, "{count} {mean}");
        // 0.3 is no multiple of 1/64: no half has the mean of the other.
        let (count, mean) = shaded(128, 0.0, |x| if x < 0.3 { 1.0 } else { 20.0 });
        assert!(count == 128 && (mean - 14.3).abs() < 0.1, "{count} {mean}");
    }

    /// An edge that the first halves do not see has to be seen later on.
    #[test]
    fn halves_have_to_agree_twice() {
        let (mut values, mut count) = (vec![], 0);
        let jumps = [1.972, 1.972, 1.972, 1.972, 1.972, 1.972, 1.972, 2.196];
        shade_part(128, Whole { rays: 128, first: 8, others: 0.0 }, &mut values, |ray| {
            count += 1;
            if ray < 16 { jumps[ray % 8] } else { 2.0 }
        });
        // 8 rays: apart; 16: one mean, for the first time; 32: again.
        assert_eq!(count, 32);
    }

    /// Halves of which each has as much of a pattern agree by chance.
    #[test]
    fn rays_that_differ_much_are_all_shaded() {
        let (mut values, mut count) = (vec![], 0);
        shade_part(128, Whole { rays: 128, first: 16, others: 0.0 }, &mut values, |ray| {
            count += 1;
            if ray % 2 == 0 { 1.0 } else { 3.0 }
        });
        assert_eq!(count, 128);
    }

    /// The more rays a pixel has, the closer its halves must be; a faint part of a bright pixel needs less.
    #[test]
    fn tolerance_is_that_of_the_pixel() {
        let counts = [128, 256, 512, 1024].map(|rays| shaded(rays, 0.0, |x| 1.0 + 0.1 * x).0);
        assert!(counts.is_sorted() && counts[0] < counts[3], "{counts:?}");
        let [alone, faint] = [0.0, 1e4].map(|others| shaded(128, others, |x| 1.0 + 0.6 * x).0);
        assert!(faint < alone, "{faint} {alone}");
    }

    #[test]
    fn rates_are_means_too() {
        let mut values: Vec<Rated> = vec![];
        shade_part(64, Whole { rays: 64, first: 8, others: 0.0 }, &mut values, |ray| Rated::new(1.0, ray as f64));
        assert_eq!((values[63].value(), values[63].rate()), (1.0, 7.5));
    }

    #[test]
    fn parts_are_told_apart_by_finish() {
        let ray = |number: usize, finish: u32| GlossyRay { at: number, number, triangle: 0, finish };
        let mut rays = [ray(0, 7), ray(1, 3), ray(2, 7)];
        let numbers: Vec<Vec<usize>> =
            parts(&mut rays).map(|part| part.iter().map(|ray| ray.number).collect()).collect();
        assert_eq!(numbers, [vec![1], vec![0, 2]]);
    }
}
