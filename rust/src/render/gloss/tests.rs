//! Oracles of glossy surfaces: a mirror shows what a mirrored camera sees, a thin sheet what lies behind it, and rates
//! are differences in time.

use std::sync::Arc;

use super::coat::Coat;
use super::emissive::{DARK, EmissiveTextures};
use super::finish::{Finish, Fresnel, Under};
use super::microfacets::Distribution;
use super::sheen::Sheen;
use super::tables::{DIFFUSE, GlossTables};
use crate::render::geometry::vector::{self, Vector, cross, dot, sub};
use crate::render::light::colours::ColourImage;
use crate::render::visibility::first_hit::{FirstHits, Ray, is_blocked};
use crate::render::{Emission, Light, LightKind, PixelRays, Pose, Renderer, Scene, SceneTables, View};

const SIZE: usize = 16;

/// A mirror of all light.
const MIRROR: Finish = Finish {
    alpha: 0.0,
    across: None,
    distribution: Distribution::Ggx,
    fresnel: Fresnel::Conductor([0.0; 3], [1.0; 3]),
    tint: [1.0; 3],
    passing: [1.0; 3],
    base_tints: false,
    under: Under::Nothing,
    coat: None,
    sheen: None,
    transmission: 0.0,
    flatness: 0.0,
    lobe: [None; 2],
};

fn clear_solid(index: f64) -> Under {
    Under::Solid { index, absorption: [0.0; 3] }
}

fn colours(layout: [i64; 3], texels: &[[f32; 3]]) -> Arc<ColourImage> {
    Arc::new(ColourImage::linear(layout, texels).unwrap())
}

/// Adds a parallelogram of two triangles, whose front is where its sides turn left.
fn add(tables: &mut SceneTables, [corner, u, v]: [[f64; 3]; 3], look: (f64, u32, u32)) {
    let (reflectance, finish, frame) = look;
    let normal = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]];
    let length = normal.iter().map(|x| x * x).sum::<f64>().sqrt();
    let normal = normal.map(|x| x / length);
    let at = |a: f64, b: f64| -> [f64; 3] { std::array::from_fn(|i| corner[i] + a * u[i] + b * v[i]) };
    let first = tables.texels.first().map_or(0, |texels| texels.len());
    // Two texels next to each other, in their frame.
    tables.layouts.push([first as i64, 2, 1, 1]);
    let (low, high) = (0.6 * reflectance, reflectance);
    let row = [low, low, high, high];
    for texels in &mut tables.texels {
        texels.to_mut().extend([row, row, row].iter().flatten().map(|&x| x as f32));
    }
    tables.gloss.texels.of_texture.push(tables.gloss.texels.images.len() as u32);
    tables.gloss.texels.images.push(colours([2, 1, 1], &[[low as f32; 3], [high as f32; 3]]));
    let along: f64 = u.iter().map(|x| x * x).sum();
    for corners in [[at(0.0, 0.0), at(1.0, 0.0), at(1.0, 1.0)], [at(0.0, 0.0), at(1.0, 1.0), at(0.0, 1.0)]] {
        let offset = -(0..3).map(|i| normal[i] * corner[i]).sum::<f64>();
        tables.corners.to_mut().push(corners);
        tables.planes.to_mut().push([normal[0], normal[1], normal[2], offset]);
        let start = (0..3).map(|i| u[i] * corner[i]).sum::<f64>() / along;
        tables.u_maps.to_mut().push([u[0] / along, u[1] / along, u[2] / along, -start]);
        tables.v_maps.to_mut().push([0.0, 0.0, 0.0, 0.5]);
        tables.textures.push(tables.layouts.len() as u32 - 1);
        tables.two_sided.push(true);
        tables.frames.push(frame);
        tables.emissions.push(None);
        tables.gloss.finish_of.push(finish);
        tables.gloss.emitted.push([0.0; 3]);
    }
}

/// Returns a floor, a post that moves (frame 1) and a wall, under a lamp in a place, a sun and light from all sides.
fn room(mirror: Option<Finish>) -> SceneTables<'static> {
    let mut tables = SceneTables {
        frame_count: 2,
        texels: vec![vec![].into()],
        lights: vec![
            light(LightKind::Point([1.0, 2.5, -1.0]), 6.0),
            light(LightKind::Directional([0.36, -0.8, 0.48]), 1.5),
            Light { background: 1.0, ..light(LightKind::Constant, 0.2) },
        ],
        shadows: true,
        step: 1000.0 / f64::from(1 << 24),
        end: 0.001,
        ..SceneTables::default()
    };
    tables.gloss.colours = vec![[1.0; 3]];
    tables.gloss.backgrounds = vec![[0.0; 3], [0.0; 3], [1.0; 3]];
    tables.gloss.longest = 12;
    add(&mut tables, [[-3.0, 0.0, -3.0], [0.0, 0.0, 5.9], [6.0, 0.0, 0.0]], (0.7, DIFFUSE, 0));
    add(&mut tables, [[-0.3, 0.0, 0.2], [0.0, 1.0, 0.0], [0.5, 0.0, 0.3]], (0.5, DIFFUSE, 1));
    add(&mut tables, [[-2.0, 0.0, -2.5], [0.0, 2.0, 0.0], [0.4, 0.0, 2.0]], (0.3, DIFFUSE, 0));
    if let Some(finish) = mirror {
        tables.gloss.finishes = vec![finish];
        add(&mut tables, [[-9.0, -9.0, 3.0], [0.0, 18.0, 0.0], [18.0, 0.0, 0.0]], (1.0, 0, 0));
    }
    tables
}

fn light(kind: LightKind, strength: f64) -> Light {
    Light { kind, group: 0, strength, background: 0.0, beam: None, slide: None }
}

/// Returns a camera, the same in both frames but for the body's own motion.
fn view(position: [f64; 3], rotation: [[f64; 3]; 3], velocity: [f64; 3], turning: [f64; 3]) -> View {
    let world = Pose { position, rotation, velocity, angular_rate: turning };
    let body = Pose { velocity: [velocity[0] - 0.3, velocity[1], velocity[2] + 0.2], ..world };
    View { poses: vec![world, body], factors: vec![[1.0, 0.4], [0.8, 0.0], [1.0, -0.2]] }
}

/// Returns a view a little later, as far as its velocities tell.
fn later(view: &View, dt: f64) -> View {
    let pose = |pose: &Pose| {
        let [x, y, z] = pose.angular_rate.map(|rate| rate * dt);
        let small = [[1.0, -z, y], [z, 1.0, -x], [-y, x, 1.0]];
        let rotation =
            std::array::from_fn(|i| std::array::from_fn(|j| (0..3).map(|k| pose.rotation[i][k] * small[k][j]).sum()));
        Pose { position: std::array::from_fn(|i| pose.position[i] + dt * pose.velocity[i]), rotation, ..*pose }
    };
    View {
        poses: view.poses.iter().map(pose).collect(),
        factors: view.factors.iter().map(|[factor, rate]| [factor + dt * rate, *rate]).collect(),
    }
}

