"""Estimates given also the readings of later frames: `smoothed`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from tdcr_fe.elements import Array
from tdcr_fe.estimate.description import Estimate, Passage
from tdcr_fe.estimate.frame import LOAD, PLACE


def smoothed(frames: Sequence[Estimate]) -> list[Estimate]:
    """The estimates of an estimator, in their order, each given the readings of all.

    One pass backwards, without inverse covariances, which are singular (A. E. Bryson, M. Frazier, 1963; G. J. Bierman,
    Automatica 9 (1973) 503-508). Where a frame has the mean ``x`` and the covariance ``P`` before its readings, all
    readings from it on make them ``x + P pull`` and ``P - P information P``. States follow to first order. Frames
    that have the state of the one before stay as they are.
    """
    found = [replace(frame, passage=None) for frame in frames]
    later: tuple[Array, Array, Array] | None = None
    for k, frame in reversed(list(enumerate(frames))):
        if (now := frame.passage) is None:
            continue
        before, jacobian, pull = now.covariance, now.jacobian, now.pull
        inner = jacobian @ before @ jacobian.T + np.eye(len(jacobian))
        information = jacobian.T @ np.linalg.solve(inner, jacobian)
        if later is not None:
            kept, later_pull, later_information = later
            forward = kept[:, None] * now.carried
            back, seen = forward.T @ later_pull, forward.T @ later_information @ forward
            after = before - before @ information @ before
            found[k] = _moved(found[k], now, after @ back, after - after @ seen @ after, frames[-1])
            left = np.eye(len(before)) - information @ before
            pull, information = pull + left @ back, information + left @ seen @ left.T
        later = now.kept, pull, information
    return found


def _moved(frame: Estimate, now: Passage, change: Array, covariance: Array, last: Estimate) -> Estimate:
    """An estimate with other unknowns; numbers of effects are those of the last frame, which has seen all readings."""
    turn = Rotation.from_rotvec(now.rotations @ change).as_matrix()
    tensions = np.maximum(frame.tensions + now.base_tensions @ change, 0.0)
    result = replace(
        frame.result,
        positions=frame.result.positions + now.positions @ change,
        rotations=turn @ frame.result.rotations,
        base_tensions=tensions,
    )
    force, moment = np.split(change[LOAD], 2)
    return replace(
        frame,
        result=result,
        at=frame.at + float(change[PLACE]),
        sigma_at=float(np.sqrt(max(covariance[PLACE, PLACE], 0.0))),
        force=frame.force + force,
        moment=frame.moment + moment,
        force_covariance=covariance[:3, :3],
        moment_covariance=covariance[3:6, 3:6],
        input_errors=frame.input_errors + change[PLACE + 1 :][: len(tensions)],
        parameters=last.parameters,
        sigma_parameters=last.sigma_parameters,
        tensions=tensions,
        tension_covariance=now.base_tensions @ covariance @ now.base_tensions.T,
        position_covariance=now.positions @ covariance @ now.positions.swapaxes(1, 2),
    )
