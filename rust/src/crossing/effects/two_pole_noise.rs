//! White noise behind two poles, in closed form: where both outputs go in a step, and what they do between two known
//! instants.
//!
//! Both outputs together are a Markov process: du = -a u dt + s sqrt(2 a) dW, dv = b (u - v) dt. So a path can be drawn
//! at coarse instants first, and in between afterwards, each time by the law given what is known, as Paul Levy did for
//! Brownian motion. The finer path is one path with the coarser one, however far it is drawn.
//!
//! All numbers here are for noise of standard deviation 1 behind both poles.
//!
//! What must not break: no covariance is a difference of nearly equal numbers. Those of long steps are sums of those
//! of short ones.

#![allow(clippy::many_single_char_names, reason = "formulas of two by two matrices")]

/// The outputs of the photoreceptor's pole and of the source follower's.
pub(super) type Outputs = [f64; 2];

/// A covariance, as (first, across, second).
type Covariance = [f64; 3];

/// The largest spans are such, of at most two time constants of the source follower over 2^10, that no noise is less than
/// smooth in them. Those of more than half a time constant are always halved where noise may reach a level, because
/// their means are not yet cubics.
const HALVINGS: usize = 10;
const NOT_CUBIC: usize = 2;

/// Takes both outputs over a step of time: a triangular matrix as (first, first to second, second).
#[derive(Clone, Copy, Debug)]
struct Step([f64; 3]);

impl Step {
    fn then(self, next: Self) -> Self {
        let (a, b) = (self.0, next.0);
        Self([b[0] * a[0], b[1] * a[0] + b[2] * a[1], b[2] * a[2]])
    }

    fn of(self, outputs: Outputs) -> Outputs {
        [self.0[0] * outputs[0], self.0[1] * outputs[0] + self.0[2] * outputs[1]]
    }

    /// M Q M^T.
    fn carries(self, q: Covariance) -> Covariance {
        let [f, g, h] = self.0;
        let [x, y, z] = q;
        [f * f * x, f * (g * x + h * y), g * g * x + 2.0 * g * h * y + h * h * z]
    }
}

/// A step and what noise adds on the way.
#[derive(Clone, Copy, Debug)]
struct Law {
    step: Step,
    noise: Covariance,
}

impl Law {
    fn then(self, next: Self) -> Self {
        let carried = next.step.carries(self.noise);
        Self { step: self.step.then(next.step), noise: std::array::from_fn(|i| carried[i] + next.noise[i]) }
    }

    /// A step that is short compared with both time constants: `first` and `second` times it, `ratio` their quotient.
    fn short(first: f64, second: f64, ratio: f64) -> Self {
        let response = |fraction: f64| {
            let (a, b) = (first * fraction, second * fraction);
            (libm::exp(-a), b * lag(a, b))
        };
        let mut noise = [0.0; 3];
        for (fraction, weight) in GAUSS {
            let (u, v) = response(fraction);
            let weight = weight * 2.0 * first * (1.0 + ratio);
            noise = [noise[0] + weight * u * u, noise[1] + weight * u * v, noise[2] + weight * v * v];
        }
        let (u, v) = response(1.0);
        Self { step: Step([u, v, libm::exp(-second)]), noise }
    }
}

/// (exp(-b) - exp(-a)) / (a - b), for any a and b >= 0.
fn lag(a: f64, b: f64) -> f64 {
    let (slow, apart) = (a.min(b), (a - b).abs());
    libm::exp(-slow) * if apart < 1e-8 { 1.0 - 0.5 * apart } else { -libm::expm1(-apart) / apart }
}

/// Gauss and Legendre's rule of five nodes for the integral from 0 to 1: (node, weight).
const GAUSS: [(f64, f64); 5] = [
    (0.046_910_077_030_668, 0.118_463_442_528_094_54),
    (0.230_765_344_947_158_45, 0.239_314_335_249_683_24),
    (0.5, 0.284_444_444_444_444_43),
    (0.769_234_655_052_841_6, 0.239_314_335_249_683_24),
    (0.953_089_922_969_332, 0.118_463_442_528_094_54),
];

/// The lower root of a covariance, as (first, first to second, second).
fn root([x, y, z]: Covariance) -> [f64; 3] {
    let first = x.sqrt();
    let across = if first > 0.0 { y / first } else { 0.0 };
    [first, across, (z - across * across).max(0.0).sqrt()]
}

