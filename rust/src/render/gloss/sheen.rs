//! Sheen, as cloth has it, and the hue of a base colour, in which sheen and highlights may be tinted.
//!
//! Sheen is that of Mitsuba's `principled` (Burley 2012, Physically-Based Shading at Disney, section 5.5): a term of the
//! diffuse base that is bright where light comes from behind the surface's edge. It has no directions of its own.

use std::f64::consts::PI;

use super::number::{Number, Triple, constant, dot, each, fifth_power};

/// Luminance of red, green and blue (BT.709), by which Mitsuba tells a colour's hue from its brightness.
const LUMINANCE: [f64; 3] = [0.212_671, 0.715_160, 0.072_169];

/// The mean of Schlick's weight of half vectors over light from all sides, as a polynomial in 1 - c from the second
/// power on, c being the cosine to the viewer: to 0.0002 of at most 0.028.
const EVENLY: [f64; 3] = [0.021_353_28, -0.011_741_23, 0.018_603_7];

/// Sheen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sheen {
    /// How much of it there is, 0 or more.
    pub strength: f64,
    /// How much of it has the hue of the base, 0 to 1; the rest is white.
    pub tint: f64,
}

impl Sheen {
    /// Returns whether its numbers make sense.
    pub(crate) fn is_valid(&self) -> bool {
        self.strength.is_finite() && self.strength >= 0.0 && (0.0..=1.0).contains(&self.tint)
    }

    /// Returns its reflectance, which times irradiance / pi is radiance, by the cosine of light and viewer to the vector
    /// half-way between them.
    pub(crate) fn reflectance<N: Number>(&self, base: Triple<N>, facet: N) -> Triple<N> {
        self.of_weight(base, fifth_power(N::constant(1.0) - facet))
    }

    /// Returns the same for light from all sides, by the cosine to the viewer.
    pub(crate) fn evenly<N: Number>(&self, base: Triple<N>, out: N) -> Triple<N> {
        let rest = N::constant(1.0) - out;
        let [second, third, fourth] = EVENLY;
        let sum = N::constant(second) + rest * (N::constant(third) + rest.scaled(fourth));
        self.of_weight(base, rest.squared() * sum)
    }

    fn of_weight<N: Number>(&self, base: Triple<N>, weight: N) -> Triple<N> {
        let weight = weight.scaled(PI * self.strength);
        if self.tint == 0.0 {
            return [weight; 3];
        }
        let white = N::constant(1.0 - self.tint);
        each(hue(base), |hue| weight * (white + hue.scaled(self.tint)))
    }
}

/// Returns a colour of luminance 1: white for black.
pub(super) fn hue<N: Number>(colour: Triple<N>) -> Triple<N> {
    let luminance = dot(colour, constant(LUMINANCE));
    if luminance.value() > 0.0 { each(colour, |channel| channel / luminance) } else { [N::constant(1.0); 3] }
}

#[cfg(test)]
mod tests {
    use super::super::number::{add, scale, unit};
    use super::*;

    /// Even light is the mean over directions that follow the cosine.
    #[test]
    fn even_light_is_the_mean_over_all_sides() {
        let (sheen, base) = (Sheen { strength: 0.6, tint: 0.5 }, [0.2, 0.4, 0.1]);
        let most = sheen.evenly(base, 0.0f64);
        for cosine in [0.0, 0.2, 0.5, 0.8, 1.0f64] {
            let viewer = [(1.0 - cosine * cosine).sqrt(), 0.0, cosine];
            let (mut sum, count) = ([0.0; 3], 20_000);
            for number in 0..count {
                let within = (f64::from(number) + 0.5) / f64::from(count);
                let angle = std::f64::consts::TAU * (f64::from(number) * 0.618_033_988_749_894_9).fract();
                let light = [within.sqrt() * angle.cos(), within.sqrt() * angle.sin(), (1.0 - within).sqrt()];
                let half = unit(add(viewer, light));
                sum = add(sum, sheen.reflectance(base, dot(viewer, half)));
            }
            let (mean, evenly) = (scale(sum, 1.0 / f64::from(count)), sheen.evenly(base, cosine));
            for channel in 0..3 {
                let off = (mean[channel] - evenly[channel]) / most[channel];
                assert!(off.abs() < 0.01, "{cosine}: {mean:?} {evenly:?}");
            }
        }
    }

    #[test]
    fn hues_have_a_luminance_of_one() {
        let of = |colour: [f64; 3]| dot(hue(colour), LUMINANCE);
        assert!((of([0.1, 0.7, 0.3]) - 1.0).abs() < 1e-12);
        assert_eq!(hue([0.0; 3]), [1.0f64; 3]);
    }

    #[test]
    fn wrong_sheen_is_refused() {
        assert!(Sheen { strength: 2.0, tint: 1.0 }.is_valid());
        for (strength, tint) in [(-0.1, 0.0), (f64::INFINITY, 0.0), (0.5, 1.1)] {
            assert!(!Sheen { strength, tint }.is_valid());
        }
    }
}
