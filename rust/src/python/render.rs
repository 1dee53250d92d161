//! `SceneRenderer` and `PixelRays` for Python.

use numpy::{Element, IntoPyArray, PyArray1, PyReadonlyArray1};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use super::arrays::column;
use crate::render::{Light, LightKind, PixelRays, Pose, Renderer, Scene, SceneTables, View};

/// See `_core.pyi`.
#[pyclass(name = "PixelRays", module = "davis_rs._core", frozen)]
pub(super) struct PyPixelRays(PixelRays);

#[pymethods]
impl PyPixelRays {
    #[new]
    fn new(width: usize, height: usize, rays: usize, table: &Bound<'_, PyAny>) -> PyResult<Self> {
        Ok(Self(PixelRays::new(width, height, rays, column::<f32>(table, "table")?.as_slice()?)?))
    }
}

/// See `_core.pyi`.
#[pyclass(name = "SceneRenderer", module = "davis_rs._core", frozen)]
pub(super) struct PySceneRenderer(Renderer);

/// Where cameras are, and what surrounds them: positions, rotations, velocities and rates of each view in each frame;
/// factors and their rates of each view and light.
type Views<'py> =
    (Bound<'py, PyAny>, Bound<'py, PyAny>, Bound<'py, PyAny>, Bound<'py, PyAny>, Bound<'py, PyAny>, Bound<'py, PyAny>);

/// An array without its shape.
type Flat<'py, T> = Bound<'py, PyArray1<T>>;

/// Kind, group, strength, background and vector of a light.
type LightTuple = (String, u32, f64, f64, [f64; 3]);

#[pymethods]
impl PySceneRenderer {
    #[new]
    #[pyo3(signature = (
        *,
        corners,
        planes,
        u_maps,
        v_maps,
        normal_maps,
        textures,
        two_sided,
        frames,
        frame_count,
        layouts,
        texels,
        lights,
        shadows,
        centre,
        step,
        end,
        threads=None,
    ))]
    #[allow(clippy::too_many_arguments, reason = "keywords in Python")]
    fn new(
        corners: &Bound<'_, PyAny>,
        planes: &Bound<'_, PyAny>,
        u_maps: &Bound<'_, PyAny>,
        v_maps: &Bound<'_, PyAny>,
        normal_maps: Option<&Bound<'_, PyAny>>,
        textures: &Bound<'_, PyAny>,
        two_sided: &Bound<'_, PyAny>,
        frames: &Bound<'_, PyAny>,
        frame_count: usize,
        layouts: &Bound<'_, PyAny>,
        texels: Vec<Bound<'_, PyAny>>,
        lights: Vec<LightTuple>,
        shadows: bool,
        centre: [f64; 3],
        step: f64,
        end: f64,
        threads: Option<usize>,
    ) -> PyResult<Self> {
        let (u_maps, v_maps) = (groups::<f64, 4>(u_maps, "u_maps")?, groups::<f64, 4>(v_maps, "v_maps")?);
        if u_maps.len() != v_maps.len() {
            return Err(PyValueError::new_err(format!(
                "{} u_maps need as many v_maps, got {}",
                u_maps.len(),
                v_maps.len()
            )));
        }
        let tables = SceneTables {
            corners: groups::<f64, 9>(corners, "corners")?.into_iter().map(rows).collect(),
            planes: groups(planes, "planes")?,
            uv_maps: u_maps.into_iter().zip(v_maps).map(|(u, v)| [u, v]).collect(),
            normal_maps: normal_maps.map_or(Ok(vec![]), |maps| {
                PyResult::Ok(groups::<f64, 12>(maps, "normal_maps")?.into_iter().map(rows).collect())
            })?,
            textures: column::<u32>(textures, "textures")?.as_slice()?.to_vec(),
            two_sided: column::<u32>(two_sided, "two_sided")?.as_slice()?.iter().map(|&flag| flag != 0).collect(),
            frames: column::<u32>(frames, "frames")?.as_slice()?.to_vec(),
            frame_count,
            layouts: groups(layouts, "layouts")?,
            texels: texels
                .iter()
                .map(|group| PyResult::Ok(column::<f32>(group, "texels")?.as_slice()?.to_vec()))
                .collect::<PyResult<_>>()?,
            lights: lights.into_iter().map(light).collect::<PyResult<_>>()?,
            shadows,
            centre,
            step,
            end,
        };
        Ok(Self(Renderer::new(Scene::new(&tables)?, threads)?))
    }

    #[pyo3(signature = (rays, views, *, rate=false))]
    fn luma<'py>(
        &self,
        py: Python<'py>,
        rays: &PyPixelRays,
        views: Views<'py>,
        rate: bool,
    ) -> PyResult<(Flat<'py, f32>, Option<Flat<'py, f32>>)> {
        let views = self.views(&views)?;
        let room = vec![0f32; views.len() * rays.0.pixels()];
        let (mut luma, mut rates) = (room.clone(), rate.then_some(room));
        py.detach(|| self.0.luma(&rays.0, &views, &mut luma, rates.as_deref_mut()))?;
        Ok((luma.into_pyarray(py), rates.map(|rates| rates.into_pyarray(py))))
    }

    fn samples<'py>(
        &self,
        py: Python<'py>,
        rays: &PyPixelRays,
        views: Views<'py>,
        view: &Bound<'py, PyAny>,
        pixel: &Bound<'py, PyAny>,
    ) -> PyResult<Flat<'py, f32>> {
        let (view, pixel) = (column::<u32>(view, "view")?, column::<u32>(pixel, "pixel")?);
        let pixels: Vec<(u32, u32)> = view.as_slice()?.iter().copied().zip(pixel.as_slice()?.iter().copied()).collect();
        let views = self.views(&views)?;
        let mut luma = vec![0f32; pixels.len()];
        py.detach(|| self.0.samples(&rays.0, &views, &pixels, &mut luma))?;
        Ok(luma.into_pyarray(py))
    }

    fn depth<'py>(
        &self,
        py: Python<'py>,
        rays: &PyPixelRays,
        views: Views<'py>,
    ) -> PyResult<(Flat<'py, f32>, Flat<'py, u32>)> {
        let views = self.views(&views)?;
        let size = views.len() * rays.0.pixels();
        let (mut depth, mut owners) = (vec![0f32; size], vec![0u32; size]);
        py.detach(|| self.0.depth(&rays.0, &views, &mut depth, &mut owners))?;
        Ok((depth.into_pyarray(py), owners.into_pyarray(py)))
    }
}

