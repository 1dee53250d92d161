"""Defines a real sensor's imperfections, each off unless asked for.

Each effect has one module, with its parameters, ranges and source. ``optics`` applies those on luma, for every renderer
and for frames, rates and single samples alike; ``rust/src/crossing/effects`` applies those in the pixel.
``custom_effects`` calls a user's own objects. They see whole keyframes and whole intervals, each once and in the
order of time, so that they may have a state.
"""

from .aps import Aps
from .custom_effects import CustomEffects
from .effect import Effect
from .effects import EFFECTS, Effects, EffectsLike, parse_effect
from .event_draws import event_draws
from .hot_pixels import HotPixels
from .leak_rate import LeakRate
from .lens_blur import LensBlur
from .optics import Optics, with_optics
from .photoreceptor_bandwidth import PhotoreceptorBandwidth
from .readout import Readout
from .refractory_period import RefractoryPeriod
from .shot_noise import ShotNoise
from .threshold_mismatch import ThresholdMismatch
from .vignetting import Vignetting

__all__ = [
    "EFFECTS",
    "Aps",
    "CustomEffects",
    "Effect",
    "Effects",
    "EffectsLike",
    "HotPixels",
    "LeakRate",
    "LensBlur",
    "Optics",
    "PhotoreceptorBandwidth",
    "Readout",
    "RefractoryPeriod",
    "ShotNoise",
    "ThresholdMismatch",
    "Vignetting",
    "event_draws",
    "parse_effect",
    "with_optics",
]
