//! Traces rays of any direction: what each hits first, or whether it hits anything.
//!
//! Rays from one point are traced in packets of [`PACKET`] that share the way through the BVH. Where only a few rays of
//! a packet are left in a node, each is tested against its eight boxes alone, so rays that part cost little more than
//! single ones.
//!
//! Triangles are tested by Woop, Benthin and Wald, "Watertight ray/triangle intersection", JCGT 2(1), 2013: no ray
//! passes between two triangles at a common edge or corner. Boxes are tested with a margin for roundings, after Ize,
//! "Robust BVH ray traversal", JCGT 2(2), 2013.
//!
//! What must not break: the same bits on every processor, and for a ray in any packet. Of two triangles at the same
//! distance the one with the lower number is hit, whatever the tree looks like.

use crate::render::geometry::bvh::{Bvh, Node, WIDTH, index};
use crate::render::geometry::vector::{Bounds, Vector, largest, single, sub};
use crate::render::scene::has_area;

/// Rays that are traced together.
pub(crate) const PACKET: usize = 16;

/// The number of no triangle.
pub(crate) const NOTHING: u32 = u32::MAX;

/// A box that is farther than another by this factor at most may be nearer but for roundings.
const MARGIN: f32 = 1.0 + 3e-6;

/// Of a ray that hardly moves along an axis, the distance per unit of that axis is no larger.
const LEAST_ALONG: f32 = 1e-30;

/// Packets with so many rays in a node test these together against each box; others test each ray against all boxes.
const MANY_IN_NODE: u32 = 6;

/// Packets with so many rays in a leaf test these together against each triangle.
const MANY_IN_LEAF: u32 = 3;

/// The triangles of a scene, ready for rays. Coordinates are relative to the scene's centre and scaled by a power of
/// two, so that none is larger than 1.
#[derive(Debug)]
pub(crate) struct RayTracer {
    bvh: Bvh,
    /// In the order of the BVH.
    corners: Vec<[[f32; 3]; 3]>,
    /// Of the triangles in the table that they came in.
    numbers: Vec<u32>,
    centre: Vector,
    /// Units of these coordinates in a metre.
    pub(crate) scale: f64,
    /// The length of the scene's diagonal, in these coordinates.
    pub(crate) diagonal: f32,
}

/// What a ray hits first.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Hit {
    /// Its number, [`NOTHING`] where nothing is hit.
    pub(crate) triangle: u32,
    /// In units of the ray's direction.
    pub(crate) distance: f32,
    /// Barycentric coordinates: the weights of the second and the third corner.
    pub(crate) weights: [f32; 2],
}

/// Rays from one point, and room for their results.
#[derive(Debug, Default)]
pub(crate) struct Fan {
    /// Where all begin, in the coordinates of the [`RayTracer`].
    pub(crate) origin: [f32; 3],
    /// Their directions, of any length but 0.
    pub(crate) directions: [Vec<f32>; 3],
    /// Where they end, in units of their directions; infinite for those that do not.
    pub(crate) ends: Vec<f32>,
    /// What each hits first, after [`RayTracer::closest`].
    pub(crate) hits: Vec<Hit>,
    /// Whether each hits anything before its end, after [`RayTracer::any`].
    pub(crate) blocked: Vec<bool>,
    sides: [Vec<u32>; 6],
    stack: Vec<Waiting>,
}

impl Fan {
    /// Makes room for so many rays.
    pub(crate) fn resize(&mut self, rays: usize) {
        for axis in &mut self.directions {
            axis.resize(rays, 0.0);
        }
        self.ends.resize(rays, f32::INFINITY);
    }
}

/// A node or leaf that some rays of a packet may hit, and how near it is to the nearest of them.
#[derive(Clone, Copy, Debug)]
struct Waiting {
    distance: f32,
    first: u32,
    count: u32,
    rays: u32,
}

