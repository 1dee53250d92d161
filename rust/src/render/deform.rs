//! Deforms the mesh of a body: gives its triangles new corners, and its BVH the boxes around them.
//!
//! The tree keeps its shape, because to build another one takes longer than to render a frame. It decides which
//! triangles are looked at, not which of them are seen. Light that was baked stays on the triangles.
//!
//! What must not break: a scene depends on the corners that it was given last, not on those before.

use super::geometry::vector::{Bounds, Vector, sub};
use super::renderer::Renderer;
use super::scene::{Scene, about, has_area, is_smooth};
use crate::error::{Error, Result};

/// What a body's triangles are after a deformation, in the order of their numbers, as in
/// [`SceneTables`](super::SceneTables).
#[derive(Clone, Copy, Debug)]
pub struct Deformed<'a> {
    /// Corners in the body's frame, metres.
    pub corners: &'a [[[f64; 3]; 3]],
    /// Planes.
    pub planes: &'a [[f64; 4]],
    /// Maps to the texture coordinate u.
    pub u_maps: &'a [[f64; 4]],
    /// Maps to the texture coordinate v.
    pub v_maps: &'a [[f64; 4]],
    /// Maps to the shading normal; empty where every triangle is flat.
    pub normal_maps: &'a [[[f64; 4]; 3]],
}

impl Renderer {
    /// Deforms a body: what is rendered after this shows its triangles `first`, `first` + 1, ... as they are in `new`.
    ///
    /// # Errors
    ///
    /// [`Error::Argument`] for what is no body, other triangles than it has, or one without an area; then nothing
    /// changes.
    pub fn deform(&mut self, frame: usize, first: u32, new: &Deformed) -> Result<()> {
        self.scene.deform(frame, first, new)
    }
}

impl Scene {
    fn deform(&mut self, frame: usize, first: u32, new: &Deformed) -> Result<()> {
        self.check_deformed(frame, first, new)?;
        let body = &mut self.frames[frame];
        let (range, centre) = (body.triangles.clone(), body.centre);
        let moved = |map: [f64; 4]| about(centre, map);
        for (surface, corners) in self.surfaces[range.clone()].iter_mut().zip(&mut self.corners[range.clone()]) {
            let at = (surface.number - first) as usize;
            *corners = new.corners[at].map(|corner: Vector| sub(corner, centre));
            surface.plane = moved(new.planes[at]);
            if let Some(uv) = &mut surface.uv {
                **uv = [moved(new.u_maps[at]), moved(new.v_maps[at])];
            }
            let normal = new.normal_maps.get(at).map(|maps| maps.map(moved));
            match (&mut surface.normal, normal.filter(|maps| is_smooth(maps, &surface.plane))) {
                (Some(own), Some(maps)) => **own = maps,
                (own, maps) => *own = maps.map(Box::new),
            }
            for side in surface.light_maps.iter_mut().flat_map(|sides| sides.iter_mut()) {
                side.put_on(corners);
            }
        }
        let bounds: Vec<Bounds> = self.corners[range].iter().map(|corners| Bounds::of(corners)).collect();
        body.bvh.refit(&bounds);
        Ok(())
    }

