"""Broken input files, made by mutation of good ones: each must be refused by name, or be a valid input."""

from tdcr_fe.validation.broken_files.campaign import Case, Outcome, draw, run_case
from tdcr_fe.validation.broken_files.inputs import INPUTS, Inputs
from tdcr_fe.validation.broken_files.mutations import MUTATIONS, Change

__all__ = ["INPUTS", "MUTATIONS", "Case", "Change", "Inputs", "Outcome", "draw", "run_case"]
