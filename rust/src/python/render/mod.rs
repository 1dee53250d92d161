//! `SceneRenderer` and `PixelRays` for Python.

mod pixel_rays;
mod scene_renderer;
mod scene_tables;
mod views;

pub(super) use pixel_rays::PyPixelRays;
pub(super) use scene_renderer::PySceneRenderer;
