//! Edges at which one surface may hide another or bends, and the instants at which they pass a camera's rays.
//!
//! An edge and the camera lie in a plane. A ray is passed when it lies in that plane, between the edge's ends. Over a
//! short time each end moves along a parabola in camera axes, and so does the plane's normal. So the instants are the
//! roots of a polynomial of the second degree.
//!
//! What must not break: corners at the same place count as one, or inner edges of a mesh would seem to be open.

use std::collections::HashMap;

use crate::render::geometry::linear::{Linear, Rect};
use crate::render::geometry::pixel_rays::{LANES, PixelRays, RayBlocks, TileRays};
use crate::render::geometry::vector::{Vector, cross, dot, largest, single, sub};
use crate::render::geometry::view::View;
use crate::render::scene::Scene;

/// What of a distance is rounding.
const ROUNDING: f64 = 1e-9;

/// The sine of the angle between two wings below which they lie in one plane.
const FLAT: f64 = 1e-3;

/// A bend is measured half way; nowhere is it taken to be more than this many times larger.
const BEND_SAFETY: f64 = 1.5;

/// Whether a sum of three float32 products is 0 or more is uncertain below this fraction of their magnitudes.
const UNCERTAIN: f32 = 1e-6;

/// An edge of the scene's triangles.
#[derive(Clone, Copy, Debug)]
struct Edge {
    frame: u32,
    ends: [Vector; 2],
    /// The third corners of the two triangles that meet in it; none where another number does: it may always hide what
    /// is behind it.
    wings: Option<[Vector; 2]>,
}

impl Edge {
    /// Whether its wings do not lie in one plane.
    fn bends(&self) -> bool {
        let Some(wings) = self.wings else { return true };
        let [a, b] = self.ends;
        let along = sub(b, a);
        let [one, other] = wings.map(|wing| cross(along, sub(wing, a)));
        dot(cross(one, other), cross(one, other)) > FLAT * FLAT * dot(one, one) * dot(other, other)
    }

    /// Whether a camera that goes from one place to another may see what it looks at change at the edge: where it hides
    /// something, or where both of its wings are seen and the surface bends.
    fn may_be_seen(&self, from: Vector, to: Vector) -> bool {
        let Some(wings) = self.wings else { return true };
        let [a, b] = self.ends;
        let along = sub(b, a);
        let [before, after] = [from, to].map(|place| {
            let away = sub(place, a);
            wings.map(|wing| {
                let normal = cross(along, sub(wing, a));
                let height = dot(normal, away);
                if height.abs() <= ROUNDING * largest(normal) * (largest(away) + largest(along)) {
                    0.0
                } else {
                    height.signum()
                }
            })
        });
        // The camera's way is taken to be straight: to both sides at both ends is so all the way.
        before != after || before[0] * before[1] >= 0.0 || self.bends()
    }
}

/// A polynomial of the second degree over 0..1, in Bernstein's form: its values lie between the least and the largest
/// of the three.
type Curve<T> = [T; 3];

/// The curve through values at 0, at `middle`, and at 1.
fn curve(values: [Vector; 3], middle: f64) -> Curve<Vector> {
    let [first, second, last] = values;
    std::array::from_fn(|k| {
        std::array::from_fn(|i| {
            let (a, b, c) = (first[i], second[i], last[i]);
            match k {
                0 => a,
                2 => c,
                _ => {
                    let rest = 1.0 - middle;
                    (b - rest * rest * a - middle * middle * c) / (2.0 * middle * rest)
                }
            }
        })
    })
}

fn at(curve: &Curve<Vector>, fraction: f64) -> Vector {
    let rest = 1.0 - fraction;
    let weights = [rest * rest, 2.0 * fraction * rest, fraction * fraction];
    std::array::from_fn(|i| weights[0] * curve[0][i] + weights[1] * curve[1][i] + weights[2] * curve[2][i])
}

/// The roots of a polynomial of the second degree in 0 < fraction <= 1.
fn roots(values: Curve<f64>) -> impl Iterator<Item = f64> {
    let [first, middle, last] = values;
    let (square, half, constant) = (first - 2.0 * middle + last, middle - first, first);
    let discriminant = half * half - square * constant;
    let passes = if discriminant < 0.0 {
        [f64::NAN; 2]
    } else {
        // Of the two usual forms each is used where it does not cancel.
        let sum = -(half + discriminant.sqrt().copysign(half));
        [sum / square, constant / sum]
    };
    passes.into_iter().filter(|fraction| *fraction > 0.0 && *fraction <= 1.0)
}

