"""A real sensor's imperfections, each off unless asked for."""

from .aps import Aps
from .effect import Effect
from .effects import EFFECTS, Effects, parse_effect
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
    "Effect",
    "Effects",
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
    "parse_effect",
    "with_optics",
]