fn scattered(mean: Outputs, root: [f64; 3], sigma: f64, (first, second): (f64, f64)) -> Outputs {
    [mean[0] + sigma * root[0] * first, mean[1] + sigma * (root[1] * first + root[2] * second)]
}

/// The law of an instant within a span, given both outputs at its ends.
#[derive(Clone, Copy, Debug)]
struct Between {
    /// Weights of the outputs at the start and at the end, row by row.
    start: [f64; 4],
    end: [f64; 4],
    noise: Covariance,
}

impl Between {
    /// Of an instant that `before` leads to, and `after` leads on from to the end.
    fn new(before: Law, after: Law) -> Self {
        let [x, y, z] = before.noise;
        let [f, g, h] = after.step.0;
        let [p, q, r] = before.then(after).noise;
        let determinant = p * r - q * q;
        // Gain K = Q M^T S^-1, of what the end has beyond what the start leads to.
        let qm = [f * x, g * x + h * y, f * y, g * y + h * z];
        let gain = [
            (qm[0] * r - qm[1] * q) / determinant,
            (qm[1] * p - qm[0] * q) / determinant,
            (qm[2] * r - qm[3] * q) / determinant,
            (qm[3] * p - qm[2] * q) / determinant,
        ];
        let [f, g, h] = before.step.then(after.step).0;
        let taken = [gain[0] * f + gain[1] * g, gain[1] * h, gain[2] * f + gain[3] * g, gain[3] * h];
        let step = before.step.0;
        Self {
            start: [step[0] - taken[0], -taken[1], step[1] - taken[2], step[2] - taken[3]],
            end: gain,
            noise: [
                x - (gain[0] * qm[0] + gain[1] * qm[1]),
                y - (gain[0] * qm[2] + gain[1] * qm[3]),
                z - (gain[2] * qm[2] + gain[3] * qm[3]),
            ],
        }
    }
}

/// A span of time of which the outputs at both ends are known.
#[derive(Clone, Copy, Debug)]
struct Span {
    start: [f64; 4],
    end: [f64; 4],
    root: [f64; 3],
    /// How far the second output is led from its own ends, at most, by a first output that differs from it there.
    led: [f64; 2],
    /// What is left of both ends in between, at least.
    kept: f64,
    /// The largest standard deviation in between.
    spread: f64,
}

/// How often a cell of so many time constants of the source follower can be halved.
#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "small and positive")]
pub(super) fn levels(second: f64) -> usize {
    HALVINGS + libm::log2(second).floor().max(0.0) as usize
}

/// Noise behind two poles whose corners have a given ratio, over cells of a given length and their halves.
#[derive(Clone, Debug)]
pub(super) struct TwoPoleNoise {
    stationary: [f64; 3],
    cell: Step,
    cell_root: [f64; 3],
    /// By how often the cell was halved.
    spans: Vec<Span>,
}

impl TwoPoleNoise {
    /// `second` are the time constants of the source follower in a cell; those of the photoreceptor are `ratio` times as
    /// many.
    #[allow(clippy::cast_precision_loss, reason = "small")]
    pub(super) fn new(ratio: f64, second: f64) -> Self {
        const EIGHTHS: usize = 3;
        let levels = levels(second);
        let parts = libm::exp2((levels + EIGHTHS) as f64);
        let shortest = Law::short(ratio * second / parts, second / parts, ratio);
        // The law of a cell over 2^k, by k.
        let mut laws = vec![shortest; levels + EIGHTHS + 1];
        for k in (0..levels + EIGHTHS).rev() {
            laws[k] = laws[k + 1].then(laws[k + 1]);
        }
        let span = |level: usize| {
            let eighth = laws[level + EIGHTHS];
            let mut steps = [eighth; 7];
            for k in 1..7 {
                steps[k] = steps[k - 1].then(eighth);
            }
            let between = |k: usize| Between::new(steps[k], steps[6 - k]);
            let half = Between::new(laws[level + 1], laws[level + 1]);
            let mut span = Span {
                start: half.start,
                end: half.end,
                root: root(half.noise),
                led: [0.0; 2],
                kept: 1.0,
                spread: 0.0,
            };
            for Between { start, end, noise } in (0..7).map(between) {
                span.led = [span.led[0].max(start[2].abs()), span.led[1].max(end[2].abs())];
                span.kept = span.kept.min(start[2] + start[3] + end[2] + end[3]);
                span.spread = span.spread.max(noise[2].max(0.0).sqrt());
            }
            // Between the eighths all may be a little more.
            span.led = span.led.map(|led| 1.3 * led);
            span.spread *= 1.05;
            span.kept = span.kept.clamp(0.0, 1.0);
            span
        };
        Self {
            stationary: root([1.0 + ratio, 1.0, 1.0]),
            cell: laws[0].step,
            cell_root: root(laws[0].noise),
            spans: (0..=levels).map(span).collect(),
        }
    }

