//! `SceneRenderer` and `PixelRays` for Python.

use std::borrow::Cow;

use numpy::{Element, IntoPyArray, PyArray1, PyReadonlyArray1};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use super::arrays::column;
use crate::render::{
    BEFORE_LIGHTS, Beam, EdgeTracks, Emission, Light, LightKind, LightMapTables, PixelRays, Pose, RaySight, Renderer,
    Scene, SceneTables, Sky, TrackSettings, View,
};

/// The lattice rays of a sensor's pixels, as undistorted image coordinates.
///
/// Args:
///     width, height: of the sensor, in pixels, 1..65535.
///     rays: rays of each pixel, 1..1024.
///     table: float32 (rays * height * width * 2), flat: x and y of the direction (x, y, 1) in camera axes, by ray of
///         the lattice and pixel, row by row.
///
/// Raises:
///     ValueError: for a size or number of rays out of range, or a table of another length or with numbers that are not
///         finite.
#[pyclass(name = "PixelRays", module = "davis_rs._core", frozen)]
pub(super) struct PyPixelRays(PixelRays);

#[pymethods]
impl PyPixelRays {
    #[new]
    fn new(width: usize, height: usize, rays: usize, table: &Bound<'_, PyAny>) -> PyResult<Self> {
        Ok(Self(PixelRays::new(width, height, rays, column::<f32>(table, "table")?.as_slice()?)?))
    }

    /// Make the rays of a sensor from tables of a few rows each, so that no table of all of them is needed.
    ///
    /// Args:
    ///     width, height, rays: as for the class.
    ///     rows: rows of the image in a table, a multiple of 8; the last one may have fewer.
    ///     next: called with the first row of a part; returns its table, as that of the class.
    ///
    /// Raises:
    ///     ValueError: as the class does.
    #[staticmethod]
    fn from_parts(width: usize, height: usize, rays: usize, rows: usize, next: &Bound<'_, PyAny>) -> PyResult<Self> {
        let part = |first: usize| -> PyResult<Vec<f32>> {
            Ok(column::<f32>(&next.call1((first,))?, "table")?.as_slice()?.to_vec())
        };
        Ok(Self(PixelRays::from_parts(width, height, rays, rows, part)?))
    }

    /// Make the rays of a sensor without distortion. They take next to no memory, and have the bits of a table.
    ///
    /// Args:
    ///     width, height, rays: as for the class.
    ///     x: float32 (rays * width), flat: x of (x, y, 1) by ray of the lattice and column.
    ///     y: float32 (rays * height), flat: y by ray of the lattice and row.
    ///
    /// Raises:
    ///     ValueError: as the class does.
    #[staticmethod]
    fn grid(width: usize, height: usize, rays: usize, x: &Bound<'_, PyAny>, y: &Bound<'_, PyAny>) -> PyResult<Self> {
        let (x, y) = (column::<f32>(x, "x")?, column::<f32>(y, "y")?);
        Ok(Self(PixelRays::grid(width, height, rays, x.as_slice()?, y.as_slice()?)?))
    }

    fn __repr__(&self) -> String {
        format!("PixelRays({} x {}, rays={})", self.0.width(), self.0.height(), self.0.rays())
    }
}

