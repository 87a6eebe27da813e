"""Fit a given list of effects to measured data, one after another, and report what each takes away."""

from tdcr_fe.validation.given_effects.stages import (
    Stage,
    chosen_form,
    every_nth_step,
    fit_in_order,
    mean_distance,
)

__all__ = ["Stage", "chosen_form", "every_nth_step", "fit_in_order", "mean_distance"]