    /// Noise that has been there for long, by two normal draws.
    pub(super) fn stationary(&self, sigma: f64, draws: (f64, f64)) -> Outputs {
        scattered([0.0; 2], self.stationary, sigma, draws)
    }

    /// Where outputs are a cell later.
    pub(super) fn after_a_cell(&self, outputs: Outputs, sigma: f64, draws: (f64, f64)) -> Outputs {
        scattered(self.cell.of(outputs), self.cell_root, sigma, draws)
    }

    /// Where outputs are in the middle of a span, of a cell that was halved so often.
    pub(super) fn middle(&self, level: usize, ends: [Outputs; 2], sigma: f64, draws: (f64, f64)) -> Outputs {
        let Span { start: s, end: e, root, .. } = &self.spans[level];
        let [[u, v], [x, y]] = ends;
        let mean = [s[0] * u + s[1] * v + e[0] * x + e[1] * y, s[2] * u + s[3] * v + e[2] * x + e[3] * y];
        scattered(mean, *root, sigma, draws)
    }

    /// The least and the most that the second output comes to in a span, `deviations` standard deviations about its
    /// mean.
    #[inline]
    pub(super) fn range(&self, level: usize, ends: [Outputs; 2], sigma: f64, deviations: f64) -> (f64, f64) {
        let span = &self.spans[level];
        let [[u, v], [x, y]] = ends;
        let stray = span.led[0] * (u - v).abs() + span.led[1] * (x - y).abs() + deviations * sigma * span.spread;
        let (least, most) = (v.min(y), v.max(y));
        (least.min(span.kept * least) - stray, most.max(span.kept * most) + stray)
    }

    /// The first level whose spans are smooth: what is not known of the second output in between is a share of `sigma`
    /// below `fine`, and its mean is a cubic.
    pub(super) fn smooth(&self, fine: f64) -> usize {
        let last = self.spans.len() - 1;
        (last - HALVINGS + NOT_CUBIC..last).find(|&level| self.spans[level].spread <= fine).unwrap_or(last)
    }
}

