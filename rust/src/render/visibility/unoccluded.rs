//! Remembers from which triangles a light, or what is far away in some direction, is unoccluded.
//!
//! From most triangles of a scene nothing lies between any of their points and a light that stands still, and nothing in
//! most directions. This is found out once for a triangle, when it is first asked for ([`Sweep`]), and serves all rays
//! of all views from then on: none of them has to be traced.
//!
//! Only what stands still is looked at here. Bodies may hide the light all the same.
//!
//! What must not break: an answer depends on the scene alone, so that it does not matter which view or thread asks
//! first. Where something may be hit, the answer is false, and rays are traced.

use std::sync::atomic::{AtomicU8, AtomicU64, Ordering};

use multiversion::multiversion;

use crate::prefetch::prefetch;
use crate::render::geometry::bvh::Bvh;
use crate::render::geometry::sweep::{Sweep, Towards};
use crate::render::geometry::vector::Vector;
use crate::render::light::cone::Source;

/// Directions are cells on the sides of a cube, so many along each of its edges.
const CELLS: usize = 8;
const WORDS: usize = (6 * CELLS * CELLS * BITS).div_ceil(64);

/// What is known of a cell or a light: two bits each.
const BITS: usize = 2;
const CLEAR: u8 = 1;
const BLOCKED: u8 = 2;

/// After so many triangles that lie near the way, it is not looked on: to trace the rays takes less time.
const MOST_TESTED: usize = 256;

/// No more than so many bytes are kept for either of the tables.
const MOST: usize = 1 << 28;

/// What is known of the triangles that stand still.
#[derive(Debug, Default)]
pub(crate) struct Unoccluded {
    /// Of each light where it is, and its number among those that are somewhere.
    lights: Vec<Option<(usize, Source)>>,
    /// By light that is somewhere, and triangle; empty where it would be too large.
    by_light: Vec<AtomicU8>,
    /// Of each triangle [`WORDS`]; empty where no ray asks for directions.
    by_direction: Vec<AtomicU64>,
}

/// The triangles among which it is looked for what may be hit.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Still<'a> {
    pub(crate) bvh: &'a Bvh,
    pub(crate) corners: &'a [[Vector; 3]],
}

impl Unoccluded {
    /// Makes room for so many triangles and these lights; for directions where rays ask for them.
    pub(crate) fn new(triangles: usize, lights: Vec<Option<Source>>, directions: bool) -> Self {
        let mut somewhere = 0..;
        let lights: Vec<_> =
            lights.into_iter().map(|light| light.and_then(|light| Some((somewhere.next()?, light)))).collect();
        let of_lights = triangles * lights.iter().flatten().count();
        let of_directions = if directions { triangles * WORDS } else { 0 };
        Self {
            lights,
            by_light: (0..if of_lights <= MOST { of_lights } else { 0 }).map(|_| AtomicU8::new(0)).collect(),
            by_direction: (0..if of_directions <= MOST / 8 { of_directions } else { 0 })
                .map(|_| AtomicU64::new(0))
                .collect(),
        }
    }

    /// Forgets all, and learns nothing more: rays are traced.
    #[cfg(test)]
    pub(crate) fn forget(&mut self) {
        (self.by_light, self.by_direction) = (vec![], vec![]);
    }

    /// Asks for what is known of the directions from a triangle before it is read.
    pub(crate) fn prefetch(&self, triangle: usize) {
        prefetch(self.by_direction.chunks_exact(WORDS).nth(triangle).unwrap_or_default());
    }

    /// Returns whether nothing that stands still lies between a triangle that does, too, and a light; true where the light
    /// is nowhere.
    #[inline]
    pub(crate) fn is_lit(&self, still: Still, triangle: usize, light: usize) -> bool {
        let triangles = still.corners.len();
        let Some((number, light)) = self.lights[light] else { return true };
        if self.by_light.is_empty() || triangle >= triangles {
            return false;
        }
        let known = &self.by_light[number * triangles + triangle];
        match known.load(Ordering::Relaxed) {
            0 => {
                let clear = match light {
                    Source::Point(point) => is_clear(still, triangle, Towards::Point(point)),
                    Source::Directional(towards) => is_clear(still, triangle, Towards::Directions(&[towards])),
                };
                known.store(if clear { CLEAR } else { BLOCKED }, Ordering::Relaxed);
                clear
            }
            known => known == CLEAR,
        }
    }

    /// Returns whether no ray from a triangle that stands still hits another one that does in about this direction.
    #[inline]
    pub(crate) fn is_free(&self, still: Still, triangle: usize, direction: Vector) -> bool {
        if self.by_direction.is_empty() || triangle >= still.corners.len() {
            return false;
        }
        let cell = Cell::of(direction);
        let (word, shift) = (triangle * WORDS + cell.number() * BITS / 64, cell.number() * BITS % 64);
        let known = &self.by_direction[word];
        #[allow(clippy::cast_possible_truncation, reason = "two bits")]
        match (known.load(Ordering::Relaxed) >> shift) as u8 & (CLEAR | BLOCKED) {
            0 => {
                let clear = is_clear(still, triangle, Towards::Directions(&cell.corners()));
                known.fetch_or(u64::from(if clear { CLEAR } else { BLOCKED }) << shift, Ordering::Relaxed);
                clear
            }
            known => known == CLEAR,
        }
    }
}

