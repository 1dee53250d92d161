//! Irradiance at points of surfaces, by rays: what is baked into light maps.
//!
//! ```text
//! lattice: points in the unit square, shifted from point to point
//!      -> emitters: light of lamps, the sky, and of small lights, towards a point
//!      -> sampler: the mean over the rays of each point; light that bounces is gathered, or traced along paths
//! ```
//!
//! - [`surfaces`]: what a ray hits: its reflectance, and the light that falls on it, if that is known.
//! - [`sampler`]: what Python calls.
//!
//! What must not break: the light at a point is a function of the scene, the point and the numbers of its samples. It
//! has the same bits on every processor, on any number of threads, and in any batch of points.

mod emitters;
mod lattice;
mod sampler;
mod surfaces;

pub use emitters::{AreaLamp, EnvironmentMap, GroupLight, SharpLight, SkyLight};
pub use sampler::{IrradianceSampler, PathRule, SurfacePoint};
pub use surfaces::{ReflectedLight, SurfaceTables};