/// Of a camera that looks along z, with y upwards.
const LEVEL: [[f64; 3]; 3] = [[-1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, 1.0]];

fn rays(mirrored: bool, each: usize) -> PixelRays {
    let side = if mirrored { -1.0 } else { 1.0 };
    let table: Vec<f32> = (0..each)
        .flat_map(|ray| (0..SIZE * SIZE).map(move |pixel| (ray, pixel)))
        .flat_map(|(ray, pixel)| {
            let at = |number: usize, shift: usize| {
                (number as f32 + 0.37 + (ray * shift % each) as f32 / each as f32) / SIZE as f32 - 0.5
            };
            [side * at(pixel % SIZE, 1), at(pixel / SIZE, 3)]
        })
        .collect();
    PixelRays::new(SIZE, SIZE, each, &table).unwrap()
}

fn luma(renderer: &Renderer, rays: &PixelRays, view: &View) -> (Vec<f32>, Vec<f32>) {
    let (mut luma, mut rate) = (vec![0.0; SIZE * SIZE], vec![0.0; SIZE * SIZE]);
    renderer.luma(rays, std::slice::from_ref(view), &mut luma, Some(&mut rate)).unwrap();
    let mut without = vec![0.0; SIZE * SIZE];
    renderer.luma(rays, std::slice::from_ref(view), &mut without, None).unwrap();
    assert!(luma.iter().zip(&without).all(|(a, b)| a.to_bits() == b.to_bits()));
    (luma, rate)
}

fn renderer(tables: &SceneTables) -> Renderer {
    Renderer::new(Scene::new(tables).unwrap(), Some(1)).unwrap()
}

/// Counts pixels that are off by more than a share of the brightest.
fn off(one: &[f32], other: &[f32], share: f32) -> usize {
    let most = one.iter().fold(0f32, |most, x| most.max(x.abs()));
    assert!(most > 0.0);
    one.iter().zip(other).filter(|(a, b)| a.is_nan() || b.is_nan() || (**a - **b).abs() > share * most).count()
}

/// A mirror at z = 3 shows what a camera sees that is mirrored at it, and that moves so.
#[test]
fn a_mirror_shows_what_a_mirrored_camera_sees() {
    let here = view([0.4, 0.9, 2.0], LEVEL, [0.2, 0.1, -0.3], [0.05, -0.1, 0.2]);
    // With its image turned from left to right, the axes of the mirrored camera are right-handed.
    let turned = [[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0]];
    let there = view([0.4, 0.9, 4.0], turned, [0.2, 0.1, 0.3], [0.05, 0.1, -0.2]);
    let (shown, rate) = luma(&renderer(&room(Some(MIRROR))), &rays(false, 1), &here);
    let (seen, seen_rate) = luma(&renderer(&room(None)), &rays(true, 1), &there);
    assert!(off(&seen, &shown, 1e-4) <= 3, "{}", off(&seen, &shown, 1e-4));
    assert!(off(&seen_rate, &rate, 1e-3) <= 3, "{}", off(&seen_rate, &rate, 1e-3));
    // It shows shadows, textures and the sky.
    assert!(seen.iter().any(|&x| x > 0.4) && seen.iter().any(|&x| x > 0.0 && x < 0.07), "{seen:?}");
}

/// A mirror shows what a surface emits by a texture, whose luma is that of light from all sides, and what it emits
/// itself.
#[test]
fn a_mirror_shows_what_shines_by_a_texture() {
    let (of_wall, of_mirror) = ([0.2_f32, 0.9], 0.25);
    let shining = |mirror: Option<Finish>| {
        let mut tables = room(mirror);
        // The texels of the wall, between those of the post and the mirror, in their frame.
        let mut emitted = vec![0.0; tables.texels[0].len()];
        for (at, luma) in emitted[24..36].iter_mut().enumerate() {
            *luma = of_wall[at % 4 / 2];
        }
        tables.gloss.emissive = EmissiveTextures {
            of_texture: [DARK, DARK, 1, 0][..tables.layouts.len()].to_vec(),
            layouts: vec![[0, 1, 1, 0], [9, 2, 1, 1]],
            lights: vec![2, 3],
            texels: [&[of_mirror; 9][..], &emitted[24..36]].concat().into_iter().map(|x| [x; 3]).collect(),
        };
        tables.texels.push(emitted.into());
        tables.lights.push(Light { group: 1, ..light(LightKind::Constant, 1.0) });
        tables.gloss.colours.push([0.0; 3]);
        tables.gloss.backgrounds.push([0.0; 3]);
        tables
    };
    let factor = [0.9, 0.3];
    let with_factor = |mut view: View| {
        view.factors.push(factor);
        view
    };
    let here = with_factor(view([0.4, 0.9, 2.0], LEVEL, [0.2, 0.1, -0.3], [0.05, -0.1, 0.2]));
    let turned = [[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0]];
    let there = with_factor(view([0.4, 0.9, 4.0], turned, [0.2, 0.1, 0.3], [0.05, 0.1, -0.2]));
    let (shown, rate) = luma(&renderer(&shining(Some(MIRROR))), &rays(false, 1), &here);
    let (seen, seen_rate) = luma(&renderer(&shining(None)), &rays(true, 1), &there);
    let own = here.factors[2].map(|x| of_mirror * x as f32);
    let more = |luma: &[f32], own: f32| luma.iter().map(|x| x + own).collect::<Vec<_>>();
    assert!(off(&more(&seen, own[0]), &shown, 1e-4) <= 3, "{seen:?} {shown:?}");
    assert!(off(&more(&seen_rate, own[1]), &rate, 1e-3) <= 3, "{seen_rate:?} {rate:?}");
    let of_room = View { factors: there.factors[..3].to_vec(), ..there };
    let (dark, _) = luma(&renderer(&room(None)), &rays(true, 1), &of_room);
    let most = seen.iter().zip(&dark).map(|(a, b)| a - b).fold(0.0, f32::max);
    assert!((most - 0.9 * of_wall[1]).abs() < 1e-3, "{most}");
    // What does not belong together is refused.
    let wrong: [fn(&mut EmissiveTextures); 5] = [
        |emissive| emissive.of_texture[2] = 2,
        |emissive| emissive.lights[0] = 4,
        |emissive| emissive.lights.truncate(1),
        |emissive| emissive.of_texture.truncate(2),
        |emissive| emissive.texels[0][1] = f32::NAN,
    ];
    for change in wrong {
        let mut tables = shining(Some(MIRROR));
        change(&mut tables.gloss.emissive);
        assert!(Scene::new(&tables).is_err());
    }
}