    fn check_deformed(&self, frame: usize, first: u32, new: &Deformed) -> Result<()> {
        let refuse = |message: String| Err(Error::Argument(message));
        if frame == 0 || frame >= self.frames.len() {
            return refuse(format!("a body that deforms is one of 1..{}, got {frame}", self.frames.len()));
        }
        let n = new.corners.len();
        let smooth = if new.normal_maps.is_empty() { n } else { new.normal_maps.len() };
        if [new.planes.len(), new.u_maps.len(), new.v_maps.len(), smooth] != [n; 4] {
            return refuse(format!("{n} deformed triangles need as many planes and maps"));
        }
        let surfaces = &self.surfaces[self.frames[frame].triangles.clone()];
        if surfaces.len() != n || surfaces.iter().any(|surface| surface.number.wrapping_sub(first) as usize >= n) {
            return refuse(format!(
                "body {frame} has {} triangles that can be seen, got {n} from number {first}",
                surfaces.len()
            ));
        }
        if let Some(flat) = new.corners.iter().position(|corners| !has_area(corners)) {
            return refuse(format!("deformed triangle {flat} has no area: its corners are {:?}", new.corners[flat]));
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::geometry::vector::{cross, dot, scale};
    use super::super::{Channel, Emission, Light, LightKind, LightMapTables, PixelRays, Pose, SceneTables, View};
    use super::*;

    /// A sheet of triangles before a wall; the sheet is a body.
    struct Sheet {
        tables: SceneTables<'static>,
        first: u32,
    }

    const SIDE: usize = 12;

    fn plane(corners: &[[f64; 3]; 3]) -> [f64; 4] {
        let [a, b, c] = *corners;
        let normal = cross(sub(b, a), sub(c, a));
        let normal = scale(normal, 1.0 / dot(normal, normal).sqrt());
        [normal[0], normal[1], normal[2], -dot(normal, a)]
    }

    #[allow(clippy::cast_precision_loss, reason = "small numbers")]
    fn sheet(bend: f64) -> Sheet {
        let point = |i: usize, j: usize| {
            let (x, y) = (i as f64 / SIDE as f64 - 0.5, j as f64 / SIDE as f64 - 0.5);
            [x + 0.1 * bend * y, y, 1.0 + bend * (4.0 * x).sin() * (3.0 * y).cos()]
        };
        let mut corners = vec![[[-9.0, -9.0, 3.0], [9.0, -9.0, 3.0], [0.0, 18.0, 3.0]]];
        for (i, j) in (0..SIDE).flat_map(|i| (0..SIDE).map(move |j| (i, j))) {
            corners.push([point(i, j), point(i + 1, j), point(i, j + 1)]);
            corners.push([point(i + 1, j), point(i + 1, j + 1), point(i, j + 1)]);
        }
        let planes: Vec<[f64; 4]> = corners.iter().map(plane).collect();
        let n = corners.len();
        // Smooth where it is bent: a normal that changes over each triangle.
        let own = |i: usize| if i == 0 { 0.0 } else { bend };
        let map = |i: usize, n: f64| [0.2 * own(i), 0.0, 0.1 * own(i), n];
        let normal_maps = planes.iter().enumerate().map(|(i, p)| [0, 1, 2].map(|k| map(i, p[k]))).collect();
        let light = |kind| Light { kind, group: 0, strength: 2.0, background: 0.0, beam: None, slide: None };
        let tables = SceneTables {
            corners: corners.into(),
            planes: planes.into(),
            u_maps: (0..n).map(|i| [1.0 + own(i), 0.0, 0.0, 0.2]).collect(),
            v_maps: (0..n).map(|i| [0.0, 1.0 - own(i), 0.0, 0.4]).collect(),
            normal_maps: Vec::into(normal_maps),
            textures: vec![0; n],
            two_sided: vec![true; n],
            frames: (0..n).map(|i| u32::from(i > 0)).collect(),
            frame_count: 2,
            layouts: vec![[0, 3, 2, 0]],
            texels: vec![(0..20u8).map(|i| f32::from(i % 7) / 7.0).collect()],
            lights: vec![light(LightKind::Point([1.0, -2.0, -1.0])), light(LightKind::Directional([0.0, 0.6, 0.8]))],
            shadows: true,
            step: 1000.0 / f64::from(1 << 24),
            end: 0.999,
            ..SceneTables::default()
        };
        Sheet { tables, first: 1 }
    }

    fn of(sheet: &Sheet) -> Deformed<'_> {
        let tables = &sheet.tables;
        Deformed {
            corners: &tables.corners[1..],
            planes: &tables.planes[1..],
            u_maps: &tables.u_maps[1..],
            v_maps: &tables.v_maps[1..],
            normal_maps: &tables.normal_maps[1..],
        }
    }

    fn renderer(sheet: &Sheet) -> Renderer {
        Renderer::new(Scene::new(&sheet.tables).unwrap(), Some(1)).unwrap()
    }

    #[allow(clippy::cast_precision_loss, reason = "small numbers")]
    fn seen(renderer: &Renderer) -> (Vec<f32>, Vec<f32>, Vec<u32>) {
        let (width, height) = (40, 30);
        let table: Vec<f32> = (0..width * height)
            .flat_map(|pixel| [(pixel % width) as f32 / 20.0 - 0.98, (pixel / width) as f32 / 20.0 - 0.73])
            .collect();
        let rays = PixelRays::new(width, height, 1, &table).unwrap();
        let rotation = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        let pose = Pose { position: [0.0, 0.0, -0.2], rotation, velocity: [0.0; 3], angular_rate: [0.0; 3] };
        let views = [View { poses: vec![pose; 2], factors: vec![[1.0, 0.0]; 2] }];
        let size = width * height;
        let (mut luma, mut depth, mut triangles) = (vec![0f32; size], vec![0f32; size], vec![0; size]);
        renderer.luma(&rays, &views, &mut luma, None).unwrap();
        renderer.depth(&rays, &views, &mut depth, &mut triangles).unwrap();
        (luma, depth, triangles)
    }

    /// A scene that was deformed shows what one that was made so shows, with its shadows, and the bits of it are those
    /// of its last corners alone. The sheet bends out of the boxes that it had.
    #[test]
    fn a_deformed_sheet_is_one_that_was_made_so() {
        let (flat, bent, other) = (sheet(0.0), sheet(0.6), sheet(-0.4));
        let mut renderer_of = renderer(&flat);
        let at_first = seen(&renderer_of);
        renderer_of.deform(1, bent.first, &of(&bent)).unwrap();
        let deformed = seen(&renderer_of);
        let made = seen(&renderer(&bent));
        // Coordinates are rounded relative to another centre: a ray on an edge may see the neighbour.
        let close = |a: &[f32], b: &[f32]| {
            let far = a.iter().zip(b).filter(|(a, b)| (*a - *b).abs() > 1e-4 * b.abs().max(1.0)).count();
            far * 200 <= a.len()
        };
        assert!(close(&deformed.0, &made.0) && close(&deformed.1, &made.1));
        let same = deformed.2.iter().zip(&made.2).filter(|(a, b)| a == b).count();
        assert!(same * 200 >= 199 * deformed.2.len());
        assert!(!close(&deformed.0, &at_first.0) && !close(&deformed.1, &at_first.1));
        renderer_of.deform(1, other.first, &of(&other)).unwrap();
        let mut straight_there = renderer(&flat);
        straight_there.deform(1, other.first, &of(&other)).unwrap();
        assert_eq!(seen(&renderer_of), seen(&straight_there));
        renderer_of.deform(1, bent.first, &of(&bent)).unwrap();
        assert_eq!(seen(&renderer_of), deformed);
        renderer_of.deform(1, flat.first, &of(&flat)).unwrap();
        assert_eq!(seen(&renderer_of), at_first);
    }

    /// What does not fit is refused, and changes nothing.
    #[test]
    fn what_does_not_fit_is_refused() {
        let (flat, bent) = (sheet(0.0), sheet(0.6));
        let mut renderer = renderer(&flat);
        let before = seen(&renderer);
        let good = of(&bent);
        let mut corners = good.corners.to_vec();
        corners[3][1] = corners[3][0];
        let mut infinite = good.corners.to_vec();
        infinite[5][0][1] = f64::INFINITY;
        for (frame, first, new) in [
            (0, 1, good),
            (2, 1, good),
            (1, 0, good),
            (1, 2, good),
            (1, 1, Deformed { planes: &good.planes[1..], ..good }),
            (1, 1, Deformed { normal_maps: &good.normal_maps[1..], ..good }),
            (1, 1, Deformed { corners: &good.corners[1..], ..good }),
            (1, 1, Deformed { corners: &corners, ..good }),
            (1, 1, Deformed { corners: &infinite, ..good }),
        ] {
            assert!(matches!(renderer.deform(frame, first, &new), Err(Error::Argument(_))));
            assert_eq!(seen(&renderer), before);
        }
        renderer.deform(1, 1, &good).unwrap();
        assert_ne!(seen(&renderer), before);
    }

    /// Gives a sheet baked light: each triangle has its own at each corner, and nothing else lights it.
    #[allow(clippy::cast_possible_wrap, clippy::cast_precision_loss, reason = "small numbers")]
    fn baked(sheet: Sheet) -> Sheet {
        const SIDE: usize = 3;
        let n = sheet.tables.corners.len();
        let around = SIDE + 2;
        let layout = |at: usize| [(at / 2 * around * around) as i64, SIDE as i64, SIDE as i64, 1];
        let texel = |i: usize| 1.0 + ((i * 7919) % 13) as f32;
        let texels: Vec<f32> = (0..n * around * around).map(texel).collect();
        let (mut u_maps, mut v_maps) = (vec![], vec![]);
        for [a, b, c] in sheet.tables.corners.iter() {
            let (u, v) = (sub(*b, *a), sub(*c, *a));
            let normal = cross(u, v);
            let by = (SIDE - 1) as f64 / SIDE as f64 / dot(normal, normal);
            for _ in 0..2 {
                for (maps, along) in [(&mut u_maps, cross(v, normal)), (&mut v_maps, cross(normal, u))] {
                    let along = scale(along, by);
                    maps.push([along[0], along[1], along[2], 0.5 / SIDE as f64 - dot(along, *a)]);
                }
            }
        }
        let light_maps = LightMapTables {
            u_maps: u_maps.into(),
            v_maps: v_maps.into(),
            layouts: (0..2 * n).map(layout).collect::<Vec<_>>().into(),
            texels: vec![Channel::new(texels.leak(), 1, 0).unwrap()],
            ..LightMapTables::default()
        };
        let light = Light { kind: LightKind::Baked(0), ..sheet.tables.lights[0] };
        let emissions = (0..n).map(|i| (i % 5 == 1).then_some(Emission { light: 0, luma: 3.0 })).collect();
        let tables = SceneTables { lights: vec![light, light], light_maps, emissions, ..sheet.tables };
        Sheet { tables, ..sheet }
    }

    /// Light that was baked, and what triangles emit, stays on them while they are deformed.
    #[test]
    fn baked_light_stays_on_the_triangles() {
        let (flat, bent) = (baked(sheet(0.0)), baked(sheet(0.6)));
        let mut renderer_of = renderer(&flat);
        let at_first = seen(&renderer_of);
        renderer_of.deform(1, bent.first, &of(&bent)).unwrap();
        let (deformed, made) = (seen(&renderer_of), seen(&renderer(&bent)));
        let differ = |a: &[f32], b: &[f32]| a.iter().zip(b).filter(|(a, b)| (*a - *b).abs() > 1e-3 * b.abs()).count();
        assert!(differ(&deformed.0, &made.0) * 100 <= made.0.len());
        assert!(differ(&at_first.0, &made.0) * 4 >= made.0.len());
    }
}
