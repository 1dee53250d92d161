//! Finishes: how glossy surfaces reflect light between two directions.
//!
//! A finish has one lobe of microfacets (GGX: Walter et al. 2007, Microfacet Models for Refraction through Rough
//! Surfaces; or Beckmann), weighted by Fresnel's equations, over a diffuse colour. A surface without roughness is a
//! mirror. Formulas are those of Mitsuba 3's `plastic`, `roughplastic`, `conductor`, `roughconductor`, `dielectric`,
//! `roughdielectric`, `thindielectric` and `principled`, so that its path tracer is the reference.
//!
//! What must not break: only arithmetic, roots and `libm` are used, so that bits are the same on every processor.

use std::f64::consts::{FRAC_1_PI, PI};

use super::number::{Number, Triple, add, constant, cross, dot, each, scale, sub, times, unit};
use crate::error::{Error, Result};

/// How microfacets are turned.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Distribution {
    /// Trowbridge and Reitz, with long tails.
    Ggx,
    /// Beckmann and Spizzichino.
    Beckmann,
}

/// How much light microfacets reflect, by the angle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Fresnel {
    /// Of a dielectric with this index of refraction, relative to the outside.
    Dielectric(f64),
    /// Of a metal: index of refraction and extinction for red, green and blue.
    Conductor([f64; 3], [f64; 3]),
    /// Of a mix of a dielectric with this index and a metal of the base colour (by Schlick's approximation), by the
    /// metal's fraction.
    Mixed(f64, f64),
}

/// A mix of a dielectric and a metal is never smoother than this, as Mitsuba's is not.
const SMOOTHEST: f64 = 1e-3;

/// What a texture makes rough is never smoother than this, as Mitsuba's is not.
const LEAST_ALPHA: f64 = 1e-4;

/// At so many cosines it is known how much passes a rough coat.
pub const PASSING: usize = 33;

/// What is below the lobe.
#[derive(Clone, Debug, PartialEq)]
pub enum Under {
    /// Nothing.
    Nothing,
    /// A diffuse base below a smooth dielectric.
    Coated {
        /// The index of refraction.
        index: f64,
        /// Diffuse light from inside that is reflected inside.
        inside: f64,
        /// Diffuse light from outside that enters.
        entering: f64,
        /// Whether the base colour changes with each reflection inside.
        nonlinear: bool,
        /// Of a rough coat: the fractions of light that pass it, at cosines from 0 to 1.
        passing: Option<Box<[f64; PASSING]>>,
    },
    /// A rough diffuse base (Burley 2012, Physically-Based Shading at Disney): its roughness, and a factor.
    Rough(f64, f64),
    /// Light passes through, bent by this index of refraction: the surface of a solid.
    Solid(f64),
    /// Light passes straight through a thin sheet with this index of refraction.
    Sheet(f64),
    /// A diffuse base covers this fraction; through the rest light passes straight.
    Blend(f64),
}

/// How a surface reflects.
#[derive(Clone, Debug, PartialEq)]
pub struct Finish {
    /// Roughness; 0 is a mirror.
    pub alpha: f64,
    /// Of the microfacets.
    pub distribution: Distribution,
    /// Of the microfacets.
    pub fresnel: Fresnel,
    /// Factor on the lobe, or on a mirror's image: red, green, blue.
    pub tint: [f64; 3],
    /// Factor on light that passes through.
    pub passing: [f64; 3],
    /// Whether the base colour is one more factor on the lobe.
    pub base_tints: bool,
    /// What is below.
    pub under: Under,
    /// The number of a texture of the roughness or of the opacity, and of one of the metal, where they differ from place
    /// to place. The roughness of a mix is the root of its alpha, else it is alpha.
    pub lobe: [Option<u32>; 2],
}

/// Cosines between directions at a surface: each to the normal or, `facet`, of both to the half vector.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Cosines<N> {
    pub(crate) out: N,
    pub(crate) into: N,
    pub(crate) half: N,
    pub(crate) facet: N,
}

impl<N: Number> Cosines<N> {
    /// Returns those of unit vectors: the normal, and directions to the viewer and to the light.
    pub(crate) fn new(normal: Triple<N>, viewer: Triple<N>, light: Triple<N>) -> Self {
        let half = unit(add(viewer, light));
        Self { out: dot(normal, viewer), into: dot(normal, light), half: dot(normal, half), facet: dot(viewer, half) }
    }
}

