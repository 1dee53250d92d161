//! The renderer: linear luma of diffuse triangles under direct light, as a camera's rays see them.
//!
//! ```text
//! view -> bins: which triangles each tile of the image may see
//!      -> visibility: which of them each of its rays meets first
//!      -> shade: depth, texture, light and shadow of the rays of one triangle
//!      -> tile: the mean of each pixel's rays
//! ```
//!
//! [`scene`] holds what is rendered, [`hierarchy`] finds its triangles, [`pixel_rays`] holds the camera's rays by tiles,
//! [`view`] says where the camera is and how it moves there. [`sorted`] finds the rays of one triangle, which are shaded side by
//! side in [`lanes`]. [`linear`] makes a tile's decisions those of its rays,
//! [`texture`], [`lights`], [`beam`], [`light_map`], [`sky`], [`shadows`] (what lies between, behind [`cone`]s) and [`cast`] (on which rays)
//! give what [`shade`] needs; [`tile`] is compiled for several processors, [`samples`] are single pixels, [`renderer`] is
//! what the user sees. [`edges`] tells when edges pass rays, [`tracks`] what luma does meanwhile
//! ([`smooth_motion`] says how all moves),
//! [`edge_tracks`] which pixels that concerns. [`gradients`] are derivatives of single pixels in float64: what their rays meet
//! ([`first_hit`]), and how it changes with the place ([`slopes`], [`framed_lights`]); [`texel_gradients`] are those by the
//! texels that they see.

#![allow(clippy::many_single_char_names, reason = "coordinates and corners have such names")]
#![allow(clippy::needless_range_loop, reason = "loops over the lanes of several arrays become vector code")]
#![allow(clippy::float_cmp, reason = "ties are exact")]

mod beam;
mod bins;
mod cast;
mod cone;
mod edge_tracks;
mod edges;
mod first_hit;
mod framed_lights;
mod gradients;
mod hierarchy;
mod lanes;
mod light_map;
mod lights;
mod linear;
mod patch;
mod pixel_rays;
mod renderer;
mod samples;
mod scene;
mod shade;
mod shadows;
mod sky;
mod slopes;
mod smooth_motion;
mod sorted;
mod texel_gradients;
mod texture;
mod tile;
mod tracks;
mod vector;
mod view;
mod visibility;

pub use beam::Beam;
pub use edge_tracks::{EdgeTracks, TrackSettings};
#[cfg(feature = "python")]
pub use gradients::{BEFORE_LIGHTS, RaySight};
pub use light_map::{Emission, LightMapTables};
pub use pixel_rays::PixelRays;
pub use renderer::Renderer;
pub use scene::{Light, LightKind, Scene, SceneTables};
pub use sky::Sky;
pub use view::{Pose, View};
