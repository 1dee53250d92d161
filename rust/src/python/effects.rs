//! Effects as dictionaries: the effect's name, and its parameters by theirs.

use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::crossing::{Effects, HotPixels, Leak, PhotoreceptorBandwidth, ShotNoise, ThresholdMismatch};
use crate::readout::ReadoutParameters;

/// Refuse settings of effects that are out of range.
///
/// Raises:
///     ValueError: naming the effect, the value and the range.
#[pyfunction]
pub(super) fn check_effects(effects: &Bound<'_, PyAny>) -> PyResult<()> {
    Ok(from_python(Some(effects))?.check()?)
}

/// Reads what stands for effects in every other call too: Python's parser reads what is not `davis_rs.Effects` already.
pub(super) fn from_any(effects: Option<&Bound<'_, PyAny>>) -> PyResult<Effects> {
    let Some(given) = effects else { return Ok(Effects::default()) };
    let py = given.py();
    let rule = PyDict::new(py);
    rule.set_item("not_planned", "is for a scene that can be rendered; here name {effects}")?;
    let parser = py.import("davis_rs.sensor.effects.effects")?.getattr("effects_of")?;
    from_python(Some(&parser.call((given,), Some(&rule))?))
}

/// Reads the settings of effects on the log signal, in the pixel and on the stream, from a dictionary with all of their
/// parameters or from an object with `engine_settings`.
pub(super) fn from_python(effects: Option<&Bound<'_, PyAny>>) -> PyResult<Effects> {
    let mut all = Effects::default();
    let Some(effects) = effects else { return Ok(all) };
    let settings = match effects.cast::<PyDict>() {
        Ok(dict) => dict.clone(),
        Err(_) if effects.hasattr("engine_settings")? => {
            let (settings, all) = (effects.call_method0("engine_settings")?, effects.call_method0("describe")?);
            let (settings, all) = (settings.cast_into::<PyDict>()?, all.cast_into::<PyDict>()?);
            for name in all.keys() {
                if !settings.contains(&name)? {
                    return Err(PyValueError::new_err(format!("{name} does not act in the crossing engine")));
                }
            }
            settings
        }
        Err(_) => {
            return Err(PyValueError::new_err(format!(
                "effects must be davis_rs.Effects or None, got {}",
                effects.repr()?
            )));
        }
    };
    for (name, values) in settings {
        let rule =
            || PyValueError::new_err(format!("effects must be a dictionary of dictionaries, got {name}: {values}"));
        let name: String = name.extract().map_err(|_| rule())?;
        let values = values.cast::<PyDict>().map_err(|_| rule())?.clone();
        let number = |parameter: &str| -> PyResult<f64> {
            let value = parameter_of(&name, &values, parameter)?;
            value
                .extract()
                .map_err(|_| PyValueError::new_err(format!("{name}: {parameter} must be a number, got {value}")))
        };
        match name.as_str() {
            "photoreceptor_bandwidth_hz" => {
                all.photoreceptor_bandwidth =
                    PhotoreceptorBandwidth { hz: number("hz")?, source_follower_hz: number("source_follower_hz")? };
            }
            "threshold_mismatch" => {
                all.threshold_mismatch = ThresholdMismatch {
                    sigma: number("sigma")?,
                    correlation: number("correlation")?,
                    column_parity: number("column_parity")?,
                    columns: number("columns")?,
                    rows: number("rows")?,
                };
            }
            "refractory_period_us" => all.refractory_period_us = number("period_us")?,
            "leak_rate_hz" => {
                all.leak = Leak {
                    rate_hz: number("rate_hz")?,
                    spread: number("spread")?,
                    jitter: number("jitter")?,
                    temperature_c: number("temperature_c")?,
                    doubling_c: number("doubling_c")?,
                    double_luma: number("double_luma")?,
                };
            }
            "shot_noise_rms" => {
                all.shot_noise = ShotNoise {
                    rms: number("rms")?,
                    floor: number("floor")?,
                    half_luma: number("half_luma")?,
                    bandwidth_hz: number("bandwidth_hz")?,
                };
            }
            "hot_pixels" => {
                all.hot_pixels = HotPixels {
                    fraction: number("fraction")?,
                    rate_hz: number("rate_hz")?,
                    rate_spread: number("rate_spread")?,
                    least_cv: number("least_cv")?,
                    most_cv: number("most_cv")?,
                };
            }
            "readout" => {
                all.readout = Some(ReadoutParameters {
                    events_per_s: number("events_per_s")?,
                    row_us: number("row_us")?,
                    latency_us: number("latency_us")?,
                    jitter_us: number("jitter_us")?,
                    drop_after_us: match parameter_of(&name, &values, "drop_after_us")? {
                        none if none.is_none() => None,
                        _ => Some(number("drop_after_us")?),
                    },
                    by_columns: match number("by_columns")? {
                        0.0 => false,
                        1.0 => true,
                        other => {
                            let rule = format!("readout: by_columns must be 0 or 1, got {other}");
                            return Err(PyValueError::new_err(rule));
                        }
                    },
                });
            }
            _ => return Err(PyValueError::new_err(format!("there is no effect {name:?} of the crossing engine"))),
        }
    }
    Ok(all)
}