/// An edge as it moves before the camera, in camera axes.
#[derive(Clone, Copy, Debug)]
struct MovingEdge {
    ends: [Curve<Vector>; 2],
    /// Of the plane of the edge and the camera's centre.
    normal: Curve<Vector>,
    /// Around its images; the whole plane where it is not wholly before the camera.
    image: [[f64; 2]; 2],
}

impl MovingEdge {
    /// None where all of it stays behind the camera.
    fn new(edge: &Edge, views: [&View; 3], middle: f64) -> Option<Self> {
        let seen = views.map(|view| {
            let pose = &view.poses[edge.frame as usize];
            edge.ends.map(|end| pose.turned(sub(end, pose.position)))
        });
        if seen.iter().flatten().all(|end| end[2] <= 0.0) {
            return None;
        }
        let mut image = [[f64::NEG_INFINITY; 2], [f64::INFINITY; 2]];
        if seen.iter().flatten().all(|end| end[2] > 0.0) {
            image = [[f64::INFINITY; 2], [f64::NEG_INFINITY; 2]];
            for end in 0..2 {
                let places = seen.map(|ends| [ends[end][0] / ends[end][2], ends[end][1] / ends[end][2]]);
                for i in 0..2 {
                    let bend = places[1][i] - (1.0 - middle) * places[0][i] - middle * places[2][i];
                    let spare = BEND_SAFETY * bend.abs() + ROUNDING;
                    for place in places {
                        image[0][i] = image[0][i].min(place[i] - spare);
                        image[1][i] = image[1][i].max(place[i] + spare);
                    }
                }
            }
        }
        let ends = [0, 1].map(|end| curve(seen.map(|ends| ends[end]), middle));
        let normal = curve(seen.map(|[a, b]| cross(a, b)), middle);
        Some(Self { ends, normal, image })
    }

    /// Whether a line through the edge may meet a part of the image.
    fn may_meet(&self, ray_blocks: &Rect) -> bool {
        let [mut low, mut high] = [f64::INFINITY, f64::NEG_INFINITY];
        for [x, y] in ray_blocks.corners() {
            for n in &self.normal {
                let value = n[0] * f64::from(x) + n[1] * f64::from(y) + n[2];
                (low, high) = (low.min(value), high.max(value));
            }
        }
        low <= 0.0 && high >= 0.0
    }

    /// When it passes a ray, and its inverse depth there.
    fn passes(&self, x: f32, y: f32) -> impl Iterator<Item = (f64, f64)> {
        let ray = [f64::from(x), f64::from(y), 1.0];
        roots(self.normal.map(|n| dot(n, ray))).filter_map(move |fraction| {
            let [a, b] = [&self.ends[0], &self.ends[1]].map(|end| at(end, fraction));
            // The ray is of + of b, and meets the edge between them where both shares are positive.
            let normal = cross(a, b);
            let (of_a, of_b) = (dot(cross(ray, b), normal), dot(cross(a, ray), normal));
            (of_a >= 0.0 && of_b >= 0.0).then(|| (fraction, (of_a + of_b) / dot(normal, normal)))
        })
    }
}

/// An edge that passes a ray.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Pass {
    /// Row by row.
    pub(crate) pixel: u32,
    pub(crate) ray: u32,
    /// When, from 0 to 1 of the time that is looked at.
    pub(crate) fraction: f64,
    /// 1 / z of the edge there.
    pub(crate) inverse_depth: f64,
}

/// The edges of a scene's triangles.
#[derive(Debug)]
pub(crate) struct Edges(Vec<Edge>);

