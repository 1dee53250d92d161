//! Microfacets: how they are turned, how many of them are seen, and which directions they reflect light along.
//!
//! They are those of GGX (Walter et al. 2007, Microfacet Models for Refraction through Rough Surfaces) or of Beckmann.
//! Anisotropic ones, as those of brushed metal, are rougher along one direction than across it: the same ones, stretched
//! (Heitz 2014, Understanding the Masking-Shadowing Function in Microfacet-Based BRDFs, section 5.3).
//!
//! What must not break: surfaces that are equally rough along all directions keep their bits.

use std::f64::consts::{FRAC_1_PI, PI};

use super::number::{Number, Triple, add, constant, cross, dot, scale, sub, unit};

/// How microfacets are turned.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Distribution {
    /// Trowbridge and Reitz, with long tails.
    Ggx,
    /// Beckmann and Spizzichino.
    Beckmann,
}

/// Two directions in a surface, unit vectors that stand on its normal and on each other, and its roughness along each.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Anisotropy<N> {
    tangents: [Triple<N>; 2],
    alphas: [f64; 2],
}

impl<N: Number> Anisotropy<N> {
    /// Returns that of a surface with a unit normal. `along` is the direction of the first roughness, in the surface or
    /// close to it; zero for any.
    pub(crate) fn new(normal: Triple<N>, along: Triple<N>, alphas: [f64; 2]) -> Self {
        let flat = sub(along, scale(normal, dot(normal, along)));
        let tangents = if dot(flat, flat).value() > 0.0 {
            let first = unit(flat);
            [first, cross(normal, first)]
        } else {
            tangents(normal)
        };
        Self { tangents, alphas }
    }

    /// Returns how a direction is stretched by the roughness: the squares of what lies in the plane.
    fn stretched(&self, direction: Triple<N>) -> N {
        let [x, y] = self.tangents.map(|tangent| dot(tangent, direction));
        x.squared().scaled(self.alphas[0] * self.alphas[0]) + y.squared().scaled(self.alphas[1] * self.alphas[1])
    }

    /// Returns the directions' stretches: to the viewer, to the light, and of the half vector the other way round.
    pub(crate) fn stretches(&self, viewer: Triple<N>, light: Triple<N>, half: Triple<N>) -> Stretches<N> {
        let [x, y] = self.tangents.map(|tangent| dot(tangent, half));
        let [along, across] = self.alphas;
        let half = x.squared().scaled(1.0 / (along * along)) + y.squared().scaled(1.0 / (across * across));
        Stretches { out: self.stretched(viewer), into: self.stretched(light), half, area: along * across }
    }
}

/// What stands for roughness times sine where a surface is anisotropic, as squares.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Stretches<N> {
    pub(crate) out: N,
    pub(crate) into: N,
    /// Of the half vector, by what roughness divides.
    half: N,
    /// Both roughnesses multiplied.
    area: f64,
}

/// Cosines between directions at a surface: each to the normal or, `facet`, of both to the half vector.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Cosines<N> {
    pub(crate) out: N,
    pub(crate) into: N,
    pub(crate) half: N,
    pub(crate) facet: N,
    /// None where a surface is equally rough along all directions.
    pub(crate) stretches: Option<Stretches<N>>,
}

impl<N: Number> Cosines<N> {
    /// Returns those of unit vectors: the normal, and directions to the viewer and to the light.
    pub(crate) fn new(
        normal: Triple<N>,
        viewer: Triple<N>,
        light: Triple<N>,
        anisotropy: Option<&Anisotropy<N>>,
    ) -> Self {
        let half = unit(add(viewer, light));
        Self {
            out: dot(normal, viewer),
            into: dot(normal, light),
            half: dot(normal, half),
            facet: dot(viewer, half),
            stretches: anisotropy.map(|anisotropy| anisotropy.stretches(viewer, light, half)),
        }
    }
}

impl Distribution {
    /// Returns how many microfacets are turned so (Walter et al. 2007, equations 25 and 33), by the cosine to the normal.
    pub(crate) fn density<N: Number>(self, cosine: N, alpha: f64, stretches: Option<&Stretches<N>>) -> N {
        let squared = cosine.squared();
        match (self, stretches) {
            (Self::Ggx, None) => ggx_density(cosine, alpha),
            (Self::Ggx, Some(of)) => N::constant(FRAC_1_PI / of.area) / (of.half + squared).squared(),
            (Self::Beckmann, None) => {
                let tangent = (N::constant(1.0) - squared) / squared;
                (-tangent.scaled(1.0 / (alpha * alpha))).exp() / squared.squared().scaled(PI * alpha * alpha)
            }
            (Self::Beckmann, Some(of)) => (-(of.half / squared)).exp() / squared.squared().scaled(PI * of.area),
        }
    }

