//! Gradients: luma of single pixels in float64, with its derivatives by time, by the camera's pose and by each light.
//!
//! Derivatives are closed forms, not differences, so they need no step size. Which surface a ray hits, and which lights
//! are hidden from it, is taken as fixed.
//!
//! What must not break: the layout of a gradient ([`BEFORE_LIGHTS`] numbers, then one for each light), which Python
//! reads.

use rayon::prelude::*;

use super::framed_lights::{FramedLight, framed_lights};
use super::slopes::{Hit, Shaded, on_plane, shade};
use crate::error::{Error, Result};
use crate::render::geometry::pixel_rays::PixelRays;
use crate::render::geometry::vector::{Vector, add, cross, dot, scale};
use crate::render::geometry::view::View;
use crate::render::renderer::{NO_TRIANGLE, Renderer, check_length};
use crate::render::scene::Scene;
use crate::render::visibility::first_hit::Candidates;

/// Numbers of a gradient before those of the lights: luma, its rate per second, and its derivatives by the camera's
/// position in world axes and by a rotation vector in camera axes.
pub const BEFORE_LIGHTS: usize = 8;

/// Pixels that a thread takes at a time.
pub(crate) const PIXELS_OF_THREAD: usize = 64;

/// What one ray sees.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct RayHit {
    /// The triangle's number in the scene's tables, [`NO_TRIANGLE`] for none.
    pub triangle: u32,
    /// Bit n mod 64 is turned over for each light n that falls on the point, but for what lies between.
    pub hidden: u64,
    /// Luma.
    pub luma: f64,
}

/// A view, and its lights in each frame.
pub(crate) struct Lit<'a> {
    pub(crate) number: u32,
    view: &'a View,
    lights: Vec<Vec<FramedLight>>,
}

impl<'a> Lit<'a> {
    pub(crate) fn new(scene: &Scene, views: &'a [View], number: u32) -> Self {
        let view = &views[number as usize];
        let lights = (0..scene.frames.len()).map(|frame| framed_lights(scene, view, frame)).collect();
        Self { number, view, lights }
    }
}

/// Room for one ray after the other.
#[derive(Default)]
pub(crate) struct RayBuffers {
    stack: Vec<u32>,
    candidates: Candidates,
    shaded: Shaded,
    x: Vec<f32>,
    y: Vec<f32>,
}

impl Renderer {
    /// Computes luma of pixels, or of weighted sums of pixels, in float64, each with its derivatives.
    ///
    /// Which surface a ray meets, and whether a light is hidden from it, is taken as fixed. A gradient has
    /// `BEFORE_LIGHTS` numbers, and for each light its part in luma, which is the derivative by the logarithm of its
    /// strength.
    ///
    /// `pixels` are `weights.len()` for each of `of_view`, the numbers of their views.
    ///
    /// # Errors
    ///
    /// [`Error::Argument`] for views of another scene, pixels or views that are not there, or a buffer of another
    /// length.
    pub fn gradients(
        &self,
        rays: &PixelRays,
        views: &[View],
        of_view: &[u32],
        pixels: &[u32],
        weights: &[f64],
        gradients: &mut [f64],
    ) -> Result<()> {
        self.check_plain("derivatives")?;
        let views = &self.centred(views)?;
        check_numbers(rays, views, of_view, pixels, weights.len())?;
        let size = BEFORE_LIGHTS + self.scene.lights.len();
        check_length(of_view.len() * size, gradients.len())?;
        if of_view.is_empty() {
            return Ok(());
        }
        self.install(|| {
            let of_view = of_view.par_chunks(PIXELS_OF_THREAD);
            let pixels = pixels.par_chunks(PIXELS_OF_THREAD * weights.len());
            let gradients = gradients.par_chunks_mut(PIXELS_OF_THREAD * size);
            of_view.zip(pixels).zip(gradients).for_each(|((of_view, pixels), gradients)| {
                let (mut buffers, mut lit) = (RayBuffers::default(), Lit::new(&self.scene, views, of_view[0]));
                let pixels = pixels.chunks_exact(weights.len());
                for ((&view, pixels), gradient) in of_view.iter().zip(pixels).zip(gradients.chunks_exact_mut(size)) {
                    if lit.number != view {
                        lit = Lit::new(&self.scene, views, view);
                    }
                    self.add_pixels(rays, &lit, pixels, weights, &mut buffers, gradient);
                }
            });
        })
    }

