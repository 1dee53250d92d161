//! `CrossingEngine` for Python.

use numpy::{IntoPyArray, PyArray1, PyArray2};
use pyo3::prelude::*;
use pyo3::types::PyDict;

use super::arrays::{Float, column, frame, image, microseconds, threshold, threshold_to_python};
use super::{arrays, effects, interpolation, start_phase, state};
use crate::crossing::{CrossingEngine, CrossingParameters, Frame, SparseSamples, Threshold};
use crate::error::Error;
use crate::event::{Event, SensorSize};

/// Turns frames of linear luma into events, by the crossing rule of an ideal event-camera pixel.
///
/// Each pixel holds a reference R = B + n_on C_on - n_off C_off with integer counters, B being its log intensity at the
/// first frame (see ``start_phase``). Between two frames log intensity L = ln(luma + log_eps) is interpolated; an ON
/// event falls each time it reaches R + C_on, an OFF event each time it reaches R - C_off. An event's stamp is the
/// first microsecond at or after the crossing, so it lies in (t_a, t_b]. After every frame -C_off < L - R < C_on holds
/// in every pixel.
///
/// With linear interpolation levels and stamps are decided exactly for the float64 L. With Hermite interpolation the
/// stamp may be one microsecond off where the crossing lies within 1e-6 us of one, and where an extremum comes
/// within 4 ulp of a level either count may come. See docs/crossing.md for the guarantee and where it ends.
///
/// Under ``effects`` the pixel is not ideal, and what is said above holds as far as they let it: see
/// :class:`davis_rs.Effects` and docs/effects.md. Noise is a function of (seed, effect, pixel, number of the draw).
///
/// Engines can be pickled. A pixel may have 2^32 - 1 events of each polarity.
///
/// Args:
///     width, height: sensor size in pixels, 1..65535.
///     contrast_threshold: C_on in natural-log units, 1e-6..1e3: a number (None means 0.15), or float, shape
///         (height, width).
///     contrast_threshold_off: C_off, likewise; None means C_on.
///     log_eps: dark level in units of luma, > 0.
///     interpolation: ``linear``, or ``hermite``: cubics through samples and rates of change.
///     effects: :class:`davis_rs.Effects`, or what stands for them in other calls: texts such as
///         ``"refractory_period_us=100"``, or numbers and parameters by name. Those on the log signal, in the pixel and
///         on the stream act here. None for ideal pixels.
///     start_phase: where references lie at the first frame: ``zero``, at its log intensity; ``stationary``, so that
///         L - R is uniform in (-C_off, C_on), drawn for each pixel, as in a camera that has run before.
///     seed: of thresholds, start phases and noise, 0..2^64 - 1; None means 0.
///     threads: 1..1024; None means as many as make a sensor of this size faster, at most one a core. The events do not
///         depend on it.
///
/// Raises:
///     ValueError: for a parameter out of range.
///
/// Source: Mueggler, Rebecq, Gallego, Delbruck, Scaramuzza, The Event-Camera Dataset and Simulator, IJRR 2017,
/// section 6.
#[pyclass(name = "CrossingEngine", module = "davis_rs._core")]
pub(super) struct PyCrossingEngine(CrossingEngine);

