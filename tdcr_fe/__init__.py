"""Tendon-driven continuum robots in Exudyn: the public names, each imported when it is first used."""

from __future__ import annotations

import os.path as _path
from importlib import import_module as _import_module
from typing import TYPE_CHECKING
from typing import Any as _Any

if TYPE_CHECKING:
    from tdcr_fe.effects import Experiment as Experiment
    from tdcr_fe.effects import effect as effect
    from tdcr_fe.effects import with_effects as with_effects
    from tdcr_fe.identify import IdentificationResult as IdentificationResult
    from tdcr_fe.identify import IdentifySettings as IdentifySettings
    from tdcr_fe.identify import identify as identify
    from tdcr_fe.io.keys import json_schema as json_schema
    from tdcr_fe.io.measured import read_measured as read_measured
    from tdcr_fe.io.problems import InputError as InputError
    from tdcr_fe.io.result_files import write_results as write_results
    from tdcr_fe.io.toml import read_model as read_model
    from tdcr_fe.io.toml import read_robot as read_robot
    from tdcr_fe.io.toml import read_scenario as read_scenario
    from tdcr_fe.io.write_toml import model_to_toml as model_to_toml
    from tdcr_fe.io.write_toml import robot_to_toml as robot_to_toml
    from tdcr_fe.io.write_toml import scenario_to_toml as scenario_to_toml
    from tdcr_fe.model.backbone import Backbone as Backbone
    from tdcr_fe.model.backbone import NonlinearMaterial as NonlinearMaterial
    from tdcr_fe.model.backbone import StiffnessPatch as StiffnessPatch
    from tdcr_fe.model.backbone import Superelastic as Superelastic
    from tdcr_fe.model.friction import ConstantFriction as ConstantFriction
    from tdcr_fe.model.friction import ForceDependentFriction as ForceDependentFriction
    from tdcr_fe.model.friction import StribeckFriction as StribeckFriction
    from tdcr_fe.model.loading import Load as Load
    from tdcr_fe.model.loading import LoadStep as LoadStep
    from tdcr_fe.model.loading import Model as Model
    from tdcr_fe.model.loading import SolverSettings as SolverSettings
    from tdcr_fe.model.results import Interrupted as Interrupted
    from tdcr_fe.model.results import LocalResponse as LocalResponse
    from tdcr_fe.model.results import Sensitivities as Sensitivities
    from tdcr_fe.model.results import Sensitivity as Sensitivity
    from tdcr_fe.model.results import SequenceResult as SequenceResult
    from tdcr_fe.model.results import StepResult as StepResult
    from tdcr_fe.model.robot import Disks as Disks
    from tdcr_fe.model.robot import Robot as Robot
    from tdcr_fe.model.routing import ConvergingRouting as ConvergingRouting
    from tdcr_fe.model.routing import HelicalRouting as HelicalRouting
    from tdcr_fe.model.routing import ParallelRouting as ParallelRouting
    from tdcr_fe.model.routing import PointsRouting as PointsRouting
    from tdcr_fe.model.routing import TwistedRouting as TwistedRouting
    from tdcr_fe.model.routing import VaryingHelicalRouting as VaryingHelicalRouting
    from tdcr_fe.model.targets import FollowResult as FollowResult
    from tdcr_fe.model.targets import ReachedTarget as ReachedTarget
    from tdcr_fe.model.targets import TensionLimits as TensionLimits
    from tdcr_fe.model.targets import TipTarget as TipTarget
    from tdcr_fe.model.tendon import Tendon as Tendon
    from tdcr_fe.native import register as register
    from tdcr_fe.scene.builder import CreateTDCR as CreateTDCR
    from tdcr_fe.scene.handle import TDCR as TDCR
    from tdcr_fe.scene.linearized import TDCREigenvalues as TDCREigenvalues
    from tdcr_fe.scene.linearized import TDCRLinearized as TDCRLinearized
    from tdcr_fe.scene.loads import PointLoad as PointLoad
    from tdcr_fe.solve.inverse_statics.inverse import follow_path as follow_path
    from tdcr_fe.solve.inverse_statics.inverse import reach as reach
    from tdcr_fe.solve.load_steps.load_path import StepFailed as StepFailed
    from tdcr_fe.solve.sensitivities.local_response import local_response as local_response
    from tdcr_fe.solve.sensitivities.parameters import effect_parameter as effect_parameter
    from tdcr_fe.solve.simulate import simulate as simulate
    from tdcr_fe.solve.simulation import Simulation as Simulation
    from tdcr_fe.solve.stability import Stability as Stability
    from tdcr_fe.solve.stability import stability as stability
    from tdcr_fe.solve.statics import SolveTDCR as SolveTDCR
    from tdcr_fe.solve.statics import track_sensitivities as track_sensitivities
    from tdcr_fe.sweeps.cases import parameter_function as parameter_function
    from tdcr_fe.sweeps.read import read_sweep as read_sweep
    from tdcr_fe.sweeps.result import SweepResult as SweepResult
    from tdcr_fe.sweeps.run import sweep as sweep

