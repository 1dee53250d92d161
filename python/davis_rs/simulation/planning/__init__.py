"""Plans which of a sensor's effects a sequence calls for, by what leaving them out would do to it."""

from .effect_plan import EffectPlan, PlannedEffect
from .effects_together import SetForecast
from .planner import plan_effects, plan_effects_of

__all__ = ["EffectPlan", "PlannedEffect", "SetForecast", "plan_effects", "plan_effects_of"]