/// A thin sheet lets through what it does not reflect.
#[test]
fn a_sheet_shows_what_lies_behind_it() {
    let sheet = Finish {
        fresnel: Fresnel::Dielectric(1.5),
        tint: [0.0; 3],
        passing: [0.5; 3],
        under: Under::Sheet(1.5),
        ..MIRROR
    };
    let there =
        view([0.4, 0.9, 4.0], [[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0]], [0.1, 0.2, -0.4], [0.0; 3]);
    let tables = SceneTables { shadows: false, ..room(Some(sheet)) };
    let (shown, rate) = luma(&renderer(&tables), &rays(false, 1), &there);
    let (seen, seen_rate) = luma(&renderer(&SceneTables { shadows: false, ..room(None) }), &rays(false, 1), &there);
    for pixel in 0..SIZE * SIZE {
        let at = |number: usize| (number as f64 + 0.37) / SIZE as f64 - 0.5;
        let (x, y) = (at(pixel % SIZE), at(pixel / SIZE));
        let cosine = 1.0 / (x * x + y * y + 1.0).sqrt();
        let sine = (1.0 - cosine * cosine).sqrt() / 1.5;
        let inside = (1.0 - sine * sine).sqrt();
        let across = (cosine - 1.5 * inside) / (cosine + 1.5 * inside);
        let along = (1.5 * cosine - inside) / (1.5 * cosine + inside);
        let once = 0.5 * (across * across + along * along);
        let passed = 0.5 * (1.0 - 2.0 * once / (1.0 + once));
        let expected = [f64::from(seen[pixel]) * passed, f64::from(seen_rate[pixel]) * passed];
        let found = [shown[pixel], rate[pixel]].map(f64::from);
        assert!(
            (0..2).all(|k| (found[k] - expected[k]).abs() < 2e-4 * (1.0 + expected[k].abs())),
            "{found:?} {expected:?}"
        );
    }
}

/// What covers a part of its area shows as much of itself and the rest of what lies behind it, on both sides alike; the
/// back of one side alone shows what lies behind it.
#[test]
fn what_blends_shows_itself_and_what_lies_behind_it() {
    let opacity = 0.3;
    let blend = Finish { under: Under::Blend(opacity), ..MIRROR };
    let by_texture = Finish { under: Under::Blend(0.9), lobe: [Some(0), None], ..MIRROR };
    let turned = [[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0]];
    let there = view([0.4, 0.9, 4.0], turned, [0.1, 0.2, -0.4], [0.0; 3]);
    let open = SceneTables { shadows: false, ..room(None) };
    let (behind, behind_rate) = luma(&renderer(&open), &rays(false, 1), &there);
    for (finish, two_sided) in [(blend.clone(), true), (blend, false), (by_texture, true)] {
        let mut tables = SceneTables { shadows: false, ..room(Some(finish)) };
        tables.gloss.lobe_layouts = vec![[0, 1, 1, 0]];
        tables.gloss.lobes = vec![opacity as f32; 9];
        let wall = tables.corners.len() - 2;
        tables.two_sided[wall..].fill(two_sided);
        let (shown, rate) = luma(&renderer(&tables), &rays(false, 1), &there);
        tables.gloss.finish_of[wall..].fill(DIFFUSE);
        let (own, own_rate) = luma(&renderer(&tables), &rays(false, 1), &there);
        let mixed = |behind: &[f32], own: &[f32]| -> Vec<f32> {
            behind.iter().zip(own).map(|(a, b)| (1.0 - opacity as f32) * a + opacity as f32 * b).collect()
        };
        assert_eq!(own.iter().any(|&x| x > 0.1), two_sided);
        let (expected, expected_rate) = (mixed(&behind, &own), mixed(&behind_rate, &own_rate));
        assert!(off(&expected, &shown, 1e-4) <= 3, "{expected:?} {shown:?}");
        assert!(off(&expected_rate, &rate, 1e-3) <= 3, "{expected_rate:?} {rate:?}");
    }
    // What makes no sense is refused.
    for (opacity, lobe) in [(1.5, [None; 2]), (f64::NAN, [None; 2]), (0.5, [None, Some(0)])] {
        let mut tables = room(Some(Finish { under: Under::Blend(opacity), lobe, ..MIRROR }));
        tables.gloss.lobe_layouts = vec![[0, 1, 1, 0]];
        tables.gloss.lobes = vec![0.5; 9];
        assert!(Scene::new(&tables).is_err());
    }
}

/// Rates of rough, coated and clear surfaces are differences in time, and single pixels have the bits of frames.
#[test]
fn rates_are_differences_in_time() {
    let coated = Under::Coated { index: 1.5, inside: 0.6, entering: 0.9, nonlinear: true, passing: None };
    let tinted = Under::Solid { index: 1.5, absorption: [0.4, 0.1, 0.8] };
    let rough = Finish {
        alpha: 0.2,
        fresnel: Fresnel::Mixed { index: 1.5, metal: 0.3, tint: 0.0 },
        under: Under::Rough(0.45, 0.7),
        ..MIRROR
    };
    let finishes = [
        MIRROR,
        rough.clone(),
        Finish {
            fresnel: Fresnel::Mixed { index: 1.5, metal: 0.3, tint: 0.6 },
            coat: Some(Coat { strength: 1.0, alpha: 0.05 }),
            sheen: Some(Sheen { strength: 0.8, tint: 0.5 }),
            flatness: 0.6,
            ..rough.clone()
        },
        Finish {
            distribution: Distribution::Beckmann,
            fresnel: Fresnel::Dielectric(1.5),
            under: coated,
            ..rough.clone()
        },
        Finish { fresnel: Fresnel::Conductor([0.2, 0.9, 1.1], [3.9, 2.4, 2.1]), base_tints: true, ..rough.clone() },
        Finish { transmission: 0.6, ..rough },
        Finish { fresnel: Fresnel::Dielectric(1.5), under: tinted.clone(), ..MIRROR },
        Finish { alpha: 0.3, fresnel: Fresnel::Dielectric(1.5), under: tinted, ..MIRROR },
    ];
    for finish in finishes {
        let mut tables = room(Some(finish.clone()));
        let texels = (0..64 * 64).map(|i| [1.0 + 0.01 * (i % 64) as f32, 1.0, 0.5 + 0.002 * (i / 64) as f32]).collect();
        tables.gloss.sky = Some((1, 64, texels));
        // A lamp behind the camera.
        add(&mut tables, [[-0.6, 0.5, -0.9], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]], (0.0, DIFFUSE, 0));
        let lamp = tables.corners.len() - 2;
        for triangle in lamp..lamp + 2 {
            tables.emissions[triangle] = Some(Emission { light: 0, luma: 3.0 });
            tables.gloss.emitted[triangle] = [3.0; 3];
        }
        let (renderer, rays) = (renderer(&tables), rays(false, 3));
        let here = view([0.4, 0.9, 1.6], LEVEL, [0.2, 0.1, -0.3], [0.05, -0.1, 0.2]);
        let dt = 1e-3;
        let (shown, rate) = luma(&renderer, &rays, &here);
        let [before, after] = [-dt, dt].map(|dt| luma(&renderer, &rays, &later(&here, dt)).0);
        let difference: Vec<f32> =
            before.iter().zip(&after).map(|(a, b)| (f64::from(b - a) / (2.0 * dt)) as f32).collect();
        // Where edges and shadows pass in between, differences are none of surfaces.
        let wrong = off(&difference, &rate, 0.02);
        assert!(wrong < SIZE * SIZE / 4, "{finish:?}: {wrong}");
        let pixels: Vec<(u32, u32)> = (0..(SIZE * SIZE) as u32).step_by(5).map(|pixel| (0, pixel)).collect();
        let mut samples = vec![0.0; pixels.len()];
        renderer.samples(&rays, std::slice::from_ref(&here), &pixels, &mut samples).unwrap();
        let same = |(&(_, pixel), sample): (&(u32, u32), &f32)| sample.to_bits() == shown[pixel as usize].to_bits();
        assert!(pixels.iter().zip(&samples).all(same));
    }
}