impl PySceneRenderer {
    fn views(&self, views: &Views<'_>) -> PyResult<Vec<View>> {
        let (frames, lights) = (self.0.scene().frames(), self.0.scene().lights());
        let positions = groups::<f64, 3>(&views.0, "positions")?;
        let rotations = groups::<f64, 9>(&views.1, "rotations")?;
        let velocities = groups::<f64, 3>(&views.2, "velocities")?;
        let rates = groups::<f64, 3>(&views.3, "angular_rates")?;
        let (factors, factor_rates) = (column::<f64>(&views.4, "factors")?, column::<f64>(&views.5, "factor_rates")?);
        let count = positions.len() / frames;
        let lengths = [positions.len(), rotations.len(), velocities.len(), rates.len()];
        let of_lights = [factors.as_slice()?.len(), factor_rates.as_slice()?.len()];
        if lengths != [count * frames; 4] || of_lights != [count * lights; 2] {
            return Err(PyValueError::new_err(format!(
                "views of {frames} frames and {lights} lights need as many poses and factors, got {lengths:?}, {of_lights:?}"
            )));
        }
        let of_light = |i: usize| PyResult::Ok([factors.as_slice()?[i], factor_rates.as_slice()?[i]]);
        (0..count)
            .map(|view| {
                Ok(View {
                    poses: (view * frames..(view + 1) * frames)
                        .map(|i| Pose {
                            position: positions[i],
                            rotation: rows(rotations[i]),
                            velocity: velocities[i],
                            angular_rate: rates[i],
                        })
                        .collect(),
                    factors: (view * lights..(view + 1) * lights).map(of_light).collect::<PyResult<_>>()?,
                })
            })
            .collect()
    }
}

fn light((kind, group, strength, background, vector): LightTuple) -> PyResult<Light> {
    let kind = match kind.as_str() {
        "point" => LightKind::Point(vector),
        "directional" => LightKind::Directional(vector),
        "constant" => LightKind::Constant,
        _ => return Err(PyValueError::new_err(format!("a light is point, directional or constant, got {kind:?}"))),
    };
    Ok(Light { kind, group, strength, background })
}

/// A flat array as groups of N numbers.
fn groups<T: Element + Copy, const N: usize>(array: &Bound<'_, PyAny>, name: &str) -> PyResult<Vec<[T; N]>> {
    let array: PyReadonlyArray1<T> = column(array, name)?;
    let (groups, rest) = array.as_slice()?.as_chunks::<N>();
    if !rest.is_empty() {
        return Err(PyValueError::new_err(format!(
            "{name} must be groups of {N}, got {} numbers",
            array.as_slice()?.len()
        )));
    }
    Ok(groups.to_vec())
}

/// Rows of a matrix.
fn rows<const N: usize, const M: usize, const K: usize>(flat: [f64; N]) -> [[f64; M]; K] {
    std::array::from_fn(|i| std::array::from_fn(|j| flat[i * M + j]))
}