/// Rays from one point that go the farthest along the same axis.
struct RayPacket {
    origin: [f32; 3],
    /// The two other axes, and the one that they go along.
    axes: [usize; 3],
    /// Takes a ray to the axis: steps along both other axes for one along it, and the distance for one.
    shear: [[f32; PACKET]; 3],
    /// Distance for a step along each axis of the scene.
    per_step: [[f32; PACKET]; 3],
    /// How far each looks for triangles: to what it hit, if that is any.
    ends: [f32; PACKET],
    triangles: [u32; PACKET],
    weights: [[f32; PACKET]; 2],
}

#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
impl RayPacket {
    #[inline(always)]
    fn new(fan: &Fan, axis: usize, members: &[u32]) -> Self {
        let order = [(axis + 1) % 3, (axis + 2) % 3, axis];
        let mut packet = Self {
            origin: fan.origin,
            axes: order,
            shear: [[0.0; PACKET]; 3],
            per_step: [[1.0; PACKET]; 3],
            ends: [-1.0; PACKET],
            triangles: [NOTHING; PACKET],
            weights: [[0.0; PACKET]; 2],
        };
        let mut directions = [[1f32; PACKET]; 3];
        for (ray, &member) in members.iter().enumerate() {
            for i in 0..3 {
                directions[i][ray] = fan.directions[i][member as usize];
            }
            packet.ends[ray] = fan.ends[member as usize];
        }
        for ray in 0..PACKET {
            let along = directions[axis][ray];
            packet.shear[0][ray] = directions[order[0]][ray] / along;
            packet.shear[1][ray] = directions[order[1]][ray] / along;
            packet.shear[2][ray] = 1.0 / along;
        }
        for i in 0..3 {
            for ray in 0..PACKET {
                let along = directions[i][ray];
                let size = if along < 0.0 { -along } else { along };
                let size = if size > LEAST_ALONG { size } else { LEAST_ALONG };
                packet.per_step[i][ray] = 1.0 / if along < 0.0 { -size } else { size };
            }
        }
        packet
    }

    /// Returns the rays (as bits) that may hit each box of a node, and how near each box is to the nearest of them.
    #[inline(always)]
    fn meet(&self, node: &Node, rays: u32) -> ([u32; WIDTH], [f32; WIDTH]) {
        let (mut meeting, mut nearest) = ([0u32; WIDTH], [f32::INFINITY; WIDTH]);
        if rays.count_ones() > MANY_IN_NODE {
            for lane in 0..node.used {
                let (mut first, mut last) = ([0f32; PACKET], self.ends);
                for axis in 0..3 {
                    let low = node.boxes.low[axis][lane] - self.origin[axis];
                    let high = node.boxes.high[axis][lane] - self.origin[axis];
                    for ray in 0..PACKET {
                        within(&mut first[ray], &mut last[ray], low, high, self.per_step[axis][ray]);
                    }
                }
                let (mut members, mut distances) = ([0u32; PACKET], [0f32; PACKET]);
                for ray in 0..PACKET {
                    let meets = u32::from(first[ray] <= last[ray] * MARGIN) & u32::from(rays & (1 << ray) != 0);
                    members[ray] = if meets == 1 { 1 << ray } else { 0 };
                    distances[ray] = if meets == 1 { first[ray] } else { f32::INFINITY };
                }
                meeting[lane] = members.iter().fold(0, |all, bit| all | bit);
                nearest[lane] = smallest(distances);
            }
            return (meeting, nearest);
        }
        let mut left = rays;
        while left != 0 {
            let ray = left.trailing_zeros() as usize;
            left &= left - 1;
            let (mut first, mut last) = ([0f32; WIDTH], [self.ends[ray]; WIDTH]);
            for axis in 0..3 {
                let (origin, per_step) = (self.origin[axis], self.per_step[axis][ray]);
                let (low, high) = (&node.boxes.low[axis], &node.boxes.high[axis]);
                for lane in 0..WIDTH {
                    within(&mut first[lane], &mut last[lane], low[lane] - origin, high[lane] - origin, per_step);
                }
            }
            for lane in 0..WIDTH {
                let meets = first[lane] <= last[lane] * MARGIN;
                meeting[lane] |= u32::from(meets) << ray;
                let near = if meets { first[lane] } else { f32::INFINITY };
                nearest[lane] = if near < nearest[lane] { near } else { nearest[lane] };
            }
        }
        (meeting, nearest)
    }