#[cold]
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+avx512bw", "x86_64+avx2"))]
fn is_clear(still: Still, triangle: usize, towards: Towards) -> bool {
    let sweep = Sweep::new(&still.corners[triangle], towards);
    let (mut clear, mut tested) = (true, 0);
    still.bvh.visit(&mut vec![], &sweep, |leaf| {
        tested += leaf.triangles.len();
        let misses = |other: usize| other == triangle || sweep.misses(&still.corners[other]);
        clear = tested <= MOST_TESTED && leaf.triangles.clone().all(misses);
        clear
    });
    clear
}

/// A cell of directions: one side of a cube, and a square on it.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Cell {
    axis: usize,
    sign: f64,
    at: [usize; 2],
}

impl Cell {
    /// Returns the cell that a direction lies in.
    fn of(direction: Vector) -> Self {
        let [x, y, z] = direction.map(f64::abs);
        let axis = if x >= y && x >= z { 0 } else { 1 + usize::from(z > y) };
        let largest = direction[axis].abs();
        let at = [(axis + 1) % 3, (axis + 2) % 3].map(|other| {
            #[allow(clippy::cast_precision_loss, reason = "a small number")]
            let at = (direction[other] / largest + 1.0) * (0.5 * CELLS as f64);
            #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a number within the cells")]
            let at = at as usize;
            at.min(CELLS - 1)
        });
        Self { axis, sign: direction[axis].signum(), at }
    }

    fn number(&self) -> usize {
        ((2 * self.axis + usize::from(self.sign < 0.0)) * CELLS + self.at[0]) * CELLS + self.at[1]
    }