impl Edges {
    /// Those of a scene. Corners at the same place are one.
    pub(crate) fn of_scene(scene: &Scene) -> Self {
        type Key = (u32, [[u64; 3]; 2]);
        let mut wings: HashMap<Key, Vec<Vector>> = HashMap::new();
        let mut order: Vec<(Key, Edge)> = vec![];
        let bits = |place: Vector| place.map(|x| (x + 0.0).to_bits());
        for (corners, surface) in scene.corners.iter().zip(&scene.surfaces) {
            for k in 0..3 {
                let (a, b, third) = (corners[k], corners[(k + 1) % 3], corners[(k + 2) % 3]);
                let (a, b) = if bits(a) <= bits(b) { (a, b) } else { (b, a) };
                let key = (surface.frame, [bits(a), bits(b)]);
                let of_edge = wings.entry(key).or_default();
                if of_edge.is_empty() {
                    order.push((key, Edge { frame: surface.frame, ends: [a, b], wings: None }));
                }
                of_edge.push(third);
            }
        }
        let with_wings = order.into_iter().map(|(key, edge)| Edge {
            wings: match wings[&key].as_slice() {
                [one, other] => Some([*one, *other]),
                _ => None,
            },
            ..edge
        });
        Self(with_wings.collect())
    }

    /// Which edges pass which rays between three views, the second of which is at `middle` of
    /// the time, 0 < middle < 1; by pixel, ray and time.
    ///
    /// Edges in the middle of a plane do not count. The camera must not turn or go far meanwhile: what moves is taken to go along parabolas. An edge that is hidden
    /// itself passes rays too.
    pub(crate) fn passes(&self, rays: &PixelRays, views: [&View; 3], middle: f64) -> Vec<Pass> {
        let mut moving = vec![];
        let mut tiles: Vec<(u32, u32)> = vec![];
        for edge in &self.0 {
            let [first, _, last] = views.map(|view| view.poses[edge.frame as usize].position);
            if !edge.may_be_seen(first, last) {
                continue;
            }
            let Some(edge) = MovingEdge::new(edge, views, middle) else { continue };
            #[allow(clippy::cast_possible_truncation, reason = "float64 is rounded to float32, with room to spare")]
            let [columns, rows] = [0, 1].map(|axis| {
                let [low, high] = [edge.image[0][axis] as f32, edge.image[1][axis] as f32];
                rays.reaching(axis, low.next_down(), high.next_up())
            });
            for tile in rows.flat_map(|row| columns.clone().map(move |column| row * rays.columns + column)) {
                if edge.may_meet(rays.tile(tile)) {
                    #[allow(clippy::cast_possible_truncation, reason = "there are fewer")]
                    tiles.push((tile as u32, moving.len() as u32));
                }
            }
            moving.push(edge);
        }
        tiles.sort_unstable();
        let (mut passes, mut buffer) = (vec![], TileRays::default());
        for edges in tiles.chunk_by(|a, b| a.0 == b.0) {
            let tile = edges[0].0 as usize;
            let ray_blocks = rays.of_tile(tile, &mut buffer);
            for (_, edge) in edges {
                self::of_tile(&moving[*edge as usize], rays, tile, &ray_blocks, &mut passes);
            }
        }
        passes.sort_unstable_by(|a, b| (a.pixel, a.ray).cmp(&(b.pixel, b.ray)).then(a.fraction.total_cmp(&b.fraction)));
        passes
    }
}

/// The rays of a tile that an edge passes.
fn of_tile(edge: &MovingEdge, rays: &PixelRays, tile: usize, ray_blocks: &RayBlocks, all: &mut Vec<Pass>) {
    let lines = edge.normal.map(|n| Linear(single(n)));
    let per_block = ray_blocks.x.len() / ray_blocks.blocks.len();
    for (block, around) in ray_blocks.blocks.iter().enumerate() {
        if !edge.may_meet(around) {
            continue;
        }
        let [far_x, far_y] = [0, 1].map(|axis| around.low[axis].abs().max(around.high[axis].abs()));
        let uncertain = lines
            .map(|Linear([a, b, c])| UNCERTAIN * (a.abs() * far_x + b.abs() * far_y + c.abs()))
            .into_iter()
            .fold(0.0, f32::max);
        for ray in 0..rays.rays {
            let first = block * per_block + ray * LANES;
            let (x, y) = (&ray_blocks.x[first..first + LANES], &ray_blocks.y[first..first + LANES]);
            let mut near = [false; LANES];
            for i in 0..LANES {
                let [a, b, c] = lines.map(|line| line.at(x[i], y[i]));
                near[i] = a.min(b).min(c) <= uncertain && a.max(b).max(c) >= -uncertain;
            }
            for lane in (0..LANES).filter(|lane| near[*lane]) {
                let (column, row) = rays.pixel(tile, block * LANES + lane);
                if column >= rays.width || row >= rays.height {
                    continue;
                }
                #[allow(clippy::cast_possible_truncation, reason = "sides are u16, rays are few")]
                let (pixel, ray) = ((row * rays.width + column) as u32, ray as u32);
                let passes = edge.passes(x[lane], y[lane]);
                all.extend(passes.map(|(fraction, inverse_depth)| Pass { pixel, ray, fraction, inverse_depth }));
            }
        }
    }
}