    /// Tests the triangles of a leaf for some rays, which are given as bits.
    #[inline(always)]
    fn test(&mut self, tracer: &RayTracer, first: u32, count: u32, rays: u32) {
        let [i, j, k] = self.axes;
        for at in first as usize..(first + count) as usize {
            let number = tracer.numbers[at];
            let [p, q, r] = &tracer.corners[at];
            let from = &self.origin;
            let a = [p[i] - from[i], p[j] - from[j], p[k] - from[k]];
            let b = [q[i] - from[i], q[j] - from[j], q[k] - from[k]];
            let c = [r[i] - from[i], r[j] - from[j], r[k] - from[k]];
            if rays.count_ones() > MANY_IN_LEAF {
                let Some([distances, seconds, thirds]) = meets(&[a, b, c], &self.shear) else { continue };
                for ray in 0..PACKET {
                    let asked = u32::from(rays & (1 << ray) != 0);
                    let (distance, end) = (distances[ray], self.ends[ray]);
                    let same = u32::from(distance == end) & u32::from(number < self.triangles[ray]);
                    let taken = asked & u32::from(distance > 0.0) & (u32::from(distance < end) | same);
                    self.ends[ray] = if taken == 1 { distance } else { end };
                    self.triangles[ray] = if taken == 1 { number } else { self.triangles[ray] };
                    self.weights[0][ray] = if taken == 1 { seconds[ray] } else { self.weights[0][ray] };
                    self.weights[1][ray] = if taken == 1 { thirds[ray] } else { self.weights[1][ray] };
                }
                continue;
            }
            let mut left = rays;
            while left != 0 {
                let ray = left.trailing_zeros() as usize;
                left &= left - 1;
                let shear = [[self.shear[0][ray]], [self.shear[1][ray]], [self.shear[2][ray]]];
                let Some([[distance], [second], [third]]) = meets(&[a, b, c], &shear) else { continue };
                let end = self.ends[ray];
                if distance > 0.0 && (distance < end || (distance == end && number < self.triangles[ray])) {
                    (self.ends[ray], self.triangles[ray]) = (distance, number);
                    (self.weights[0][ray], self.weights[1][ray]) = (second, third);
                }
            }
        }
    }
}

/// Returns the smallest of some numbers, by halves, because that is vector code.
#[inline(always)]
#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
fn smallest(mut values: [f32; PACKET]) -> f32 {
    let mut half = PACKET / 2;
    while half > 0 {
        for i in 0..half {
            let (a, b) = (values[i], values[i + half]);
            values[i] = if b < a { b } else { a };
        }
        half /= 2;
    }
    values[0]
}

/// Shortens the part of a ray that lies within a box to that between two of its sides, which are given relative to the
/// ray's origin.
#[inline(always)]
#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
fn within(first: &mut f32, last: &mut f32, low: f32, high: f32, per_step: f32) {
    let (to_low, to_high) = (low * per_step, high * per_step);
    let near = if to_low < to_high { to_low } else { to_high };
    let far = if to_low < to_high { to_high } else { to_low };
    *first = if near > *first { near } else { *first };
    *last = if far < *last { far } else { *last };
}