impl Finish {
    /// Refuses numbers that make no sense.
    ///
    /// # Errors
    ///
    /// [`Error::Argument`] with the finish.
    pub(crate) fn check(&self) -> Result<()> {
        let index = |&index: &f64| index.is_finite() && index > 0.0 && index != 1.0;
        let fraction = |x: &f64| (0.0..=1.0).contains(x);
        let fresnel = match &self.fresnel {
            Fresnel::Dielectric(eta) => index(eta),
            Fresnel::Conductor(eta, k) => eta.iter().chain(k).all(|x| x.is_finite() && *x >= 0.0),
            Fresnel::Mixed(eta, metal) => index(eta) && fraction(metal),
        };
        let under = match &self.under {
            Under::Nothing => true,
            Under::Coated { index: eta, inside, entering, passing, .. } => {
                let passing = passing.iter().flat_map(|nodes| nodes.iter()).all(|&x| x.is_finite() && x >= 0.0);
                index(eta) && (0.0..1.0).contains(inside) && fraction(entering) && passing
            }
            Under::Rough(roughness, factor) => fraction(roughness) && fraction(factor),
            Under::Solid(eta) | Under::Sheet(eta) => index(eta),
            Under::Blend(opacity) => fraction(opacity),
        };
        let textured = match (&self.fresnel, &self.under) {
            (Fresnel::Mixed(..), Under::Rough(..)) => true,
            (_, Under::Blend(_) | Under::Nothing | Under::Solid(_)) => self.lobe[1].is_none(),
            _ => self.lobe == [None; 2],
        };
        let tints = self.tint.iter().chain(&self.passing).all(|x| x.is_finite() && *x >= 0.0);
        if (0.0..=2.0).contains(&self.alpha) && fresnel && under && tints && textured {
            return Ok(());
        }
        Err(Error::Argument(format!(
            "a finish has a roughness of 0..2, indices of refraction above 0 other than 1, and fractions of 0..1, and a \
             texture of metal only if it is a mix, of roughness if it is a mix or has nothing diffuse below, of opacity \
             only if it blends, got {self:?}"
        )))
    }

    /// Returns the finish of a place where textures say how rough the surface is, how much of it is metal, or how opaque
    /// it is.
    ///
    /// Rates take all as constant.
    pub(crate) fn with_lobe(&self, [rough, metal]: [Option<f64>; 2]) -> Self {
        if let Under::Blend(opacity) = self.under {
            return Self { under: Under::Blend(rough.unwrap_or(opacity)), ..self.clone() };
        }
        let (Fresnel::Mixed(index, own_metal), &Under::Rough(own_rough, _)) = (self.fresnel, &self.under) else {
            return Self { alpha: rough.unwrap_or(self.alpha).max(LEAST_ALPHA), ..self.clone() };
        };
        let (rough, metal) = (rough.unwrap_or(own_rough), metal.unwrap_or(own_metal));
        Self {
            alpha: (rough * rough).max(SMOOTHEST),
            fresnel: Fresnel::Mixed(index, metal),
            under: Under::Rough(rough, 1.0 - metal),
            ..*self
        }
    }

    pub(crate) fn is_mirror(&self) -> bool {
        self.alpha == 0.0
    }

    /// Returns the fraction of light that microfacets reflect at a cosine, in each channel, with all factors.
    pub(crate) fn reflected<N: Number>(&self, base: Triple<N>, cosine: N) -> Triple<N> {
        let fresnel = match self.fresnel {
            Fresnel::Dielectric(eta) => [dielectric(cosine, eta); 3],
            Fresnel::Conductor(eta, k) => {
                let of = |i: usize| conductor(cosine, eta[i], k[i]);
                [of(0), of(1), of(2)]
            }
            Fresnel::Mixed(eta, metal) => {
                let plain = dielectric(cosine, eta).scaled(1.0 - metal);
                let grazing = fifth_power(N::constant(1.0) - cosine);
                each(base, |colour| plain + (colour + (N::constant(1.0) - colour) * grazing).scaled(metal))
            }
        };
        let tinted = times(fresnel, constant(self.tint));
        if self.base_tints { times(tinted, base) } else { tinted }
    }

