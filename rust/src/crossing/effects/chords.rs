//! Takes cubic input of low-passes as chords, because a low-pass has a closed form only for straight input.
//!
//! The outputs at the end of each chord are computed in vector code: the chords of a pixel follow each other, but the
//! pixels of a tile that have equally many chords take them together. [`super::band`] marks from them which pixels may
//! have an event, and [`super::input`] follows those along the same chords.
//!
//! What must not break: the outputs have the bits that [`super::input`] would compute, chord by chord.

use super::parameters::PhotoreceptorBandwidth;
use super::scan::{TwoOutputs, low_pass, two_low_passes};
use crate::crossing::cubic::Cubic;
use crate::crossing::line::Line;

/// No pixel takes more chords.
const MOST: u8 = 16;

/// How many chords a cubic takes so that they lie within `tolerance` of it; at most 16, and one where a slope is NaN.
///
/// `slopes` are in log intensity over the interval of `ticks` ticks, `change` is that of log intensity.
#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "1 to 16")]
pub(super) fn number_of_chords(slopes: (f64, f64), change: f64, tolerance: f64, ticks: i64) -> usize {
    // The error of chords falls with the square of their number.
    let number = (bend(slopes, change) / tolerance).sqrt().ceil().max(1.0).min(f64::from(MOST));
    (number as i64).min(ticks) as usize
}

/// How far a cubic with these slopes strays from its chord, from above: an eighth of its largest second derivative, which
/// lies at one of its ends. NaN where it is its chord for want of a slope.
fn bend(slopes: (f64, f64), chord: f64) -> f64 {
    let (from, to) = (slopes.0 - chord, slopes.1 - chord);
    0.25 * (2.0 * from + to).abs().max((from + 2.0 * to).abs())
}

/// The end of a chord: what a pixel's low-passes have come to there.
#[derive(Clone, Copy)]
pub(super) struct Node {
    pub(super) tick: i64,
    pub(super) log: f64,
    /// Time constants of the photoreceptor, or of a single low-pass, in the chord.
    pub(super) decay: f64,
    /// The output of the photoreceptor, where a source follower filters it, and of the last low-pass.
    pub(super) photoreceptor: f64,
    pub(super) filtered: f64,
}

/// A pixel whose input is taken as several chords.
struct Bent {
    in_tile: usize,
    cubic: Cubic,
    chords: usize,
    /// Where its start is among the nodes; its next node is `stride` further on.
    first: usize,
    stride: usize,
}

/// The chords of a tile's pixels. Nodes are kept for pixels of equally many chords together, one row a node.
#[derive(Default)]
pub(super) struct Chords {
    ticks: i64,
    /// In the order of the tile.
    bent: Vec<Bent>,
    logs: Vec<f64>,
    decay: Vec<f64>,
    photoreceptor: Vec<f64>,
    filtered: Vec<f64>,
    /// What [`two_low_passes`] gives in addition.
    slopes: [Vec<f64>; 2],
}

/// The signals of a tile's pixels at the start of the interval.
pub(super) struct Start<'a> {
    /// Empty where there is a single low-pass.
    pub(super) photoreceptor: &'a [f64],
    pub(super) filtered: &'a [f64],
}

impl Chords {
    /// Begins a tile, over an interval of `ticks` ticks.
    pub(super) fn begin(&mut self, ticks: i64) {
        self.ticks = ticks;
        self.bent.clear();
        for nodes in [&mut self.logs, &mut self.decay, &mut self.photoreceptor, &mut self.filtered] {
            nodes.clear();
        }
    }

    /// Adds a pixel, behind those of the tile that were added before it.
    pub(super) fn add(&mut self, in_tile: usize, line: Line, slopes: (f64, f64), chords: usize) {
        let cubic = Cubic::new(line, slopes.0, slopes.1);
        self.bent.push(Bent { in_tile, cubic, chords, first: 0, stride: 0 });
    }