/// Returns where rays meet a triangle, and the weights of its second and third corner there; the distance is -1 for
/// rays that pass it, and None is returned where all do. Corners are relative to the rays' origin, in the order of a
/// packet's axes.
#[inline(always)]
#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
#[allow(clippy::similar_names, reason = "coordinates of three corners")]
fn meets<const N: usize>([a, b, c]: &[[f32; 3]; 3], shear: &[[f32; N]; 3]) -> Option<[[f32; N]; 3]> {
    let mut met = [[-1f32; N], [0f32; N], [0f32; N]];
    let mut edges = [[0f32; N]; 3];
    let mut at_edge = 0u32;
    for ray in 0..N {
        let (x, y) = (shear[0][ray], shear[1][ray]);
        let (ax, ay) = (a[0] - x * a[2], a[1] - y * a[2]);
        let (bx, by) = (b[0] - x * b[2], b[1] - y * b[2]);
        let (cx, cy) = (c[0] - x * c[2], c[1] - y * c[2]);
        let (u, v, w) = (cx * by - cy * bx, ax * cy - ay * cx, bx * ay - by * ax);
        (edges[0][ray], edges[1][ray], edges[2][ray]) = (u, v, w);
        at_edge |= u32::from(u == 0.0) | u32::from(v == 0.0) | u32::from(w == 0.0);
    }
    if at_edge != 0 {
        for ray in 0..N {
            let at = |corner: &[f32; 3]| {
                let [x, y] = [0, 1].map(|axis| corner[axis] - shear[axis][ray] * corner[2]);
                [f64::from(x), f64::from(y)]
            };
            let [a, b, c] = [at(a), at(b), at(c)];
            let side = |[px, py]: [f64; 2], [qx, qy]: [f64; 2]| exact_sign(px * qy - py * qx);
            let exact = [side(c, b), side(a, c), side(b, a)];
            for edge in 0..3 {
                if edges[edge][ray] == 0.0 {
                    edges[edge][ray] = exact[edge];
                }
            }
        }
    }
    let (mut passes, mut all_pass) = ([0u32; N], 1);
    for ray in 0..N {
        let (u, v, w) = (edges[0][ray], edges[1][ray], edges[2][ray]);
        let behind = u32::from(u < 0.0) | u32::from(v < 0.0) | u32::from(w < 0.0);
        let before = u32::from(u > 0.0) | u32::from(v > 0.0) | u32::from(w > 0.0);
        passes[ray] = (behind & before) | u32::from(u + v + w == 0.0);
        all_pass &= passes[ray];
    }
    if all_pass == 1 {
        return None;
    }
    for ray in 0..N {
        let (u, v, w) = (edges[0][ray], edges[1][ray], edges[2][ray]);
        let per_sum = 1.0 / (u + v + w);
        let distance = (u * a[2] + v * b[2] + w * c[2]) * per_sum * shear[2][ray];
        met[0][ray] = if passes[ray] == 0 { distance } else { -1.0 };
        (met[1][ray], met[2][ray]) = (v * per_sum, w * per_sum);
    }
    Some(met)
}

/// Rounds to float32, but never to 0.
#[allow(clippy::cast_possible_truncation, reason = "float64 is rounded to float32")]
fn exact_sign(value: f64) -> f32 {
    let single = value as f32;
    if single == 0.0 && value != 0.0 {
        f32::MIN_POSITIVE.copysign(if value < 0.0 { -1.0 } else { 1.0 })
    } else {
        single
    }
}

#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
impl RayTracer {
    /// Makes triangles ready, on the threads of this pool where that is `parallel`. Those without area, or with a corner
    /// that is not finite, are never hit.
    pub(crate) fn new(corners: &[[Vector; 3]], parallel: bool) -> Self {
        let members: Vec<u32> =
            corners.iter().enumerate().filter(|(_, triangle)| has_area(triangle)).map(|(i, _)| index(i)).collect();
        let around = members.iter().fold(Bounds::NONE, |all, &i| all.with(&Bounds::of(&corners[i as usize])));
        let centre = if members.is_empty() { [0.0; 3] } else { around.centre() };
        let reach = largest(sub(around.high, centre)).max(largest(sub(around.low, centre)));
        let scale = if members.is_empty() { 1.0 } else { libm::exp2(-libm::ceil(libm::log2(reach))) };
        let own = |&i: &u32| corners[i as usize].map(|corner| sub(corner, centre).map(|x| x * scale));
        let (bvh, order) = Bvh::new(members.iter().map(|i| Bounds::of(&own(i))), parallel);
        let numbers: Vec<u32> = order.iter().map(|&at| members[at as usize]).collect();
        let size = sub(around.high, around.low).map(|x| x * scale);
        let diagonal = if members.is_empty() { 1.0 } else { size.iter().map(|x| x * x).sum::<f64>().sqrt() };
        Self {
            corners: numbers.iter().map(|i| own(i).map(single)).collect(),
            bvh,
            numbers,
            centre,
            scale,
            #[allow(clippy::cast_possible_truncation, reason = "float64 is rounded to float32")]
            diagonal: diagonal as f32,
        }
    }