    /// Returns what each ray of pixels sees, in float64: `rays.rays()` for each pixel.
    ///
    /// # Errors
    ///
    /// [`Error::Argument`] as for [`Self::gradients`].
    pub fn ray_hits(
        &self,
        rays: &PixelRays,
        views: &[View],
        of_view: &[u32],
        pixels: &[u32],
        hits: &mut [RayHit],
    ) -> Result<()> {
        self.check_plain("hits of single rays with their luma")?;
        let views = &self.centred(views)?;
        check_numbers(rays, views, of_view, pixels, 1)?;
        check_length(pixels.len() * rays.rays(), hits.len())?;
        self.install(|| {
            let numbers = of_view.par_iter().zip(pixels).with_min_len(PIXELS_OF_THREAD);
            numbers.zip(hits.par_chunks_exact_mut(rays.rays())).for_each(|((&view, &pixel), hits)| {
                let (mut buffers, lit) = (RayBuffers::default(), Lit::new(&self.scene, views, view));
                let mut hits = hits.iter_mut();
                self.each_ray(rays, &lit, &[pixel], &mut buffers, |_, _, seen, shaded| {
                    if let Some(hit) = hits.next() {
                        let triangle = seen.map_or(NO_TRIANGLE, |hit| hit.surface.number);
                        *hit = RayHit { triangle, hidden: shaded.hidden, luma: shaded.luma };
                    }
                });
            });
        })
    }

    /// Adds up the gradients of pixels, each times its weight.
    fn add_pixels(
        &self,
        rays: &PixelRays,
        lit: &Lit,
        pixels: &[u32],
        weights: &[f64],
        buffers: &mut RayBuffers,
        gradient: &mut [f64],
    ) {
        #[allow(clippy::cast_precision_loss, reason = "rays are few")]
        let per_ray = 1.0 / rays.rays() as f64;
        let camera = &lit.view.poses[0];
        gradient.fill(0.0);
        self.each_ray(rays, lit, pixels, buffers, |number, ray, hit, shaded| {
            let weight = weights[number] * per_ray;
            let (by_position, by_turn, rate) = match hit {
                Some(hit) => {
                    let own = &lit.view.poses[hit.surface.frame as usize];
                    let slope = own.turned(on_plane(shaded.slope, &hit.surface.plane, hit.direction));
                    let moved = dot(slope, add(own.turned(own.velocity), cross(own.angular_rate, hit.seen)));
                    (camera.vector(slope), cross(hit.seen, slope), moved)
                }
                None => self.by_direction(lit, ray),
            };
            gradient[0] += weight * shaded.luma;
            gradient[1] += weight * (shaded.rate + rate);
            for k in 0..3 {
                gradient[2 + k] += weight * by_position[k];
                gradient[5 + k] += weight * by_turn[k];
            }
            for (sum, of_light) in gradient[BEFORE_LIGHTS..].iter_mut().zip(&shaded.by_light) {
                *sum += weight * of_light;
            }
        });
    }

    /// Returns the derivatives of what a ray sees that hits nothing, and its rate by the camera's motion.
    fn by_direction(&self, lit: &Lit, [x, y, _]: Vector) -> (Vector, Vector, f64) {
        let Some(sky) = &self.scene.sky else { return ([0.0; 3], [0.0; 3], 0.0) };
        let mut camera = lit.view.poses[0];
        let factor = lit.view.factors[sky.light as usize][0];
        let rate = camera.angular_rate;
        let by_turn = std::array::from_fn(|k| {
            camera.angular_rate = [0.0; 3];
            camera.angular_rate[k] = 1.0;
            factor * sky.along(&camera, x, y).1
        });
        ([0.0; 3], by_turn, dot(by_turn, rate))
    }