    /// Returns the lobe's reflectance (per steradian) times the cosine to the light.
    pub(crate) fn lobe<N: Number>(&self, base: Triple<N>, cosines: &Cosines<N>) -> Triple<N> {
        let Cosines { out, into, half, facet } = *cosines;
        let shape = self.density(half) * self.visible(out) * self.visible(into) / out.scaled(4.0);
        scale(self.reflected(base, facet), shape)
    }

    /// Returns what microfacets of a solid let through (per steradian), times the cosine to the light: the lobe of light
    /// from behind the surface (Walter et al. 2007, equation 21); and how densely the directions of [`Finish::refracted`]
    /// lie there. `index` is that behind it, relative to the viewer's side.
    ///
    /// Light of a solid is weaker where rays spread, by the square of the index.
    pub(crate) fn lobe_through<N: Number>(
        &self,
        normal: Triple<N>,
        viewer: Triple<N>,
        light: Triple<N>,
        index: f64,
    ) -> Option<(Triple<N>, N)> {
        let half = unit(add(viewer, scale(light, N::constant(index))));
        let half = scale(half, N::constant(dot(half, normal).value().signum()));
        let (out, into) = (dot(normal, viewer), -dot(normal, light));
        let (facet, behind) = (dot(viewer, half), -dot(light, half));
        if out.value() <= 0.0 || into.value() <= 0.0 || facet.value() <= 0.0 || behind.value() <= 0.0 {
            return None;
        }
        let passed = N::constant(1.0) - dielectric(facet, index);
        let spread = facet * behind / ((facet - behind.scaled(index)).squared() * out);
        let up = dot(normal, half);
        let shape = self.density(up) * self.visible(out) * self.visible(into) * spread;
        let density = (ggx_density(up, self.alpha) * ggx_visible(out, self.alpha) * spread).scaled(index * index);
        Some((scale(constant(self.passing), passed * shape), density))
    }

    /// Returns a direction in which light passes the surface of a rough solid, for a point of the unit disk; None where there
    /// is none. `index` is that behind it, relative to the viewer's side.
    pub(crate) fn refracted<N: Number>(
        &self,
        normal: Triple<N>,
        viewer: Triple<N>,
        disk: [f64; 2],
        index: f64,
    ) -> Option<Triple<N>> {
        let (half, _) = facet_of_lobe(self.alpha, normal, viewer, disk);
        let facet = dot(viewer, half);
        let squared = N::constant(1.0) - (N::constant(1.0) - facet.squared()).scaled(1.0 / (index * index));
        if facet.value() <= 0.0 || squared.value() <= 0.0 {
            return None;
        }
        let along = facet.scaled(1.0 / index) - squared.sqrt();
        Some(sub(scale(half, along), scale(viewer, N::constant(1.0 / index))))
    }

    /// Returns how many microfacets are turned so (Walter et al. 2007, equations 25 and 33), by the cosine to the normal.
    fn density<N: Number>(&self, cosine: N) -> N {
        match self.distribution {
            Distribution::Ggx => ggx_density(cosine, self.alpha),
            Distribution::Beckmann => {
                let squared = cosine.squared();
                let tangent = (N::constant(1.0) - squared) / squared;
                (-tangent.scaled(1.0 / (self.alpha * self.alpha))).exp()
                    / squared.squared().scaled(PI * self.alpha * self.alpha)
            }
        }
    }

    /// Returns the fraction of microfacets that are seen (Walter et al. 2007, equations 27 and 34).
    fn visible<N: Number>(&self, cosine: N) -> N {
        match self.distribution {
            Distribution::Ggx => ggx_visible(cosine, self.alpha),
            Distribution::Beckmann => {
                let squared = cosine.squared();
                let tangent = ((N::constant(1.0) - squared).at_least(0.0) / squared).sqrt();
                if tangent.value() * self.alpha * 1.6 <= 1.0 {
                    return N::constant(1.0);
                }
                let a = N::constant(1.0 / self.alpha) / tangent;
                let above = a.scaled(3.535) + a.squared().scaled(2.181);
                above / (N::constant(1.0) + a.scaled(2.276) + a.squared().scaled(2.577))
            }
        }
    }