    /// Returns a point of the scene, in metres, in the coordinates of the triangles.
    pub(crate) fn scaled(&self, point: Vector) -> [f32; 3] {
        single(sub(point, self.centre).map(|x| x * self.scale))
    }

    /// Finds what each ray of a fan hits first.
    #[inline(always)]
    pub(crate) fn closest(&self, fan: &mut Fan) {
        fan.hits.clear();
        fan.hits.resize(fan.ends.len(), Hit { triangle: NOTHING, distance: f32::INFINITY, weights: [0.0; 2] });
        self.trace(fan, false, |fan, members, packet| {
            for (ray, &member) in members.iter().enumerate() {
                fan.hits[member as usize] = Hit {
                    triangle: packet.triangles[ray],
                    distance: packet.ends[ray],
                    weights: [packet.weights[0][ray], packet.weights[1][ray]],
                };
            }
        });
    }

    /// Finds whether each ray of a fan hits anything before its end.
    #[inline(always)]
    pub(crate) fn any(&self, fan: &mut Fan) {
        fan.blocked.clear();
        fan.blocked.resize(fan.ends.len(), false);
        self.trace(fan, true, |fan, members, packet| {
            for (&member, triangle) in members.iter().zip(packet.triangles) {
                fan.blocked[member as usize] = triangle != NOTHING;
            }
        });
    }

    /// Traces the rays of a fan, and hands over each packet with the numbers of its rays.
    #[inline(always)]
    fn trace(&self, fan: &mut Fan, any: bool, mut done: impl FnMut(&mut Fan, &[u32], &RayPacket)) {
        let mut sides = std::mem::take(&mut fan.sides);
        let mut stack = std::mem::take(&mut fan.stack);
        sides.iter_mut().for_each(Vec::clear);
        for ray in 0..fan.ends.len() {
            if fan.ends[ray] > 0.0 {
                let [x, y, z] = [0, 1, 2].map(|axis| fan.directions[axis][ray]);
                let axis =
                    if x.abs() >= y.abs() && x.abs() >= z.abs() { 0 } else { 1 + usize::from(z.abs() > y.abs()) };
                sides[2 * axis + usize::from([x, y, z][axis] < 0.0)].push(index(ray));
            }
        }
        for (side, rays) in sides.iter().enumerate() {
            for members in rays.chunks(PACKET) {
                let mut packet = RayPacket::new(fan, side / 2, members);
                self.walk(&mut packet, members.len(), any, &mut stack);
                done(fan, members, &packet);
            }
        }
        (fan.sides, fan.stack) = (sides, stack);
    }

    /// Walks through the BVH with a packet, nearer boxes first.
    #[inline(always)]
    fn walk(&self, packet: &mut RayPacket, rays: usize, any: bool, stack: &mut Vec<Waiting>) {
        stack.clear();
        if !self.bvh.nodes.is_empty() {
            stack.push(Waiting { distance: 0.0, first: 0, count: 0, rays: (1 << rays) - 1 });
        }
        while let Some(next) = stack.pop() {
            let mut left = next.rays;
            // Rays that hit something nearer are done with it.
            let mut reaching = [0u32; PACKET];
            for ray in 0..PACKET {
                reaching[ray] = u32::from(next.distance <= packet.ends[ray] * MARGIN) << ray;
            }
            left &= reaching.iter().fold(0, |all, bit| all | bit);
            if left == 0 {
                continue;
            }
            if next.count > 0 {
                packet.test(self, next.first, next.count, left);
                if any {
                    for ray in 0..PACKET {
                        let hit = packet.triangles[ray] != NOTHING;
                        packet.ends[ray] = if hit { -1.0 } else { packet.ends[ray] };
                    }
                }
                continue;
            }
            let node = &self.bvh.nodes[next.first as usize];
            let (meeting, nearest) = packet.meet(node, left);
            let begin = stack.len();
            for lane in 0..node.used {
                if meeting[lane] == 0 {
                    continue;
                }
                let new = Waiting {
                    distance: nearest[lane],
                    first: node.first[lane],
                    count: node.count[lane],
                    rays: meeting[lane],
                };
                let at = begin + stack[begin..].iter().filter(|other| other.distance > new.distance).count();
                stack.insert(at, new);
            }
        }
    }
}