/// Returns the dictionary that [`from_python`] takes.
pub(super) fn to_dict<'py>(py: Python<'py>, effects: &Effects) -> PyResult<Bound<'py, PyDict>> {
    let all = PyDict::new(py);
    let put = |name: &str, parameters: &[(&str, f64)]| -> PyResult<Bound<'py, PyDict>> {
        let dict = PyDict::new(py);
        for (parameter, value) in parameters {
            dict.set_item(parameter, value)?;
        }
        all.set_item(name, &dict)?;
        Ok(dict)
    };
    let (bandwidth, shot, hot) = (effects.photoreceptor_bandwidth, effects.shot_noise, effects.hot_pixels);
    put("photoreceptor_bandwidth_hz", &[("hz", bandwidth.hz), ("source_follower_hz", bandwidth.source_follower_hz)])?;
    put("refractory_period_us", &[("period_us", effects.refractory_period_us)])?;
    let leak = effects.leak;
    put(
        "leak_rate_hz",
        &[
            ("rate_hz", leak.rate_hz),
            ("spread", leak.spread),
            ("jitter", leak.jitter),
            ("temperature_c", leak.temperature_c),
            ("doubling_c", leak.doubling_c),
            ("double_luma", leak.double_luma),
        ],
    )?;
    let noise =
        [("rms", shot.rms), ("floor", shot.floor), ("half_luma", shot.half_luma), ("bandwidth_hz", shot.bandwidth_hz)];
    put("shot_noise_rms", &noise)?;
    put(
        "hot_pixels",
        &[
            ("fraction", hot.fraction),
            ("rate_hz", hot.rate_hz),
            ("rate_spread", hot.rate_spread),
            ("least_cv", hot.least_cv),
            ("most_cv", hot.most_cv),
        ],
    )?;
    if let Some(bus) = effects.readout {
        let numbers = [
            ("events_per_s", bus.events_per_s),
            ("row_us", bus.row_us),
            ("latency_us", bus.latency_us),
            ("jitter_us", bus.jitter_us),
            ("by_columns", f64::from(u8::from(bus.by_columns))),
        ];
        put("readout", &numbers)?.set_item("drop_after_us", bus.drop_after_us)?;
    }
    Ok(all)
}

/// Returns the names of the effects that are on, of those that act beyond the thresholds.
pub(super) fn active(effects: &Effects) -> Vec<&'static str> {
    let hot = effects.hot_pixels;
    let all = [
        ("photoreceptor_bandwidth_hz", effects.filters()),
        ("refractory_period_us", effects.refractory_period_us > 0.0),
        ("leak_rate_hz", effects.leak.is_on()),
        ("shot_noise_rms", effects.shot_noise.is_on()),
        ("hot_pixels", hot.are_on()),
        ("readout", effects.readout.is_some_and(|bus| !bus.is_neutral())),
    ];
    all.into_iter().filter(|(_, on)| *on).map(|(name, _)| name).collect()
}

fn parameter_of<'py>(name: &str, values: &Bound<'py, PyDict>, parameter: &str) -> PyResult<Bound<'py, PyAny>> {
    values.get_item(parameter)?.ok_or_else(|| PyValueError::new_err(format!("{name} must have {parameter}")))
}
