//! `IrradianceSampler` and `ReflectedLight` for Python.

use numpy::{IntoPyArray, PyArray1};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use super::scene_tables::{BeamTuple, ColoursTuple, SlideTuple, beam_of, slide_of, texture_colours};
use crate::python::arrays::{column, flags, grouped, groups, matrices, numbers};
use crate::render::{
    AreaLamp, EnvironmentMap, GroupLight, IrradianceSampler, PathRule, ReflectedLight, SharpLight, SkyLight,
    SurfacePoint, SurfaceTables,
};

/// First triangle, number of triangles, radiance of a lamp, and whether it shines from its back too.
type LampTuple = (usize, usize, [f64; 3], bool);

/// Width, height, texels, and the rotation to its axes, of an environment map.
type MapTuple<'py> = (usize, usize, Bound<'py, PyAny>, [[f64; 3]; 3]);

/// Position, intensity, beam and slide of a light.
type PointTuple<'py> = ([f64; 3], [f64; 3], Option<BeamTuple>, Option<SlideTuple<'py>>);

/// Lamps, radiance from all sides, environment map, lights at points, from directions, and small lamps.
type GroupTuple<'py> = (
    Vec<LampTuple>,
    Option<[f64; 3]>,
    Option<MapTuple<'py>>,
    Vec<PointTuple<'py>>,
    Vec<([f64; 3], [f64; 3])>,
    Vec<LampTuple>,
);

fn lamp((first, count, radiance, two_sided): LampTuple) -> AreaLamp {
    AreaLamp { first, count, radiance, two_sided }
}

fn group_light((lamps, constant, map, points, directions, small): GroupTuple<'_>) -> PyResult<GroupLight> {
    let sky = match (constant, map) {
        (Some(_), Some(_)) => return Err(PyValueError::new_err("a group has one sky: a constant one or a map")),
        (Some(radiance), None) => Some(SkyLight::Constant(radiance)),
        (None, Some((width, height, texels, to_map))) => {
            Some(SkyLight::Map(EnvironmentMap { width, height, texels: groups(&texels, "texels")?, to_map }))
        }
        (None, None) => None,
    };
    let point = |(position, intensity, beam, slide): PointTuple<'_>| {
        let (beam, slide) = (beam.map(beam_of), slide.map(slide_of).transpose()?);
        Ok(SharpLight::Point { position, intensity, beam, slide })
    };
    let points = points.into_iter().map(point).collect::<PyResult<Vec<_>>>()?.into_iter();
    let directions = directions.into_iter().map(|(along, irradiance)| SharpLight::Directional { along, irradiance });
    let small = small.into_iter().map(|tuple| SharpLight::Lamp(lamp(tuple)));
    Ok(GroupLight {
        lamps: lamps.into_iter().map(lamp).collect(),
        sky,
        sharp: points.chain(directions).chain(small).collect(),
    })
}

/// Points, and by how much the lattice of samples is shifted at each.
type SurfacePoints<'py> = (Bound<'py, PyAny>, Bound<'py, PyAny>, Bound<'py, PyAny>);

fn points_of((positions, normals, shifts): SurfacePoints<'_>) -> PyResult<Vec<SurfacePoint>> {
    let positions = groups::<f64, 3>(&positions, "positions")?;
    let (normals, shifts) = (groups::<f64, 3>(&normals, "normals")?, groups::<f64, 2>(&shifts, "shifts")?);
    if normals.len() != positions.len() || shifts.len() != positions.len() {
        return Err(PyValueError::new_err(format!(
            "{} points need as many normals and shifts, got {} and {}",
            positions.len(),
            normals.len(),
            shifts.len()
        )));
    }
    let point = |((position, normal), shift)| SurfacePoint { position, normal, shift };
    Ok(positions.into_iter().zip(normals).zip(shifts).map(point).collect())
}

/// Light that falls on the surfaces of a scene, for :meth:`IrradianceSampler.gathered`.
///
/// Args:
///     layouts: int64 (t, 2 sides, 2), flat: first texel, and texels along a side, of the map of each triangle's front
///         and back; a frame of one texel lies around each map.
///     texels: float32 (n, 3), flat, irradiance / pi.
///
/// Raises:
///     ValueError: for maps that do not lie in the texels.
#[pyclass(name = "ReflectedLight", module = "davis_rs._core", frozen)]
pub(crate) struct PyReflectedLight(ReflectedLight);

#[pymethods]
impl PyReflectedLight {
    #[new]
    fn new(layouts: &Bound<'_, PyAny>, texels: &Bound<'_, PyAny>) -> PyResult<Self> {
        let layouts = groups::<i64, 4>(layouts, "layouts")?;
        let sides: Vec<[[i64; 2]; 2]> = layouts.iter().map(|&[a, b, c, d]| [[a, b], [c, d]]).collect();
        let texels = column::<f32>(texels, "texels")?;
        Ok(Self(ReflectedLight::new(&sides, grouped(&texels, "texels")?)?))
    }
}

