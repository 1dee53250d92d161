//! `SceneRenderer` for Python.

use std::borrow::Cow;
use std::sync::{PoisonError, RwLock, RwLockReadGuard};

use numpy::{IntoPyArray, PyArray1};
use pyo3::prelude::*;

use super::pixel_rays::PyPixelRays;
use super::scene_tables::{
    EmissionTuple, GlossTuple, LightMapColumns, LightMapTuple, LightTuple, NormalTextureTuple, SkyTuple, SlideTuple,
    emission_table, gloss_tables, normal_texture_tables, numbered, sky_map, slide_of,
};
use super::views::{Views, view_pixels, views_of};
use crate::python::arrays::{column, flags, grouped, groups, matrices, numbers};
use crate::render::{
    BEFORE_LIGHTS, Deformed, GlossTables, LightMapTables, LinePattern, NormalTextureTables, RayHit, Renderer, Scene,
    SceneTables, View,
};

/// Renders diffuse triangles under direct light: luma, its rate, and depth.
///
/// Each pixel has the same bits in any batch of views and on any number of threads. The steps are those of
/// docs/rendering.md. Arrays are flat; t is the number of triangles. Each triangle is in the coordinates of its own
/// frame: the world, or a body that moves.
///
/// Args:
///     corners: float64 (t, 3, 3), metres.
///     planes: float64 (t, 4), unit normal n on the front side and offset d, n . p + d = 0.
///     u_maps, v_maps: float64 (t, 4), affine maps of a point (x, y, z, 1) to texture coordinates.
///     normal_maps: float64 (t, 3, 4), those to the shading normal; None where all triangles are flat.
///     textures: uint32 (t), the number of the triangle's texture.
///     two_sided: uint32 (t), 1 where the back of the triangle reflects too.
///     culled: uint32 (t), 1 where the back is culled: from behind, neither a camera nor a mirror sees the triangle,
///         which throws shadows all the same; None where no triangle is so.
///     hidden: uint32 (t), 1 where the camera sees through the triangle, which mirrors see and which throws shadows all
///         the same; None where no triangle is so.
///     frames: uint32 (t), 0 for the world, 1, 2, ... for bodies.
///     frame_count: frames in all, with the world's.
///     layouts: int64 (textures, 4): first texel, width, height, wrap mode (0 repeat, 1 clamp, 2 mirror).
///     texels: for each light colour float32, all texels as luma, with a frame of one texel around each texture.
///     lights: of each light (kind, colour, strength, background luma per strength, vector, beam, slide). The kind is
///         ``point``, whose vector is its position, ``directional``, whose vector is the unit vector along which it
///         travels, ``constant``, ``baked``, or ``visible``: baked lights take the light maps' texels one after the
///         other, and visible ones fall on nothing, but emissions and the sky are theirs. The beam is that of a point:
///         None where it shines alike to all sides; (unit vector, None) where it does with the cosine of the angle to
///         it; (unit vector, (full, cutoff)) for a spot, with the angles from it up to which it shines fully, and at
///         all. The slide is that before a point: its number and which of its planes counts, or None.
///     light_maps: irradiance that was computed beforehand, None where there is none: u_maps and v_maps, float64
///         (t, 2 sides, 4), affine maps of a point to coordinates in the map of the triangle's front and back; layouts,
///         int64 (t, 2 sides, 4), as those of textures; for each baked light all texels as irradiance / pi, as
///         (float32 (texels, channels), flat, the number of channels, and the light's own channel);
///         and None, or where normal textures turn surfaces the part of irradiance vectors / pi along these: layouts,
///         and for each baked light three such of x, y and z in the triangle's frame.
///     emissions: luma that each triangle emits from its front, and the number of its light: float64 (t) and uint32
///         (t); None where none does.
///     sky: what rays see that hit nothing: the number of its light, the side of its octahedral map, and float32
///         (side + 2, side + 2) luma with a frame of one texel; None where that is the lights' background alone.
///     gloss: surfaces that are not diffuse; None where all are. The finishes, each (roughness along u and, if that
///         differs, across it or None, ``ggx`` or
///         ``beckmann``, Fresnel's equations, tint of the lobe, tint of what passes through, whether the base
///         colour tints the lobe, what is below, the numbers of textures of roughness and of metal or None,
///         (strength, roughness) of a coat or None, (strength, tint) of sheen or None, and the fraction of a mix that
///         light passes);
///         uint32 (t), the finish of each triangle, 2^32 - 1 for none; the colours of textures: uint32
///         (textures), the number of each one's image, and for each image (width, height, wrap mode), and its texels
///         (height, width, 3), flat, as float32 and None, or as uint8 and float32 (256, 3), flat, what each number
///         stands for in red, green and blue; for each light
///         colour what strength 1 is in red, green and blue; for each light such a background; float64 (t, 3),
///         radiance that each triangle emits, or nothing; the number of a sky's light, its side and float32 (side,
///         side, 3); the most segments of a path; layouts and float32 texels of the textures of roughness and metal,
///         as those of other textures; and emissive textures: uint32 (textures), the number of the one on the same
///         triangles, 2^32 - 1 for none, or nothing; their layouts, the numbers of their lights, and float32 (texels,
///         3), radiance from either side. Fresnel's equations are (``dielectric``, [index]), (``conductor``, [index
///         and extinction, 3 each]) or (``mixed``, [index, metal, tint]). Below is (``nothing``, []), (``coated``,
///         [index, reflected inside, entering, 1 if nonlinear, and of a rough coat what passes at 33 cosines from 0 to
///         1]), (``rough``, [roughness, factor]), (``solid``, [index, and what is absorbed inside per unit of length, 3
///         channels]), (``sheet``, [index]) or (``blend``, [opacity], whose texture takes the place of that of
///         roughness).
///     normal_textures: which way the texels of surfaces face; None where no surface has any. uint32 (textures), the
///         number of the normal texture on the same triangles, 2^32 - 1 for none; layouts, as those of textures; uint16
///         (texels, 3), components along the tangent, the second tangent and the normal, from -1 (0) to 1 (65,535),
///         or of a bump map its height in metres: the lower and the upper half of a float32, and 0; for each, whether
///         it is a bump map; for each, whether light fades where a turned normal faces it and the surface hardly
///         does; and whether all follow glTF's rule for mirrored texture coordinates and backs, or Mitsuba's.
///     slides: what lights throw on surfaces, each (rows, map, projected, nearest, layout, texels). Rows (3, 3) are
///         vectors of the world for u, v and depth: a place that lies ``away`` from the light has u = rows[0] . away /
///         rows[2] . away, and v likewise; the last one is the unit vector along which the light looks. The map (2, 3)
///         takes (u, v, 1) to the coordinates of the texture. A slide that is ``projected`` ends where u or v leave
///         0..1, and has the third power of one over the cosine to the last row as a factor; ``nearest`` takes the
///         nearest texel in place of a mix of four. The layout is (width, height, wrap mode); texels are float32, one
///         plane or three (red, green, blue), each in a frame of one texel. None where there are none.
///     shadows: whether point and directional lights throw shadows.
///     centre: (3), metres, the middle of the scene.
///     step, end: where shadow rays begin and end, see :mod:`davis_rs.render.rays.shadow_rays`.
///     threads: None for as many as there are processors.
///
/// Raises:
///     ValueError: for arrays that do not belong together, or no threads.
#[pyclass(name = "SceneRenderer", module = "davis_rs._core", frozen)]
pub(crate) struct PySceneRenderer {
    /// Who waits for it, or holds it, does not hold Python's lock: two threads could wait for each other.
    renderer: RwLock<Renderer>,
    frames: usize,
    lights: usize,
}

