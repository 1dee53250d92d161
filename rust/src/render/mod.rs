//! The renderer: linear luma of diffuse and glossy triangles under direct or baked light, as a camera's rays see them.
//!
//! ```text
//! view -> bins: which triangles each tile of the image may see
//!      -> nearest: which of them each of its rays hits first
//!      or, in large scenes, beam: what the rays of a tile hit first, by a walk through the BVH from front to back
//!      -> shade: depth, texture, light and shadow of the rays of one triangle
//!      -> tile: the mean of each pixel's rays
//! ```
//!
//! Work is shared by many rays wherever that does not change a bit: triangles are set up once per view, tiles are
//! decided at their corners ([`linear`](geometry::linear)), and the rays of one triangle are shaded together
//! ([`sorted`](visibility::sorted), [`lanes`]).
//!
//! - [`geometry`]: vectors, the BVH ([`bvh`](geometry::bvh)) that finds triangles, the camera's
//!   [`view`](geometry::view) and its [`pixel_rays`](geometry::pixel_rays).
//! - [`visibility`]: [`bins`](visibility::bins) and the [`nearest`](visibility::nearest) triangle of each ray, or a
//!   [`beam`](visibility::beam) for a tile; [`unoccluded`](visibility::unoccluded) remembers from which triangles rays
//!   hit nothing.
//! - [`light`]: a [`shader`](light::shader) is a triangle as a camera sees it, and [`shade`](light::shade) computes the
//!   luma of its rays from [`lights`](light::lights), [`light_map`](light::light_map), [`texture`](light::texture),
//!   [`slide`](light::slide) and [`sky`](light::sky). [`shadows`](light::shadows) finds what lies between a [`patch`](light::patch) and a light, as
//!   [`cone`](light::cone)s, and [`cast`](light::cast) the rays that see hidden points; [`any_hit`](light::any_hit)
//!   asks the BVH for a few points at a time.
//! - [`gloss`]: surfaces that are not diffuse, by rays of their own.
//! - [`lines`]: a pixel's integral over its area, by taps on lines instead of rays.
//! - [`gradients`]: derivatives of single pixels in float64.
//! - [`irradiance`]: light at places on surfaces, which is baked into light maps, by rays of any direction
//!   ([`ray_tracer`](visibility::ray_tracer)).
//!
//! What is rendered is a [`scene`], whose meshes may [`deform`]; the [`renderer`] is what the user sees; [`tile`] and [`samples`] join the steps for
//! whole images and for single pixels; [`tile_hits`] is what rays and taps have in common.
//!
//! What must not break: the same view gives the same bits in any batch, on any number of threads and on every
//! processor.

#![allow(clippy::many_single_char_names, reason = "coordinates and corners have such names")]
#![allow(clippy::needless_range_loop, reason = "loops over the lanes of several arrays become vector code")]
#![allow(clippy::float_cmp, reason = "ties are exact")]

mod deform;
mod geometry;
mod gloss;
mod gradients;
mod irradiance;
mod lanes;
mod light;
mod lines;
mod renderer;
mod samples;
mod scene;
mod tile;
mod tile_hits;
mod visibility;

#[cfg(feature = "python")]
pub use deform::Deformed;
pub use geometry::pixel_rays::PixelRays;
pub use geometry::view::{Pose, View};
#[cfg(feature = "python")]
pub use gloss::coat::Coat;
#[cfg(feature = "python")]
pub use gloss::emissive::EmissiveTextures;
#[cfg(feature = "python")]
pub use gloss::finish::{Finish, Fresnel, PASSING, Under};
#[cfg(feature = "python")]
pub use gloss::microfacets::Distribution;
#[cfg(feature = "python")]
pub use gloss::sheen::Sheen;
#[cfg(feature = "python")]
pub use gloss::tables::GlossTables;
#[cfg(feature = "python")]
pub use gradients::pixel_gradients::{BEFORE_LIGHTS, RayHit};
pub use irradiance::{
    AreaLamp, EnvironmentMap, GroupLight, IrradianceSampler, PathRule, ReflectedLight, SharpLight, SkyLight,
    SurfacePoint, SurfaceTables,
};
pub use light::beam::Beam;
pub use light::colours::{ColourImage, TextureColours};
pub use light::light_map::{Channel, Emission, LightMapTables, VectorMapTables};
#[cfg(feature = "python")]
pub use light::normal_texture::NormalTextureTables;
pub use light::sky::Sky;
#[cfg(feature = "python")]
pub use light::slide::{Slide, SlideTables};
#[cfg(feature = "python")]
pub use lines::pattern::LinePattern;
pub use renderer::Renderer;
pub use scene::{Light, LightKind, Scene, SceneTables};