/// Returns a box in front of the camera, of the first of some finishes, under light from all sides alone, and the other
/// surfaces far away.
fn boxed(finishes: Vec<Finish>) -> SceneTables<'static> {
    let mut tables = room(None);
    tables.gloss.finishes = finishes;
    tables.gloss.longest = 100;
    tables.frames = tables.frames.iter().map(|_| 1).collect();
    for lights in &mut tables.lights[..2] {
        lights.strength = 0.0;
    }
    tables.lights[2].strength = 1.0;
    for sides in BOX {
        add(&mut tables, sides, (1.0, 0, 0));
    }
    tables
}

/// Returns a view of it. No ray meets two of its sides at once.
fn of_the_box(position: Vector) -> View {
    let mut here = view(position, LEVEL, [0.0; 3], [0.0; 3]);
    here.poses[1].position = [0.0, 1e4, 1e6];
    here.factors = vec![[1.0, 0.0]; 3];
    here
}

/// Returns what a ray of the middle sees there.
fn in_the_middle(tables: &SceneTables, position: Vector) -> f64 {
    let (shown, _) = luma(&renderer(tables), &rays(false, 1), &of_the_box(position));
    f64::from(shown[SIZE * SIZE / 2 + SIZE / 2])
}

/// Within light from all sides, a box of glass is not seen, and what neither absorbs nor shades has the light's luma.
#[test]
fn nothing_is_lost_in_a_furnace() {
    for (under, alpha) in [(clear_solid(1.5), 0.0), (Under::Sheet(1.3), 0.0), (clear_solid(1.5), 0.3)] {
        let glass = Finish { alpha, fresnel: Fresnel::Dielectric(1.5), under: under.clone(), ..MIRROR };
        let tables = boxed(vec![glass]);
        let mut here = of_the_box([0.013, 0.007, -0.5]);
        let (shown, rate) = luma(&renderer(&tables), &rays(false, 1), &here);
        if alpha > 0.0 {
            // Microfacets lose some, and nothing comes on top.
            assert!(shown.iter().all(|x| (0.4..1.02).contains(x)), "{under:?} {shown:?}");
            continue;
        }
        assert!(shown.iter().all(|x| (x - 1.0).abs() < 0.02), "{under:?} {shown:?}");
        assert!(rate.iter().all(|x| x.abs() < 1e-6));
        if under == clear_solid(1.5) {
            // Within the glass light is as many times denser as the square of its index.
            here.poses[0].position = [0.013, 0.007, 1.5];
            let (inside, _) = luma(&renderer(&tables), &rays(false, 1), &here);
            assert!(inside.iter().all(|x| (x - 2.25).abs() < 0.03), "{inside:?}");
        }
    }
}

/// Through a box of glass that bends nothing light is left as Beer's law says, also from within it, and next to a box of clear
/// glass inside it, which is in what is around it.
#[test]
fn solids_absorb_by_the_way_through_them() {
    // A mix of channels: one passes whole, one is dark.
    let absorption = [0.3, 0.0, 9.0];
    let beer = |way: f64| 0.299 * f64::exp(-0.3 * way) + 0.587 + 0.114 * f64::exp(-9.0 * way);
    let shown = |inner: Option<Under>, alpha: f64, at: Vector| {
        let unbent = Finish { alpha, fresnel: Fresnel::Dielectric(1.0 + 1e-9), ..MIRROR };
        let outer = Finish { under: Under::Solid { index: 1.0 + 1e-9, absorption }, ..unbent.clone() };
        let inner = inner.map(|under| Finish { under, ..unbent });
        let mut tables = boxed([Some(outer), inner].into_iter().flatten().collect());
        if tables.gloss.finishes.len() == 2 {
            for [corner, u, v] in BOX {
                let centred = |x: Vector| vector::scale(x, 0.5);
                let corner = vector::add(centred(corner), [0.0, 0.0, 0.75]);
                add(&mut tables, [corner, centred(u), centred(v)], (1.0, 1, 0));
            }
        }
        in_the_middle(&tables, at)
    };
    let (before, within) = ([0.013, 0.007, -0.5], [0.013, 0.007, 1.5]);
    let solid = |absorption| Some(Under::Solid { index: 1.0 + 1e-9, absorption });
    let close = |shown: f64, expected: f64| (shown / expected - 1.0).abs() < 1e-3;
    assert!(close(shown(None, 0.0, before), beer(1.0)));
    assert!(close(shown(None, 0.3, before), beer(1.0)));
    assert!(close(shown(solid([0.0; 3]), 0.0, before), beer(1.0)));
    // A box that absorbs has its own inside, and nothing is behind it.
    let dense = 0.299 * f64::exp(-0.3 * 0.25 - 0.5) + 0.587 * f64::exp(-1.0) + 0.114 * f64::exp(-9.0 * 0.25);
    assert!(close(shown(solid([1.0, 2.0, 0.0]), 0.0, before), dense));
    // The camera itself is in nothing that absorbs.
    assert!(close(shown(None, 0.0, within), 1.0));
}

/// So are surfaces within it, which a lamp lights or which shine themselves, by the way of that light, too.
#[test]
fn solids_absorb_the_light_of_lamps_inside() {
    let shown = |absorption: f64, alpha: f64, shines: bool| {
        let index = if shines { 1.5 } else { 1.0 + 1e-9 };
        let under = Under::Solid { index, absorption: [absorption; 3] };
        let mut tables = boxed(vec![Finish { alpha, fresnel: Fresnel::Dielectric(index), under, ..MIRROR }]);
        tables.lights[0] = light(LightKind::Point([0.2, 0.1, 1.2]), if shines { 0.0 } else { 1.0 });
        tables.lights[2] = light(LightKind::Constant, 0.0);
        add(&mut tables, [[-0.4, -0.4, 1.6], [0.0, 0.8, 0.0], [0.8, 0.0, 0.0]], (0.5, DIFFUSE, 0));
        let plate = tables.corners.len() - 2;
        for triangle in plate..if shines { plate + 2 } else { plate } {
            tables.emissions[triangle] = Some(Emission { light: 0, luma: 3.0 });
            tables.gloss.emitted[triangle] = [3.0; 3];
        }
        in_the_middle(&tables, [0.013, 0.007, -0.5])
    };
    // A ray of the middle meets the plate 0.6 behind the front of the box, and the lamp's way to there is known.
    let at = 0.37 / 16.0;
    let lamp = vector::sub([0.2, 0.1, 1.2], [0.013 - 2.1 * at, 0.007 - 2.1 * at, 1.6]);
    let way = 0.6 * f64::sqrt(1.0 + 2.0 * at * at) + dot(lamp, lamp).sqrt();
    let left = shown(1.3, 0.0, false) / shown(0.0, 0.0, false);
    assert!((left / f64::exp(-1.3 * way) - 1.0).abs() < 1e-4, "{left} {way}");
    // Through a rough surface light comes along the lobe's rays and from points of the lamp, on ways of 0.6 to 0.9.
    for alpha in [0.1, 0.3] {
        let left = shown(5.0, alpha, true) / shown(0.0, alpha, true);
        assert!((f64::exp(-5.0 * 0.9)..f64::exp(-5.0 * 0.6)).contains(&left), "{alpha}: {left}");
    }
}