impl PySceneRenderer {
    /// Returns the renderer, which nobody deforms meanwhile.
    fn renderer(&self) -> RwLockReadGuard<'_, Renderer> {
        // Who deforms checks first, and then does not fail.
        self.renderer.read().unwrap_or_else(PoisonError::into_inner)
    }

    fn views(&self, views: &Views<'_>) -> PyResult<Vec<View>> {
        views_of(self.frames, self.lights, views)
    }
}

/// An array without its shape.
type Flat<'py, T> = Bound<'py, PyArray1<T>>;

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
        culled=None,
        hidden=None,
        frames,
        frame_count,
        layouts,
        texels,
        lights,
        light_maps=None,
        emissions=None,
        sky=None,
        gloss=None,
        normal_textures=None,
        slides=None,
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
        culled: Option<&Bound<'_, PyAny>>,
        hidden: Option<&Bound<'_, PyAny>>,
        frames: &Bound<'_, PyAny>,
        frame_count: usize,
        layouts: &Bound<'_, PyAny>,
        texels: Vec<Bound<'_, PyAny>>,
        lights: Vec<LightTuple>,
        light_maps: Option<LightMapTuple<'_>>,
        emissions: Option<EmissionTuple<'_>>,
        sky: Option<SkyTuple<'_>>,
        gloss: Option<GlossTuple<'_>>,
        normal_textures: Option<NormalTextureTuple<'_>>,
        slides: Option<Vec<SlideTuple<'_>>>,
        shadows: bool,
        centre: [f64; 3],
        step: f64,
        end: f64,
        threads: Option<usize>,
    ) -> PyResult<Self> {
        let (corners, planes) = (column::<f64>(corners, "corners")?, column::<f64>(planes, "planes")?);
        let (u_maps, v_maps) = (column::<f64>(u_maps, "u_maps")?, column::<f64>(v_maps, "v_maps")?);
        let normal_maps = normal_maps.map(|maps| column::<f64>(maps, "normal_maps")).transpose()?;
        let light_maps = light_maps.map(LightMapColumns::new).transpose()?;
        // Texels may be the largest of all: none are copied here.
        let texels = texels.iter().map(|texels| column::<f32>(texels, "texels")).collect::<PyResult<Vec<_>>>()?;
        let tables = SceneTables {
            corners: matrices(&corners, "corners")?.into(),
            planes: grouped(&planes, "planes")?.into(),
            u_maps: grouped(&u_maps, "u_maps")?.into(),
            v_maps: grouped(&v_maps, "v_maps")?.into(),
            normal_maps: match &normal_maps {
                None => Cow::default(),
                Some(maps) => matrices(maps, "normal_maps")?.into(),
            },
            textures: numbers::<u32>(textures, "textures")?,
            two_sided: flags(two_sided, "two_sided")?,
            culled: culled.map_or(Ok(vec![]), |culled| flags(culled, "culled"))?,
            hidden: hidden.map_or(Ok(vec![]), |hidden| flags(hidden, "hidden"))?,
            frames: numbers::<u32>(frames, "frames")?,
            frame_count,
            layouts: groups(layouts, "layouts")?,
            texels: texels.iter().map(|texels| Ok(texels.as_slice()?.into())).collect::<PyResult<_>>()?,
            lights: numbered(lights)?,
            slides: slides.unwrap_or_default().into_iter().map(slide_of).collect::<PyResult<_>>()?,
            light_maps: light_maps.as_ref().map_or(Ok(LightMapTables::default()), LightMapColumns::tables)?,
            emissions: emissions.map_or(Ok(vec![]), emission_table)?,
            sky: sky.map(sky_map).transpose()?,
            normal_textures: normal_textures.map_or(Ok(NormalTextureTables::default()), normal_texture_tables)?,
            gloss: gloss.map_or(Ok(GlossTables::default()), gloss_tables)?,
            shadows,
            centre,
            step,
            end,
        };
        let renderer = Renderer::new(Scene::new(&tables)?, threads)?;
        let (frames, lights) = (renderer.scene().frames(), renderer.scene().lights());
        Ok(Self { renderer: RwLock::new(renderer), frames, lights })
    }

    /// Deform the mesh of a body: what is rendered after this shows it so. Its BVH keeps its shape.
    ///
    /// Args:
    ///     frame: number of the body, 1, 2, ...
    ///     first: number of its first triangle; its d triangles follow each other.
    ///     corners, planes, u_maps, v_maps, normal_maps: of these triangles, float64, as the renderer was made with.
    ///
    /// Raises:
    ///     ValueError: for what is no body, one with baked light, arrays that do not fit it, or a triangle that has no
    ///         area or is not finite; then nothing changes.
    #[allow(clippy::too_many_arguments, reason = "keywords in Python")]
    fn deform(
        &self,
        py: Python<'_>,
        frame: usize,
        first: u32,
        corners: &Bound<'_, PyAny>,
        planes: &Bound<'_, PyAny>,
        u_maps: &Bound<'_, PyAny>,
        v_maps: &Bound<'_, PyAny>,
        normal_maps: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<()> {
        let (corners, planes) = (column::<f64>(corners, "corners")?, column::<f64>(planes, "planes")?);
        let (u_maps, v_maps) = (column::<f64>(u_maps, "u_maps")?, column::<f64>(v_maps, "v_maps")?);
        let normal_maps = normal_maps.map(|maps| column::<f64>(maps, "normal_maps")).transpose()?;
        let deformed = Deformed {
            corners: matrices(&corners, "corners")?,
            planes: grouped(&planes, "planes")?,
            u_maps: grouped(&u_maps, "u_maps")?,
            v_maps: grouped(&v_maps, "v_maps")?,
            normal_maps: normal_maps.as_ref().map_or(Ok(&[][..]), |maps| matrices(maps, "normal_maps"))?,
        };
        py.detach(|| {
            let mut renderer = self.renderer.write().unwrap_or_else(PoisonError::into_inner);
            renderer.deform(frame, first, &deformed)
        })?;
        Ok(())
    }

    /// Render linear luma of each view, and its rate.
    ///
    /// Args:
    ///     rays: of the sensor.
    ///     views: the camera at n instants in each of f frames, under l lights, as six flat float64 arrays: positions
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
        let zeros = || vec![0f32; views.len() * rays.0.pixels()];
        let (mut luma, mut rates) = (zeros(), rate.then(zeros));
        py.detach(|| self.renderer().luma(&rays.0, &views, &mut luma, rates.as_deref_mut()))?;
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
        py.detach(|| self.renderer().samples(&rays.0, &views, &pixels, &mut luma))?;
        Ok(luma.into_pyarray(py))
    }

    /// Render luma of frames by lines through the pixels: of each pixel's area, not of single rays.
    ///
    /// Args:
    ///     corners: of the sensor. By :meth:`PixelRays.grid` two rays a pixel, through its upper left and its lower
    ///         right corner; else, behind a lens with distortion, four: through all of its corners, row by row.
    ///     lines: lines a pixel: 4, 8, 16 or 64.
    ///     views: as in :meth:`luma`.
    ///
    /// Returns:
    ///     Luma, float32, flat (n, height, width).
    ///
    /// Raises:
    ///     ValueError: for other rays or lines, or views that do not fit the scene.
    fn line_luma<'py>(
        &self,
        py: Python<'py>,
        corners: &PyPixelRays,
        lines: usize,
        views: Views<'py>,
    ) -> PyResult<Flat<'py, f32>> {
        let (pattern, views) = (LinePattern::new(lines)?, self.views(&views)?);
        let mut luma = vec![0f32; views.len() * corners.0.pixels()];
        py.detach(|| self.renderer().line_luma(&corners.0, &pattern, &views, &mut luma))?;
        Ok(luma.into_pyarray(py))
    }

    /// Return the least and the largest depth of triangles in parts of the image, whatever hides them.
    ///
    /// Args:
    ///     parts: float64, flat (m, 2, 2), of rays (x, y, 1) in camera axes the lowest x and y, and the highest.
    ///     views: as in :meth:`luma`.
    ///
    /// Returns:
    ///     float64, flat (n, m, 2), in metres along the optical axis; NaN where surely no triangle is seen. Depths of
    ///     what is only near to a part may be among them.
    ///
    /// Raises:
    ///     ValueError: for views that do not fit the scene.
    fn depths_in_parts<'py>(
        &self,
        py: Python<'py>,
        parts: &Bound<'py, PyAny>,
        views: Views<'py>,
    ) -> PyResult<Flat<'py, f64>> {
        let (parts, views) = (column::<f64>(parts, "parts")?, self.views(&views)?);
        let parts = matrices::<2, 2>(&parts, "parts")?;
        let depths = py.detach(|| self.renderer().depths_in_parts(parts, &views))?;
        Ok(depths.into_flattened().into_pyarray(py))
    }

    /// Return how far the nearest triangle of the world's frame is from a point, in any direction.
    ///
    /// Args:
    ///     point: x, y and z in the world, metres.
    ///
    /// Returns:
    ///     Metres, inf where that frame has no triangle.
    fn nearest_distance(&self, point: [f64; 3]) -> f64 {
        self.renderer().nearest_distance(point)
    }

    /// Render luma of single pixels by lines, the bits of :meth:`line_luma`.
    ///
    /// Args:
    ///     corners, lines: as in :meth:`line_luma`.
    ///     views: as in :meth:`luma`.
    ///     view, pixel: uint32 (k), the number of the view, and of the pixel, row by row.
    ///
    /// Returns:
    ///     Luma, float32 (k).
    ///
    /// Raises:
    ///     ValueError: as in :meth:`line_luma`, or for a view or pixel that is not there.
    fn line_samples<'py>(
        &self,
        py: Python<'py>,
        corners: &PyPixelRays,
        lines: usize,
        views: Views<'py>,
        view: &Bound<'py, PyAny>,
        pixel: &Bound<'py, PyAny>,
    ) -> PyResult<Flat<'py, f32>> {
        let (pattern, views) = (LinePattern::new(lines)?, self.views(&views)?);
        let pixels = view_pixels(view, pixel)?;
        let mut luma = vec![0f32; pixels.len()];
        py.detach(|| self.renderer().line_samples(&corners.0, &pattern, &views, &pixels, &mut luma))?;
        Ok(luma.into_pyarray(py))
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
        py.detach(|| self.renderer().depth(&rays.0, &views, &mut depth, &mut triangles))?;
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
        let mut hits = vec![(0f32, 0u32); pixels.len()];
        py.detach(|| self.renderer().hits(&rays.0, &views, &pixels, &mut hits))?;
        let (depth, triangles): (Vec<f32>, Vec<u32>) = hits.into_iter().unzip();
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
        let view = numbers::<u32>(view, "view")?;
        let pixel = numbers::<u32>(pixel, "pixel")?;
        let weights = numbers::<f64>(weights, "weights")?;
        let mut gradients = vec![0.0; view.len() * (BEFORE_LIGHTS + self.lights)];
        py.detach(|| self.renderer().gradients(&rays.0, &views, &view, &pixel, &weights, &mut gradients))?;
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
        let view = numbers::<u32>(view, "view")?;
        let pixel = numbers::<u32>(pixel, "pixel")?;
        let weights = numbers::<f64>(weights, "weights")?;
        let steps = numbers::<f64>(steps, "steps")?;
        let gradients =
            py.detach(|| self.renderer().texel_gradients(&rays.0, &views, &view, &pixel, &weights, &steps))?;
        Ok((gradients.counts.into_pyarray(py), gradients.texels.into_pyarray(py), gradients.values.into_pyarray(py)))
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
    ///     from the point, uint64 in the same shape: bit n mod 64 is turned over for each light n that something hides;
    ///     and luma, float64 in the same shape.
    ///
    /// Raises:
    ///     ValueError: for views that do not fit the scene, or a view or pixel that is not there.
    fn ray_hits<'py>(
        &self,
        py: Python<'py>,
        rays: &PyPixelRays,
        views: Views<'py>,
        view: &Bound<'py, PyAny>,
        pixel: &Bound<'py, PyAny>,
    ) -> PyResult<(Flat<'py, u32>, Flat<'py, u64>, Flat<'py, f64>)> {
        let views = self.views(&views)?;
        let (view, pixel): (Vec<u32>, Vec<u32>) = view_pixels(view, pixel)?.into_iter().unzip();
        let mut hits = vec![RayHit::default(); pixel.len() * rays.0.rays()];
        py.detach(|| self.renderer().ray_hits(&rays.0, &views, &view, &pixel, &mut hits))?;
        let triangles: Vec<u32> = hits.iter().map(|hit| hit.triangle).collect();
        let hidden: Vec<u64> = hits.iter().map(|hit| hit.hidden).collect();
        let luma: Vec<f64> = hits.iter().map(|hit| hit.luma).collect();
        Ok((triangles.into_pyarray(py), hidden.into_pyarray(py), luma.into_pyarray(py)))
    }

    fn __repr__(&self, py: Python<'_>) -> String {
        py.detach(|| {
            let renderer = self.renderer();
            let shadows = if renderer.scene().shadows() { "True" } else { "False" };
            let threads = renderer.threads().map_or("None".to_owned(), |threads| threads.to_string());
            format!(
                "SceneRenderer(triangles={}, frames={}, lights={}, shadows={shadows}, threads={threads})",
                renderer.scene().triangles(),
                self.frames,
                self.lights
            )
        })
    }
}
