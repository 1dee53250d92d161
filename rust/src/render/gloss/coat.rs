//! Coats: a second, white lobe above all else of a surface, as varnish has it.
//!
//! It is that of Mitsuba's `principled` (Burley 2012, Physically-Based Shading at Disney, section 5.6), so that its path
//! tracer is the reference: microfacets with longer tails than those of GGX, Schlick's approximation of a dielectric
//! with an index of 1.5, and a fixed fraction of microfacets that are hidden. What is below gets no less light.
//!
//! What must not break: surfaces without a coat have the same bits, and pay nothing.

use std::f64::consts::PI;

use super::microfacets::{Cosines, Distribution, LobeRay, tangents};
use super::number::{Number, Triple, add, dot, fifth_power, scale, sub};

/// What the coat reflects at normal incidence, were it whole.
const REFLECTED: f64 = 0.04;

/// A whole coat has so much of a lobe's strength.
const PART: f64 = 0.25;

/// The roughness by which microfacets hide each other, whatever the coat's own is.
const HIDING: f64 = 0.25;

/// A coat.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Coat {
    /// How much of one there is, 0 to 1.
    pub strength: f64,
    /// Roughness of its microfacets, above 0 and below 1.
    pub alpha: f64,
}

impl Coat {
    /// Returns whether its numbers make sense.
    pub(crate) fn is_valid(&self) -> bool {
        (0.0..=1.0).contains(&self.strength) && self.alpha > 0.0 && self.alpha < 1.0
    }

    /// Returns its reflectance (per steradian) times the cosine to the light.
    pub(crate) fn lobe<N: Number>(&self, cosines: &Cosines<N>) -> N {
        let grazing = fifth_power(N::constant(1.0) - cosines.facet);
        let fresnel = N::constant(REFLECTED) + grazing.scaled(1.0 - REFLECTED);
        let [out, into] = [cosines.out, cosines.into].map(|cosine| Distribution::Ggx.visible(cosine, HIDING, None));
        (fresnel * self.facets(cosines.half) * out * into * cosines.into).scaled(PART * self.strength)
    }

    /// Returns the lobe divided by how densely its own directions lie: what one of them brings.
    pub(crate) fn lobe_weight<N: Number>(&self, cosines: &Cosines<N>) -> N {
        self.lobe(cosines) / self.density(cosines)
    }

    /// Returns how densely the directions of [`Coat::ray`] lie, per steradian.
    pub(crate) fn density<N: Number>(&self, cosines: &Cosines<N>) -> N {
        self.facets(cosines.half) * cosines.half / cosines.facet.scaled(4.0)
    }

    /// Returns the direction of its lobe for a point of the unit disk; None where it leads below the surface.
    pub(crate) fn ray<N: Number>(&self, normal: Triple<N>, viewer: Triple<N>, disk: [f64; 2]) -> Option<LobeRay<N>> {
        let squared = self.alpha * self.alpha;
        let within = disk[0] * disk[0] + disk[1] * disk[1];
        // Of all microfacets, this fraction is turned less from the normal.
        let up = (1.0 - libm::exp((1.0 - within) * libm::log(squared))) / (1.0 - squared);
        let flat = ((1.0 - up) / within).sqrt();
        let [across, along] = tangents(normal);
        let level = add(scale(across, N::constant(flat * disk[0])), scale(along, N::constant(flat * disk[1])));
        let half = add(level, scale(normal, N::constant(up.sqrt())));
        let facet = dot(viewer, half);
        let towards = sub(scale(half, facet.scaled(2.0)), viewer);
        let (out, into) = (dot(normal, viewer), dot(normal, towards));
        let cosines = Cosines { out, into, half: dot(normal, half), facet, stretches: None };
        let seen = into.value() > 0.0 && facet.value() > 0.0 && out.value() > 0.0;
        seen.then_some(LobeRay { towards, cosines })
    }

    /// Returns how many microfacets are turned so, by the cosine to the normal.
    fn facets<N: Number>(&self, cosine: N) -> N {
        let squared = self.alpha * self.alpha;
        let rest = N::constant(1.0) - cosine.squared().scaled(1.0 - squared);
        N::constant((squared - 1.0) / (PI * libm::log(squared))) / rest
    }
}

