"""Effects whose numbers have errors, which are estimated along with the state: `UncertainEffects`."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from tdcr_fe.effects import Experiment, Parameter, effect, with_effects
from tdcr_fe.elements import Array
from tdcr_fe.estimate.description import ParameterPrior
from tdcr_fe.model.schema import FieldError
from tdcr_fe.scene.handle import TDCR
from tdcr_fe.solve.sensitivities.parameters import ModelParameter, effect_parameter
from tdcr_fe.solve.sensitivities.robot_model import ExplicitDerivatives
from tdcr_fe.solve.sensitivities.sensitivity import models_around


@dataclass(frozen=True, eq=False)
class UncertainEffects:
    """A robot with effects at their present values, from which errors count, in `Parameter.coordinate`."""

    declared: Experiment  # Without these effects
    prior: ParameterPrior

    @cached_property
    def experiment(self) -> Experiment:
        """With the effects at their present values."""
        return with_effects(self.declared, self.prior.effects)

    @property
    def _keys(self) -> list[tuple[str, str]]:
        """Effect and parameter of each number that has an error."""
        return [(name, key) for name, _, key in (x.partition(".") for x in self.prior.names)]

    @cached_property
    def _chosen(self) -> list[ModelParameter]:
        return [effect_parameter(self.declared, *key, self.prior.effects) for key in self._keys]

    @cached_property
    def _parameters(self) -> list[Parameter]:
        known = ({p.name: p for p in effect(name).parameters_of(self.declared)} for name, _ in self._keys)
        return [own[key] for own, (_, key) in zip(known, self._keys, strict=True)]

    def values(self, errors: Array) -> Array:
        """The numbers with their errors, shape (q,)."""
        numbers = zip(self._parameters, self._chosen, errors, strict=True)
        return np.array([p.value(now.value + error) for p, now, error in numbers])

    def sigmas(self, errors: Array, variances: Array) -> Array:
        """Standard deviations of `values` from the variances of the errors, shape (q,)."""
        inverse = [p.inverse for p in self._parameters]
        return np.sqrt(variances) * np.where(inverse, self.values(errors) ** 2, 1.0)

    def within_bounds(self, errors: Array) -> Array:
        """The errors that keep the numbers within their bounds, shape (q,)."""
        numbers = zip(self._parameters, self._chosen, self.values(errors), strict=True)
        return np.array([p.coordinate(np.clip(x, p.lower, p.upper)) - now.value for p, now, x in numbers])

    def moved(self, errors: Array) -> UncertainEffects:
        """At other values; the errors are within bounds."""
        effects = {name: dict(own) for name, own in self.prior.effects.items()}
        for (name, key), value in zip(self._keys, self.values(errors).tolist(), strict=True):
            effects.setdefault(name, {})[key] = value
        return replace(self, prior=replace(self.prior, effects=effects))

    def derivatives(self, handle: TDCR) -> ExplicitDerivatives:
        """Derivatives of the forces by the errors while the nodes stay where they are.

        Raises
        ------
        FieldError
            There are none by a number, it changes neither robot nor model, or decides whether a hole has friction.
        """
        try:
            present, near = models_around(handle, self.experiment, self._chosen)
        except ValueError as error:
            raise FieldError("uncertain", "", str(error).removeprefix("sensitivities: ")) from error
        frictional = present.forces.law.frictional
        for number, name in enumerate(self.prior.names):
            models = near[number].models
            if all(model is present for model in models):
                raise FieldError(f"uncertain.{name}", "", "must be a number of the robot or the model")
            if any(not np.array_equal(m.forces.law.frictional, frictional) for m in models):
                raise FieldError(f"uncertain.{name}", "", "must not decide whether there is friction")
        return ExplicitDerivatives(present, near, len(self._chosen))