/// Renders diffuse triangles under direct light: luma, its rate, and depth.
///
/// Each pixel has the same bits in any batch of views and on any number of threads. The steps are those of
/// docs/rendering.md. Arrays are flat; t is the number of triangles. Each triangle is in the coordinates of its own
/// frame: the world, or a body that moves.
///
/// Args:
///     corners: float64 (t, 3, 3), metres.
///     planes: float64 (t, 4), unit normal n on the front side and offset d, n . p + d = 0.
///     u_maps, v_maps: float64 (t, 4), affine maps of a place (x, y, z, 1) to texture coordinates.
///     normal_maps: float64 (t, 3, 4), those to the shading normal; None where all triangles are flat.
///     textures: uint32 (t), the number of the triangle's texture.
///     two_sided: uint32 (t), 1 where the back of the triangle reflects too.
///     frames: uint32 (t), 0 for the world, 1, 2, ... for bodies.
///     frame_count: frames in all, with the world's.
///     layouts: int64 (textures, 4): first texel, width, height, wrap mode (0 repeat, 1 clamp, 2 mirror).
///     texels: for each light colour float32, all texels as luma, with a frame of one texel around each texture.
///     lights: of each light (kind, colour, strength, background luma per strength, vector, beam). The kind is
///         ``point``, whose vector is its place, ``directional``, whose vector is the unit vector along which it
///         travels, ``constant``, ``baked``, or ``visible``: baked lights take the light maps' texels one after the
///         other, and visible ones fall on nothing, but emissions and the sky are theirs. The beam is that of a point:
///         None where it shines alike to all sides; (unit vector, None) where it does with the cosine of the angle to
///         it; (unit vector, (full, cutoff)) for a spot, with the angles from it up to which it shines fully, and at
///         all.
///     light_maps: irradiance that was computed beforehand, None where there is none: u_maps and v_maps, float64
///         (t, 2 sides, 4), affine maps of a place to coordinates in the map of the triangle's front and back; layouts,
///         int64 (t, 2 sides, 4), as those of textures; for each baked light float32, all texels as irradiance / pi.
///     emissions: luma that each triangle emits from its front, and the number of its light: float64 (t) and uint32
///         (t); None where none does.
///     sky: what rays see that hit nothing: the number of its light, the side of its octahedral map, and float32
///         (side + 2, side + 2) luma with a frame of one texel; None where that is the lights' background alone.
///     shadows: whether point and directional lights throw shadows.
///     centre: (3), metres, the middle of the scene.
///     step, end: where shadow rays begin and end, see :mod:`davis_rs.render.rays.shadow_rays`.
///     threads: None for as many as there are processors.
///
/// Raises:
///     ValueError: for arrays that do not belong together, or no threads.
#[pyclass(name = "SceneRenderer", module = "davis_rs._core", frozen)]
pub(super) struct PySceneRenderer(Renderer);

/// Where cameras are, and what surrounds them: positions, rotations, velocities and rates of each view in each frame;
/// factors and their rates of each view and light.
type Views<'py> =
    (Bound<'py, PyAny>, Bound<'py, PyAny>, Bound<'py, PyAny>, Bound<'py, PyAny>, Bound<'py, PyAny>, Bound<'py, PyAny>);

/// An array without its shape.
type Flat<'py, T> = Bound<'py, PyArray1<T>>;

/// Pixels, those with something unseen, the samples' pixels, instants and luma, and how much was rendered.
type TrackTuple<'py> = (Flat<'py, u32>, Flat<'py, u32>, Flat<'py, u32>, Flat<'py, i64>, Flat<'py, f32>, usize);

/// Kind, group, strength, background, vector and beam of a light.
type LightTuple = (String, u32, f64, f64, [f64; 3], Option<([f64; 3], Option<(f64, f64)>)>);

