//! Derivatives of single pixels' luma by the texels that their rays see.
//!
//! A lookup mixes four texels linearly, so the derivatives are its weights times the light. They are collected as a
//! sparse list, because a pixel sees few texels.
//!
//! What must not break: weights are those of [`super::slopes`], and light that bounces is taken as fixed.

use rayon::prelude::*;

use super::pixel_gradients::{Lit, PIXELS_OF_THREAD, RayBuffers, check_numbers};
use super::slopes::taps;
use crate::error::{Error, Result};
use crate::render::geometry::pixel_rays::PixelRays;
use crate::render::geometry::view::View;
use crate::render::renderer::Renderer;

/// Derivatives of k sums of pixels by texels, those of each sum after those of the one before.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TexelGradients {
    /// How many texels each sum sees.
    pub counts: Vec<u32>,
    /// Their numbers in the scene's texels, ascending for each sum.
    pub texels: Vec<u32>,
    /// Luma by what is added to the texel.
    pub values: Vec<f64>,
}

impl TexelGradients {
    fn join(mut self, b: Self) -> Self {
        self.counts.extend(b.counts);
        self.texels.extend(b.texels);
        self.values.extend(b.values);
        self
    }
}

impl Renderer {
    /// Computes derivatives of weighted sums of pixels by the texels of the surfaces that their rays meet, in float64.
    ///
    /// `pixels` are `weights.len()` for each of `of_view`, the numbers of their views. `steps` say by how much each
    /// light colour's texels change for a unit. Light that bounces is taken as fixed.
    ///
    /// # Errors
    ///
    /// [`Error::Argument`] for views of another scene, pixels or views that are not there, or another number of steps.
    pub fn texel_gradients(
        &self,
        rays: &PixelRays,
        views: &[View],
        of_view: &[u32],
        pixels: &[u32],
        weights: &[f64],
        steps: &[f64],
    ) -> Result<TexelGradients> {
        self.check_plain("derivatives")?;
        let views = &self.centred(views)?;
        check_numbers(rays, views, of_view, pixels, weights.len())?;
        if steps.len() != self.scene.texels.len() {
            return Err(Error::Argument(format!(
                "{} light colours need as many steps, got {}",
                self.scene.texels.len(),
                steps.len()
            )));
        }
        let mut gradients = vec![];
        self.install(|| {
            let of_view = of_view.par_chunks(PIXELS_OF_THREAD);
            let pixels = pixels.par_chunks(PIXELS_OF_THREAD * weights.len());
            let of_chunk = |(of_view, pixels): (&[u32], &[u32])| {
                let (mut buffers, mut seen, mut gradients) = (RayBuffers::default(), vec![], TexelGradients::default());
                let mut lit: Option<Lit> = None;
                for (&view, pixels) in of_view.iter().zip(pixels.chunks_exact(weights.len())) {
                    let lit = match lit.take() {
                        Some(same) if same.number == view => lit.insert(same),
                        _ => lit.insert(Lit::new(&self.scene, views, view)),
                    };
                    self.collect(rays, lit, pixels, weights, steps, &mut buffers, &mut seen);
                    let before = gradients.texels.len();
                    for same in seen.chunk_by(|a, b| a.0 == b.0) {
                        gradients.texels.push(same[0].0);
                        gradients.values.push(same.iter().map(|a| a.1).sum());
                    }
                    #[allow(clippy::cast_possible_truncation, reason = "1024 rays of a few pixels see fewer")]
                    gradients.counts.push((gradients.texels.len() - before) as u32);
                }
                gradients
            };
            of_view.zip(pixels).map(of_chunk).collect_into_vec(&mut gradients);
        })?;
        Ok(gradients.into_iter().fold(TexelGradients::default(), TexelGradients::join))
    }

    /// Collects what pixels, each times its weight, see of texels: sorted, a texel as often as rays see it.
    #[allow(clippy::too_many_arguments, reason = "buffers that are used again")]
    fn collect(
        &self,
        rays: &PixelRays,
        lit: &Lit,
        pixels: &[u32],
        weights: &[f64],
        steps: &[f64],
        buffers: &mut RayBuffers,
        seen: &mut Vec<(u32, f64)>,
    ) {
        #[allow(clippy::cast_precision_loss, reason = "rays are few")]
        let per_ray = 1.0 / rays.rays() as f64;
        let scene = &self.scene;
        seen.clear();
        self.each_ray(rays, lit, pixels, buffers, |number, _, hit, shaded| {
            let Some(hit) = hit else { return };
            let lights = scene.lights.iter().zip(&shaded.falls);
            let by_reflectance: f64 = lights.map(|(light, falls)| falls * steps[light.group as usize]).sum();
            if by_reflectance == 0.0 {
                return;
            }
            let surface = hit.surface;
            let texture = &scene.textures[surface.texture as usize];
            for (texel, fraction) in taps(texture, surface.uv().each_ref(), hit.point) {
                if fraction != 0.0 {
                    #[allow(clippy::cast_possible_truncation, reason = "texels are numbered below 2^31")]
                    seen.push((texel as u32, weights[number] * per_ray * by_reflectance * fraction));
                }
            }
        });
        seen.sort_by_key(|&(texel, _)| texel);
    }
}