#[cfg(test)]
#[allow(clippy::cast_precision_loss, reason = "small numbers")]
mod tests {
    use super::*;
    use crate::render::geometry::vector::{add, cross, dot, scale};
    use proptest::prelude::*;

    enum Found {
        /// The number of the nearest triangle, and its distance.
        At(usize, f64),
        Nothing,
        /// A triangle is met within rounding of its edge or of its plane, so that float32 may decide otherwise.
        Doubtful,
    }

    /// Returns what a ray meets, in float64, by a test of every triangle.
    fn brute_force(corners: &[[Vector; 3]], origin: Vector, direction: Vector) -> Found {
        let mut nearest: Option<(usize, f64)> = None;
        let mut doubtful = f64::INFINITY;
        let length = dot(direction, direction).sqrt();
        for (number, triangle) in corners.iter().enumerate().filter(|(_, triangle)| has_area(triangle)) {
            let [a, b, c] = triangle.map(|corner| sub(corner, origin));
            let size = largest(a).max(largest(b)).max(largest(c));
            let normal = cross(sub(b, a), sub(c, a));
            let height = dot(normal, a);
            let sides = [cross(b, c), cross(c, a), cross(a, b)].map(|side| dot(side, direction));
            let slack = 1e-5 * size * size * length;
            let distance = height / dot(normal, direction);
            if sides.iter().all(|side| *side > slack) || sides.iter().all(|side| *side < -slack) {
                if distance > 0.0 && nearest.is_none_or(|(_, least)| distance < least) {
                    nearest = Some((number, distance));
                }
            } else if !(sides.iter().any(|side| *side > slack) && sides.iter().any(|side| *side < -slack)) {
                let near = [a, b, c].iter().map(|&corner| dot(corner, corner).sqrt()).fold(f64::INFINITY, f64::min);
                let reach = if distance.is_finite() { distance.abs() } else { 0.0 };
                doubtful = doubtful.min(reach.min(near / length) * 0.99 - 1e-3 * size / length);
            }
        }
        match nearest {
            Some((number, distance)) if distance < doubtful => Found::At(number, distance),
            None if doubtful == f64::INFINITY => Found::Nothing,
            _ => Found::Doubtful,
        }
    }

    fn fan(tracer: &RayTracer, origin: Vector, directions: &[Vector], end: f32) -> Fan {
        let mut fan = Fan { origin: tracer.scaled(origin), ..Fan::default() };
        fan.resize(directions.len());
        for (ray, direction) in directions.iter().enumerate() {
            for axis in 0..3 {
                fan.directions[axis][ray] = single([direction[axis]])[0];
            }
            fan.ends[ray] = end;
        }
        fan
    }

    fn corner() -> impl Strategy<Value = Vector> {
        prop_oneof![
            8 => prop::array::uniform3(-4f64..4.0),
            4 => prop::array::uniform3((-3i8..4).prop_map(f64::from)),
            1 => prop::array::uniform3(prop::sample::select(vec![f64::NAN, 1e9, -1e9, 1e200, f64::INFINITY, 0.0])),
        ]
    }

