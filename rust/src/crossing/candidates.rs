//! Pixels that left their reach, collected, and what is computed of them many at a time in vector registers.
//!
//! [`super::decision`] decides them, as straight lines or as cubics. Here its input is gathered: the pixels' records and,
//! with rates of change, their slopes. Then events, records and marks after them are computed. Each quantity is in an
//! array of its own, padded to whole vectors, because the loops need that to become vector code.
//!
//! What must not break: the loops have no branches and no calls that are not inlined.

use std::ops::Range;

use multiversion::multiversion;

use super::band_events::{Grid, Key};
use super::cubic_candidates::{Cubics, Ends, Preparation, prepare};
use super::decision::{Decisions, References, Verdict, decide};
use super::line_candidates::Lines;
use super::parameters::{CrossingParameters, Interpolation};
use super::record::Record;
use super::registers::{self, Happened, LANES, Progress, Registers, Setting};
use super::sample::{DarkLevel, Sample};
use super::scan::{MOST_NOTED, NotedSamples};
use super::steps::{StepArrays, Steps};

/// Candidates as arrays.
pub(crate) struct Candidates<S> {
    /// Room for log intensity at the interval's start and end.
    from: Vec<f64>,
    to: Vec<f64>,
    base: Vec<f64>,
    steps: StepArrays,
    /// Rates of change at the interval's start and end, where curves are cubics, and slopes there: log intensity over the
    /// interval.
    rate_from: Vec<S>,
    rate_to: Vec<S>,
    pub(crate) slope_from: Vec<f64>,
    pub(crate) slope_to: Vec<f64>,
    /// Where cubics are likely to reach their level.
    likely: Vec<f64>,
    /// The tick of the event, where there is one, and the reference that is left behind.
    pub(crate) tick: Vec<i64>,
    pub(crate) verdict: Vec<Verdict>,
    after: Vec<f64>,
    /// The mark of that reference.
    pub(crate) marks: Vec<f32>,
    /// The words of the records, before the event and after it.
    pub(crate) words: Vec<u64>,
    pub(crate) words_after: Vec<u64>,
    /// The events themselves.
    pub(crate) keys: Vec<Key>,
}

/// Arrays are worked on in whole vectors: up to the next multiple.
const VECTOR: usize = 8;

/// What all candidates together came to.
#[derive(Clone, Copy, Default)]
pub(crate) struct Outcome {
    /// Those with one event.
    pub(crate) events: usize,
    /// Those that the exact rule decides.
    pub(crate) unclear: usize,
    /// Is there a record that cannot count its event?
    pub(crate) is_full: bool,
}

impl<S: Sample> Candidates<S> {
    pub(crate) fn new(p: &CrossingParameters) -> Self {
        let length = MOST_NOTED.next_multiple_of(VECTOR);
        let zeros = || vec![0.0; length];
        let rates = || vec![S::default(); if p.interpolation == Interpolation::Hermite { length } else { 0 }];
        Self {
            from: zeros(),
            to: zeros(),
            base: zeros(),
            steps: StepArrays::new(length, p),
            rate_from: rates(),
            rate_to: rates(),
            slope_from: zeros(),
            slope_to: zeros(),
            likely: zeros(),
            tick: vec![0; length],
            verdict: vec![Verdict::Nothing; length],
            after: zeros(),
            marks: vec![0.0; length],
            words: vec![0; length],
            words_after: vec![0; length],
            keys: vec![Key::default(); length],
        }
    }

    /// Takes the thresholds and the log intensity of what was noted.
    pub(crate) fn take_inputs(&mut self, samples: &NotedSamples<S>, first_pixel: usize, p: &CrossingParameters) {
        self.steps.take(|j| first_pixel + samples.pixel[j] as usize, samples.count, p);
        let n = samples.count.next_multiple_of(VECTOR);
        S::take_logs(&samples.from[..n], p.log_eps, &mut self.from);
        S::take_logs(&samples.to[..n], p.log_eps, &mut self.to);
    }

    /// Decides and carries out candidates from number `first` on, in registers: see [`Registers::carry_out`]. What they
    /// need was taken by [`Self::take_inputs`]. None if records are wide.
    pub(crate) fn carry_out<R: Record>(
        &mut self,
        registers: Registers,
        samples: &NotedSamples<S>,
        first: usize,
        at: Setting,
        (records, keys, old): (&mut [R], &mut [Key], &mut [R::Old]),
    ) -> Option<Progress> {
        let these = first..samples.count + LANES;
        let Steps { on, off } = self.steps.first(these.end);
        let lines = registers::Lines {
            count: samples.count - first,
            pixel: &samples.pixel[these.clone()],
            from: S::logs_of(&samples.from[these.clone()], &self.from[these.clone()]),
            to: S::logs_of(&samples.to[these.clone()], &self.to[these.clone()]),
            steps: Steps { on: &on[these.clone()], off: &off[these.clone()] },
        };
        let (records, old) = R::narrow(records, old)?;
        Some(registers.carry_out(&lines, at, records, Happened { after: &mut self.after[these], keys, old }))
    }

    /// Computes the marks of the references that decided candidates leave behind.
    pub(crate) fn take_marks(&mut self, these: Range<usize>, dark_level: DarkLevel) -> &[f32] {
        let marks = &mut self.marks[these.clone()];
        S::marks(&self.after[these], dark_level, marks);
        marks
    }