    /// Computes all nodes of the pixels that were added.
    #[allow(clippy::cast_precision_loss, reason = "intervals are shorter than 2^53 us")]
    pub(super) fn filter(&mut self, bandwidth: PhotoreceptorBandwidth, start: &Start<'_>) {
        let ticks = self.ticks;
        for chords in 2..=usize::from(MOST) {
            let first = self.logs.len();
            for bent in self.bent.iter_mut().filter(|bent| bent.chords == chords) {
                bent.first = self.logs.len();
                self.logs.push(bent.cubic.line.from);
                self.photoreceptor.extend(start.photoreceptor.get(bent.in_tile));
                self.filtered.push(start.filtered[bent.in_tile]);
            }
            let n = self.logs.len() - first;
            if n == 0 {
                continue;
            }
            let rows = first + n * (chords + 1);
            let twice = !self.photoreceptor.is_empty();
            self.logs.resize(rows, 0.0);
            self.decay.resize(rows, 0.0);
            self.photoreceptor.resize(if twice { rows } else { 0 }, 0.0);
            self.filtered.resize(rows, 0.0);
            for slopes in &mut self.slopes {
                slopes.resize(slopes.len().max(n), 0.0);
            }
            for bent in self.bent.iter_mut().filter(|bent| bent.chords == chords) {
                bent.stride = n;
                for k in 1..chords {
                    self.logs[bent.first + k * n] = bent.cubic.at(tick(ticks, k, chords) as f64 / ticks as f64);
                }
                self.logs[bent.first + chords * n] = bent.cubic.line.to;
            }
            for k in 1..=chords {
                let row = first + k * n;
                let chord_ticks = (tick(ticks, k, chords) - tick(ticks, k - 1, chords)) as f64;
                let input = (&self.logs[row - n..row], &self.logs[row..row + n]);
                let (before, after) = self.filtered.split_at_mut(row);
                let (before, after, decay) = (&before[row - n..], &mut after[..n], &mut self.decay[row..row + n]);
                if twice {
                    let (first_before, first_after) = self.photoreceptor.split_at_mut(row);
                    let [first_slope, second_slope] = &mut self.slopes;
                    let outputs = TwoOutputs { first: &mut first_after[..n], second: after, first_slope, second_slope };
                    let first_before = &first_before[row - n..];
                    two_low_passes(bandwidth, chord_ticks, (first_before, before), input, decay, outputs);
                } else {
                    low_pass(bandwidth, chord_ticks, before, input, (decay, after));
                }
            }
        }
    }

    /// The pixels that were added: their index in the tile, and the least and the most of what their input and outputs
    /// are at any node.
    pub(super) fn extents(&self) -> impl Iterator<Item = (usize, (f64, f64))> {
        self.bent.iter().map(|bent| {
            let rows = (0..=bent.chords).map(|k| bent.first + k * bent.stride);
            let start = bent.first..=bent.first;
            let outputs = self.photoreceptor.get(start.clone()).unwrap_or_default().iter().chain(&self.filtered[start]);
            let values = rows.map(|at| self.logs[at]).chain(outputs.copied());
            let extent = values
                .fold((f64::INFINITY, f64::NEG_INFINITY), |(least, most), value| (least.min(value), most.max(value)));
            (bent.in_tile, extent)
        })
    }

    /// Where the outputs of the pixels that were added end: their index in the tile, and the last node.
    pub(super) fn ends(&self) -> impl Iterator<Item = (usize, Node)> {
        self.bent.iter().map(|bent| (bent.in_tile, self.node(bent, bent.chords)))
    }

    /// The nodes of a pixel from its start on; None if it was not added.
    pub(super) fn nodes(&self, in_tile: usize) -> Option<impl Iterator<Item = Node>> {
        let at = self.bent.binary_search_by_key(&in_tile, |bent| bent.in_tile).ok()?;
        let bent = &self.bent[at];
        Some((0..=bent.chords).map(move |k| self.node(bent, k)))
    }

    fn node(&self, bent: &Bent, k: usize) -> Node {
        let at = bent.first + k * bent.stride;
        Node {
            tick: tick(self.ticks, k, bent.chords),
            log: self.logs[at],
            decay: self.decay[at],
            photoreceptor: self.photoreceptor.get(at).copied().unwrap_or_default(),
            filtered: self.filtered[at],
        }
    }
}

/// Where the `k`-th of so many chords ends.
#[allow(clippy::cast_possible_wrap, reason = "at most 16")]
fn tick(ticks: i64, k: usize, chords: usize) -> i64 {
    ticks * k as i64 / chords as i64
}

#[cfg(test)]
#[allow(clippy::float_cmp, reason = "the same bits are asked for")]
#[allow(clippy::cast_possible_wrap, clippy::cast_precision_loss, reason = "small numbers")]
mod tests {
    use super::*;
    use crate::crossing::effects::filtered::filter;
    use crate::crossing::effects::two_poles::{Decays, filter_twice};
    use proptest::prelude::*;

    /// Pixels of a tile: log intensity at both ends, both slopes, and the outputs of both low-passes before.
    fn pixels() -> impl Strategy<Value = Vec<[f64; 6]>> {
        prop::collection::vec(
            [-3.0f64..3.0, -3.0f64..3.0, -9.0f64..9.0, -9.0f64..9.0, -3.0f64..3.0, -3.0f64..3.0],
            1..40,
        )
    }

