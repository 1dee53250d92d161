//! Light that reaches the camera: lights and their shadows, baked light, textures, and the sky.

mod affine;
pub(super) mod any_hit;
pub(super) mod beam;
mod bumps;
pub(super) mod cast;
pub(super) mod colours;
pub(super) mod cone;
pub(super) mod light_map;
pub(super) mod lights;
mod lookup;
pub(super) mod normal_texture;
mod normals;
pub(super) mod patch;
pub(super) mod shade;
pub(super) mod shader;
pub(super) mod shadows;
pub(super) mod sky;
pub(super) mod slide;
pub(super) mod texture;