    /// Returns the reflectance of what is below the lobe for light from a direction: times irradiance / pi it is
    /// radiance.
    pub(crate) fn below<N: Number>(&self, base: Triple<N>, cosines: &Cosines<N>) -> Triple<N> {
        match &self.under {
            Under::Nothing | Under::Solid(_) | Under::Sheet(_) | Under::Blend(_) => [N::constant(0.0); 3],
            Under::Coated { index, passing, .. } => {
                self.coated(base, cosines.out, passed(cosines.into, *index, passing.as_deref()))
            }
            &Under::Rough(roughness, factor) => {
                let light = fifth_power(N::constant(1.0) - cosines.into);
                let returned = cosines.facet.squared().scaled(2.0 * roughness);
                rough(base, factor, [cosines.out, light, returned])
            }
        }
    }

    /// Returns the same for light from all sides.
    pub(crate) fn below_evenly<N: Number>(&self, base: Triple<N>, out: N) -> Triple<N> {
        match self.under {
            Under::Nothing | Under::Solid(_) | Under::Sheet(_) | Under::Blend(_) => [N::constant(0.0); 3],
            Under::Coated { entering, .. } => self.coated(base, out, N::constant(entering)),
            Under::Rough(roughness, factor) => {
                // Means over directions that follow the cosine: 1/21 of (1 - c)^5, and 2/3 of c.
                let returned = (N::constant(1.0) + out.scaled(2.0 / 3.0)).scaled(roughness);
                rough(base, factor, [out, N::constant(1.0 / 21.0), returned])
            }
        }
    }

    fn coated<N: Number>(&self, base: Triple<N>, out: N, entering: N) -> Triple<N> {
        let Under::Coated { index, inside, nonlinear, passing, .. } = &self.under else { return base };
        let leaving = passed(out, *index, passing.as_deref());
        let both = (entering * leaving).scaled(1.0 / (index * index));
        each(base, |colour| {
            let again = if *nonlinear { colour.scaled(*inside) } else { N::constant(*inside) };
            colour * both / (N::constant(1.0) - again)
        })
    }
}

/// Returns how much light passes a coat at a cosine.
#[allow(
    clippy::cast_precision_loss,
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "small numbers"
)]
fn passed<N: Number>(cosine: N, index: f64, rough: Option<&[f64; PASSING]>) -> N {
    let Some(nodes) = rough else { return N::constant(1.0) - dielectric(cosine, index) };
    let along = cosine.at_least(0.0).at_most(1.0).scaled((PASSING - 1) as f64);
    let before = (along.value() as usize).min(PASSING - 2);
    N::constant(nodes[before]) + (along - N::constant(before as f64)).scaled(nodes[before + 1] - nodes[before])
}

/// Returns Burley's diffuse reflectance: by the cosine to the viewer, Schlick's weight of the light, and the
/// retro-reflection.
fn rough<N: Number>(base: Triple<N>, factor: f64, [out, light, returned]: [N; 3]) -> Triple<N> {
    let one = N::constant(1.0);
    let viewer = fifth_power(one - out);
    let even = (one - light.scaled(0.5)) * (one - viewer.scaled(0.5));
    let retro = returned * (viewer + light + viewer * light * (returned - one));
    scale(base, (even + retro).scaled(factor))
}

fn fifth_power<N: Number>(x: N) -> N {
    let squared = x.squared();
    squared.squared() * x
}

/// Returns what a dielectric reflects at a cosine outside of it (unpolarised, Fresnel's equations).
pub(crate) fn dielectric<N: Number>(cosine: N, index: f64) -> N {
    let one = N::constant(1.0);
    let squared = one - (one - cosine.squared()).scaled(1.0 / (index * index));
    if squared.value() <= 0.0 {
        return one;
    }
    let inside = squared.sqrt();
    let across = (cosine - inside.scaled(index)) / (cosine + inside.scaled(index));
    let along = (cosine.scaled(index) - inside) / (cosine.scaled(index) + inside);
    (across.squared() + along.squared()).scaled(0.5)
}