    /// Triangles: any, flat along an axis, degenerate, and the same one several times.
    fn soup() -> impl Strategy<Value = Vec<[Vector; 3]>> {
        let triangle = (prop::array::uniform3(corner()), 0u8..8).prop_map(|([a, b, c], kind)| match kind {
            0 => [a, b, b],
            1 => [a, b, add(a, scale(sub(b, a), 0.5))],
            2 => [a, [b[0], b[1], a[2]], [c[0], c[1], a[2]]],
            _ => [a, b, c],
        });
        (prop::collection::vec(triangle, 0..60), 1usize..4)
            .prop_map(|(triangles, times)| triangles.iter().cycle().take(times * triangles.len()).copied().collect())
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(400))]

        /// Each ray hits what float64 finds among all triangles, alone and in a packet; of equal ones the first.
        #[test]
        fn rays_hit_what_is_there(
            triangles in soup(), origin in prop::array::uniform3(-5f64..5.0),
            directions in prop::collection::vec(
                prop::array::uniform3(prop_oneof![4 => -1f64..1.0, 1 => Just(0.0)]), 1..40),
        ) {
            let directions: Vec<Vector> =
                directions.into_iter().filter(|d| largest(*d) > 0.0).map(|d| single(d).map(f64::from)).collect();
            let tracer = RayTracer::new(&triangles, false);
            let mut all = fan(&tracer, origin, &directions, f32::INFINITY);
            tracer.closest(&mut all);
            tracer.any(&mut all);
            for (ray, &direction) in directions.iter().enumerate() {
                let hit = all.hits[ray];
                prop_assert_eq!(all.blocked[ray], hit.triangle != NOTHING);
                let mut alone = fan(&tracer, origin, &[direction], f32::INFINITY);
                tracer.closest(&mut alone);
                prop_assert_eq!(alone.hits[0], hit);
                // What is a billion times as large as the rest leaves float32 no digits for it.
                if tracer.scale < 1e-6 {
                    continue;
                }
                let (number, distance) = match brute_force(&triangles, origin, direction) {
                    Found::At(number, distance) => (number, distance),
                    Found::Nothing => {
                        prop_assert_eq!(hit.triangle, NOTHING, "{:?}", hit);
                        continue;
                    }
                    Found::Doubtful => continue,
                };
                prop_assert!(hit.triangle != NOTHING, "{number} at {distance} is missed");
                let hit_distance = f64::from(hit.distance) / tracer.scale;
                prop_assert!((hit_distance - distance).abs() < 1e-3 * (1.0 + distance), "{hit_distance} {distance}");
                if triangles[hit.triangle as usize] == triangles[number] {
                    let first = triangles.iter().position(|triangle| *triangle == triangles[number]).unwrap();
                    prop_assert_eq!(hit.triangle as usize, first);
                    let [a, b, c] = triangles[first];
                    let [second, third] = hit.weights.map(f64::from);
                    let point = add(a, add(scale(sub(b, a), second), scale(sub(c, a), third)));
                    let there = add(origin, scale(direction, distance));
                    prop_assert!(largest(sub(point, there)) < 1e-2, "{point:?} {there:?}");
                }
                // What ends before it hits nothing, what ends behind it does.
                for (end, blocked) in [(0.98, false), (1.02, true)] {
                    let mut short_fan = fan(&tracer, origin, &[direction], hit.distance * end);
                    tracer.any(&mut short_fan);
                    prop_assert_eq!(short_fan.blocked[0], blocked);
                    tracer.closest(&mut short_fan);
                    prop_assert_eq!(short_fan.hits[0].triangle != NOTHING, blocked);
                }
            }
        }

        /// No ray passes an uneven ground, at whatever edge or corner it comes down; none is so steep that a ray
        /// could only touch it.
        #[test]
        fn nothing_passes_between_triangles(
            heights in prop::collection::vec(-0.04f64..0.04, 49), origin in prop::array::uniform2(-0.9f64..0.9),
            rays in prop::collection::vec((0usize..7, 0usize..7, 0usize..3, 0f64..0.95), 48),
        ) {
            let at = |i: usize, j: usize| [i as f64 / 3.0 - 1.0, j as f64 / 3.0 - 1.0, heights[7 * i + j]];
            let mut triangles = vec![];
            for i in 0..6 {
                for j in 0..6 {
                    triangles.push([at(i, j), at(i + 1, j), at(i, j + 1)]);
                    triangles.push([at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)]);
                }
            }
            let tracer = RayTracer::new(&triangles, false);
            let origin = [origin[0], origin[1], 1.5];
            let directions: Vec<Vector> = rays
                .iter()
                .map(|&(i, j, kind, along)| {
                    let (i, j) = (i.clamp(1, 5), j.clamp(1, 5));
                    let other = [at(i + 1, j), at(i, j + 1), at(i - 1, j + 1)][kind];
                    let along = if along < 0.3 { 0.0 } else { along };
                    sub(add(at(i, j), scale(sub(other, at(i, j)), along)), origin)
                })
                .collect();
            let mut all = fan(&tracer, origin, &directions, f32::INFINITY);
            tracer.closest(&mut all);
            prop_assert!(all.hits.iter().all(|hit| hit.triangle != NOTHING));
        }
    }

    /// Rays in a packet, in many packets, and alone meet the same boxes: a mesh of many triangles, by both ways. Builds
    /// without optimization try fewer rays.
    #[test]
    fn a_ray_hits_the_same_in_any_packet() {
        let at = |i: u32, j: u32| [f64::from(i), f64::from(j), 0.3 * libm::sin(f64::from(i * 7 + j * 3))];
        let squares = (0..60).flat_map(|i| (0..60).map(move |j| (i, j)));
        let triangles: Vec<[Vector; 3]> = squares
            .flat_map(|(i, j)| {
                let (a, b, c, d) = (at(i, j), at(i + 1, j), at(i, j + 1), at(i + 1, j + 1));
                [[a, b, c], [b, d, c]]
            })
            .collect();
        let tracer = RayTracer::new(&triangles, false);
        let origin = [29.3, 30.4, 2.0];
        let every = if cfg!(debug_assertions) { 3 } else { 1 };
        let directions: Vec<Vector> = (0..500u32)
            .step_by(every)
            .map(|i| [libm::cos(f64::from(i) * 2.4), libm::sin(f64::from(i) * 2.4), 0.1 - 0.004 * f64::from(i)])
            .collect();
        let mut all = fan(&tracer, origin, &directions, f32::INFINITY);
        tracer.closest(&mut all);
        let mut down = 0;
        for (ray, &direction) in directions.iter().enumerate() {
            let mut alone = fan(&tracer, origin, &[direction], f32::INFINITY);
            tracer.closest(&mut alone);
            assert_eq!(alone.hits[0], all.hits[ray]);
            let hits = match brute_force(&triangles, origin, direction) {
                Found::At(..) => true,
                Found::Nothing => false,
                Found::Doubtful => continue,
            };
            assert_eq!(hits, all.hits[ray].triangle != NOTHING, "{direction:?}");
            down += usize::from(hits);
        }
        assert!(down > 200 / every);
    }

    /// Scenes of any size have coordinates up to 1 and no NaN; an empty one has no hits.
    #[test]
    fn coordinates_are_scaled() {
        for size in [1e-30, 1e-3, 1.0, 1e6, 1e30] {
            let triangle = [[-size, 0.0, size], [size, 0.0, size], [0.0, size, size]];
            let tracer = RayTracer::new(&[triangle], false);
            let reach = tracer.corners.iter().flatten().flatten().fold(0f32, |most, x| most.max(x.abs()));
            assert!((0.5..=1.0).contains(&reach), "{reach}");
            let mut fan = fan(&tracer, [0.0, 0.3 * size, 0.0], &[[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]], f32::INFINITY);
            tracer.closest(&mut fan);
            assert_eq!(fan.hits.iter().map(|hit| hit.triangle).collect::<Vec<_>>(), [0, NOTHING]);
            let distance = f64::from(fan.hits[0].distance) / tracer.scale;
            assert!((distance / size - 1.0).abs() < 1e-6, "{distance}");
            assert!((f64::from(tracer.diagonal) / (tracer.scale * size) - 5f64.sqrt()).abs() < 1e-5);
        }
        let tracer = RayTracer::new(&[[[f64::NAN; 3]; 3], [[1.0; 3]; 3]], false);
        let mut fan = fan(&tracer, [0.0; 3], &[[0.0, 0.0, 1.0]], f32::INFINITY);
        tracer.closest(&mut fan);
        tracer.any(&mut fan);
        assert_eq!((fan.hits[0].triangle, fan.blocked[0]), (NOTHING, false));
    }
}