/// Noise of these corners (time constants in the time that passes) and standard deviation after any time.
pub(super) fn leap(outputs: Outputs, (first, second): (f64, f64), sigma: f64, draws: (f64, f64)) -> Outputs {
    let step = Step([libm::exp(-first), second * lag(first, second), libm::exp(-second)]);
    let stationary = [1.0 + first / second, 1.0, 1.0];
    let carried = step.carries(stationary);
    let noise = std::array::from_fn(|i| (stationary[i] - carried[i]).max(0.0));
    scattered(step.of(outputs), root(noise), sigma, draws)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::{Draw, Purpose};
    use proptest::prelude::*;

    /// M a M^T + b, of symmetric matrices as (first, across, second).
    fn carried(step: [f64; 4], a: Covariance) -> Covariance {
        let [f, e, g, h] = step;
        let [x, y, z] = a;
        [
            f * f * x + 2.0 * f * e * y + e * e * z,
            f * g * x + (f * h + e * g) * y + e * h * z,
            g * g * x + 2.0 * g * h * y + h * h * z,
        ]
    }

    /// A matrix times another one, both row by row.
    fn product(a: [f64; 4], b: [f64; 4]) -> [f64; 4] {
        [a[0] * b[0] + a[1] * b[2], a[0] * b[1] + a[1] * b[3], a[2] * b[0] + a[3] * b[2], a[2] * b[1] + a[3] * b[3]]
    }

    /// exp(t A) for du = -first u, dv = second (u - v), of time constants that differ, row by row.
    fn decay(first: f64, second: f64) -> [f64; 4] {
        let (u, v) = ((-first).exp(), (-second).exp());
        [u, 0.0, second * (u - v) / (second - first), v]
    }

    fn poles() -> impl Strategy<Value = (f64, f64)> {
        (-16.0f64..6.65, 0.9f64..2.0)
            .prop_filter("not alike", |(power, _)| power.abs() > 0.01)
            .prop_map(|(p, b)| (p.exp2(), b))
    }

    proptest! {
        /// A cell leaves the stationary covariance as it is, and so does a long leap.
        #[test]
        fn cells_keep_the_stationary_law((ratio, second) in poles()) {
            let noise = TwoPoleNoise::new(ratio, second);
            let [f, g, h] = noise.cell.0;
            let expected = decay(ratio * second, second);
            for (got, expected) in [f, 0.0, g, h].into_iter().zip(expected) {
                prop_assert!((got - expected).abs() < 1e-12);
            }
            let stationary = [1.0 + ratio, 1.0, 1.0];
            let [r, s, t] = noise.cell_root;
            let after = carried([f, 0.0, g, h], stationary);
            let after = [after[0] + r * r, after[1] + r * s, after[2] + s * s + t * t];
            for (got, expected) in after.into_iter().zip(stationary) {
                prop_assert!((got - expected).abs() < 1e-11 * (1.0 + ratio), "{after:?} {stationary:?}");
            }
            let unit = |outputs, draws| leap(outputs, (ratio * second, second), 1.0, draws);
            let (a, b) = (unit([0.0; 2], (1.0, 0.0)), unit([0.0; 2], (0.0, 1.0)));
            prop_assert!((a[0] - r).abs() < 1e-6 * (1.0 + r) && (a[1] - s).abs() < 1e-6 && (b[1] - t).abs() < 1e-6);
            prop_assert!((unit([1.0, 0.0], (0.0, 0.0))[1] - g).abs() < 1e-12);
            let late = leap([3.0, 3.0], (1e9 * ratio * second, 1e9 * second), 1.0, (0.7, 0.3));
            let expected = noise.stationary(1.0, (0.7, 0.3));
            prop_assert!((late[0] - expected[0]).abs() < 1e-9 * (1.0 + ratio) && (late[1] - expected[1]).abs() < 1e-9);
        }

        /// A middle has the stationary covariance, and decays from the start and to the end as a process does.
        #[test]
        fn middles_lie_between_their_ends((ratio, second) in poles(), level in 0..=HALVINGS) {
            let noise = TwoPoleNoise::new(ratio, second);
            let Span { start, end, root: [r, s, t], .. } = noise.spans[level];
            let fraction = 0.5f64.powi(i32::try_from(level).expect("small"));
            let whole = decay(ratio * second * fraction, second * fraction);
            let half = decay(0.5 * ratio * second * fraction, 0.5 * second * fraction);
            let stationary = [1.0 + ratio, 1.0, 1.0];
            let through = product(end, whole);
            let from_start: [f64; 4] = std::array::from_fn(|i| start[i] + through[i]);
            for (got, expected) in from_start.into_iter().zip(half) {
                prop_assert!((got - expected).abs() < 1e-7, "{from_start:?} {half:?}");
            }
            let after = carried(whole, stationary);
            let added = carried(end, std::array::from_fn(|i| stationary[i] - after[i]));
            let middle = carried(from_start, stationary);
            let own = [r * r, r * s, s * s + t * t];
            for i in 0..3 {
                let got = middle[i] + added[i] + own[i];
                prop_assert!((got - stationary[i]).abs() < 1e-7 * (1.0 + ratio), "{got} {stationary:?}");
            }
        }

        /// Halved again and again, noise stays within the range that was told, and comes near to it.
        #[test]
        fn noise_stays_in_its_range((ratio, second) in poles(), level in 0..HALVINGS, seed in 0u64..1000) {
            let noise = TwoPoleNoise::new(ratio, second);
            let draws = |index| Draw::at(seed, Purpose::ShotNoise, 0, index).normals();
            let start = noise.stationary(1.0, draws(0));
            let mut span = [start, noise.after_a_cell(start, 1.0, draws(1))];
            for (halved, index) in (0..level).zip(2..) {
                span[1] = noise.middle(halved, span, 1.0, draws(index));
            }
            let (least, most) = noise.range(level, span, 1.0, 4.0);
            let mut path = span.to_vec();
            for (halved, index) in (level..HALVINGS.min(level + 5)).zip(1000u64..) {
                let middles = path.windows(2).zip(0..).map(|(ends, k)| {
                    [noise.middle(halved, [ends[0], ends[1]], 1.0, draws(index * 1000 + k)), ends[1]]
                });
                path = std::iter::once(path[0]).chain(middles.flatten()).collect();
            }
            for outputs in path {
                prop_assert!((least..=most).contains(&outputs[1]), "{least} {most} {}", outputs[1]);
            }
            let spread = noise.spans[level].spread;
            let ends = (span[0][1] - span[1][1]).abs() + (span[0][0] - span[0][1]).abs() + (span[1][0] - span[1][1]).abs();
            prop_assert!(most - least < 8.0 * spread + 3.0 * ends + (1.0 - noise.spans[level].kept) * 5.0 + 1e-9);
        }
    }

    /// A cell of many time constants is halved as often more.
    #[test]
    fn long_cells_have_the_same_spans_in_the_end() {
        let (long, short) = (TwoPoleNoise::new(3.0, 96.0), TwoPoleNoise::new(3.0, 1.5));
        assert_eq!(long.spans.len(), short.spans.len() + 6);
        for (a, b) in long.spans[6..].iter().zip(&short.spans) {
            assert!((a.spread / b.spread - 1.0).abs() < 1e-9 && (a.start[2] - b.start[2]).abs() < 1e-9);
        }
        assert_eq!(long.smooth(0.005), short.smooth(0.005) + 6);
    }

    proptest! {
        /// The middle lies in the range of its span, however far its draws take it, up to the deviations that are asked
        /// for; beyond them by far it does not.
        #[test]
        fn ranges_hold_for_middles_of_any_draws(
            (ratio, second) in poles(), level in 0..=HALVINGS, ends in prop::array::uniform4(-3.0f64..3.0), up in any::<bool>(),
        ) {
            let noise = TwoPoleNoise::new(ratio, second);
            let first = (1.0 + ratio).sqrt();
            let ends = [[first * ends[0], ends[1]], [first * ends[2], ends[3]]];
            let [_, across, own] = noise.spans[level].root;
            let unit = if up { 1.0 } else { -1.0 } / across.hypot(own);
            let at = |times: f64| noise.middle(level, ends, 1.0, (times * unit * across, times * unit * own))[1];
            let (least, most) = noise.range(level, ends, 1.0, 5.0);
            prop_assert!((least..=most).contains(&at(4.9)), "{least} {most} {}", at(4.9));
            prop_assert!((least..=most).contains(&at(0.0)));
            let stray = 2.0 * noise.spans[level].led[0] * (ends[0][0] - ends[0][1]).abs();
            let other = 2.0 * noise.spans[level].led[1] * (ends[1][0] - ends[1][1]).abs();
            let apart = (ends[0][1] - ends[1][1]).abs() + ends[0][1].abs().min(ends[1][1].abs());
            let far = at(6.0) + unit.signum() * (stray + other + apart);
            prop_assert!(!(least..=most).contains(&far));
        }
    }

    /// What is not known in a short span is that of integrated noise: b s sqrt(2 a h^3 / 192) at its middle.
    #[test]
    fn short_spans_are_smooth() {
        for ratio in [0.01, 2.0, 50.0] {
            let noise = TwoPoleNoise::new(ratio, 1.5);
            for level in 8..=HALVINGS {
                let fraction = 0.5f64.powi(i32::try_from(level).expect("small"));
                let expected = ((1.0 + ratio) * 2.0 * ratio * (1.5 * fraction).powi(3) / 192.0).sqrt();
                let got = noise.spans[level].spread;
                assert!(
                    (got / expected / 1.05 - 1.0).abs() < 0.03 + ratio * fraction,
                    "{ratio} {level} {got} {expected}"
                );
            }
            assert!(noise.smooth(1.0) == NOT_CUBIC && noise.smooth(0.0) == HALVINGS);
            let level = noise.smooth(0.005);
            assert!(level == NOT_CUBIC || noise.spans[level - 1].spread > 0.005);
        }
    }
}