#[cfg(test)]
#[allow(clippy::cast_precision_loss, reason = "small numbers")]
mod tests {
    use super::super::number::unit;
    use super::super::pattern::Pattern;
    use super::*;

    /// Sums over a grid of half vectors about the normal, by the solid angles of the directions that they reflect to.
    fn over_directions(coat: &Coat, viewer: [f64; 3], value: impl Fn(&Cosines<f64>) -> f64) -> f64 {
        let (rows, columns) = (4000u32, 60u32);
        let mut sum = 0.0;
        for row in 0..rows {
            // Sines of half vectors, evenly by their logarithm.
            let [low, high] =
                [row, row + 1].map(|row| (1e-5 * coat.alpha).powf(1.0 - f64::from(row) / f64::from(rows)));
            let sine = (low * high).sqrt();
            let up = (1.0 - sine * sine).sqrt();
            let area = (high * high - low * low) / up / 2.0 * std::f64::consts::TAU / f64::from(columns);
            for column in 0..columns {
                let angle = std::f64::consts::TAU * (f64::from(column) + 0.5) / f64::from(columns);
                let half = [sine * angle.cos(), sine * angle.sin(), up];
                let facet = dot(viewer, half);
                let towards = sub(scale(half, 2.0 * facet), viewer);
                if facet > 0.0 && towards[2] > 0.0 {
                    sum += 4.0 * facet * area * value(&Cosines::new([0.0, 0.0, 1.0], viewer, towards, None));
                }
            }
        }
        sum
    }

    /// What the directions bring is what the whole half sphere does, and they lie as densely as is said.
    #[test]
    fn directions_of_a_coat_stand_for_the_half_sphere() {
        let up = [0.0, 0.0, 1.0];
        for (alpha, viewer) in [(0.1, [0.1, 0.0, 1.0]), (0.02, [0.5, 0.3, 0.8]), (0.001, [-0.9, 0.3, 0.5])] {
            let (coat, viewer) = (Coat { strength: 0.7, alpha }, unit(viewer));
            let whole = over_directions(&coat, viewer, |cosines| coat.lobe(cosines));
            let density = over_directions(&coat, viewer, |cosines| coat.density(cosines));
            let (mut sum, mut above, count) = (0.0, 0.0, 4096);
            let pattern = Pattern::new(count);
            for ray in (0..count).filter_map(|number| coat.ray(up, viewer, pattern.point(number).disk)) {
                let cosines = Cosines::new(up, viewer, ray.towards, None);
                assert!((coat.lobe(&cosines) / coat.lobe(&ray.cosines) - 1.0).abs() < 1e-6);
                sum += coat.lobe_weight(&ray.cosines) / count as f64;
                above += 1.0 / count as f64;
            }
            assert!((sum / whole - 1.0).abs() < 0.01, "{alpha}: {sum} {whole}");
            assert!((density / above - 1.0).abs() < 0.01, "{alpha}: {density} {above}");
        }
    }

    /// Level microfacets: the projected area of all of them is that of the surface.
    #[test]
    fn microfacets_of_a_coat_cover_the_surface() {
        let coat = Coat { strength: 1.0, alpha: 0.05 };
        // Seen from straight above, directions are half vectors.
        let all = over_directions(&coat, [0.0, 0.0, 1.0], |cosines| coat.facets(cosines.half) / 4.0);
        // Half vectors that lean by more than 45 degrees reflect into the surface.
        let squared = coat.alpha * coat.alpha;
        let expected = 1.0 - libm::log(0.5 * (1.0 + squared)) / libm::log(squared);
        assert!((all - expected).abs() < 0.01, "{all} {expected}");
    }

    #[test]
    fn wrong_coats_are_refused() {
        for (strength, alpha) in [(1.1, 0.1), (f64::NAN, 0.1), (0.5, 0.0), (0.5, 1.0)] {
            assert!(!Coat { strength, alpha }.is_valid());
        }
    }
}
