//! Flatness of a rough base: an approximation of light that goes below the surface and comes out near by.
//!
//! It is that of Mitsuba's `principled` (Burley 2012, Physically-Based Shading at Disney, section 5.3, after Hanrahan and
//! Krueger 1993). A base that is less flat is a mean of this and of Burley's diffuse base.

use super::number::{Number, fifth_power};

/// The mean of 1 / (o + c) over light from all sides, o being the cosine to the viewer and c that to the light: a
/// polynomial in the root of o, to 0.004.
const MEAN: [f64; 7] = [2.009_796, -0.493_426, -6.661_658, 14.671_036, -15.724_299, 8.960_298, -2.148_323];

/// The same of (1 - c)^5 / (o + c).
const GRAZING_MEAN: [f64; 7] = [0.345_109, -0.569_531, -1.006_702, 5.095_455, -7.921_997, 5.672_906, -1.576_980];

/// The least sum of cosines: what is seen from its side alone has less.
const LEAST: f64 = 1e-3;

/// Returns the reflectance of a flat white base, which times irradiance / pi is radiance: by the cosines to the viewer and
/// to the light, and by Burley's retro-reflection.
pub(crate) fn reflectance<N: Number>([out, into]: [N; 2], returned: N) -> N {
    let both = bent(out, returned) * bent(into, returned);
    mixed(both / (out + into).at_least(LEAST), both)
}

/// Returns the same for light from all sides, by the mean of the retro-reflection.
pub(crate) fn evenly<N: Number>(out: N, returned: N) -> N {
    let (viewer, more) = (bent(out, returned), returned.scaled(0.5) - N::constant(1.0));
    let root = out.at_least(LEAST).sqrt();
    let divided = viewer * (polynomial(&MEAN, root) + more * polynomial(&GRAZING_MEAN, root));
    // 1/21 is the mean of (1 - c)^5.
    mixed(divided, viewer * (N::constant(1.0) + more.scaled(1.0 / 21.0)))
}

fn mixed<N: Number>(divided: N, both: N) -> N {
    (divided - both.scaled(0.5) + N::constant(0.5)).scaled(1.25)
}

/// Returns how much light passes the surface at a cosine: 1 straight ahead, half the retro-reflection from its side.
fn bent<N: Number>(cosine: N, returned: N) -> N {
    let one = N::constant(1.0);
    one + (returned.scaled(0.5) - one) * fifth_power(one - cosine)
}

fn polynomial<N: Number>(coefficients: &[f64], x: N) -> N {
    coefficients.iter().rev().fold(N::constant(0.0), |sum, &next| sum * x + N::constant(next))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Light from all sides is the mean of light from each.
    #[test]
    fn even_light_is_the_mean_of_all_light() {
        for roughness in [0.0, 0.4, 1.0] {
            for out in [0.1_f64, 0.3, 0.6, 1.0] {
                let (mut sum, mut weights) = (0.0, 0.0);
                for i in 0..400 {
                    let into = (f64::from(i) + 0.5) / 400.0;
                    for k in 0..32 {
                        let azimuth = std::f64::consts::PI * (f64::from(k) + 0.5) / 32.0;
                        let sines = ((1.0 - into * into) * (1.0 - out * out)).sqrt();
                        let returned = roughness * (1.0 + into * out + sines * azimuth.cos());
                        sum += into * reflectance([out, into], returned);
                        weights += into;
                    }
                }
                let even = evenly(out, roughness * (1.0 + 2.0 / 3.0 * out));
                assert!((even / (sum / weights) - 1.0).abs() < 0.01, "{roughness} {out}: {even} {}", sum / weights);
            }
        }
    }
}