/// Computes irradiance at points of diffuse surfaces, by rays.
///
/// The light at a point is a function of the scene, the point, its shift and the samples. It has the same bits in any
/// batch of points, on any number of threads and on every processor. Arrays are flat; t is the number of triangles.
///
/// Args:
///     corners: float64 (t, 3, 3), in the world, metres.
///     normals: float64 (t, 3), unit normals of the fronts.
///     shading_normals: float64 (t, 3, 3), unit normals of the fronts at the corners.
///     uv: float64 (t, 3, 2), texture coordinates of the corners.
///     textures: uint32 (t), the number of the triangle's texture.
///     two_sided: uint32 (t), 1 where the back of the triangle reflects too.
///     colours: the reflectance of textures, as that of :class:`SceneRenderer`'s glossy surfaces.
///     groups: of lights that are baked together, each (lamps, constant, map, points, directions, small lamps). A lamp
///         is (first triangle, number of triangles, radiance, whether it shines from its back too); ``constant`` is the
///         radiance from all sides or None; ``map`` is an environment map (width, height, float32 texels (height,
///         width, 3), rotation (3, 3) of the world to its axes) or None; points are (position, intensity, beam,
///         slide), with beams and slides of :class:`SceneRenderer` or None; directions are (unit vector along which
///         light travels, irradiance).
///
/// Raises:
///     ValueError: for arrays that do not belong together, or light that is not finite or negative.
#[pyclass(name = "IrradianceSampler", module = "davis_rs._core", frozen)]
pub(crate) struct PyIrradianceSampler(IrradianceSampler);

type Flat<'py> = Bound<'py, PyArray1<f64>>;