/// Returns what a metal reflects at a cosine (unpolarised, Fresnel's equations).
fn conductor<N: Number>(cosine: N, eta: f64, k: f64) -> N {
    let squared = cosine.squared();
    let sine = N::constant(1.0) - squared;
    let rest = N::constant(eta * eta - k * k) - sine;
    let length = (rest.squared() + N::constant(4.0 * eta * eta * k * k)).sqrt();
    let real = (length + rest).scaled(0.5).at_least(0.0).sqrt();
    let (even, odd) = (length + squared, (cosine * real).scaled(2.0));
    let across = (even - odd) / (even + odd);
    let (even, odd) = (squared * length + sine.squared(), odd * sine);
    let along = across * (even - odd) / (even + odd);
    (across + along).scaled(0.5)
}

fn ggx_density<N: Number>(cosine: N, alpha: f64) -> N {
    let squared = alpha * alpha;
    let rest = N::constant(1.0) - cosine.squared().scaled(1.0 - squared);
    N::constant(squared * FRAC_1_PI) / rest.squared()
}

fn ggx_visible<N: Number>(cosine: N, alpha: f64) -> N {
    let squared = cosine.squared();
    let tangent = (N::constant(1.0) - squared).at_least(0.0) / squared;
    N::constant(2.0) / (N::constant(1.0) + (N::constant(1.0) + tangent.scaled(alpha * alpha)).sqrt())
}

/// A direction of a lobe, and how densely directions lie there, per steradian.
#[derive(Clone, Copy, Debug)]
pub(crate) struct LobeRay<N> {
    pub(crate) towards: Triple<N>,
    pub(crate) density: N,
    pub(crate) cosines: Cosines<N>,
}

/// Returns how densely the directions of [`lobe_ray`] lie.
pub(crate) fn lobe_density<N: Number>(alpha: f64, cosines: &Cosines<N>) -> N {
    ggx_visible(cosines.out, alpha) * ggx_density(cosines.half, alpha) / cosines.out.scaled(4.0)
}

/// Returns the direction of a lobe for a point of the unit disk, which stands for a microfacet that is seen (Heitz 2018,
/// Sampling the GGX Distribution of Visible Normals); None where it leads below the surface.
///
/// Microfacets of GGX stand in for Beckmann's, whose tails are shorter. Their weights take the difference back.
pub(crate) fn lobe_ray<N: Number>(
    alpha: f64,
    normal: Triple<N>,
    viewer: Triple<N>,
    disk: [f64; 2],
) -> Option<LobeRay<N>> {
    let (half, out) = facet_of_lobe(alpha, normal, viewer, disk);
    let facet = dot(viewer, half);
    let towards = sub(scale(half, facet.scaled(2.0)), viewer);
    let cosines = Cosines { out, into: dot(normal, towards), half: dot(normal, half), facet };
    let seen = cosines.into.value() > 0.0 && facet.value() > 0.0 && cosines.out.value() > 0.0;
    seen.then(|| LobeRay { towards, density: lobe_density(alpha, &cosines), cosines })
}

/// Returns the normal of the microfacet for a point of the unit disk, and the cosine between surface and viewer.
fn facet_of_lobe<N: Number>(alpha: f64, normal: Triple<N>, viewer: Triple<N>, disk: [f64; 2]) -> (Triple<N>, N) {
    let [across, along] = tangents(normal);
    let local = [dot(viewer, across), dot(viewer, along), dot(viewer, normal)];
    let facet = seen_facet(unit([local[0].scaled(alpha), local[1].scaled(alpha), local[2]]), disk);
    let half = unit([facet[0].scaled(alpha), facet[1].scaled(alpha), facet[2].at_least(0.0)]);
    (add(add(scale(across, half[0]), scale(along, half[1])), scale(normal, half[2])), local[2])
}

/// Returns a normal of the half sphere above a plane that a viewer in a direction sees, for a point of the unit disk.
///
/// The disk's axes are fixed to those of the plane, not to the viewer's azimuth, so that the pattern does not turn where
/// a surface is seen from straight above.
fn seen_facet<N: Number>(viewer: Triple<N>, [x, y]: [f64; 2]) -> Triple<N> {
    let one = N::constant(1.0);
    let first = unit(sub(constant([1.0, 0.0, 0.0]), scale(viewer, viewer[0])));
    let flat = viewer[0].squared() + viewer[1].squared();
    let level = if flat.value() < 1e-18 {
        first
    } else {
        let per_length = one / flat.sqrt();
        [-viewer[1] * per_length, viewer[0] * per_length, N::constant(0.0)]
    };
    let upwards = cross(viewer, level);
    let (cosine, sine) = (dot(level, first), dot(level, cross(viewer, first)));
    let [x, y] = [cosine.scaled(x) + sine.scaled(y), cosine.scaled(y) - sine.scaled(x)];
    // What of the disk lies below the equator, as the viewer sees it, is squeezed away.
    let most = (one - x.squared()).at_least(0.0).sqrt();
    let fraction = (one + viewer[2]).scaled(0.5);
    let y = most * (one - fraction) + y * fraction;
    let z = (one - x.squared() - y.squared()).at_least(0.0).sqrt();
    add(add(scale(level, x), scale(upwards, y)), scale(viewer, z))
}