#[pymethods]
impl PyCrossingEngine {
    #[new]
    #[pyo3(signature = (
        width,
        height,
        *,
        contrast_threshold=None,
        contrast_threshold_off=None,
        log_eps=1e-3,
        interpolation="linear",
        effects=None,
        start_phase="zero",
        seed=None,
        threads=None,
    ))]
    #[allow(clippy::too_many_arguments, reason = "keywords in Python")]
    fn new(
        width: i64,
        height: i64,
        contrast_threshold: Option<&Bound<'_, PyAny>>,
        contrast_threshold_off: Option<&Bound<'_, PyAny>>,
        log_eps: f64,
        interpolation: &str,
        effects: Option<&Bound<'_, PyAny>>,
        start_phase: &str,
        seed: Option<&Bound<'_, PyAny>>,
        threads: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Self> {
        let pixels = |name, n: i64| {
            let rule = || Error::Argument(format!("{name} must lie in 1..65535, got {n}"));
            u16::try_from(n).map_err(|_| rule())
        };
        let size = SensorSize { width: pixels("width", width)?, height: pixels("height", height)? };
        let default = CrossingParameters::default();
        let on = contrast_threshold.map(|c| threshold(c, "contrast_threshold", size)).transpose()?;
        let on = on.unwrap_or(default.contrast_threshold);
        let off = contrast_threshold_off.map(|c| threshold(c, "contrast_threshold_off", size)).transpose()?;
        let parameters = CrossingParameters {
            contrast_threshold_off: off.unwrap_or_else(|| on.clone()),
            contrast_threshold: on,
            log_eps,
            interpolation: interpolation::of_name(interpolation)?,
            start_phase: start_phase::of_name(start_phase)?,
        };
        let effects = effects::from_any(effects)?;
        let seed = seed.map_or(Ok(0), arrays::seed)?;
        Ok(Self(CrossingEngine::with_effects(size, parameters, &effects, seed, arrays::threads(threads)?)?))
    }

    /// Take the frame at ``t_us``; return the events since the frame before it.
    ///
    /// The first frame sets the references and returns no events. The GIL is released.
    ///
    /// Args:
    ///     t_us: time in microseconds, >= 0 and after the last frame's.
    ///     luma: linear luma, shape (height, width), finite and >= 0; float32 in C order is taken without a copy,
    ///         other layouts are copied, float64 is rounded to float32.
    ///     dluma_dt: for Hermite interpolation, the total dY/dt in luma per second, likewise; a value that is not
    ///         finite means a straight line for that pixel. A slope makes no extremum that the samples do not support:
    ///         slopes of one sign against the samples' way are ignored, along it cut to three times the chord's.
    ///     sparse: samples that some pixels bring since the last frame: (pixel, t_us, luma), arrays of one length:
    ///         row-major pixel index, time strictly between the two frames, luma as above; sorted by pixel and then
    ///         by time. Straight lines run between them, also where the frames have rates.
    ///
    /// Returns:
    ///     Events (:data:`davis_rs.EVENT_DTYPE`), sorted by (t, y, x, order of crossing).
    ///
    /// Raises:
    ///     ValueError: for a wrong shape or dtype, luma that is NaN, infinite or negative (with time and pixel), a time
    ///         that does not increase, a rate that is missing or should not be there, sparse samples that are out of
    ///         order or outside of the interval, an engine that has been fed with log intensity, or more than 2^27
    ///         events. The engine is then as it was.
    ///     MemoryError: if there is no memory for the events. The engine is then as it was.
    #[pyo3(signature = (t_us, luma, dluma_dt=None, *, sparse=None))]
    fn push<'py>(
        &mut self,
        t_us: &Bound<'py, PyAny>,
        luma: &Bound<'py, PyAny>,
        dluma_dt: Option<&Bound<'py, PyAny>>,
        sparse: Option<SparseArrays<'py>>,
    ) -> PyResult<Bound<'py, PyArray1<Event>>> {
        let names = ("luma", "dluma_dt");
        take(&mut self.0, CrossingEngine::push, t_us, (luma, dluma_dt, sparse), names)
    }

    /// Take log intensity itself instead of luma, otherwise as :meth:`push`; ``log_eps`` is not used.
    ///
    /// Args:
    ///     t_us: time in microseconds, >= 0 and after the last frame's.
    ///     log_intensity: natural logarithm, shape (height, width), within +-746; float64 in C order is taken without
    ///         a copy, float32 is widened.
    ///     slope: for Hermite interpolation, dL/dt per second, likewise; see ``dluma_dt`` of :meth:`push`.
    ///     sparse: as of :meth:`push`, with log intensity instead of luma.
    ///
    /// Returns:
    ///     Events (:data:`davis_rs.EVENT_DTYPE`), as of :meth:`push`.
    ///
    /// Raises:
    ///     ValueError: as :meth:`push`, for log intensity that is NaN or beyond +-746, or an engine that has been fed
    ///         with luma. The engine is then as it was.
    #[pyo3(signature = (t_us, log_intensity, slope=None, *, sparse=None))]
    fn push_log<'py>(
        &mut self,
        t_us: &Bound<'py, PyAny>,
        log_intensity: &Bound<'py, PyAny>,
        slope: Option<&Bound<'py, PyAny>>,
        sparse: Option<SparseArrays<'py>>,
    ) -> PyResult<Bound<'py, PyArray1<Event>>> {
        let names = ("log_intensity", "slope");
        take(&mut self.0, CrossingEngine::push_log, t_us, (log_intensity, slope, sparse), names)
    }

    /// Return the events that the readout effect still holds: requested up to the last frame, stamped after it.
    ///
    /// Returns:
    ///     Events (:data:`davis_rs.EVENT_DTYPE`), sorted; none without that effect.
    fn flush<'py>(&mut self, py: Python<'py>) -> Bound<'py, PyArray1<Event>> {
        self.0.flush().into_pyarray(py)
    }

    /// How many events the readout effect has dropped so far; 0 without it.
    #[getter]
    fn dropped_events(&self) -> u64 {
        self.0.dropped_events()
    }

    /// How often a pixel reached a level before its last event was read out and its reset over; 0 without a bus.
    #[getter]
    fn missed_events(&self) -> u64 {
        self.0.missed_events()
    }

    /// C_on in natural-log units: one number for all pixels, or float64, shape (height, width), one for each.
    #[getter]
    fn contrast_threshold<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        threshold_to_python(py, self.0.parameters().contrast_threshold.clone(), self.0.size())
    }

    /// C_off in natural-log units: one number for all pixels, or float64, shape (height, width), one for each.
    #[getter]
    fn contrast_threshold_off<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        threshold_to_python(py, self.0.parameters().contrast_threshold_off.clone(), self.0.size())
    }

    /// The reference R in log intensity, float64, shape (height, width).
    ///
    /// NaN before the first frame, and where a refractory period holds a pixel in reset.
    #[getter]
    fn reference<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        image(py, self.0.reference(), self.0.size())
    }

    /// The surface of active events: the time of each pixel's last event in microseconds, -1 where there was none.
    ///
    /// int64, shape (height, width).
    #[getter]
    fn last_event_us<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<i64>>> {
        image(py, self.0.last_event_us(), self.0.size())
    }

    /// Return what decides which events come next, as numbers and arrays: parameters, time, last frame, counters.
    ///
    /// For :meth:`from_state`, and for NumPy's or any other storage; pickling stores the same.
    fn state<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        state::to_dict(py, self.0.state())
    }

    /// Return an engine that continues from :meth:`state` as the original engine would have.
    ///
    /// Args:
    ///     state: what :meth:`state` gave, also in another process or at another time.
    ///     threads: as of the class; the events do not depend on it.
    ///
    /// Raises:
    ///     ValueError: for a state that no engine can be in, naming the entry.
    #[staticmethod]
    #[pyo3(signature = (state, *, threads=None))]
    fn from_state(state: &Bound<'_, PyDict>, threads: Option<&Bound<'_, PyAny>>) -> PyResult<Self> {
        Ok(Self(CrossingEngine::from_state(&state::from_dict(state)?, arrays::threads(threads)?)?))
    }

    fn __repr__(&self) -> String {
        let (SensorSize { width, height }, p) = (self.0.size(), self.0.parameters());
        let [on, off] = [&p.contrast_threshold, &p.contrast_threshold_off].map(threshold_range);
        let (log_eps, interpolation) = (p.log_eps, interpolation::name(p.interpolation));
        let start_phase = start_phase::name(p.start_phase);
        let effects = effects::active(self.0.effects()).join(", ");
        let t_us = self.0.t_us().map_or("None".to_owned(), |t_us| t_us.to_string());
        format!(
            "CrossingEngine({width} x {height}, contrast_threshold={on}, contrast_threshold_off={off}, \
             log_eps={log_eps:?}, interpolation={interpolation:?}, effects=[{effects}], \
             start_phase={start_phase:?}, t_us={t_us})"
        )
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<(Bound<'py, PyAny>, (Bound<'py, PyDict>,))> {
        Ok((py.get_type::<Self>().getattr("from_state")?, (self.state(py)?,)))
    }
}