/// `u_maps`, `v_maps`, layouts and texels of the light maps.
type LightMapTuple<'py> = (Bound<'py, PyAny>, Bound<'py, PyAny>, Bound<'py, PyAny>, Vec<Bound<'py, PyAny>>);

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
        light_maps=None,
        emissions=None,
        sky=None,
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
        light_maps: Option<LightMapTuple<'_>>,
        emissions: Option<(Bound<'_, PyAny>, Bound<'_, PyAny>)>,
        sky: Option<(u32, usize, Bound<'_, PyAny>)>,
        shadows: bool,
        centre: [f64; 3],
        step: f64,
        end: f64,
        threads: Option<usize>,
    ) -> PyResult<Self> {
        let (corners, planes) = (column::<f64>(corners, "corners")?, column::<f64>(planes, "planes")?);
        let (u_maps, v_maps) = (column::<f64>(u_maps, "u_maps")?, column::<f64>(v_maps, "v_maps")?);
        let normal_maps = normal_maps.map(|maps| column::<f64>(maps, "normal_maps")).transpose()?;
        let tables = SceneTables {
            corners: matrices(&corners, "corners")?.into(),
            planes: grouped(&planes, "planes")?.into(),
            u_maps: grouped(&u_maps, "u_maps")?.into(),
            v_maps: grouped(&v_maps, "v_maps")?.into(),
            normal_maps: match &normal_maps {
                None => Cow::default(),
                Some(maps) => matrices(maps, "normal_maps")?.into(),
            },
            textures: column::<u32>(textures, "textures")?.as_slice()?.to_vec(),
            two_sided: column::<u32>(two_sided, "two_sided")?.as_slice()?.iter().map(|&flag| flag != 0).collect(),
            frames: column::<u32>(frames, "frames")?.as_slice()?.to_vec(),
            frame_count,
            layouts: groups(layouts, "layouts")?,
            texels: texels
                .iter()
                .map(|group| PyResult::Ok(column::<f32>(group, "texels")?.as_slice()?.to_vec()))
                .collect::<PyResult<_>>()?,
            lights: numbered(lights)?,
            light_maps: light_maps.map_or(Ok(LightMapTables::default()), light_map_tables)?,
            emissions: emissions.map_or(Ok(vec![]), emission_table)?,
            sky: sky
                .map(|(light, side, texels)| {
                    PyResult::Ok(Sky { light, side, texels: column::<f32>(&texels, "sky")?.as_slice()?.to_vec() })
                })
                .transpose()?,
            shadows,
            centre,
            step,
            end,
        };
        Ok(Self(Renderer::new(Scene::new(&tables)?, threads)?))
    }

    /// Render linear luma of each view, and its rate.
    ///
    /// Args:
    ///     rays: of the sensor.
    ///     views: the camera at n instants in each of f frames, under l lights, as six flat float64 arrays: places
    ///         (n, f, 3) in metres; rotations (n, f, 3, 3) that take camera axes to the frame's; velocities (n, f, 3)
    ///         in the frame's axes, m/s; angular rates (n, f, 3) in camera axes, rad/s; factors (n, l) on the strengths
    ///         of the lights; the rates of these factors (n, l), 1/s.
    ///     rate: whether the rate is computed too.
    ///
    /// Returns:
    ///     Luma, float32, flat (n, height, width), and its rate per second in the same shape, None where it was not
    ///     asked for.
    ///
    /// Raises:
    ///     ValueError: for views of another number of frames or lights than the scene has.
    #[pyo3(signature = (rays, views, *, rate=false))]
    fn luma<'py>(
        &self,
        py: Python<'py>,
        rays: &PyPixelRays,
        views: Views<'py>,
        rate: bool,
    ) -> PyResult<(Flat<'py, f32>, Option<Flat<'py, f32>>)> {
        let views = self.views(&views)?;
        let room = || vec![0f32; views.len() * rays.0.pixels()];
        let (mut luma, mut rates) = (room(), rate.then(room));
        py.detach(|| self.0.luma(&rays.0, &views, &mut luma, rates.as_deref_mut()))?;
        Ok((luma.into_pyarray(py), rates.map(|rates| rates.into_pyarray(py))))
    }

    /// Render luma of single pixels, the bits of :meth:`luma`.
    ///
    /// Args:
    ///     rays: of the sensor.
    ///     views: as in :meth:`luma`.
    ///     view, pixel: uint32 (k), the number of the view, and of the pixel, row by row.
    ///
    /// Returns:
    ///     Luma, float32 (k).
    ///
    /// Raises:
    ///     ValueError: for views that do not fit the scene, or a view or pixel that is not there.
    fn samples<'py>(
        &self,
        py: Python<'py>,
        rays: &PyPixelRays,
        views: Views<'py>,
        view: &Bound<'py, PyAny>,
        pixel: &Bound<'py, PyAny>,
    ) -> PyResult<Flat<'py, f32>> {
        let (pixels, views) = (view_pixels(view, pixel)?, self.views(&views)?);
        let mut luma = vec![0f32; pixels.len()];
        py.detach(|| self.0.samples(&rays.0, &views, &pixels, &mut luma))?;
        Ok(luma.into_pyarray(py))
    }

    /// Render luma of the pixels that edges pass, through spans of time.
    ///
    /// Args:
    ///     rays: of the sensor.
    ///     views: as in :meth:`luma`, five of each of n spans: at its ends, its middle, and about half way between.
    ///     t_us: int64 (n * 5), flat: when these are, in whole microseconds.
    ///     reach: how many pixels away, in x or y, the farthest one lies whose luma a pixel takes.
    ///     tolerated: change of log luma that is tolerated.
    ///     log_eps: the dark level, in luma.
    ///
    /// Returns:
    ///     Of each span: uint32 (p), increasing, the pixels that edges pass, and those that take luma from them;
    ///     uint32, those of them that do what neither edges nor their rates tell; samples by pixel and time,
    ///     between which luma changes evenly: uint32 (m), the pixel; int64 (m), microseconds within the span;
    ///     float32 (m), luma; and how many pixels were rendered, one at several instants counted so often. With a
    ///     reach the samples are those of all pixels that luma is taken from, the span's ends among them.
    ///
    /// Raises:
    ///     ValueError: for views that do not fit the scene or the instants, or instants that do not increase in a span.
    #[pyo3(signature = (rays, views, t_us, *, reach, tolerated, log_eps))]
    #[allow(clippy::too_many_arguments, reason = "keywords in Python")]
    fn edge_tracks<'py>(
        &self,
        py: Python<'py>,
        rays: &PyPixelRays,
        views: Views<'py>,
        t_us: &Bound<'py, PyAny>,
        reach: usize,
        tolerated: f32,
        log_eps: f32,
    ) -> PyResult<Vec<TrackTuple<'py>>> {
        let (views, t_us) = (self.views(&views)?, column::<i64>(t_us, "t_us")?.as_slice()?.to_vec());
        let settings = TrackSettings { reach, tolerated, log_eps };
        let tracks = py.detach(|| self.0.edge_tracks(&rays.0, &views, &t_us, settings))?;
        let tuple = |tracks: EdgeTracks| {
            (
                tracks.pixels.into_pyarray(py),
                tracks.unknown.into_pyarray(py),
                tracks.sample_pixel.into_pyarray(py),
                tracks.sample_t_us.into_pyarray(py),
                tracks.sample_luma.into_pyarray(py),
                tracks.rendered,
            )
        };
        Ok(tracks.into_iter().map(tuple).collect())
    }

    /// Find what the pixels' rays hit.
    ///
    /// Args:
    ///     rays: of the sensor, one ray a pixel.
    ///     views: as in :meth:`luma`.
    ///
    /// Returns:
    ///     Depth, float32, flat (n, height, width): z in camera axes, metres, inf where nothing is hit; and the number
    ///     of the triangle that is hit, uint32 in the same shape, 2^32 - 1 where none is.
    ///
    /// Raises:
    ///     ValueError: for views that do not fit the scene, or more than one ray a pixel.
    fn depth<'py>(
        &self,
        py: Python<'py>,
        rays: &PyPixelRays,
        views: Views<'py>,
    ) -> PyResult<(Flat<'py, f32>, Flat<'py, u32>)> {
        let views = self.views(&views)?;
        let size = views.len() * rays.0.pixels();
        let (mut depth, mut triangles) = (vec![0f32; size], vec![0u32; size]);
        py.detach(|| self.0.depth(&rays.0, &views, &mut depth, &mut triangles))?;
        Ok((depth.into_pyarray(py), triangles.into_pyarray(py)))
    }

    /// Find what the rays of single pixels hit, the bits of :meth:`depth`.
    ///
    /// Args:
    ///     rays: of the sensor, one ray a pixel.
    ///     views: as in :meth:`luma`.
    ///     view, pixel: uint32 (k), the number of the view, and of the pixel, row by row.
    ///
    /// Returns:
    ///     Depth, float32 (k), and the number of the triangle, uint32 (k), as in :meth:`depth`.
    ///
    /// Raises:
    ///     ValueError: for views that do not fit the scene, a view or pixel that is not there, or more than one ray a
    ///         pixel.
    fn hits<'py>(
        &self,
        py: Python<'py>,
        rays: &PyPixelRays,
        views: Views<'py>,
        view: &Bound<'py, PyAny>,
        pixel: &Bound<'py, PyAny>,
    ) -> PyResult<(Flat<'py, f32>, Flat<'py, u32>)> {
        let (pixels, views) = (view_pixels(view, pixel)?, self.views(&views)?);
        let mut found = vec![(0f32, 0u32); pixels.len()];
        py.detach(|| self.0.hits(&rays.0, &views, &pixels, &mut found))?;
        let (depth, triangles): (Vec<f32>, Vec<u32>) = found.into_iter().unzip();
        Ok((depth.into_pyarray(py), triangles.into_pyarray(py)))
    }

    /// Compute luma of single pixels in float64, or of weighted sums of pixels, each with its derivatives.
    ///
    /// Which surface a ray meets, and whether a light is hidden from it, is taken as fixed.
    ///
    /// Args:
    ///     rays: of the sensor.
    ///     views: as in :meth:`luma`.
    ///     view: uint32 (k), the number of the view.
    ///     pixel: uint32 (k * m), flat: the pixels that are added up, row by row.
    ///     weights: float64 (m), by which they are multiplied before.
    ///
    /// Returns:
    ///     float64, flat (k, 8 + l): luma; its rate per second; its derivatives by the camera's position in world axes
    ///     (3, per metre), and by a rotation vector in camera axes (3, per radian); and the part of each of l lights in
    ///     it, which is the derivative by the logarithm of the light's strength.
    ///
    /// Raises:
    ///     ValueError: for views that do not fit the scene, a view or pixel that is not there, or another number of
    ///         pixels.
    fn gradients<'py>(
        &self,
        py: Python<'py>,
        rays: &PyPixelRays,
        views: Views<'py>,
        view: &Bound<'py, PyAny>,
        pixel: &Bound<'py, PyAny>,
        weights: &Bound<'py, PyAny>,
    ) -> PyResult<Flat<'py, f64>> {
        let views = self.views(&views)?;
        let view = column::<u32>(view, "view")?.as_slice()?.to_vec();
        let pixel = column::<u32>(pixel, "pixel")?.as_slice()?.to_vec();
        let weights = column::<f64>(weights, "weights")?.as_slice()?.to_vec();
        let mut gradients = vec![0.0; view.len() * (BEFORE_LIGHTS + self.0.scene().lights())];
        py.detach(|| self.0.gradients(&rays.0, &views, &view, &pixel, &weights, &mut gradients))?;
        Ok(gradients.into_pyarray(py))
    }

    /// Compute derivatives of single pixels' luma by texels in float64, or of weighted sums of pixels.
    ///
    /// Which surface a ray meets, whether a light is hidden from it, and light that bounces, is taken as fixed.
    ///
    /// Args:
    ///     rays, views, view, pixel, weights: as in :meth:`gradients`.
    ///     steps: float64 (g), by how much the texels of each light colour change for a unit.
    ///
    /// Returns:
    ///     How many texels each of the k sums sees, uint32 (k); their numbers in the buffer of texels that the scene
    ///     was made with, ascending for each sum, uint32, flat, one sum's after the other's; and luma by the unit,
    ///     float64, as many.
    ///
    /// Raises:
    ///     ValueError: for views that do not fit the scene, a view or pixel that is not there, or another number of
    ///         pixels or steps.
    #[allow(clippy::too_many_arguments, reason = "one pixel's, and the weights")]
    fn texel_gradients<'py>(
        &self,
        py: Python<'py>,
        rays: &PyPixelRays,
        views: Views<'py>,
        view: &Bound<'py, PyAny>,
        pixel: &Bound<'py, PyAny>,
        weights: &Bound<'py, PyAny>,
        steps: &Bound<'py, PyAny>,
    ) -> PyResult<(Flat<'py, u32>, Flat<'py, u32>, Flat<'py, f64>)> {
        let views = self.views(&views)?;
        let view = column::<u32>(view, "view")?.as_slice()?.to_vec();
        let pixel = column::<u32>(pixel, "pixel")?.as_slice()?.to_vec();
        let weights = column::<f64>(weights, "weights")?.as_slice()?.to_vec();
        let steps = column::<f64>(steps, "steps")?.as_slice()?.to_vec();
        let found = py.detach(|| self.0.texel_gradients(&rays.0, &views, &view, &pixel, &weights, &steps))?;
        Ok((found.counts.into_pyarray(py), found.texels.into_pyarray(py), found.values.into_pyarray(py)))
    }

    /// Find what each ray of single pixels sees, in float64.
    ///
    /// Args:
    ///     rays: of the sensor, r rays a pixel.
    ///     views: as in :meth:`luma`.
    ///     view, pixel: uint32 (k), the number of the view, and of the pixel, row by row.
    ///
    /// Returns:
    ///     The number of the triangle that is hit, uint32, flat (k, r), 2^32 - 1 where none is; which lights are hidden
    ///     from the place, uint64 in the same shape: bit n mod 64 is turned over for each light n that something hides;
    ///     and luma, float64 in the same shape.
    ///
    /// Raises:
    ///     ValueError: for views that do not fit the scene, or a view or pixel that is not there.
    fn ray_sights<'py>(
        &self,
        py: Python<'py>,
        rays: &PyPixelRays,
        views: Views<'py>,
        view: &Bound<'py, PyAny>,
        pixel: &Bound<'py, PyAny>,
    ) -> PyResult<(Flat<'py, u32>, Flat<'py, u64>, Flat<'py, f64>)> {
        let views = self.views(&views)?;
        let (view, pixel): (Vec<u32>, Vec<u32>) = view_pixels(view, pixel)?.into_iter().unzip();
        let mut sights = vec![RaySight::default(); pixel.len() * rays.0.rays()];
        py.detach(|| self.0.ray_sights(&rays.0, &views, &view, &pixel, &mut sights))?;
        let triangles: Vec<u32> = sights.iter().map(|sight| sight.triangle).collect();
        let hidden: Vec<u64> = sights.iter().map(|sight| sight.hidden).collect();
        let luma: Vec<f64> = sights.iter().map(|sight| sight.luma).collect();
        Ok((triangles.into_pyarray(py), hidden.into_pyarray(py), luma.into_pyarray(py)))
    }

    fn __repr__(&self) -> String {
        let scene = self.0.scene();
        let shadows = if scene.shadows() { "True" } else { "False" };
        let threads = self.0.threads().map_or("None".to_owned(), |threads| threads.to_string());
        format!(
            "SceneRenderer(triangles={}, frames={}, lights={}, shadows={shadows}, threads={threads})",
            scene.triangles(),
            scene.frames(),
            scene.lights()
        )
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

/// Pixels as a view and a pixel in it.
fn view_pixels(view: &Bound<'_, PyAny>, pixel: &Bound<'_, PyAny>) -> PyResult<Vec<(u32, u32)>> {
    let (view, pixel) = (column::<u32>(view, "view")?, column::<u32>(pixel, "pixel")?);
    let (view, pixel) = (view.as_slice()?, pixel.as_slice()?);
    if view.len() != pixel.len() {
        return Err(PyValueError::new_err(format!(
            "view and pixel must be of one length, got {} and {}",
            view.len(),
            pixel.len()
        )));
    }
    Ok(view.iter().copied().zip(pixel.iter().copied()).collect())
}

/// Lights, of which those that are baked are numbered.
fn numbered(lights: Vec<LightTuple>) -> PyResult<Vec<Light>> {
    let mut baked = 0..;
    lights.into_iter().map(|tuple| light(tuple, &mut baked)).collect()
}

fn light_map_tables((u_maps, v_maps, layouts, texels): LightMapTuple<'_>) -> PyResult<LightMapTables> {
    let (u_maps, v_maps) = (groups::<f64, 4>(&u_maps, "u_maps")?, groups::<f64, 4>(&v_maps, "v_maps")?);
    if u_maps.len() != v_maps.len() {
        return Err(PyValueError::new_err(format!(
            "{} u_maps need as many v_maps, got {}",
            u_maps.len(),
            v_maps.len()
        )));
    }
    Ok(LightMapTables {
        uv_maps: u_maps.into_iter().zip(v_maps).map(|(u, v)| [u, v]).collect(),
        layouts: groups(&layouts, "layouts")?,
        texels: texels
            .iter()
            .map(|map| PyResult::Ok(column::<f32>(map, "texels")?.as_slice()?.to_vec()))
            .collect::<PyResult<_>>()?,
    })
}

/// What triangles emit; those of luma 0 nothing.
fn emission_table((lumas, lights): (Bound<'_, PyAny>, Bound<'_, PyAny>)) -> PyResult<Vec<Option<Emission>>> {
    let (lumas, lights) = (column::<f64>(&lumas, "emissions")?, column::<u32>(&lights, "emissions")?);
    let (lumas, lights) = (lumas.as_slice()?, lights.as_slice()?);
    if lumas.len() != lights.len() {
        return Err(PyValueError::new_err(format!(
            "{} emissions need as many lights, got {}",
            lumas.len(),
            lights.len()
        )));
    }
    Ok(lumas.iter().zip(lights).map(|(&luma, &light)| (luma != 0.0).then_some(Emission { light, luma })).collect())
}

fn light(
    (kind, group, strength, background, vector, beam): LightTuple,
    baked: &mut impl Iterator<Item = u32>,
) -> PyResult<Light> {
    let kind = match kind.as_str() {
        "point" => LightKind::Point(vector),
        "directional" => LightKind::Directional(vector),
        "constant" => LightKind::Constant,
        "baked" => LightKind::Baked(baked.next().unwrap_or(u32::MAX)),
        "visible" => LightKind::Visible,
        _ => {
            return Err(PyValueError::new_err(format!(
                "a light is point, directional, constant, baked or visible, got {kind:?}"
            )));
        }
    };
    let beam = beam.map(|(axis, angles)| match angles {
        None => Beam::Cosine(axis),
        Some((full, cutoff)) => Beam::Spot { axis, full, cutoff },
    });
    Ok(Light { kind, group, strength, background, beam })
}

/// A flat array as groups of N numbers.
fn groups<T: Element + Copy, const N: usize>(array: &Bound<'_, PyAny>, name: &str) -> PyResult<Vec<[T; N]>> {
    Ok(grouped(&column(array, name)?, name)?.to_vec())
}

/// As [`groups`], without a copy.
fn grouped<'a, T: Element, const N: usize>(array: &'a PyReadonlyArray1<'_, T>, name: &str) -> PyResult<&'a [[T; N]]> {
    match array.as_slice()?.as_chunks::<N>() {
        (groups, []) => Ok(groups),
        _ => Err(no_groups(N, array.len()?, name)),
    }
}

/// A flat array as matrices of K rows of M numbers, without a copy.
fn matrices<'a, const M: usize, const K: usize>(
    array: &'a PyReadonlyArray1<'_, f64>,
    name: &str,
) -> PyResult<&'a [[[f64; M]; K]]> {
    let (rows, rest) = array.as_slice()?.as_chunks::<M>();
    match (rows.as_chunks::<K>(), rest) {
        ((matrices, []), []) => Ok(matrices),
        _ => Err(no_groups(K * M, array.len()?, name)),
    }
}

fn no_groups(size: usize, got: usize, name: &str) -> PyErr {
    PyValueError::new_err(format!("{name} must be groups of {size}, got {got} numbers"))
}

/// Rows of a matrix.
fn rows<const N: usize, const M: usize, const K: usize>(flat: [f64; N]) -> [[f64; M]; K] {
    std::array::from_fn(|i| std::array::from_fn(|j| flat[i * M + j]))
}