/// What is around a solid is not absorbed: neither on the way behind it, nor on that of what its front mirrors.
#[test]
fn nothing_is_absorbed_outside_of_solids() {
    let shown = |absorption: f64, index: f64, plate: [[f64; 3]; 3]| {
        let under = Under::Solid { index, absorption: [absorption; 3] };
        let mut tables = boxed(vec![Finish { fresnel: Fresnel::Dielectric(index), under, ..MIRROR }]);
        tables.lights[2] = light(LightKind::Constant, 1.0);
        add(&mut tables, plate, (0.5, DIFFUSE, 0));
        in_the_middle(&tables, [0.013, 0.007, -0.5])
    };
    let behind = [[-3.0, -3.0, 5.0], [0.0, 6.0, 0.0], [6.0, 0.0, 0.0]];
    let left = shown(1.3, 1.0 + 1e-9, behind) / shown(0.0, 1.0 + 1e-9, behind);
    assert!((left / f64::exp(-1.3) - 1.0).abs() < 1e-3, "{left}");
    // Its inside is dark; the plate has 0.3 to 0.5 of the light, of which the front mirrors 4 %.
    let before = [[-3.0, -3.0, -2.0], [6.0, 0.0, 0.0], [0.0, 6.0, 0.0]];
    let mirrored = shown(30.0, 1.5, before);
    assert!((0.012..0.02).contains(&mirrored), "{mirrored}");
}

