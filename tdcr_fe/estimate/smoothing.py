"""Estimates given also the readings of later frames: `smoothed`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from tdcr_fe.elements import Array
from tdcr_fe.estimate.description import Estimate, Passage
from tdcr_fe.estimate.frame import LOAD, PLACE

#: Variances below this part of the largest, all over those of the unknowns, are those of what others determine.
SINGULAR = 1e-10


def smoothed(frames: Sequence[Estimate]) -> list[Estimate]:
    """The estimates of an estimator, in their order, each given the readings of all.

    One pass backwards over the covariances (H. E. Rauch, F. Tung, C. T. Striebel, AIAA Journal 3 (1965) 1445-1450);
    states follow to first order. Frames that were not solved stay as they are.
    """
    found, later = [replace(frame, passage=None) for frame in frames], None
    for k, frame in reversed(list(enumerate(frames))):
        if (now := frame.passage) is None:
            continue
        x, covariance = now.found, now.found_covariance
        if later is not None:
            next_one, of_next, next_covariance = later
            scale = np.sqrt(np.diagonal(next_one.covariance))
            scale[scale == 0.0] = 1.0  # of what is known
            inverse = np.linalg.pinv(
                next_one.covariance / np.outer(scale, scale), hermitian=True, rcond=SINGULAR
            )
            cross = covariance @ now.carried.T * next_one.kept
            gain = cross / scale @ inverse / scale
            x = x + gain @ (of_next - next_one.mean)
            covariance = covariance + gain @ (next_covariance - next_one.covariance) @ gain.T
            found[k] = _moved(found[k], now, x - now.found, covariance, frames[-1])
        later = now, x, covariance
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
        sigma_at=float(np.sqrt(covariance[PLACE, PLACE])),
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