    /// Returns the directions at its corners, one after the other.
    fn corners(&self) -> [Vector; 4] {
        [[0, 0], [1, 0], [1, 1], [0, 1]].map(|further: [usize; 2]| {
            let mut corner = [self.sign; 3];
            for k in 0..2 {
                #[allow(clippy::cast_precision_loss, reason = "a small number")]
                let at = (self.at[k] + further[k]) as f64 / (0.5 * CELLS as f64) - 1.0;
                corner[(self.axis + 1 + k) % 3] = at;
            }
            corner
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::render::geometry::sweep::tests::{passes, point_of};
    use crate::render::geometry::vector::{Bounds, add, cross, dot, scale, sub};
    use crate::render::scene::has_area;
    use proptest::prelude::*;
    use std::f64::consts::FRAC_PI_2;

    fn vector(size: f64) -> impl Strategy<Value = Vector> {
        prop::array::uniform3(-size..size)
    }

    fn ordered(triangles: &[[Vector; 3]]) -> (Bvh, Vec<[Vector; 3]>) {
        let (bvh, order) = Bvh::new(triangles.iter().map(|corners| Bounds::of(corners)), false);
        (bvh, order.iter().map(|&at| triangles[at as usize]).collect())
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(200))]

        /// Where lights or directions are unoccluded, no ray from any point of the triangle is blocked; asked again, the
        /// answer is the same.
        #[test]
        fn rays_are_free_where_it_says_so(
            places in prop::collection::vec((vector(3.0), vector(0.8), vector(0.8)), 2..40),
            light in vector(6.0), towards in vector(1.0), directions in prop::collection::vec(vector(1.0), 8),
            samples in prop::collection::vec(prop::array::uniform2(0f64..1.0), 16),
        ) {
            let triangles: Vec<_> = places.iter().map(|&(a, b, c)| [a, add(a, b), add(a, c)]).collect();
            let (bvh, corners) = ordered(&triangles);
            let still = Still { bvh: &bvh, corners: &corners };
            let lights = vec![Some(Source::Directional(towards)), None, Some(Source::Point(light))];
            let unoccluded = Unoccluded::new(corners.len(), lights, true);
            for triangle in 0..corners.len() {
                let others = || (0..corners.len()).filter(|&other| other != triangle).map(|other| corners[other]);
                let free = |way: &dyn Fn(Vector) -> Vector, end: f64| {
                    samples.iter().all(|&at| {
                        let from = point_of(&corners[triangle], at);
                        !others().any(|other| passes(from, way(from), end, &other).is_some())
                    })
                };
                for _ in 0..2 {
                    prop_assert!(unoccluded.is_lit(still, triangle, 1));
                    prop_assert!(!unoccluded.is_lit(still, triangle, 0) || free(&|_| towards, f64::INFINITY));
                    prop_assert!(!unoccluded.is_lit(still, triangle, 2) || free(&|from| sub(light, from), 1.0));
                    for &way in &directions {
                        prop_assert!(!unoccluded.is_free(still, triangle, way) || free(&|_| way, f64::INFINITY));
                    }
                }
            }
        }

        /// A direction lies between the corners of its cell, whose number no other has.
        #[test]
        fn directions_lie_in_their_cells(direction in prop_oneof![
            vector(1.0), prop::array::uniform3((-4i8..5).prop_map(|x| f64::from(x) / 4.0)),
        ]) {
            prop_assume!(direction != [0.0; 3]);
            let cell = Cell::of(direction);
            let corners = cell.corners();
            prop_assert!(cell.number() < 6 * CELLS * CELLS);
            for corner in corners {
                prop_assert_eq!(corner[cell.axis], cell.sign);
            }
            let size = direction[cell.axis].abs();
            for axis in 0..3 {
                let most = corners.iter().map(|corner| corner[axis]).fold(f64::NEG_INFINITY, f64::max);
                let least = corners.iter().map(|corner| corner[axis]).fold(f64::INFINITY, f64::min);
                let at = direction[axis] / size;
                prop_assert!(least <= at && at <= most, "{at} is not in {least}..{most}");
                prop_assert!(axis == cell.axis || most - least == 0.25);
            }
            let middle = corners.iter().fold([0.0; 3], |sum, &corner| add(sum, corner));
            prop_assert_eq!(Cell::of(middle), cell);
        }
    }

    /// Returns a ball of squares, each of two triangles, with their normals outward.
    fn ball() -> Vec<[Vector; 3]> {
        let at = |i: u32, j: u32| {
            let (polar, around) = (f64::from(i) * 0.1 * FRAC_PI_2, f64::from(j) * 0.2 * FRAC_PI_2);
            [libm::sin(polar) * libm::cos(around), libm::sin(polar) * libm::sin(around), libm::cos(polar)]
        };
        let squares = (0..20).flat_map(|i| (0..20).map(move |j| (i, j)));
        squares
            .flat_map(|(i, j)| {
                let next = (j + 1) % 20;
                let (a, b, c, d) = (at(i, j), at(i + 1, j), at(i, next), at(i + 1, next));
                [[a, b, c], [b, d, c]]
            })
            .filter(has_area)
            .collect()
    }

    /// On a ball just those triangles are lit that face the light, and rays are free that leave it; a screen before the
    /// light takes it from all.
    #[test]
    fn what_faces_a_light_is_lit() {
        let mut triangles = ball();
        let light = [4.0, 1.0, 3.0];
        for screened in [false, true] {
            let (bvh, corners) = ordered(&triangles);
            let still = Still { bvh: &bvh, corners: &corners };
            let lights = vec![Some(Source::Point(light)), Some(Source::Directional(scale(light, 0.2)))];
            let unoccluded = Unoccluded::new(corners.len(), lights, true);
            let mut lit = 0;
            for (triangle, &[a, b, c]) in corners.iter().enumerate() {
                let (normal, middle) = (cross(sub(b, a), sub(c, a)), scale(add(a, add(b, c)), 1.0 / 3.0));
                if dot(middle, middle) > 2.0 {
                    continue;
                }
                let outward = scale(normal, dot(normal, middle).signum());
                for (number, towards) in [sub(light, middle), light].into_iter().enumerate() {
                    let cosine = dot(outward, towards) / dot(outward, outward).sqrt();
                    let answer = unoccluded.is_lit(still, triangle, number);
                    assert!(if screened || cosine < -0.2 { !answer } else { answer || cosine < 0.2 }, "{cosine}");
                    lit += usize::from(answer);
                }
                assert_eq!(unoccluded.is_free(still, triangle, outward), !screened || outward[2] < 0.0);
                assert!(!unoccluded.is_free(still, triangle, scale(outward, -1.0)));
            }
            assert_eq!(lit > 100, !screened);
            let [low, high] = [-300.0, 300.0];
            triangles.push([[low, low, 2.0], [high, low, 2.0], [0.0, high, 2.0]]);
        }
    }

    /// Where no rays ask for directions, or for a triangle that moves, rays are to be traced.
    #[test]
    fn what_is_not_known_is_not_free() {
        let (bvh, corners) = ordered(&[[[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]]);
        let still = Still { bvh: &bvh, corners: &corners };
        let light = || vec![Some(Source::Point([0.0, 0.0, 1.0]))];
        assert!(Unoccluded::new(1, light(), true).is_free(still, 0, [0.0, 0.0, 1.0]));
        assert!(Unoccluded::new(1, light(), true).is_free(still, 0, [1.0, 0.0, 0.0]));
        assert!(!Unoccluded::new(1, light(), false).is_free(still, 0, [0.0, 0.0, 1.0]));
        assert!(!Unoccluded::new(1, light(), true).is_free(still, 1, [0.0, 0.0, 1.0]));
        assert!(Unoccluded::new(1, light(), true).is_lit(still, 0, 0));
        assert!(!Unoccluded::new(1, light(), true).is_lit(still, 1, 0));
        assert!(Unoccluded::new(1, vec![None], true).is_lit(still, 1, 0));
    }
}