#[cfg(test)]
#[allow(clippy::cast_precision_loss, clippy::cast_possible_truncation, reason = "small numbers")]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::render::geometry::view::Pose;
    use crate::render::{Renderer, SceneTables};

    const SIDE: usize = 8;
    const STEPS: usize = 50;

    /// Quadrangles one behind the other, each of two triangles in a plane of its own, before a wall.
    fn scene(places: &[[f64; 5]]) -> SceneTables<'static> {
        let mut tables = SceneTables {
            frame_count: 1,
            layouts: vec![[0, 1, 1, 0]],
            texels: vec![vec![1.0; 9]],
            step: 1e-6,
            end: 0.999,
            ..SceneTables::default()
        };
        let wall = [0.0, 0.0, 9.0, 9.0, 0.0];
        for (k, [x, y, width, height, turn]) in places.iter().chain([&wall]).enumerate() {
            let (sine, cosine) = turn.sin_cos();
            let corner = |a: f64, b: f64| {
                [x + a * width * cosine - b * height * sine, y + a * width * sine + b * height * cosine, 2.0 + k as f64]
            };
            let [a, b, c, d] = [corner(-1.0, -1.0), corner(1.0, -1.0), corner(1.0, 1.0), corner(-1.0, 1.0)];
            for corners in [[a, b, c], [a, c, d]] {
                tables.corners.to_mut().push(corners);
                tables.planes.to_mut().push([0.0, 0.0, -1.0, 2.0 + k as f64]);
                tables.u_maps.to_mut().push([0.0; 4]);
                tables.v_maps.to_mut().push([0.0; 4]);
                tables.textures.push(0);
                tables.two_sided.push(true);
                tables.frames.push(0);
            }
        }
        tables
    }

    fn view(along: f64, turn: f64) -> View {
        let (sine, cosine) = turn.sin_cos();
        let rotation = [[cosine, 0.0, sine], [0.0, 1.0, 0.0], [-sine, 0.0, cosine]];
        let pose = Pose { position: [along, 0.3 * along, 0.0], rotation, velocity: [0.0; 3], angular_rate: [0.0; 3] };
        View { poses: vec![pose], factors: vec![] }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]

        /// Wherever a ray goes from one plane to another, an edge passes it then, at the depth of the nearer plane.
        #[test]
        fn what_rays_see_changes_where_edges_pass(
            places in prop::collection::vec(
                [-0.8f64..0.8, -0.8f64..0.8, 0.02f64..0.5, 0.02f64..0.5, -3.0f64..3.0], 1..5
            ),
            speed in -0.04f64..0.04, turn in -0.02f64..0.02, middle in 0.4f64..0.6,
        ) {
            let rays = {
                let place = |i: usize| (i as f32 + 0.37) / SIDE as f32 - 0.5;
                let table: Vec<f32> = (0..SIDE * SIDE).flat_map(|i| [place(i % SIDE), place(i / SIDE)]).collect();
                PixelRays::new(SIDE, SIDE, 1, &table).unwrap()
            };
            let renderer = Renderer::new(Scene::new(&scene(&places)).unwrap(), Some(1)).unwrap();
            let at = |fraction: f64| renderer.centred(&[view(speed * fraction, turn * fraction)]).unwrap().remove(0);
            let passes = Edges::of_scene(renderer.scene()).passes(&rays, [&at(0.0), &at(middle), &at(1.0)], middle);
            prop_assert!(passes.is_sorted_by(|a, b| (a.pixel, a.ray) <= (b.pixel, b.ray)));
            let all: Vec<u32> = (0..(SIDE * SIDE) as u32).collect();
            let seen: Vec<Vec<f32>> = (0..=STEPS).map(|step| {
                let mut ray_samples = vec![];
                let order = renderer.ray_samples(&rays, &at(step as f64 / STEPS as f64), &all, &mut ray_samples);
                let mut depths = vec![0.0; all.len()];
                for (pixel, ray_sample) in order.zip(&ray_samples) {
                    depths[pixel] = 1.0 / ray_sample.inverse_depth;
                }
                depths
            }).collect();
            for step in 0..STEPS {
                for pixel in 0..all.len() {
                    let [before, after] = [seen[step][pixel], seen[step + 1][pixel]];
                    // Planes lie a metre apart, and the camera turns little.
                    if (before - after).abs() > 0.5 {
                        let near = passes.iter().filter(|pass| {
                            pass.pixel as usize == pixel
                                && (pass.fraction * STEPS as f64 - step as f64 - 0.5).abs() < 0.51
                                && (1.0 / pass.inverse_depth - f64::from(before.min(after))).abs() < 0.1
                        });
                        prop_assert!(near.count() > 0, "pixel {pixel}, step {step}: {before} to {after}");
                    }
                }
            }
        }
    }

    proptest! {
        /// However strongly an edge's image bends in the time that is looked at, its whole way lies in the part of the
        /// image in which rays are looked for.
        #[test]
        fn the_image_holds_the_whole_way(
            ends in prop::array::uniform2(prop::array::uniform2(-1.0f64..1.0)),
            places in prop::array::uniform3([-0.5f64..0.5, -0.5f64..0.5, -0.2f64..0.2]),
            middle in 0.4f64..0.6,
        ) {
            let edge = Edge { frame: 0, ends: ends.map(|[x, y]| [x, y, 2.0]), wings: None };
            let mut views = [view(0.0, 0.0), view(0.0, 0.0), view(0.0, 0.0)];
            for (view, place) in views.iter_mut().zip(places) {
                view.poses[0].position = place;
            }
            let moving = MovingEdge::new(&edge, views.each_ref(), middle).unwrap();
            for end in &moving.ends {
                for step in 0..=STEPS {
                    let [x, y, z] = at(end, step as f64 / STEPS as f64);
                    for (i, place) in [x / z, y / z].into_iter().enumerate() {
                        prop_assert!(moving.image[0][i] <= place && place <= moving.image[1][i]);
                    }
                }
            }
        }
    }

    #[test]
    fn an_edge_that_reaches_behind_the_camera_is_looked_for_everywhere() {
        let moving_edge = |ends| {
            let views = [view(0.0, 0.0), view(0.01, 0.0), view(0.02, 0.0)];
            MovingEdge::new(&Edge { frame: 0, ends, wings: None }, views.each_ref(), 0.5)
        };
        let moving = moving_edge([[0.1, -1.0, 2.0], [0.1, 1.0, -0.5]]).unwrap();
        assert_eq!(moving.image, [[f64::NEG_INFINITY; 2], [f64::INFINITY; 2]]);
        assert!(moving_edge([[0.1, -1.0, -2.0], [0.1, 1.0, -0.5]]).is_none());
    }

    #[test]
    fn edges_within_a_plane_do_not_count() {
        let renderer = Renderer::new(Scene::new(&scene(&[])).unwrap(), Some(1)).unwrap();
        let edges = Edges::of_scene(renderer.scene());
        assert_eq!(edges.0.len(), 5);
        let seen = |edge: &&Edge| edge.may_be_seen([0.0; 3], [0.1, 0.0, 0.0]);
        assert_eq!(edges.0.iter().filter(seen).count(), 4); // the diagonal is not
    }

    #[test]
    fn roots_are_those_of_the_curve() {
        let roots_of = |values| roots(values).collect::<Vec<_>>();
        assert_eq!(roots_of([-1.0, 0.0, 1.0]), [0.5]); // a line
        assert!(roots_of([1.0, 1.0, 1.0]).is_empty());
        assert!(roots_of([0.0, 0.5, 1.0]).is_empty()); // at the very beginning: that belongs to the span before
        assert_eq!(roots_of([-1.0, -0.5, 0.0]), [1.0]);
        let mut both = roots_of([3.0, -5.0, 3.0]); // 16 s^2 - 16 s + 3
        both.sort_by(f64::total_cmp);
        assert_eq!(both, [0.25, 0.75]);
    }
}
