//! Finishes: how glossy surfaces reflect light between two directions.
//!
//! A finish has one lobe of [`microfacets`](super::microfacets), weighted by Fresnel's equations, over a diffuse
//! colour, and perhaps a [`coat`](super::coat) above both,
//! or [`sheen`](super::sheen), or [`flatness`](super::flatness). A surface without roughness is a mirror. Formulas are those of Mitsuba 3's `plastic`, `roughplastic`,
//! `conductor`, `roughconductor`, `dielectric`, `roughdielectric`, `thindielectric` and `principled`, so that its path
//! tracer is the reference.
//!
//! What must not break: only arithmetic, roots and `libm` are used, so that bits are the same on every processor.

use super::coat::Coat;
use super::flatness;
use super::microfacets::Distribution;
use super::microfacets::{Anisotropy, Cosines, lobe_density};
use super::number::{Number, Triple, add, constant, dot, each, fifth_power, scale, times, unit};
use super::sheen::{Sheen, hue};
use crate::error::{Error, Result};

/// How much light microfacets reflect, by the angle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Fresnel {
    /// Of a dielectric with this index of refraction, relative to the outside.
    Dielectric(f64),
    /// Of a metal: index of refraction and extinction for red, green and blue.
    Conductor([f64; 3], [f64; 3]),
    /// Of a mix of a dielectric and a metal of the base colour (by Schlick's approximation).
    Mixed {
        /// The index of refraction of the dielectric.
        index: f64,
        /// The metal's fraction.
        metal: f64,
        /// How much of what the dielectric reflects has the hue of the base colour (by Schlick's approximation).
        tint: f64,
    },
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
    /// Light passes through, bent: the surface of a solid.
    Solid {
        /// The index of refraction.
        index: f64,
        /// How much of the light inside is absorbed on a way of length 1, as an exponent of Beer's law: red, green, blue.
        absorption: [f64; 3],
    },
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
    /// Of an anisotropic surface, roughness across the direction in which u grows, where `alpha` is that along it;
    /// None where it is the same.
    pub across: Option<f64>,
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
    /// to place. The roughness of a mix is the root of its alpha, else it is alpha; the second texture of an anisotropic
    /// surface is of the roughness across.
    pub lobe: [Option<u32>; 2],
    /// Above all, of a mix of a dielectric and a metal over a rough base.
    pub coat: Option<Coat>,
    /// Of the base, of such a mix.
    pub sheen: Option<Sheen>,
    /// Of such a mix, the fraction of what is no metal that is the surface of a solid, which light passes: bent, and
    /// tinted by the root of the base colour.
    pub transmission: f64,
    /// How flat the base of such a mix is, 0 to 1.
    pub flatness: f64,
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
            Fresnel::Mixed { index: eta, metal, tint } => index(eta) && fraction(metal) && fraction(tint),
        };
        let under = match &self.under {
            Under::Nothing => true,
            Under::Coated { index: eta, inside, entering, passing, .. } => {
                let passing = passing.iter().flat_map(|nodes| nodes.iter()).all(|&x| x.is_finite() && x >= 0.0);
                index(eta) && (0.0..1.0).contains(inside) && fraction(entering) && passing
            }
            Under::Rough(roughness, factor) => fraction(roughness) && fraction(factor),
            Under::Solid { index: eta, absorption } => {
                index(eta) && absorption.iter().all(|x| x.is_finite() && *x >= 0.0)
            }
            Under::Sheet(eta) => index(eta),
            Under::Blend(opacity) => fraction(opacity),
        };
        let textured = match (&self.fresnel, &self.under) {
            (Fresnel::Mixed { .. }, Under::Rough(..)) => self.across.is_none() || self.lobe == [None; 2],
            (_, Under::Nothing | Under::Solid { .. }) => self.across.is_some() || self.lobe[1].is_none(),
            (_, Under::Blend(_)) => self.across.is_none() && self.lobe[1].is_none(),
            _ => self.across.is_none() && self.lobe == [None; 2],
        };
        let mixed = matches!((&self.fresnel, &self.under), (Fresnel::Mixed { .. }, Under::Rough(..)));
        let layers = self.coat.is_none_or(|coat| mixed && coat.is_valid())
            && self.sheen.is_none_or(|sheen| mixed && sheen.is_valid())
            && fraction(&self.transmission)
            && fraction(&self.flatness)
            && (mixed || (self.transmission == 0.0 && self.flatness == 0.0));
        let tints = self.tint.iter().chain(&self.passing).all(|x| x.is_finite() && *x >= 0.0);
        let across = self.across.is_none_or(|across| across > 0.0 && across <= 2.0 && self.alpha > 0.0);
        if (0.0..=2.0).contains(&self.alpha) && across && fresnel && under && tints && textured && layers {
            return Ok(());
        }
        Err(Error::Argument(format!(
            "a finish has a roughness of 0..2, indices of refraction above 0 other than 1, fractions of 0..1, an absorption \
             of at least 0, and a texture of metal only if it is a mix, of roughness if it is a mix or has nothing diffuse below, of opacity \
             only if it blends; an anisotropic one is no mirror, and only a mix has a coat, with a roughness above 0 and \
             below 1, or sheen, a transmission or a flatness, got {self:?}"
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
        let (Fresnel::Mixed { index, metal: own_metal, tint }, &Under::Rough(own_rough, _)) =
            (self.fresnel, &self.under)
        else {
            let across = self.across.map(|own| metal.unwrap_or(own).max(LEAST_ALPHA));
            return Self { alpha: rough.unwrap_or(self.alpha).max(LEAST_ALPHA), across, ..self.clone() };
        };
        let (rough, metal) = (rough.unwrap_or(own_rough), metal.unwrap_or(own_metal));
        Self {
            alpha: (rough * rough).max(SMOOTHEST),
            fresnel: Fresnel::Mixed { index, metal, tint },
            under: Under::Rough(rough, (1.0 - metal) * (1.0 - self.transmission)),
            ..*self
        }
    }

    /// Returns the surface of a solid that a part of a mix is, and its index of refraction; None where there is none. What
    /// passes has no tint yet.
    pub(crate) fn solid(&self) -> Option<(Self, f64)> {
        let Fresnel::Mixed { index, metal, .. } = self.fresnel else { return None };
        let fraction = self.transmission * (1.0 - metal);
        let solid = || Self {
            fresnel: Fresnel::Dielectric(index),
            tint: [fraction; 3],
            passing: [fraction; 3],
            base_tints: false,
            under: Under::Solid { index, absorption: [0.0; 3] },
            coat: None,
            sheen: None,
            transmission: 0.0,
            flatness: 0.0,
            ..self.clone()
        };
        (fraction > 0.0).then(|| (solid(), index))
    }

    /// Returns the least roughness along any direction, that of a coat among them.
    pub(crate) fn least_alpha(&self) -> f64 {
        let own = self.across.map_or(self.alpha, |across| across.min(self.alpha));
        self.coat.map_or(own, |coat| coat.alpha.min(own))
    }

    fn visible<N: Number>(&self, cosine: N, stretch: Option<N>) -> N {
        self.distribution.visible(cosine, self.alpha, stretch)
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
            Fresnel::Mixed { index, metal, tint } => {
                let plain = dielectric(cosine, index).scaled((1.0 - metal) * (1.0 - tint));
                let grazing = fifth_power(N::constant(1.0) - cosine);
                let schlick = |colour: N| colour + (N::constant(1.0) - colour) * grazing;
                let mixed = each(base, |colour| plain + schlick(colour).scaled(metal));
                if tint == 0.0 {
                    mixed
                } else {
                    let straight = (index - 1.0) / (index + 1.0);
                    let tinted = each(hue(base), |hue| schlick(hue.scaled(straight * straight)));
                    add(mixed, scale(tinted, N::constant((1.0 - metal) * tint)))
                }
            }
        };
        let tinted = times(fresnel, constant(self.tint));
        if self.base_tints { times(tinted, base) } else { tinted }
    }

    /// Returns the lobe's reflectance (per steradian) times the cosine to the light.
    pub(crate) fn lobe<N: Number>(&self, base: Triple<N>, cosines: &Cosines<N>) -> Triple<N> {
        let Cosines { out, into, half, facet, .. } = *cosines;
        let stretches = cosines.stretches;
        let seen = self.visible(out, stretches.map(|of| of.out)) * self.visible(into, stretches.map(|of| of.into));
        let shape = self.distribution.density(half, self.alpha, stretches.as_ref()) * seen / out.scaled(4.0);
        scale(self.reflected(base, facet), shape)
    }

    /// Returns the lobe divided by how densely its own directions lie: what one of them brings.
    pub(crate) fn lobe_weight<N: Number>(&self, base: Triple<N>, cosines: &Cosines<N>) -> Triple<N> {
        match self.distribution {
            // Directions lie as densely as microfacets that the viewer sees, so only how many the light sees is left.
            Distribution::Ggx => {
                let into = self.visible(cosines.into, cosines.stretches.map(|of| of.into));
                scale(self.reflected(base, cosines.facet), into)
            }
            Distribution::Beckmann => {
                let density = lobe_density(self.alpha, cosines);
                scale(self.lobe(base, cosines), N::constant(1.0) / density)
            }
        }
    }

    /// Returns the same of all lobes.
    pub(crate) fn lobes<N: Number>(&self, base: Triple<N>, cosines: &Cosines<N>) -> Triple<N> {
        let lobe = self.lobe(base, cosines);
        match &self.coat {
            None => lobe,
            Some(coat) => add(lobe, [coat.lobe(cosines); 3]),
        }
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
        anisotropy: Option<&Anisotropy<N>>,
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
        let stretches = anisotropy.map(|anisotropy| anisotropy.stretches(viewer, light, half));
        let of_out = stretches.map(|of| of.out);
        let seen = self.visible(out, of_out) * self.visible(into, stretches.map(|of| of.into));
        let shape = self.distribution.density(up, self.alpha, stretches.as_ref()) * seen * spread;
        let ggx = Distribution::Ggx;
        let chosen = ggx.density(up, self.alpha, stretches.as_ref()) * ggx.visible(out, self.alpha, of_out);
        let density = (chosen * spread).scaled(index * index);
        Some((scale(constant(self.passing), passed * shape), density))
    }

    /// Returns the reflectance of what is below the lobe for light from a direction: times irradiance / pi it is
    /// radiance.
    pub(crate) fn below<N: Number>(&self, base: Triple<N>, cosines: &Cosines<N>) -> Triple<N> {
        match &self.under {
            Under::Nothing | Under::Solid { .. } | Under::Sheet(_) | Under::Blend(_) => [N::constant(0.0); 3],
            Under::Coated { index, passing, .. } => {
                self.coated(base, cosines.out, passed(cosines.into, *index, passing.as_deref()))
            }
            &Under::Rough(roughness, factor) => {
                let light = fifth_power(N::constant(1.0) - cosines.into);
                let returned = cosines.facet.squared().scaled(2.0 * roughness);
                let own = rough(base, factor, [cosines.out, light, returned]);
                let own =
                    self.flattened(own, base, factor, || flatness::reflectance([cosines.out, cosines.into], returned));
                self.with_sheen(own, factor, |sheen| sheen.reflectance(base, cosines.facet))
            }
        }
    }

    /// Returns the same for light from all sides.
    pub(crate) fn below_evenly<N: Number>(&self, base: Triple<N>, out: N) -> Triple<N> {
        match self.under {
            Under::Nothing | Under::Solid { .. } | Under::Sheet(_) | Under::Blend(_) => [N::constant(0.0); 3],
            Under::Coated { entering, .. } => self.coated(base, out, N::constant(entering)),
            Under::Rough(roughness, factor) => {
                // Means over directions that follow the cosine: 1/21 of (1 - c)^5, and 2/3 of c.
                let returned = (N::constant(1.0) + out.scaled(2.0 / 3.0)).scaled(roughness);
                let own = rough(base, factor, [out, N::constant(1.0 / 21.0), returned]);
                let own = self.flattened(own, base, factor, || flatness::evenly(out, returned));
                self.with_sheen(own, factor, |sheen| sheen.evenly(base, out))
            }
        }
    }

    /// Returns the reflectance of a rough base, or a mean of it and of that of a flat base by the same factor.
    fn flattened<N: Number>(&self, own: Triple<N>, base: Triple<N>, factor: f64, of: impl FnOnce() -> N) -> Triple<N> {
        if self.flatness == 0.0 {
            return own;
        }
        add(scale(own, N::constant(1.0 - self.flatness)), scale(base, of().scaled(self.flatness * factor)))
    }

    /// Returns the reflectance of a rough base, with that of its sheen by the same factor.
    fn with_sheen<N: Number>(&self, own: Triple<N>, factor: f64, of: impl FnOnce(&Sheen) -> Triple<N>) -> Triple<N> {
        match &self.sheen {
            None => own,
            Some(sheen) => add(own, scale(of(sheen), N::constant(factor))),
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

#[cfg(test)]
#[allow(clippy::cast_precision_loss, reason = "small numbers")]
mod tests {
    use super::super::microfacets::SeenFacets;
    use super::super::pattern::Pattern;
    use super::*;

    fn metal(alpha: f64, distribution: Distribution) -> Finish {
        Finish {
            lobe: [None; 2],
            coat: None,
            sheen: None,
            transmission: 0.0,
            flatness: 0.0,
            alpha,
            across: None,
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
                let whole =
                    over_directions(|towards| finish.lobe([1.0; 3], &Cosines::new(up, viewer, towards, None))[0]);
                let (mut sum, mut above, count) = (0.0, 0.0, 2048);
                let pattern = Pattern::new(count);
                let facets = SeenFacets::new(alpha, up, viewer, None);
                for ray in (0..count).filter_map(|ray| facets.lobe_ray(pattern.point(ray).disk)) {
                    let cosines = Cosines::new(up, viewer, ray.towards, None);
                    assert!(
                        (cosines.half - ray.cosines.half).abs() < 1e-9
                            && (cosines.into - ray.cosines.into).abs() < 1e-9
                    );
                    let weight = finish.lobe([1.0; 3], &ray.cosines)[0] / lobe_density(alpha, &ray.cosines);
                    assert!((finish.lobe_weight([1.0; 3], &ray.cosines)[0] / weight - 1.0).abs() < 1e-12);
                    sum += weight / count as f64;
                    above += 1.0 / count as f64;
                }
                assert!((sum / whole - 1.0).abs() < 0.01, "{alpha} {sine} {distribution:?}: {sum} {whole}");
                let density = over_directions(|towards| lobe_density(alpha, &Cosines::new(up, viewer, towards, None)));
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
                let below = |towards: [f64; 3]| finish.lobe_through(up, viewer, scale(towards, -1.0), index, None);
                let whole = over_directions(|towards| below(towards).map_or(0.0, |(light, _)| light[0]));
                let all_density = over_directions(|towards| below(towards).map_or(0.0, |(_, density)| density));
                let (mut sum, mut followed, count) = ([0.0; 3], 0.0, 2048);
                let pattern = Pattern::new(count);
                for ray in 0..count {
                    let Some(towards) =
                        SeenFacets::new(alpha, up, viewer, None).refracted(pattern.point(ray).disk, index)
                    else {
                        continue;
                    };
                    if let Some((light, density)) = finish.lobe_through(up, viewer, towards, index, None) {
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
                let up_there =
                    over_directions(|towards| lobe.lobe([1.0; 3], &Cosines::new(up, viewer, towards, None))[0]);
                let all = up_there + whole * index * index;
                assert!((0.75..1.01).contains(&all), "{told}: {all}");
            }
        }
        // From the front, a light behind; not the other way round, and none along the surface.
        let glass = metal(0.3, Distribution::Ggx);
        assert!(glass.lobe_through(up, [0.0, 0.6, 0.8], [0.0, 0.6, 0.8], 1.5, None).is_none());
        assert!(glass.lobe_through(up, [0.0, 0.6, -0.8], [0.0, 0.6, -0.8], 1.5, None).is_none());
        assert!(
            glass
                .lobe_through(up, [0.0, 0.6, 0.8], [0.0, -0.4, -0.9], 1.5, None)
                .is_some_and(|(light, _)| light[0] > 0.0)
        );
    }

    /// Level microfacets: the projected area of all of them is that of the surface (Walter et al. 2007, equation 4).
    #[test]
    fn microfacets_cover_the_surface() {
        for distribution in [Distribution::Ggx, Distribution::Beckmann] {
            for alpha in [0.2, 0.4, 0.9] {
                let finish = metal(alpha, distribution);
                let area = over_directions(|half| finish.distribution.density(half[2], finish.alpha, None) * half[2]);
                assert!((area - 1.0).abs() < 0.01, "{distribution:?} {alpha}: {area}");
            }
        }
    }

    /// Of an anisotropic surface, directions of the lobe stand for the half sphere above it, those through it for the
    /// one below.
    #[test]
    fn directions_of_an_anisotropic_lobe_stand_for_all() {
        let (up, count, index) = ([0.0, 0.0, 1.0], 2048, 1.5);
        let pattern = Pattern::new(count);
        for (alphas, angle, sine) in [([0.2, 0.5], 0.4, 0.6), ([0.6, 0.3], 1.9, 0.8), ([0.3, 0.4], 5.0, 0.1)] {
            let anisotropy = Anisotropy::new(up, [0.6, 0.8, 0.3], alphas);
            let viewer = [sine * f64::cos(angle), sine * f64::sin(angle), f64::sqrt(1.0 - sine * sine)];
            for distribution in [Distribution::Ggx, Distribution::Beckmann] {
                let finish = Finish { across: Some(alphas[1]), ..metal(alphas[0], distribution) };
                let of = |towards| Cosines::new(up, viewer, towards, Some(&anisotropy));
                let whole = over_directions(|towards| finish.lobe([1.0; 3], &of(towards))[0]);
                let density = over_directions(|towards| lobe_density(alphas[0], &of(towards)));
                let below = |towards| finish.lobe_through(up, viewer, scale(towards, -1.0), index, Some(&anisotropy));
                let behind = over_directions(|towards| below(towards).map_or(0.0, |(light, _)| light[0]));
                let (mut sum, mut above, mut through) = (0.0, 0.0, 0.0);
                for point in (0..count).map(|number| pattern.point(number).disk) {
                    if let Some(ray) = SeenFacets::new(alphas[0], up, viewer, Some(&anisotropy)).lobe_ray(point) {
                        let cosines = of(ray.towards);
                        assert!(
                            (lobe_density(alphas[0], &cosines) / lobe_density(alphas[0], &ray.cosines) - 1.0).abs()
                                < 1e-9
                        );
                        sum += finish.lobe_weight([1.0; 3], &ray.cosines)[0] / count as f64;
                        above += 1.0 / count as f64;
                    }
                    if let Some(towards) =
                        SeenFacets::new(alphas[0], up, viewer, Some(&anisotropy)).refracted(point, index)
                        && let Some((light, density)) =
                            finish.lobe_through(up, viewer, towards, index, Some(&anisotropy))
                    {
                        through += light[0] / density / count as f64;
                    }
                }
                let told = format!("{alphas:?} {distribution:?}: {sum} {whole} {above} {density} {through} {behind}");
                assert!((sum / whole - 1.0).abs() < 0.01 && (density / above - 1.0).abs() < 0.01, "{told}");
                assert!((through / behind - 1.0).abs() < 0.01, "{told}");
                let turned = |half| anisotropy.stretches(up, up, half);
                let area =
                    over_directions(|half| distribution.density(half[2], alphas[0], Some(&turned(half))) * half[2]);
                assert!((area - 1.0).abs() < 0.01, "{told} {area}");
            }
        }
    }

    /// One with equal roughness along both directions is isotropic, whatever the directions are.
    #[test]
    fn equal_alphas_are_isotropic() {
        let (up, viewer) = ([0.0, 0.0, 1.0], unit([0.3, -0.5, 0.9]));
        for along in [[1.0, 0.0, 0.0], [0.3, -0.9, 0.5], [0.0; 3]] {
            let anisotropy = Anisotropy::new(up, along, [0.35; 2]);
            for distribution in [Distribution::Ggx, Distribution::Beckmann] {
                let finish = metal(0.35, distribution);
                for towards in [[0.1, 0.2, 0.9], [-0.7, 0.1, 0.4], [0.7, 0.5, 0.35], [0.9, 0.9, 0.1]].map(unit) {
                    let [equal, isotropic] = [Some(&anisotropy), None]
                        .map(|anisotropy| finish.lobe([1.0; 3], &Cosines::new(up, viewer, towards, anisotropy)));
                    assert!(
                        (equal[0] / isotropic[0] - 1.0f64).abs() < 1e-9,
                        "{along:?} {towards:?}: {equal:?} {isotropic:?}"
                    );
                }
            }
        }
    }

    /// Where a texture says that a surface is smooth, it is nearly so, and no mirror, which has no lobe.
    #[test]
    fn textures_make_no_mirror() {
        let finish = Finish { across: Some(0.2), ..metal(0.3, Distribution::Ggx) };
        let of = |lobe| {
            let there = finish.with_lobe(lobe);
            (there.alpha, there.across)
        };
        assert_eq!(of([Some(0.0), None]), (LEAST_ALPHA, Some(0.2)));
        assert_eq!(of([None, Some(0.0)]), (0.3, Some(LEAST_ALPHA)));
        assert_eq!(of([Some(0.7), Some(0.4)]), (0.7, Some(0.4)));
        assert_eq!(metal(0.3, Distribution::Ggx).with_lobe([Some(0.0), None]).alpha, LEAST_ALPHA);
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
