//! `SceneRenderer`, `PixelRays` and `IrradianceSampler` for Python.

mod irradiance;
mod pixel_rays;
mod scene_renderer;
mod scene_tables;
mod views;

pub(super) use irradiance::{PyIrradianceSampler, PyReflectedLight};
pub(super) use pixel_rays::PyPixelRays;
pub(super) use scene_renderer::PySceneRenderer;