/// The sides of a box, which look outwards.
const BOX: [[[f64; 3]; 3]; 6] = [
    [[-0.5, -0.5, 1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]],
    [[-0.5, -0.5, 2.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]],
    [[-0.5, -0.5, 1.0], [0.0, 0.0, 1.0], [0.0, 1.0, 0.0]],
    [[0.5, -0.5, 1.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
    [[-0.5, -0.5, 1.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]],
    [[-0.5, 0.5, 1.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]],
];

/// Lamps all around are as bright as a background of the same light: neither way to them counts twice.
#[test]
fn lamps_all_around_are_a_background() {
    for alpha in [0.1, 0.4, 0.8] {
        let finish = Finish { alpha, ..MIRROR };
        let mut tables = room(None);
        tables.gloss.finishes = vec![finish];
        tables.frames = tables.frames.iter().map(|_| 1).collect();
        tables.shadows = false;
        for light in &mut tables.lights[..2] {
            light.strength = 0.0;
        }
        tables.lights[2].strength = 1.0;
        add(&mut tables, [[-0.2, -0.2, 1.8], [0.0, 0.4, 0.1], [0.4, 0.0, 0.0]], (1.0, 0, 0));
        let mut here = view([0.1, 0.05, 1.3], LEVEL, [0.0; 3], [0.0; 3]);
        here.poses[1].position = [0.0, 1e4, 1e6];
        here.factors = vec![[1.0, 0.0]; 3];
        let even = luma(&renderer(&tables), &rays(false, 16), &here).0;
        tables.lights[2].strength = 0.0;
        for [corner, u, v] in BOX {
            add(&mut tables, [corner, v, u], (0.0, DIFFUSE, 0));
            for triangle in tables.corners.len() - 2..tables.corners.len() {
                tables.emissions[triangle] = Some(Emission { light: 0, luma: 1.0 });
                tables.gloss.emitted[triangle] = [1.0; 3];
            }
        }
        let lamps = luma(&renderer(&tables), &rays(false, 16), &here).0;
        let mean = |luma: &[f32]| luma.iter().sum::<f32>() / luma.len() as f32;
        assert!((mean(&lamps) / mean(&even) - 1.0).abs() < 0.02, "{alpha}: {} {}", mean(&lamps), mean(&even));
        // From behind they are dark.
        for plane in tables.planes.to_mut().iter_mut().rev().take(2 * BOX.len()) {
            *plane = plane.map(|x| -x);
        }
        let behind = luma(&renderer(&tables), &rays(false, 16), &here).0;
        assert!(behind.iter().all(|&x| x == 0.0), "{behind:?}");
    }
}

/// Few directions a ray see a lamp as many do: neither a sharp lobe nor a small lamp is missed.
#[test]
fn a_lamp_is_as_bright_by_few_rays_as_by_many() {
    for (alpha, side, tolerated) in [(0.05, 2.0, 0.06), (0.3, 0.1, 0.03), (0.3, 2.0, 0.05), (0.7, 1.0, 0.05)] {
        let finish = Finish { alpha, ..MIRROR };
        let mut tables = room(Some(finish));
        for light in &mut tables.lights {
            light.strength = 0.0;
        }
        tables.shadows = false;
        add(&mut tables, [[-0.4, 1.2, 0.0], [side, 0.0, 0.0], [0.0, side, 0.0]], (0.0, DIFFUSE, 0));
        let lamp = tables.corners.len() - 2;
        for triangle in lamp..lamp + 2 {
            tables.emissions[triangle] = Some(Emission { light: 0, luma: 2.0 });
            tables.gloss.emitted[triangle] = [2.0; 3];
        }
        let renderer = renderer(&tables);
        let here = view([0.4, 0.9, 2.2], LEVEL, [0.0; 3], [0.0; 3]);
        let here = View { factors: vec![[1.0, 0.0]; 3], ..here };
        let mean = |each: usize| -> f64 {
            luma(&renderer, &rays(false, each), &here).0.iter().map(|&x| f64::from(x)).sum::<f64>()
                / (SIZE * SIZE) as f64
        };
        let (few, many) = (mean(4), mean(32));
        assert!(many > 0.0 && (few / many - 1.0).abs() < tolerated, "{alpha} {side}: {few} {many}");
    }
}

/// A small lamp is mirrored as one highlight, and not as a few dots, also next to a ball that is three hundred times as
/// strong: each pixel is as bright by few directions as by many. Rates are differences in time, but for points that jump.
#[test]
fn a_strong_lamp_elsewhere_takes_no_points_from_a_small_one() {
    let mut tables = room(Some(Finish { alpha: 0.15, ..MIRROR }));
    for light in &mut tables.lights {
        light.strength = 0.0;
    }
    tables.shadows = false;
    let shining = |tables: &mut SceneTables, sides, luma: f64| {
        add(tables, sides, (0.0, DIFFUSE, 0));
        for triangle in tables.corners.len() - 2..tables.corners.len() {
            tables.emissions[triangle] = Some(Emission { light: 1, luma });
            tables.gloss.emitted[triangle] = [luma; 3];
        }
    };
    shining(&mut tables, [[0.3, 0.8, 0.0], [0.1, 0.0, 0.0], [0.0, 0.1, 0.0]], 20.0);
    for [corner, u, v] in BOX {
        shining(&mut tables, [crate::render::geometry::vector::add(corner, [7.0, 0.0, -1.0]), u, v], 10.0);
    }
    let renderer = renderer(&tables);
    let here = view([0.35, 0.85, 1.0], LEVEL, [0.3, -0.2, 0.1], [0.0; 3]);
    let luma = |each: usize, view: &View| luma(&renderer, &rays(false, each), view);
    let ((few, rates), (many, _)) = (luma(16, &here), luma(256, &here));
    let brightest = many.iter().copied().fold(0.0, f32::max);
    let off = few.iter().zip(&many).map(|(few, many)| (few - many).abs() / brightest).fold(0.0, f32::max);
    assert!(brightest > 0.05 && off < 0.06, "{brightest} {off}");
    let dt = 1e-3;
    let (before, after) = (luma(16, &later(&here, -dt)).0, luma(16, &later(&here, dt)).0);
    let measured = |i: usize| f64::from(after[i] - before[i]) / (2.0 * dt);
    let mut apart: Vec<f64> = (0..few.len()).map(|i| (f64::from(rates[i]) - measured(i)).abs()).collect();
    apart.sort_by(f64::total_cmp);
    let fastest = rates.iter().map(|rate| rate.abs()).fold(0.0, f32::max);
    assert!(apart[few.len() / 2] < 0.02 * f64::from(fastest), "{} {fastest}", apart[few.len() / 2]);
}

/// Two lamps apart give what each gives alone: below a smooth coat, which sees them by what enters it, and on rough metal.
/// Paths of one segment see none.
#[test]
fn lamps_add_up() {
    let coated = Under::Coated { index: 1.5, inside: 0.6, entering: 0.9, nonlinear: false, passing: None };
    let coated = Finish { under: coated, fresnel: Fresnel::Dielectric(1.5), ..MIRROR };
    for finish in [coated, Finish { alpha: 0.4, ..MIRROR }] {
        let mut tables = room(Some(finish));
        for light in &mut tables.lights {
            light.strength = 0.0;
        }
        tables.shadows = false;
        for (light, x) in [(0, -3.0), (1, 2.0)] {
            add(&mut tables, [[x, 1.2, 1.0], [0.3, 0.0, 0.0], [0.0, 0.3, 0.0]], (0.0, DIFFUSE, 0));
            for triangle in tables.corners.len() - 2..tables.corners.len() {
                tables.emissions[triangle] = Some(Emission { light, luma: 2.0 });
                tables.gloss.emitted[triangle] = [2.0; 3];
            }
        }
        let here = view([0.4, 0.9, 2.2], LEVEL, [0.0; 3], [0.0; 3]);
        let with = |tables: &SceneTables, factors: [f64; 2]| {
            let factors = vec![[factors[0], 0.0], [factors[1], 0.0], [0.0; 2]];
            luma(&renderer(tables), &rays(false, 32), &View { factors, ..here.clone() }).0
        };
        let ([first, second], both) = ([[1.0, 0.0], [0.0, 1.0]].map(|on| with(&tables, on)), with(&tables, [1.0, 1.0]));
        let sum: Vec<f32> = first.iter().zip(&second).map(|(a, b)| a + b).collect();
        assert!(first.iter().chain(&second).any(|&x| x != 0.0));
        assert_eq!(off(&sum, &both, 0.1), 0, "{sum:?} {both:?}");
        tables.gloss.longest = 1;
        assert!(with(&tables, [1.0, 1.0]).iter().all(|&x| x == 0.0));
    }
}

/// A lamp does not hide itself, also where it is so near that a step off the surface leads a ray behind it.
#[test]
fn a_lamp_does_not_hide_itself() {
    let mut tables = room(Some(Finish { alpha: 0.3, ..MIRROR }));
    for light in &mut tables.lights {
        light.strength = 0.0;
    }
    add(&mut tables, [[0.3, 0.8, 2.8], [0.2, 0.0, 0.05], [0.0, 0.2, 0.0]], (0.0, DIFFUSE, 0));
    for triangle in tables.corners.len() - 2..tables.corners.len() {
        tables.emissions[triangle] = Some(Emission { light: 1, luma: 1.0 });
        tables.gloss.emitted[triangle] = [1.0; 3];
    }
    let here = view([0.4, 0.9, 2.2], LEVEL, [0.0; 3], [0.0; 3]);
    let mut seen = |shadows: bool| {
        tables.shadows = shadows;
        luma(&renderer(&tables), &rays(false, 16), &here).0
    };
    let (shaded, unshaded) = (seen(true), seen(false));
    assert!(unshaded.iter().any(|&luma| luma > 0.0));
    assert_eq!(shaded, unshaded);
}

/// What is remembered of the ways from triangles changes no bit: of lights, lamps and images, on mirrors and rough
/// surfaces and below a coat, with a body in the way, and one that moves there later.
#[test]
fn what_is_unoccluded_looks_as_where_rays_are_traced() {
    let coated = Under::Coated { index: 1.5, inside: 0.6, entering: 0.9, nonlinear: false, passing: None };
    let rough = Finish { alpha: 0.3, ..MIRROR };
    for finish in [MIRROR, rough.clone(), Finish { under: coated, fresnel: Fresnel::Dielectric(1.5), ..MIRROR }] {
        let mut tables = room(Some(finish));
        // A lamp that the wall hides from a part of the mirror, and something rough on the floor.
        add(&mut tables, [[-2.4, 0.4, -2.0], [0.0, 0.9, 0.0], [0.2, 0.0, 0.9]], (0.0, DIFFUSE, 0));
        for triangle in tables.corners.len() - 2..tables.corners.len() {
            tables.emissions[triangle] = Some(Emission { light: 0, luma: 2.0 });
            tables.gloss.emitted[triangle] = [2.0; 3];
        }
        tables.gloss.finishes.push(rough.clone());
        add(&mut tables, [[0.5, 0.3, 0.5], [0.1, 0.2, 0.8], [0.8, 0.1, 0.0]], (0.8, 1, 0));
        let remembering = renderer(&tables);
        let mut scene = Scene::new(&tables).unwrap();
        scene.unoccluded.forget();
        let tracing = Renderer::new(scene, Some(1)).unwrap();
        let turned = [[-0.8, 0.0, -0.6], [0.0, -1.0, 0.0], [-0.6, 0.0, 0.8]];
        for (rotation, away) in [(LEVEL, 0.0), (turned, 0.0), (LEVEL, 1.5), (turned, -0.9)] {
            let mut here = view([0.4, 0.9, -0.2], rotation, [0.2, 0.1, -0.3], [0.05, -0.1, 0.2]);
            here.poses[1].position[0] += away;
            let [known, traced] = [&remembering, &tracing].map(|renderer| luma(renderer, &rays(false, 4), &here));
            assert!(off(&traced.0, &vec![0.0; SIZE * SIZE], 0.1) > 50);
            assert_eq!((off(&traced.0, &known.0, 0.0), off(&traced.1, &known.1, 0.0)), (0, 0));
        }
    }
}

/// Adds a wall of small glossy squares at z = 3: from each of them most directions are free.
fn add_tiles(tables: &mut SceneTables, finish: Finish) {
    tables.gloss.finishes = vec![finish];
    for number in 0..100 {
        let at = |cell: i32| 0.3 * f64::from(cell) - 1.5;
        add(tables, [[at(number % 10), at(number / 10) + 1.0, 3.0], [0.0, 0.3, 0.0], [0.3, 0.0, 0.0]], (1.0, 0, 0));
    }
}

/// A body throws its shadow on glossy squares and is seen in them as what stands still does in its place, though nothing
/// that stands still is in the way there.
#[test]
fn a_body_counts_where_all_that_stands_still_is_out_of_the_way() {
    for finish in [MIRROR, Finish { alpha: 0.4, ..MIRROR }] {
        let tables = |frame: u32, height: f64| {
            let mut tables = room(None);
            add_tiles(&mut tables, finish.clone());
            add(&mut tables, [[0.1, 0.8, 2.0], [0.0, height, 0.0], [0.6, 0.0, 0.1]], (0.4, DIFFUSE, frame));
            tables
        };
        // The camera does not see the body itself: it looks past it.
        let turned = [[-0.8, 0.0, -0.6], [0.0, -1.0, 0.0], [-0.6, 0.0, 0.8]];
        let mut here = view([1.6, 1.2, 0.9], turned, [0.0; 3], [0.0; 3]);
        here.factors = vec![[1.0, 0.0]; 3];
        let [body, still, none] = [(1, 0.9), (0, 0.9), (0, 1e-6)]
            .map(|(frame, height)| luma(&renderer(&tables(frame, height)), &rays(false, 4), &here).0);
        assert!(off(&still, &none, 0.02) > 10, "{}", off(&still, &none, 0.02));
        assert!(off(&still, &body, 1e-4) <= 3, "{}", off(&still, &body, 1e-4));
    }
}

/// A lamp behind a screen sends nothing to a rough surface, whether the screen stands still or moves.
#[test]
fn a_screen_hides_a_lamp_from_a_lobe() {
    for frame in [0, 1] {
        let lit = |luma_of_lamp: f64, screened: bool| {
            let mut tables = room(None);
            add_tiles(&mut tables, Finish { alpha: 0.4, ..MIRROR });
            add(&mut tables, [[-0.5, 2.9, 1.4], [0.0, 0.0, 0.5], [0.5, 0.0, 0.0]], (0.0, DIFFUSE, 0));
            for triangle in tables.corners.len() - 2..tables.corners.len() {
                tables.planes.to_mut()[triangle] = tables.planes[triangle].map(|x| -x);
                tables.emissions[triangle] = Some(Emission { light: 0, luma: luma_of_lamp });
                tables.gloss.emitted[triangle] = [luma_of_lamp; 3];
            }
            if screened {
                add(&mut tables, [[-4.0, 2.8, -4.0], [0.0, 0.0, 6.9], [8.0, 0.0, 0.0]], (0.0, DIFFUSE, frame));
            }
            let mut here = view([0.1, 1.0, 1.2], LEVEL, [0.0; 3], [0.0; 3]);
            here.factors = vec![[1.0, 0.0], [0.0, 0.0], [0.0, 0.0]];
            luma(&renderer(&tables), &rays(false, 4), &here).0
        };
        assert!(off(&lit(9.0, false), &lit(0.0, false), 0.05) > 20);
        assert_eq!(off(&lit(9.0, true), &lit(1e-9, true), 1e-3), 0);
    }
}

#[test]
fn tables_that_do_not_belong_together_are_refused() {
    let good = room(Some(MIRROR));
    assert!(Scene::new(&good).is_ok());
    let wrong: [fn(&mut GlossTables); 33] = [
        |gloss| gloss.finish_of.truncate(3),
        |gloss| gloss.finish_of[0] = 1,
        |gloss| gloss.texels.of_texture.truncate(1),
        |gloss| gloss.texels.of_texture[0] = 99,
        |gloss| gloss.texels.images[0] = colours([1, 2, 1], &[[0.5; 3]; 2]),
        |gloss| gloss.texels.images[0] = colours([2, 1, 0], &[[0.5; 3]; 2]),
        |gloss| gloss.colours.clear(),
        |gloss| gloss.colours[0] = [-1.0; 3],
        |gloss| gloss.backgrounds.truncate(2),
        |gloss| gloss.emitted.truncate(2),
        |gloss| gloss.sky = Some((3, 1, vec![[1.0; 3]])),
        |gloss| gloss.finishes[0].alpha = -0.1,
        |gloss| gloss.finishes[0].across = Some(0.2),
        |gloss| {
            gloss.finishes[0] = Finish { alpha: 0.2, lobe: [None, Some(0)], ..MIRROR };
            (gloss.lobe_layouts, gloss.lobes) = (vec![[0, 1, 1, 0]], vec![0.5; 9]);
        },
        |gloss| gloss.finishes[0] = Finish { across: Some(0.0), ..mixed(0.3, 0.5) },
        |gloss| {
            gloss.finishes[0] = Finish { across: Some(0.2), lobe: [Some(0), None], ..mixed(0.3, 0.5) };
            (gloss.lobe_layouts, gloss.lobes) = (vec![[0, 1, 1, 0]], vec![0.5; 9]);
        },
        |gloss| gloss.finishes[0].under = clear_solid(1.0),
        |gloss| gloss.finishes[0].transmission = 0.5,
        |gloss| gloss.finishes[0] = Finish { transmission: 1.5, ..mixed(0.3, 0.5) },
        |gloss| gloss.finishes[0].flatness = 0.5,
        |gloss| gloss.finishes[0] = Finish { flatness: 1.5, ..mixed(0.3, 0.5) },
        |gloss| gloss.finishes[0].under = Under::Solid { index: 1.5, absorption: [0.0, -0.1, 0.0] },
        |gloss| gloss.finishes[0].under = Under::Solid { index: 1.5, absorption: [0.0, f64::INFINITY, 0.0] },
        |gloss| gloss.finishes[0].fresnel = Fresnel::Mixed { index: 1.5, metal: 1.1, tint: 0.0 },
        |gloss| gloss.finishes[0].fresnel = Fresnel::Mixed { index: 1.5, metal: 0.3, tint: 1.1 },
        |gloss| gloss.finishes[0].coat = Some(Coat { strength: 0.5, alpha: 0.1 }),
        |gloss| {
            gloss.finishes[0] = Finish { coat: Some(Coat { strength: 1.5, alpha: 0.1 }), ..mixed(0.3, 0.5) };
        },
        |gloss| {
            gloss.finishes[0] = Finish { sheen: Some(Sheen { strength: -0.5, tint: 0.0 }), ..mixed(0.3, 0.5) };
        },
        |gloss| gloss.finishes[0].tint = [f64::INFINITY; 3],
        |gloss| gloss.finishes[0].lobe = [None, Some(0)],
        |gloss| gloss.lobes = vec![1.01; 9],
        |gloss| gloss.lobe_layouts = vec![[0, 1, 1, 0]],
        |gloss| {
            gloss.finishes[0] = Finish { lobe: [Some(1), None], ..mixed(0.3, 0.5) };
            (gloss.lobe_layouts, gloss.lobes) = (vec![[0, 1, 1, 0]], vec![0.5; 9]);
        },
    ];
    for (number, change) in wrong.iter().enumerate() {
        let mut tables = good.clone();
        change(&mut tables.gloss);
        assert!(Scene::new(&tables).is_err(), "{number}");
    }
}

/// Returns a mix of metal and dielectric.
fn mixed(roughness: f64, metal: f64) -> Finish {
    let (fresnel, under) = (Fresnel::Mixed { index: 1.5, metal, tint: 0.0 }, Under::Rough(roughness, 1.0 - metal));
    Finish { alpha: roughness * roughness, fresnel, under, ..MIRROR }
}

/// A surface whose textures are the same everywhere is one without, and its own numbers do not matter; each texture
/// changes its own number.
#[test]
fn textures_of_roughness_and_metal_stand_for_the_numbers_of_a_finish() {
    let here = view([0.4, 0.9, 1.6], LEVEL, [0.2, 0.1, -0.3], [0.05, -0.1, 0.2]);
    let shown = |finish: Finish, layouts: &[[i64; 4]], lobes: &[f32]| {
        let mut tables = room(Some(finish));
        (tables.gloss.lobe_layouts, tables.gloss.lobes) = (layouts.to_vec(), lobes.to_vec());
        luma(&renderer(&tables), &rays(false, 2), &here)
    };
    let layouts = [[0, 2, 1, 0], [12, 1, 2, 1]];
    let texels = [[0.5f32; 12], [0.25; 12]].concat();
    for (lobe, roughness, metal) in
        [([Some(0), Some(1)], 0.5, 0.25), ([Some(0), None], 0.5, 0.875), ([None, Some(0)], 0.75, 0.5)]
    {
        let own = shown(mixed(roughness, metal), &[], &[]);
        assert_eq!(shown(Finish { lobe, ..mixed(0.75, 0.875) }, &layouts, &texels), own, "{lobe:?}");
        assert_ne!(shown(mixed(0.75, 0.875), &[], &[]), own);
    }
    // A texture of no roughness is not a mirror.
    let smooth = Finish { lobe: [Some(0), None], ..mixed(0.75, 0.875) };
    let least = Finish { alpha: 1e-3, under: Under::Rough(0.0, 0.125), ..mixed(0.75, 0.875) };
    assert_eq!(shown(smooth, &layouts, &[0.0; 24]), shown(least, &[], &[]));
}

/// Returns where a ray meets a triangle (Moller and Trumbore 1997).
fn distance([a, b, c]: [[f64; 3]; 3], ray: &Ray) -> Option<f64> {
    let (u, v, from) = (sub(b, a), sub(c, a), sub(ray.origin, a));
    let (p, q) = (cross(ray.direction, v), cross(from, u));
    let volume = dot(u, p);
    let [second, third] = [dot(from, p) / volume, dot(ray.direction, q) / volume];
    let along = dot(v, q) / volume;
    (second >= 0.0 && third >= 0.0 && second + third <= 1.0 && along > 0.0).then_some(along)
}

/// The first triangle that a ray meets, and the first but that one or but what is nearer, as a search of all has it; also
/// among small bodies, most of which a ray passes at a distance.
#[test]
fn rays_meet_what_a_search_of_all_finds() {
    let mut state = 7u64;
    let mut next = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 40) as f64 / f64::from(1 << 23) - 1.0
    };
    let mut tables = SceneTables { frame_count: 12, ..room(None) };
    let middles: [[f64; 3]; 12] = std::array::from_fn(|_| std::array::from_fn(|_| next()));
    for number in 0..1000 {
        let [corner, u, v]: [[f64; 3]; 3] = std::array::from_fn(|_| std::array::from_fn(|_| next()));
        let (body, frame) = (number >= 400, if number < 400 { number % 2 } else { 2 + number % 10 });
        let size = if body { 0.1 } else { 0.4 };
        let middle = middles[frame as usize];
        let corner = if body { std::array::from_fn(|i| middle[i] + 0.1 * corner[i]) } else { corner };
        add(&mut tables, [corner, u.map(|x| size * x), v.map(|x| size * x)], (1.0, DIFFUSE, frame));
    }
    let scene = Scene::new(&tables).unwrap();
    let (mut hits, mut met, mut missed, mut of_bodies) = (FirstHits::default(), 0, 0, 0);
    for number in 0..400 {
        let [origin, direction]: [[f64; 3]; 2] = std::array::from_fn(|_| std::array::from_fn(|_| next()));
        // Every second one goes past a body, near or through it.
        let aim = |i: usize| middles[2 + number % 10][i] + 0.2 * direction[i] - origin[i];
        let direction = if number % 2 == 0 { direction } else { std::array::from_fn(aim) };
        let rays: Vec<Ray> =
            scene.frames.iter().map(|frame| Ray { origin: sub(origin, frame.centre), direction }).collect();
        let mut all: Vec<(f64, u32)> = vec![];
        for (frame, ray) in scene.frames.iter().zip(&rays) {
            let found = frame.triangles.clone().filter_map(|i| Some((distance(scene.corners[i], ray)?, i as u32)));
            all.extend(found);
        }
        all.sort_by(|a, b| a.0.total_cmp(&b.0));
        missed += scene.frames.iter().zip(&rays).filter(|(f, ray)| f.bvh.is_missed(ray.origin, ray.direction)).count();
        of_bodies += usize::from(all.first().is_some_and(|hit| scene.surfaces[hit.1 as usize].frame > 1));
        assert_eq!(is_blocked(&scene, (&rays, 0), f64::INFINITY, u32::MAX, &mut vec![]), !all.is_empty());
        let number = |at: usize| all.get(at).map(|hit| hit.1);
        assert_eq!(hits.nearest(&scene, (&rays, 0), 0.0, u32::MAX), number(0));
        if let [first, second, ..] = all[..] {
            met += 1;
            assert_eq!(hits.nearest(&scene, (&rays, 0), 0.0, first.1), Some(second.1));
            assert_eq!(hits.nearest(&scene, (&rays, 0), f64::midpoint(first.0, second.0), u32::MAX), Some(second.1));
        }
    }
    assert!(met > 100 && missed > 1000 && of_bodies > 15, "{met} {missed} {of_bodies}");
}