    proptest! {
        /// Chord by chord and pixel by pixel, with the functions for one pixel: the same bits.
        #[test]
        fn nodes_are_those_of_single_pixels(
            pixels in pixels(), ticks in 1i64..100_000, hz in 1.0f64..5000.0, follower in prop_oneof![Just(f64::INFINITY), 1.0f64..1000.0],
        ) {
            let bandwidth = PhotoreceptorBandwidth { hz, source_follower_hz: follower };
            let twice = follower.is_finite();
            let mut chords = Chords::default();
            chords.begin(ticks);
            let number = |p: &[f64; 6]| number_of_chords((p[2], p[3]), p[1] - p[0], 0.01, ticks);
            for (i, p) in pixels.iter().enumerate().filter(|(_, p)| number(p) > 1) {
                chords.add(i, Line { from: p[0], to: p[1], ticks }, (p[2], p[3]), number(p));
            }
            let before = |k: usize| pixels.iter().map(|p| p[k]).collect::<Vec<_>>();
            let photoreceptor = if twice { before(4) } else { vec![] };
            chords.filter(bandwidth, &Start { photoreceptor: &photoreceptor, filtered: &before(5) });
            for (i, p) in pixels.iter().enumerate() {
                let Some(nodes) = chords.nodes(i) else { prop_assert!(number(p) <= 1); continue };
                let nodes: Vec<Node> = nodes.collect();
                prop_assert_eq!(nodes.len(), number(p) + 1);
                prop_assert!(number(p) <= 16 && number(p) as i64 <= ticks);
                prop_assert_eq!((nodes[0].tick, nodes[0].log, nodes[0].filtered), (0, p[0], p[5]));
                let (mut outputs, mut extent) = ((p[4], p[5]), (p[0].min(p[5]), p[0].max(p[5])));
                if twice {
                    extent = (extent.0.min(p[4]), extent.1.max(p[4]));
                }
                for pair in nodes.windows(2) {
                    let (from, to, length_us) = (pair[0].log, pair[1].log, (pair[1].tick - pair[0].tick) as f64);
                    if twice {
                        let decays = Decays {
                            first: bandwidth.photoreceptor_decay(from, to, length_us),
                            second: bandwidth.follower_decay(length_us),
                        };
                        let ends = filter_twice(outputs, from, to, decays);
                        outputs = (ends.first, ends.second);
                        prop_assert_eq!((pair[1].decay, pair[1].photoreceptor), (decays.first, ends.first));
                    } else {
                        let decay = bandwidth.decay(from, to, length_us);
                        outputs.1 = filter(outputs.1, from, to, decay);
                        prop_assert_eq!(pair[1].decay, decay);
                    }
                    prop_assert_eq!(pair[1].filtered, outputs.1);
                    extent = (extent.0.min(to), extent.1.max(to));
                }
                prop_assert_eq!((nodes[nodes.len() - 1].tick, nodes[nodes.len() - 1].log), (ticks, p[1]));
                prop_assert_eq!(chords.extents().find(|of| of.0 == i).map(|of| of.1), Some(extent));
                prop_assert_eq!(chords.ends().find(|of| of.0 == i).map(|of| of.1.filtered), Some(outputs.1));
            }
        }
    }

    #[test]
    fn chords_lie_near_the_cubic() {
        assert_eq!(number_of_chords((1.0, 1.0), 1.0, 0.01, 1000), 1);
        assert_eq!(number_of_chords((3.0, 0.0), 1.0, 0.03, 1000), 5); // a bend of 0.75
        assert_eq!(number_of_chords((3.0, 0.0), 1.0, 1e-9, 1000), 16);
        assert_eq!(number_of_chords((3.0, 0.0), 1.0, 1e-9, 3), 3);
        assert_eq!(number_of_chords((f64::NAN, 0.0), 1.0, 0.01, 1000), 1);
        assert_eq!(number_of_chords((f64::INFINITY, 0.0), 1.0, 0.01, 1000), 16);
    }

    /// Second derivatives at the ends, 6 chord - 4 p - 2 q and 2 p + 4 q - 6 chord, over eight.
    #[test]
    fn a_cubic_s_bend_is_an_eighth_of_its_largest_second_derivative() {
        for (slopes, chord, expected) in [
            ((0.0, 0.0), 1.0, 0.75),
            ((3.0, 0.0), 1.0, 0.75),
            ((0.0, 4.0), 1.0, 1.25),
            ((4.0, 0.0), 1.0, 1.25),
            ((2.0, 5.0), -1.0, 3.75),
            ((1.5, 1.5), 1.5, 0.0),
        ] {
            assert_eq!(bend(slopes, chord).to_bits(), f64::to_bits(expected), "{slopes:?} {chord}");
        }
    }
}