    /// Hands each ray of pixels on: its pixel's number among them, its direction in camera axes, what it hits, and what
    /// it sees there.
    pub(crate) fn each_ray(
        &self,
        rays: &PixelRays,
        lit: &Lit,
        pixels: &[u32],
        buffers: &mut RayBuffers,
        mut work: impl FnMut(usize, Vector, Option<&Hit>, &Shaded),
    ) {
        let (scene, view) = (&self.scene, lit.view);
        let RayBuffers { stack, candidates, shaded, x, y } = buffers;
        let per_pixel = rays.rays();
        for values in [&mut *x, &mut *y] {
            values.resize(pixels.len() * per_pixel, 0.0);
        }
        for (&pixel, (x, y)) in pixels.iter().zip(x.chunks_exact_mut(per_pixel).zip(y.chunks_exact_mut(per_pixel))) {
            let (tile, in_tile) = rays.tile_of(pixel as usize);
            rays.copy_pixel(tile, in_tile, x, y);
        }
        let mut around = [[f64::INFINITY; 2], [f64::NEG_INFINITY; 2]];
        for (axis, values) in [&*x, &*y].into_iter().enumerate() {
            for value in values.iter().map(|&value| f64::from(value)) {
                around[0][axis] = around[0][axis].min(value);
                around[1][axis] = around[1][axis].max(value);
            }
        }
        candidates.search(scene, view, &around, stack);
        for (number, (&x, &y)) in x.iter().zip(&*y).enumerate() {
            let (number, ray) = (number / per_pixel, [f64::from(x), f64::from(y), 1.0]);
            let Some((triangle, depth)) = candidates.first(ray) else {
                self.beyond(lit, ray, shaded);
                work(number, ray, None, shaded);
                continue;
            };
            let surface = &scene.surfaces[triangle as usize];
            let pose = &view.poses[surface.frame as usize];
            let direction = pose.vector(ray);
            let normal = [surface.plane[0], surface.plane[1], surface.plane[2]];
            let hit = Hit {
                surface,
                triangle,
                seen: scale(ray, depth),
                point: add(pose.position, scale(direction, depth)),
                direction,
                in_front: dot(normal, pose.position) + surface.plane[3] >= 0.0,
            };
            shade(scene, view, &lit.lights[surface.frame as usize], &hit, stack, shaded);
            work(number, ray, Some(&hit), shaded);
        }
    }

    /// Computes what a ray sees that hits nothing.
    fn beyond(&self, lit: &Lit, [x, y, _]: Vector, shaded: &mut Shaded) {
        (shaded.luma, shaded.rate, shaded.slope, shaded.hidden) = (0.0, 0.0, [0.0; 3], 0);
        shaded.by_light.clear();
        shaded.falls.clear();
        for (light, [factor, rate]) in self.scene.lights.iter().zip(&lit.view.factors) {
            let shown = light.strength * light.background;
            shaded.by_light.push(shown * factor);
            shaded.luma += shown * factor;
            shaded.rate += shown * rate;
        }
        if let Some(sky) = &self.scene.sky {
            let [factor, rate] = lit.view.factors[sky.light as usize];
            let luma = sky.along(&lit.view.poses[0], x, y).0;
            shaded.by_light[sky.light as usize] += luma * factor;
            shaded.luma += luma * factor;
            shaded.rate += luma * rate;
        }
    }
}

pub(crate) fn check_numbers(
    rays: &PixelRays,
    views: &[View],
    of_view: &[u32],
    pixels: &[u32],
    together: usize,
) -> Result<()> {
    if of_view.len() * together != pixels.len() || together == 0 {
        return Err(Error::Argument(format!(
            "{} views of {together} pixels each need as many pixels, got {}",
            of_view.len(),
            pixels.len()
        )));
    }
    if let Some(view) = of_view.iter().find(|&&view| view as usize >= views.len()) {
        return Err(Error::Argument(format!("view {view}: there are {}", views.len())));
    }
    if let Some(pixel) = pixels.iter().find(|&&pixel| pixel as usize >= rays.pixels()) {
        return Err(Error::Argument(format!("pixel {pixel}: there are {}", rays.pixels())));
    }
    Ok(())
}