    /// Returns the fraction of microfacets that are seen (Walter et al. 2007, equations 27 and 34), by the cosine to the
    /// normal; `stretch` is the direction's on an anisotropic surface.
    pub(crate) fn visible<N: Number>(self, cosine: N, alpha: f64, stretch: Option<N>) -> N {
        match (self, stretch) {
            (Self::Ggx, None) => ggx_visible(cosine, alpha),
            (Self::Ggx, Some(stretch)) => seen_of_ggx(stretch / cosine.squared()),
            (Self::Beckmann, None) => {
                let squared = cosine.squared();
                let tangent = ((N::constant(1.0) - squared).at_least(0.0) / squared).sqrt();
                if tangent.value() * alpha * 1.6 <= 1.0 {
                    return N::constant(1.0);
                }
                seen_of_beckmann(N::constant(1.0 / alpha) / tangent)
            }
            (Self::Beckmann, Some(stretch)) => {
                let sloped = (stretch / cosine.squared()).sqrt();
                if sloped.value() * 1.6 <= 1.0 {
                    return N::constant(1.0);
                }
                seen_of_beckmann(N::constant(1.0) / sloped)
            }
        }
    }
}

fn ggx_density<N: Number>(cosine: N, alpha: f64) -> N {
    let squared = alpha * alpha;
    let rest = N::constant(1.0) - cosine.squared().scaled(1.0 - squared);
    N::constant(squared * FRAC_1_PI) / rest.squared()
}

fn ggx_visible<N: Number>(cosine: N, alpha: f64) -> N {
    let squared = cosine.squared();
    let tangent = (N::constant(1.0) - squared).at_least(0.0) / squared;
    seen_of_ggx(tangent.scaled(alpha * alpha))
}

/// Returns the fraction by the square of roughness times tangent.
fn seen_of_ggx<N: Number>(squared: N) -> N {
    N::constant(2.0) / (N::constant(1.0) + (N::constant(1.0) + squared).sqrt())
}

/// Returns the fraction by one over roughness times tangent.
fn seen_of_beckmann<N: Number>(a: N) -> N {
    let above = a.scaled(3.535) + a.squared().scaled(2.181);
    above / (N::constant(1.0) + a.scaled(2.276) + a.squared().scaled(2.577))
}

/// A direction of a lobe.
#[derive(Clone, Copy, Debug)]
pub(crate) struct LobeRay<N> {
    pub(crate) towards: Triple<N>,
    pub(crate) cosines: Cosines<N>,
}

/// Returns how densely the directions of [`SeenFacets::lobe_ray`] lie, per steradian.
pub(crate) fn lobe_density<N: Number>(alpha: f64, cosines: &Cosines<N>) -> N {
    let Cosines { out, half, stretches, .. } = cosines;
    let ggx = Distribution::Ggx;
    let seen = ggx.visible(*out, alpha, stretches.map(|of| of.out));
    seen * ggx.density(*half, alpha, stretches.as_ref()) / out.scaled(4.0)
}

/// The microfacets of a surface that a viewer sees, of which points of the unit disk stand for one each (Heitz 2018,
/// Sampling the GGX Distribution of Visible Normals).
///
/// Microfacets of GGX stand in for Beckmann's, whose tails are shorter. Their weights take the difference back.
#[derive(Clone, Copy, Debug)]
pub(crate) struct SeenFacets<'a, N> {
    normal: Triple<N>,
    viewer: Triple<N>,
    anisotropy: Option<&'a Anisotropy<N>>,
    /// Directions in the surface, and its roughness along each.
    tangents: [Triple<N>; 2],
    alphas: [f64; 2],
    /// The cosine between surface and viewer.
    out: N,
    /// Of the half sphere of facets as the viewer sees it: the viewer's direction, two that stand on it, and how the disk
    /// is turned about it, as a cosine and a sine.
    towards: Triple<N>,
    level: Triple<N>,
    upwards: Triple<N>,
    turn: [N; 2],
}

