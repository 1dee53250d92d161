"""Writes times, rates and values with their units, for people."""

from __future__ import annotations

_UNITS = {
    "events_per_s": "events/s",
    "_us": "us",
    "_ms": "ms",
    "_s": "s",
    "_hz": "Hz",
    "_px": "px",
    "_lux": "lux",
    "_luma": "luma",
    "_dn": "DN",
    "_e": "e-",
    "_c": "degrees C",
    "_m": "m",
    "_percent": "%",
}
"""By the end of a name, the unit of the value."""


def time_text(us: float) -> str:
    """Write a time in microseconds to three digits, in the unit that suits it: 1.93 s, 20 ms, 5 us."""
    for factor, unit in ((1e6, "s"), (1e3, "ms")):
        if us >= factor:
            return f"{three_digits(us / factor)} {unit}"
    return f"{three_digits(us)} us"


def three_digits(value: float) -> str:
    """Write a number of at least 0.001 to three digits, never with an exponent."""
    return f"{value:.0f}" if value >= 99.5 else f"{value:.3g}"


def metres(value: float) -> str:
    """Write a length in metres to three digits or to the metre, never with a large exponent: 0.562 m, 9,995 m."""
    return f"{value:,.0f} m" if value >= 99.5 else f"{value:.3g} m"


def percent(fraction: float) -> str:
    """Write a fraction in percent to two digits, never with an exponent."""
    return f"{100 * fraction:.0f} %" if fraction >= 0.995 else f"{100 * fraction:.2g} %"


def about(seconds: float) -> str:
    """Write a time as people say it: ``about 5 minutes``."""
    units = {"second": 1, "minute": 60, "hour": 3600, "day": 86400}
    unit = [unit for unit, length in units.items() if seconds >= 1.5 * length or unit == "second"][-1]
    count = seconds / units[unit]
    count = max(1, round(count, -1 if count > 20 else 0))
    return f"about {count:.0f} {unit}{'s' * (count > 1)}"


def events_a_second(rate: float) -> str:
    """Write a rate of events: 350k/s, 4.2M/s."""
    for unit, size in (("M", 1e6), ("k", 1e3)):
        if rate >= size:
            return f"{rate / size:.{1 if rate < 10 * size else 0}f}{unit}/s"
    return f"{rate:.0f}/s"


def with_unit(name: str, value: object) -> str:
    """Return a value as text, with the unit that the end of its name says: ``refractory_period_us`` is in us."""
    if value is None:
        return "-"
    text = str(value)
    if isinstance(value, float):
        text = f"{value:,.0f}" if 1e5 <= abs(value) < 1e15 else f"{value:.6g}"
    unit = next((unit for end, unit in _UNITS.items() if name.endswith(end)), "")
    return f"{text} {unit}".rstrip()