__version__ = "0.2.0.dev0"

#: Module of every public name; the block above repeats this for type checkers.
_PUBLIC = {
    "tdcr_fe.effects": ("Experiment", "effect", "with_effects"),
    "tdcr_fe.identify": ("IdentificationResult", "IdentifySettings", "identify"),
    "tdcr_fe.io.measured": ("read_measured",),
    "tdcr_fe.io.result_files": ("write_results",),
    "tdcr_fe.io.keys": ("json_schema",),
    "tdcr_fe.io.problems": ("InputError",),
    "tdcr_fe.io.toml": ("read_model", "read_robot", "read_scenario"),
    "tdcr_fe.io.write_toml": ("model_to_toml", "robot_to_toml", "scenario_to_toml"),
    "tdcr_fe.model.friction": ("ConstantFriction", "ForceDependentFriction", "StribeckFriction"),
    "tdcr_fe.model.loading": ("Load", "LoadStep", "Model", "SolverSettings"),
    "tdcr_fe.model.results": (
        "Interrupted",
        "LocalResponse",
        "Sensitivities",
        "Sensitivity",
        "SequenceResult",
        "StepResult",
    ),
    "tdcr_fe.model.backbone": ("Backbone", "NonlinearMaterial", "StiffnessPatch", "Superelastic"),
    "tdcr_fe.model.robot": ("Disks", "Robot"),
    "tdcr_fe.model.tendon": ("Tendon",),
    "tdcr_fe.model.routing": (
        "ConvergingRouting",
        "HelicalRouting",
        "ParallelRouting",
        "PointsRouting",
        "TwistedRouting",
        "VaryingHelicalRouting",
    ),
    "tdcr_fe.model.targets": ("FollowResult", "ReachedTarget", "TensionLimits", "TipTarget"),
    "tdcr_fe.native": ("register",),
    "tdcr_fe.scene.builder": ("CreateTDCR",),
    "tdcr_fe.scene.handle": ("TDCR",),
    "tdcr_fe.scene.loads": ("PointLoad",),
    "tdcr_fe.solve.inverse_statics.inverse": ("follow_path", "reach"),
    "tdcr_fe.solve.sensitivities.local_response": ("local_response",),
    "tdcr_fe.solve.sensitivities.parameters": ("effect_parameter",),
    "tdcr_fe.solve.simulate": ("simulate",),
    "tdcr_fe.solve.simulation": ("Simulation",),
    "tdcr_fe.solve.stability": ("Stability", "stability"),
    "tdcr_fe.scene.linearized": ("TDCREigenvalues", "TDCRLinearized"),
    "tdcr_fe.solve.statics": ("SolveTDCR", "track_sensitivities"),
    "tdcr_fe.solve.load_steps.load_path": ("StepFailed",),
    "tdcr_fe.sweeps.read": ("read_sweep",),
    "tdcr_fe.sweeps.result": ("SweepResult",),
    "tdcr_fe.sweeps.run": ("sweep",),
    "tdcr_fe.sweeps.cases": ("parameter_function",),
}
_MODULE_OF = {name: module for module, names in _PUBLIC.items() for name in names}

__all__ = ["__version__", *sorted(_MODULE_OF)]

# In a clone, `elements/` and `validation/` lie beside this folder; in an installed copy they lie inside it.
_here = _path.dirname(_path.realpath(__file__))
_clone = _path.dirname(_here)
if not _path.isdir(_path.join(_here, "elements")) and _path.isdir(_path.join(_clone, "elements")):
    __path__.append(_clone)


def __getattr__(name: str) -> _Any:
    if name not in _MODULE_OF:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    module = _import_module(_MODULE_OF[name])
    # The package `tdcr_fe.identify` is itself the function of that name: importing it makes it an attribute here.
    found = module if module.__name__ == f"{__name__}.{name}" else getattr(module, name)
    globals()[name] = found
    return found


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