impl<'a, N: Number> SeenFacets<'a, N> {
    pub(crate) fn new(alpha: f64, normal: Triple<N>, viewer: Triple<N>, anisotropy: Option<&'a Anisotropy<N>>) -> Self {
        let (tangents, alphas) = anisotropy
            .map_or_else(|| (tangents(normal), [alpha; 2]), |anisotropy| (anisotropy.tangents, anisotropy.alphas));
        let ([across, along], [first, second]) = (tangents, alphas);
        let local = [dot(viewer, across), dot(viewer, along), dot(viewer, normal)];
        let towards = unit([local[0].scaled(first), local[1].scaled(second), local[2]]);
        // The disk's axes are fixed to those of the plane, not to the viewer's azimuth, so that the pattern does not turn
        // where a surface is seen from straight above.
        let fixed = unit(sub(constant([1.0, 0.0, 0.0]), scale(towards, towards[0])));
        let flat = towards[0].squared() + towards[1].squared();
        let level = if flat.value() < 1e-18 {
            fixed
        } else {
            let per_length = N::constant(1.0) / flat.sqrt();
            [-towards[1] * per_length, towards[0] * per_length, N::constant(0.0)]
        };
        let upwards = cross(towards, level);
        let turn = [dot(level, fixed), dot(level, cross(towards, fixed))];
        Self { normal, viewer, anisotropy, tangents, alphas, out: local[2], towards, level, upwards, turn }
    }

    /// Returns the direction of a lobe for a point of the unit disk; None where it leads below the surface.
    pub(crate) fn lobe_ray(&self, disk: [f64; 2]) -> Option<LobeRay<N>> {
        let Self { normal, viewer, anisotropy, out, .. } = *self;
        let half = self.facet(disk);
        let facet = dot(viewer, half);
        let towards = sub(scale(half, facet.scaled(2.0)), viewer);
        let stretches = anisotropy.map(|anisotropy| anisotropy.stretches(viewer, towards, half));
        let cosines = Cosines { out, into: dot(normal, towards), half: dot(normal, half), facet, stretches };
        let seen = cosines.into.value() > 0.0 && facet.value() > 0.0 && cosines.out.value() > 0.0;
        seen.then_some(LobeRay { towards, cosines })
    }

    /// Returns a direction in which light passes the surface of a rough solid, for a point of the unit disk; None where
    /// there is none. `index` is that behind it, relative to the viewer's side.
    pub(crate) fn refracted(&self, disk: [f64; 2], index: f64) -> Option<Triple<N>> {
        refracted(self.facet(disk), self.viewer, index)
    }

    /// Returns the normal of the microfacet for a point of the unit disk.
    fn facet(&self, disk: [f64; 2]) -> Triple<N> {
        let ([across, along], [first, second]) = (self.tangents, self.alphas);
        let facet = self.facet_of_sphere(disk);
        let half = unit([facet[0].scaled(first), facet[1].scaled(second), facet[2].at_least(0.0)]);
        add(add(scale(across, half[0]), scale(along, half[1])), scale(self.normal, half[2]))
    }

    /// Returns a normal of the half sphere above a plane that the viewer sees.
    fn facet_of_sphere(&self, [x, y]: [f64; 2]) -> Triple<N> {
        let (one, [cosine, sine], viewer) = (N::constant(1.0), self.turn, self.towards);
        let [x, y] = [cosine.scaled(x) + sine.scaled(y), cosine.scaled(y) - sine.scaled(x)];
        // What of the disk lies below the equator, as the viewer sees it, is squeezed away.
        let most = (one - x.squared()).at_least(0.0).sqrt();
        let fraction = (one + viewer[2]).scaled(0.5);
        let y = most * (one - fraction) + y * fraction;
        let z = (one - x.squared() - y.squared()).at_least(0.0).sqrt();
        add(add(scale(self.level, x), scale(self.upwards, y)), scale(viewer, z))
    }
}

/// Returns the direction in which light from a viewer passes a surface; None where all is reflected. `index` is that
/// behind it, relative to the viewer's side.
pub(crate) fn refracted<N: Number>(normal: Triple<N>, viewer: Triple<N>, index: f64) -> Option<Triple<N>> {
    let cosine = dot(normal, viewer);
    let squared = N::constant(1.0) - (N::constant(1.0) - cosine.squared()).scaled(1.0 / (index * index));
    if cosine.value() <= 0.0 || squared.value() <= 0.0 {
        return None;
    }
    let along = cosine.scaled(1.0 / index) - squared.sqrt();
    Some(sub(scale(normal, along), scale(viewer, N::constant(1.0 / index))))
}

/// Returns two unit vectors that stand on a unit normal and on each other. They change smoothly with the normal, except
/// where it points along one direction that no wall of a level camera has.
pub(super) fn tangents<N: Number>(normal: Triple<N>) -> [Triple<N>; 2] {
    let fixed: Triple<N> = constant([0.48, 0.6, 0.64]);
    let along = dot(normal, fixed);
    let flat = sub(fixed, scale(normal, along));
    let flat = if dot(flat, flat).value() > 1e-12 {
        flat
    } else {
        let other: Triple<N> = constant([1.0, 0.0, 0.0]);
        sub(other, scale(normal, dot(normal, other)))
    };
    let first = unit(flat);
    [first, cross(normal, first)]
}