/// Returns two unit vectors that stand on a unit normal and on each other. They change smoothly with the normal, except
/// where it points along one direction that no wall of a level camera has.
fn tangents<N: Number>(normal: Triple<N>) -> [Triple<N>; 2] {
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

#[cfg(test)]
#[allow(clippy::cast_precision_loss, reason = "small numbers")]
mod tests {
    use super::super::pattern::Pattern;
    use super::*;

    fn metal(alpha: f64, distribution: Distribution) -> Finish {
        Finish {
            lobe: [None; 2],
            alpha,
            distribution,
            fresnel: Fresnel::Conductor([0.2; 3], [3.9; 3]),
            tint: [1.0; 3],
            passing: [1.0; 3],
            base_tints: false,
            under: Under::Nothing,
        }
    }

    /// Sums over a grid of directions above a level surface, by their solid angles.
    fn over_directions(value: impl Fn([f64; 3]) -> f64) -> f64 {
        let (rows, columns) = (300, 90);
        let step = std::f64::consts::TAU / f64::from(columns) / f64::from(rows);
        let mut sum = 0.0;
        for row in 0..rows {
            let cosine = (f64::from(row) + 0.5) / f64::from(rows);
            let sine = (1.0 - cosine * cosine).sqrt();
            for column in 0..columns {
                let angle = std::f64::consts::TAU * (f64::from(column) + 0.5) / f64::from(columns);
                sum += step * value([sine * angle.cos(), sine * angle.sin(), cosine]);
            }
        }
        sum
    }

    /// Directions of a lobe lie as densely as is said: what they bring is what the whole half sphere does.
    #[test]
    fn directions_of_a_lobe_stand_for_the_half_sphere() {
        let up = [0.0, 0.0, 1.0];
        for (alpha, sine) in [(0.3, 0.6), (0.7, 0.28), (0.5, 0.96)] {
            for distribution in [Distribution::Ggx, Distribution::Beckmann] {
                let finish = metal(alpha, distribution);
                let viewer = [0.6 * sine, 0.8 * sine, f64::sqrt(1.0 - sine * sine)];
                let whole = over_directions(|towards| finish.lobe([1.0; 3], &Cosines::new(up, viewer, towards))[0]);
                let (mut sum, mut above, count) = (0.0, 0.0, 2048);
                let pattern = Pattern::new(count);
                for ray in (0..count).filter_map(|ray| lobe_ray(alpha, up, viewer, pattern.point(ray).disk)) {
                    assert!((lobe_density(alpha, &ray.cosines) - ray.density).abs() < 1e-12);
                    let cosines = Cosines::new(up, viewer, ray.towards);
                    assert!(
                        (cosines.half - ray.cosines.half).abs() < 1e-9
                            && (cosines.into - ray.cosines.into).abs() < 1e-9
                    );
                    sum += finish.lobe([1.0; 3], &ray.cosines)[0] / ray.density / count as f64;
                    above += 1.0 / count as f64;
                }
                assert!((sum / whole - 1.0).abs() < 0.01, "{alpha} {sine} {distribution:?}: {sum} {whole}");
                let density = over_directions(|towards| lobe_density(alpha, &Cosines::new(up, viewer, towards)));
                assert!((density / above - 1.0).abs() < 0.01, "{alpha} {sine}: {density} {above}");
            }
        }
    }

    /// The same of light that passes the rough surface of a solid, into it and out of it.
    #[test]
    fn directions_through_a_rough_surface_stand_for_the_half_sphere_behind() {
        let up = [0.0, 0.0, 1.0];
        for (alpha, sine, index) in [(0.3, 0.6, 1.5), (0.5, 0.9, 1.3), (0.4, 0.3, 1.0 / 1.5), (0.3, 0.8, 1.0 / 1.33)] {
            for distribution in [Distribution::Ggx, Distribution::Beckmann] {
                let finish = Finish { passing: [1.0, 0.5, 0.0], ..metal(alpha, distribution) };
                let viewer = [0.6 * sine, 0.8 * sine, f64::sqrt(1.0 - sine * sine)];
                let below = |towards: [f64; 3]| finish.lobe_through(up, viewer, scale(towards, -1.0), index);
                let whole = over_directions(|towards| below(towards).map_or(0.0, |(light, _)| light[0]));
                let all_density = over_directions(|towards| below(towards).map_or(0.0, |(_, density)| density));
                let (mut sum, mut followed, count) = ([0.0; 3], 0.0, 2048);
                let pattern = Pattern::new(count);
                for ray in 0..count {
                    let Some(towards) = finish.refracted(up, viewer, pattern.point(ray).disk, index) else { continue };
                    if let Some((light, density)) = finish.lobe_through(up, viewer, towards, index) {
                        assert!(towards[2] < 0.0 && (dot(towards, towards) - 1.0f64).abs() < 1e-12);
                        sum = add(sum, scale(light, 1.0 / (density * count as f64)));
                        followed += 1.0 / count as f64;
                    }
                }
                let told = format!("{alpha} {sine} {index} {distribution:?}: {sum:?} {whole}");
                assert!((sum[0] / whole - 1.0).abs() < 0.01, "{told}");
                assert!((sum[1] / sum[0] - 0.5f64).abs() < 1e-12 && sum[2] == 0.0, "{told}");
                assert!((all_density / followed - 1.0).abs() < 0.01, "{told}: {all_density} {followed}");
                // What does not pass is reflected. Some is lost between microfacets.
                let lobe = Finish { fresnel: Fresnel::Dielectric(index), ..metal(alpha, distribution) };
                let up_there = over_directions(|towards| lobe.lobe([1.0; 3], &Cosines::new(up, viewer, towards))[0]);
                let all = up_there + whole * index * index;
                assert!((0.75..1.01).contains(&all), "{told}: {all}");
            }
        }
        // From the front, a light behind; not the other way round, and none along the surface.
        let glass = metal(0.3, Distribution::Ggx);
        assert!(glass.lobe_through(up, [0.0, 0.6, 0.8], [0.0, 0.6, 0.8], 1.5).is_none());
        assert!(glass.lobe_through(up, [0.0, 0.6, -0.8], [0.0, 0.6, -0.8], 1.5).is_none());
        assert!(
            glass.lobe_through(up, [0.0, 0.6, 0.8], [0.0, -0.4, -0.9], 1.5).is_some_and(|(light, _)| light[0] > 0.0)
        );
    }

    /// Level microfacets: the projected area of all of them is that of the surface (Walter et al. 2007, equation 4).
    #[test]
    fn microfacets_cover_the_surface() {
        for distribution in [Distribution::Ggx, Distribution::Beckmann] {
            for alpha in [0.2, 0.4, 0.9] {
                let finish = metal(alpha, distribution);
                let area = over_directions(|half| finish.density(half[2]) * half[2]);
                assert!((area - 1.0).abs() < 0.01, "{distribution:?} {alpha}: {area}");
            }
        }
    }

    #[test]
    fn fresnels_equations_have_their_known_values() {
        assert!((dielectric(1.0, 1.5) - 0.04f64).abs() < 1e-12);
        assert_eq!(dielectric(0.6, 1.0 / 1.5), 1.0);
        assert!((dielectric(0.0, 1.5) - 1.0f64).abs() < 1e-12);
        // At normal incidence ((n - 1)^2 + k^2) / ((n + 1)^2 + k^2).
        let expected = (0.64 + 15.21) / (1.44 + 15.21);
        assert!((conductor(1.0_f64, 0.2, 3.9) - expected).abs() < 1e-12);
        assert_eq!(fifth_power(0.5), 0.031_25);
        let nodes = std::array::from_fn(|node| node as f64 / 64.0);
        assert_eq!(passed(0.3, 1.5, Some(&nodes)), 0.15);
        assert_eq!(passed(1.0, 1.5, Some(&nodes)), 0.5);
    }
}