/// Returns a threshold for people: the value, or the least and the largest one.
fn threshold_range(threshold: &Threshold) -> String {
    match threshold {
        Threshold::Uniform(value) => format!("{value:?}"),
        Threshold::PerPixel(values) => {
            let (least, largest) = values.iter().fold((f64::INFINITY, 0.0f64), |(a, b), &c| (a.min(c), b.max(c)));
            format!("{least:.4}..{largest:.4} by pixel")
        }
    }
}

/// Pixel, time and value of sparse samples, as a user gives them.
type SparseArrays<'py> = (Bound<'py, PyAny>, Bound<'py, PyAny>, Bound<'py, PyAny>);

/// Feeds an engine by one of its two ways, without the GIL.
fn take<'py, S: Float + Sync>(
    engine: &mut CrossingEngine,
    push: impl Fn(&mut CrossingEngine, Frame<'_, S>, &mut Vec<Event>) -> Result<(), Error> + Send + Sync,
    t_us: &Bound<'py, PyAny>,
    (samples, rate, sparse): (&Bound<'py, PyAny>, Option<&Bound<'py, PyAny>>, Option<SparseArrays<'py>>),
    names: (&str, &str),
) -> PyResult<Bound<'py, PyArray1<Event>>> {
    let py = t_us.py();
    let size = Some(engine.size());
    let samples = frame::<S>(samples, names.0, size)?;
    let rate = rate.map(|rate| frame::<S>(rate, names.1, size)).transpose()?;
    let sparse = sparse
        .map(|(pixel, t_us, value)| {
            let pixel = column::<u32>(&pixel, "the pixels of sparse samples")?;
            let t_us = column::<i64>(&t_us, "the times of sparse samples")?;
            PyResult::Ok((pixel, t_us, column::<S>(&value, "the values of sparse samples")?))
        })
        .transpose()?;
    let mut input = Frame::new(microseconds(t_us)?, samples.as_slice()?);
    input.rate = rate.as_ref().map(|rate| rate.as_slice()).transpose()?;
    if let Some((pixel, t_us, samples)) = &sparse {
        input.sparse = SparseSamples { pixel: pixel.as_slice()?, t_us: t_us.as_slice()?, samples: samples.as_slice()? };
    }
    let mut events = Vec::new();
    py.detach(|| push(engine, input, &mut events))?;
    Ok(events.into_pyarray(py))
}
