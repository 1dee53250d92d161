//! The pixels of a sensor as arrays, cut into bands for threads, and how a frame passes through them.
//!
//! There is an array for each quantity instead of a struct for each pixel, because a quiet frame then reads only
//! samples and bounds. There are several bands for each thread, because some bands have many more events than others.
//!
//! A push works on copies where it can: the new frame goes into `next`. [`Pixels::settle`] then makes it the last one.
//! If the frame makes too many events, [`Pixels::undo`] takes the counters back by the events that were made.
//!
//! What must not break:
//! - The cut into bands changes no event. Bands begin at whole tiles.
//! - After [`Pixels::undo`], the state is that before the push.

use rayon::prelude::*;

use super::band::{Band, Interval, Share};
use super::cubic::Cubic;
use super::frame::Frame;
use super::level::Level;
use super::line::Line;
use super::marks::Marking;
use super::parameters::CrossingParameters;
use super::room::{Allowance, Stop, Tally};
use super::sample::Sample;
use super::scan::TILE;
use super::state::EngineState;
use crate::event::{Event, SensorSize};

/// No event yet.
pub(crate) const NEVER: i64 = -1;

/// The pixels of a sensor: a push runs them over a frame, and then keeps what it found, or undoes it.
pub(crate) trait Pixels<S> {
    /// Runs every pixel over one checked frame, within an allowance of events: then [`Self::settle`], or [`Self::undo`].
    fn advance(&mut self, push: &Push<'_, S>, allowance: Allowance) -> std::result::Result<(), Stop>;

    /// The events of the last frame: parts that together are in raster order.
    fn events(&self) -> Vec<&[Event]>;

    /// Keeps what [`Self::advance`] has found.
    fn settle(&mut self, push: &Push<'_, S>);

    /// Goes back to before [`Self::advance`].
    fn undo(&mut self, push: &Push<'_, S>);

    /// About how many events the frame makes.
    fn count(&self, push: &Push<'_, S>) -> u64;
}

/// A checked frame, and what else pixels need.
pub(crate) struct Push<'a, S> {
    pub(crate) frame: Frame<'a, S>,
    pub(crate) at: Interval,
    pub(crate) size: SensorSize,
    pub(crate) p: &'a CrossingParameters,
    pub(crate) pool: Option<&'a rayon::ThreadPool>,
}

/// State of 36 bytes a pixel for luma (the rate of change takes four more), in arrays: what every frame touches lies
/// together, apart from what only an event touches.
pub(crate) struct Core<S> {
    last: Vec<S>,
    /// The frame that a push brings, until it is done and this becomes `last`.
    next: Vec<S>,
    marks: Vec<f32>,
    marking: Marking,
    /// Empty where interpolation is linear.
    rates: Vec<S>,
    references: Vec<Level>,
    /// Times of last events, in microseconds, without those of the last frame: the bands still hold these.
    last_event_us: Vec<i64>,
    bands: Vec<Band<S>>,
}

/// Bands for each thread, so that one with many events does not keep the others waiting.
const BANDS_PER_THREAD: usize = 4;

impl<S: Sample> Core<S> {
    /// Takes the first frame, at which references begin.
    pub(crate) fn new(
        first: &[S],
        rates: Option<&[S]>,
        parameters: &CrossingParameters,
        seed: u64,
        pool: Option<&rayon::ThreadPool>,
    ) -> Self {
        let mut logs = vec![0.0; first.len()];
        S::logs(first, parameters.log_eps, &mut logs);
        let bands = pool.map_or(1, |pool| BANDS_PER_THREAD * pool.current_num_threads());
        let samples = || vec![S::default(); first.len()];
        let mut core = Self {
            last: first.to_vec(),
            next: samples(),
            marks: vec![0.0; first.len()],
            marking: Marking::new::<S>(parameters, first.len()),
            rates: rates.map_or(vec![], <[S]>::to_vec),
            references: logs.iter().enumerate().map(|(i, &log)| parameters.first_reference(log, i, seed)).collect(),
            last_event_us: vec![NEVER; first.len()],
            bands: (0..bands).map(|_| Band::new(parameters)).collect(),
        };
        core.reset_marks(parameters);
        core
    }

    /// Takes up stored counters and times, the last frame being that of the state.
    pub(crate) fn restore(&mut self, state: &EngineState) {
        for (i, reference) in self.references.iter_mut().enumerate() {
            *reference = Level { base: state.base[i], on: state.on[i], off: state.off[i] };
        }
        self.last_event_us.copy_from_slice(&state.last_event_us);
        self.reset_marks(&state.parameters);
    }

    pub(crate) fn last(&self) -> &[S] {
        &self.last
    }

    pub(crate) fn rates(&self) -> &[S] {
        &self.rates
    }

    pub(crate) fn references(&self) -> &[Level] {
        &self.references
    }

    /// The time of each pixel's last event in microseconds, or [`NEVER`].
    pub(crate) fn last_event_us(&self, size: SensorSize) -> Vec<i64> {
        let mut times = self.last_event_us.clone();
        for event in self.bands.iter().flat_map(|band| band.events.events()) {
            times[event.pixel(size)] = event.t;
        }
        times
    }

    /// Computes the marks of all pixels afresh.
    fn reset_marks(&mut self, parameters: &CrossingParameters) {
        let mut values = vec![0.0; TILE];
        for (tile, (references, marks)) in self.references.chunks(TILE).zip(self.marks.chunks_mut(TILE)).enumerate() {
            for (j, (value, reference)) in values.iter_mut().zip(references).enumerate() {
                *value = reference.value(parameters.thresholds(tile * TILE + j));
            }
            S::marks(&values[..references.len()], self.marking.ground(), marks);
        }
    }
}

impl<S: Sample> Pixels<S> for Core<S> {
    fn events(&self) -> Vec<&[Event]> {
        self.bands.iter().map(|band| band.events.events()).collect()
    }

    fn advance(&mut self, push: &Push<'_, S>, allowance: Allowance) -> std::result::Result<(), Stop> {
        let Push { frame, at, size, p: parameters, pool } = *push;
        let Self { last, next, marks, marking, rates: before, references, last_event_us, bands } = self;
        let marking = &*marking;
        let rates_at =
            |start: usize, n: usize| frame.rate.map(|now| (&before[start..start + n], &now[start..start + n]));
        let (new, sparse) = (frame.samples, frame.sparse);
        match pool {
            None => {
                let rates = rates_at(0, new.len());
                let marking = marking.of(0..new.len());
                let share =
                    Share { first_pixel: 0, references, last_event_us, last, next, marks, marking, new, rates, sparse };
                bands[0].advance(share, at, size, parameters, allowance)
            }
            Some(pool) => {
                let length = new.len().div_ceil(bands.len()).next_multiple_of(TILE);
                pool.install(|| {
                    let state = (references.par_chunks_mut(length), last_event_us.par_chunks_mut(length));
                    let samples = (last.par_chunks(length), next.par_chunks_mut(length), new.par_chunks(length));
                    let shares = (state, marks.par_chunks_mut(length), samples, bands.par_iter_mut())
                        .into_par_iter()
                        .enumerate();
                    // Every band begins, also where another one is full: what it holds is then of this frame.
                    let outcomes = shares.map(|(i, ((references, last_event_us), marks, (last, next, new), band))| {
                        let (first_pixel, rates) = (i * length, rates_at(i * length, new.len()));
                        let sparse = sparse.of(first_pixel, first_pixel + new.len());
                        let share = Share {
                            first_pixel,
                            references,
                            last_event_us,
                            last,
                            next,
                            marks,
                            marking: marking.of(first_pixel..first_pixel + new.len()),
                            new,
                            rates,
                            sparse,
                        };
                        band.advance(share, at, size, parameters, allowance)
                    });
                    outcomes.reduce(|| Ok(()), Stop::both)
                })
            }
        }
    }

    fn settle(&mut self, push: &Push<'_, S>) {
        std::mem::swap(&mut self.last, &mut self.next);
        if let Some(now) = push.frame.rate {
            self.rates.copy_from_slice(now);
        }
    }

    #[cold]
    fn undo(&mut self, push: &Push<'_, S>) {
        for band in &mut self.bands {
            for event in band.events.events() {
                let reference = &mut self.references[event.pixel(push.size)];
                *if event.p == 0 { &mut reference.off } else { &mut reference.on } -= 1;
            }
            band.events.clear();
        }
        self.reset_marks(push.p);
    }

    #[cold]
    fn count(&self, push: &Push<'_, S>) -> u64 {
        let Push { frame, at, p, .. } = *push;
        #[allow(clippy::cast_precision_loss, reason = "ticks < 2^53")]
        let seconds = at.ticks as f64 * 1e-6;
        let log = |sample: S| {
            let mut log = [0.0];
            S::logs(&[sample], p.log_eps, &mut log);
            log[0]
        };
        let count = |(i, &reference): (usize, &Level)| {
            let (from, to, c) = (self.last[i], frame.samples[i], p.thresholds(i));
            let (line, mut tally) = (Line { from: log(from), to: log(to), ticks: at.ticks }, Tally::new(reference, c));
            let sparse = frame.sparse.of(i, i + 1);
            match frame.rate {
                Some(rates) if sparse.is_empty() => {
                    let slope = |sample: S, rate| sample.log_rate(rate, p.log_eps) * seconds;
                    tally.follow(&Cubic::new(line, slope(from, self.rates[i]), slope(to, rates[i])), c);
                }
                _ => {
                    for &sample in sparse.samples {
                        tally.follow(&Line { to: log(sample), ..line }, c);
                    }
                    tally.follow(&line, c);
                }
            }
            tally.events()
        };
        self.references.iter().enumerate().map(count).fold(0, u64::saturating_add)
    }
}
