"""Sets with two explanations: the next experiment of `identify` is simulated and added, and must part them."""

from tdcr_fe.validation.next_experiment.sets import AMBIGUITIES, Ambiguity, Outcome, run_set

__all__ = ["AMBIGUITIES", "Ambiguity", "Outcome", "run_set"]