fn flat(py: Python<'_>, light: Vec<[f64; 3]>) -> Flat<'_> {
    light.into_flattened().into_pyarray(py)
}

fn flat_vectors(py: Python<'_>, light: Vec<[[f64; 3]; 3]>) -> Flat<'_> {
    flat(py, light.into_flattened())
}

#[pymethods]
impl PyIrradianceSampler {
    #[new]
    #[pyo3(signature = (
        *, corners, normals, shading_normals, uv, textures, two_sided, colours, groups
    ))]
    #[allow(clippy::too_many_arguments, reason = "keywords in Python")]
    fn new(
        corners: &Bound<'_, PyAny>,
        normals: &Bound<'_, PyAny>,
        shading_normals: &Bound<'_, PyAny>,
        uv: &Bound<'_, PyAny>,
        textures: &Bound<'_, PyAny>,
        two_sided: &Bound<'_, PyAny>,
        colours: ColoursTuple<'_>,
        groups: Vec<GroupTuple<'_>>,
    ) -> PyResult<Self> {
        let (corners, normals) = (column::<f64>(corners, "corners")?, column::<f64>(normals, "normals")?);
        let shading_normals = column::<f64>(shading_normals, "shading_normals")?;
        let uv = column::<f64>(uv, "uv")?;
        let tables = SurfaceTables {
            corners: matrices(&corners, "corners")?.into(),
            normals: grouped(&normals, "normals")?.into(),
            shading_normals: matrices(&shading_normals, "shading_normals")?.into(),
            uv: matrices(&uv, "uv")?.into(),
            textures: numbers::<u32>(textures, "textures")?,
            two_sided: flags(two_sided, "two_sided")?,
            colours: texture_colours(colours)?,
        };
        let groups = groups.into_iter().map(group_light).collect::<PyResult<Vec<_>>>()?;
        Ok(Self(IrradianceSampler::new(&tables, &groups)?))
    }

    /// Compute direct light of the lamps of a group.
    ///
    /// Args:
    ///     group: its number.
    ///     points: positions (n, 3) in metres, unit normals (n, 3), and by how much the lattice of samples is shifted
    ///         (n, 2), 0..1; three flat float64 arrays.
    ///     samples: points on each lamp, 1..2^20.
    ///
    /// Returns:
    ///     Irradiance / pi, float64, flat (n, 3): red, green and blue.
    ///
    /// Raises:
    ///     ValueError: for a group that is not there, or points that are not finite.
    fn of_lamps<'py>(
        &self,
        py: Python<'py>,
        group: usize,
        points: SurfacePoints<'py>,
        samples: usize,
    ) -> PyResult<Flat<'py>> {
        let points = points_of(points)?;
        Ok(flat(py, py.detach(|| self.0.of_lamps(group, &points, samples))?))
    }

    /// Compute the part along the surface of irradiance vectors of the light of :meth:`of_lamps`.
    ///
    /// Where a surface is turned a little, its irradiance grows by the product of this with its normal.
    ///
    /// Args:
    ///     group, points, samples: as in :meth:`of_lamps`.
    ///
    /// Returns:
    ///     Irradiance vectors / pi, float64, flat (n, 3 axes, 3): red, green and blue of x, y and z.
    ///
    /// Raises:
    ///     ValueError: as :meth:`of_lamps`.
    fn along_of_lamps<'py>(
        &self,
        py: Python<'py>,
        group: usize,
        points: SurfacePoints<'py>,
        samples: usize,
    ) -> PyResult<Flat<'py>> {
        let points = points_of(points)?;
        Ok(flat_vectors(py, py.detach(|| self.0.along_of_lamps(group, &points, samples))?))
    }

    /// Compute direct light of the sky of a ``group`` at ``points``, as :meth:`of_lamps`, by ``samples`` rays.
    fn of_sky<'py>(
        &self,
        py: Python<'py>,
        group: usize,
        points: SurfacePoints<'py>,
        samples: usize,
    ) -> PyResult<Flat<'py>> {
        let points = points_of(points)?;
        Ok(flat(py, py.detach(|| self.0.of_sky(group, &points, samples))?))
    }

    /// Compute the same of the light of :meth:`of_sky`, of a ``group`` at ``points``, by ``samples`` rays.
    ///
    /// See :meth:`along_of_lamps`.
    fn along_of_sky<'py>(
        &self,
        py: Python<'py>,
        group: usize,
        points: SurfacePoints<'py>,
        samples: usize,
    ) -> PyResult<Flat<'py>> {
        let points = points_of(points)?;
        Ok(flat_vectors(py, py.detach(|| self.0.along_of_sky(group, &points, samples))?))
    }

    /// Compute direct light of points, directions and small lamps of a ``group`` at ``points``, as :meth:`of_lamps`.
    ///
    /// ``samples`` are taken of each light.
    fn of_sharp<'py>(
        &self,
        py: Python<'py>,
        group: usize,
        points: SurfacePoints<'py>,
        samples: usize,
    ) -> PyResult<Flat<'py>> {
        let points = points_of(points)?;
        Ok(flat(py, py.detach(|| self.0.of_sharp(group, &points, samples))?))
    }

    /// Gather light that other surfaces reflect, by rays that follow the cosine.
    ///
    /// Args:
    ///     group, points: as in :meth:`of_lamps`.
    ///     samples: rays.
    ///     reflected: light that falls on surfaces, None for none; that of the group's points, directions and small
    ///         lamps comes on top.
    ///
    /// Returns:
    ///     Irradiance / pi, float64, flat (n, 3).
    ///
    /// Raises:
    ///     ValueError: as :meth:`of_lamps`, and for reflected light of another number of triangles.
    fn gathered<'py>(
        &self,
        py: Python<'py>,
        group: usize,
        points: SurfacePoints<'py>,
        samples: usize,
        reflected: Option<PyRef<'py, PyReflectedLight>>,
    ) -> PyResult<Flat<'py>> {
        let points = points_of(points)?;
        let reflected = reflected.as_ref().map(|light| &light.0);
        Ok(flat(py, py.detach(|| self.0.gathered(group, &points, samples, reflected))?))
    }

    /// Compute the same of the light of :meth:`gathered`.
    ///
    /// Args:
    ///     group, points, samples, reflected: as in :meth:`gathered`.
    ///
    /// Returns:
    ///     As :meth:`along_of_lamps`.
    fn along_gathered<'py>(
        &self,
        py: Python<'py>,
        group: usize,
        points: SurfacePoints<'py>,
        samples: usize,
        reflected: Option<PyRef<'py, PyReflectedLight>>,
    ) -> PyResult<Flat<'py>> {
        let points = points_of(points)?;
        let reflected = reflected.as_ref().map(|light| &light.0);
        Ok(flat_vectors(py, py.detach(|| self.0.along_gathered(group, &points, samples, reflected))?))
    }

    /// Compute what :meth:`gathered` does by paths, with all lights of the group.
    ///
    /// Args:
    ///     group, points: as in :meth:`of_lamps`.
    ///     samples: paths.
    ///     seed: of their draws.
    ///     bounces: how often light bounces at most.
    ///     roulette: after so many bounces a path may end at random.
    ///
    /// Returns:
    ///     Irradiance / pi, float64, flat (n, 3).
    ///
    /// Raises:
    ///     ValueError: as :meth:`of_lamps`.
    #[allow(clippy::too_many_arguments, reason = "arguments in Python")]
    fn traced<'py>(
        &self,
        py: Python<'py>,
        group: usize,
        points: SurfacePoints<'py>,
        samples: usize,
        seed: u64,
        bounces: u32,
        roulette: u32,
    ) -> PyResult<Flat<'py>> {
        let (points, rule) = (points_of(points)?, PathRule { bounces, roulette });
        Ok(flat(py, py.detach(|| self.0.traced(group, &points, samples, seed, rule))?))
    }

    /// Find whether any of some paths meets light, however little.
    ///
    /// Args:
    ///     group, points, samples, seed, bounces, roulette: as in :meth:`traced`.
    ///
    /// Returns:
    ///     bool (n).
    #[allow(clippy::too_many_arguments, reason = "arguments in Python")]
    fn is_lit<'py>(
        &self,
        py: Python<'py>,
        group: usize,
        points: SurfacePoints<'py>,
        samples: usize,
        seed: u64,
        bounces: u32,
        roulette: u32,
    ) -> PyResult<Bound<'py, PyArray1<bool>>> {
        let (points, rule) = (points_of(points)?, PathRule { bounces, roulette });
        Ok(py.detach(|| self.0.is_lit(group, &points, samples, seed, rule))?.into_pyarray(py))
    }
}
