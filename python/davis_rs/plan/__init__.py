"""Which of a sensor's effects a sequence calls for, by what leaving them out would do to it."""

from .plan import plan_effects, plan_effects_of
from .report import EffectPlan, PlannedEffect

__all__ = ["EffectPlan", "PlannedEffect", "plan_effects", "plan_effects_of"]