    /// Decides all candidates that were noted, over an interval of `ticks` ticks.
    ///
    /// [`Self::take_inputs`] comes before. `rates` are those of change at the interval's ends, if given. They and `records`
    /// begin where the pixels of `samples` are counted from.
    pub(crate) fn decide<R: Record>(
        &mut self,
        samples: &NotedSamples<S>,
        records: &[R],
        rates: Option<(&[S], &[S])>,
        ticks: i64,
        p: &CrossingParameters,
    ) {
        let pixels = &samples.pixel[..samples.count];
        for ((&pixel, base), word) in pixels.iter().zip(&mut self.base).zip(&mut self.words) {
            let record = records[pixel as usize];
            (*base, *word) = (record.base(), record.word());
        }
        let n = samples.count.next_multiple_of(VECTOR);
        let (from, to) = (&samples.from[..n], &samples.to[..n]);
        #[allow(clippy::cast_precision_loss, reason = "ticks < 2^53")]
        let ticks = ticks as f64;
        if let Some((rates_from, rates_to)) = rates {
            let gathered = self.rate_from.iter_mut().zip(&mut self.rate_to);
            for (&pixel, (from, to)) in pixels.iter().zip(gathered) {
                (*from, *to) = (rates_from[pixel as usize], rates_to[pixel as usize]);
            }
            let seconds = ticks * 1e-6;
            slopes(from, &self.rate_from[..n], p.log_eps, seconds, &mut self.slope_from[..n]);
            slopes(to, &self.rate_to[..n], p.log_eps, seconds, &mut self.slope_to[..n]);
        }
        let (from, to) = (S::logs_of(from, &self.from), S::logs_of(to, &self.to));
        let references = References { base: &self.base[..n], words: &self.words[..n] };
        let steps = self.steps.first(n);
        let decisions =
            Decisions { tick: &mut self.tick[..n], verdict: &mut self.verdict[..n], after: &mut self.after[..n] };
        if rates.is_some() {
            let ends = Ends { from, to };
            let (slope_from, slope_to) = (&mut self.slope_from[..n], &mut self.slope_to[..n]);
            let likely = &mut self.likely[..n];
            prepare::<R>(ends, &references, steps, Preparation { slope_from, slope_to, likely });
            let cubics = Cubics { ends, slope_from, slope_to, likely };
            decide::<_, R>(&cubics, &references, steps, ticks, decisions);
        } else {
            decide::<_, R>(&Lines { from, to }, &references, steps, ticks, decisions);
        }
    }

    /// Computes the events that were decided, and the marks and records after them. `since` is from the zero of times to
    /// the interval's start.
    pub(crate) fn finish<R: Record>(
        &mut self,
        samples: &NotedSamples<S>,
        grid: Grid,
        since: i64,
        dark_level: DarkLevel,
    ) -> Outcome {
        let n = samples.count;
        self.take_marks(0..n, dark_level);
        let decided = Decided { pixel: &samples.pixel[..n], verdict: &self.verdict[..n], tick: &self.tick[..n] };
        finish::<R>(&decided, grid, since, &self.words[..n], (&mut self.words_after[..n], &mut self.keys[..n]))
    }
}

/// Slopes in log intensity over an interval of so many seconds, from samples and their rates of change.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+avx512bw", "x86_64+avx2"))]
fn slopes<S: Sample>(samples: &[S], rates: &[S], log_eps: f64, seconds: f64, slopes: &mut [f64]) {
    let n = samples.len();
    let (rates, slopes) = (&rates[..n], &mut slopes[..n]);
    for j in 0..n {
        slopes[j] = samples[j].log_rate(rates[j], log_eps) * seconds;
    }
}

/// What was decided of the candidates in these pixels.
struct Decided<'a> {
    pixel: &'a [u32],
    verdict: &'a [Verdict],
    tick: &'a [i64],
}

/// The events of candidates, and their records' words after them.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+avx512bw", "x86_64+avx2"))]
#[allow(clippy::needless_bitwise_bool, reason = "a lazy operator is a branch, which vectors cannot take")]
fn finish<R: Record>(
    decided: &Decided<'_>,
    grid: Grid,
    since: i64,
    words: &[u64],
    (after, keys): (&mut [u64], &mut [Key]),
) -> Outcome {
    let n = words.len();
    let (pixel, verdict, tick) = (&decided.pixel[..n], &decided.verdict[..n], &decided.tick[..n]);
    let (after, keys) = (&mut after[..n], &mut keys[..n]);
    let mut outcome = Outcome::default();
    for j in 0..n {
        let on = verdict[j] as u8 == Verdict::On as u8;
        let single = on | (verdict[j] as u8 == Verdict::Off as u8);
        keys[j] = Key::new(tick[j], grid.address(pixel[j]), on);
        let stepped = R::stepped(words[j], on, since + tick[j]);
        after[j] = if single { stepped } else { words[j] };
        outcome.events += usize::from(single);
        outcome.unclear += usize::from(verdict[j] as u8 == Verdict::Unclear as u8);
        outcome.is_full |= single & R::is_full(words[j], on);
    }
    outcome
}
