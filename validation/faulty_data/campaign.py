"""Run ``tdcr-fe identify`` on every faulty set, and judge what it says."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import sys
from collections.abc import Generator, Sequence
from contextlib import closing
from dataclasses import asdict, dataclass, fields
from functools import partial
from pathlib import Path

import numpy as np

from tdcr_fe.io.store import Folder, Record, solve_all
from tdcr_fe.validation.blind.maker import make_blind
from tdcr_fe.validation.blind.recipes import Recipe
from tdcr_fe.validation.crosscheck.campaign import silence_exudyn
from tdcr_fe.validation.faulty_data.faults import FAULTS, Fault
from tdcr_fe.validation.faulty_data.tables import Tables

#: Clean sets, by drive: three parallel tendons, noise of 0.2 mm.
BASES = {
    "tension": Recipe(9100, robot="parallel", drive="tension", sigma=2e-4),
    "displacement": Recipe(9103, robot="parallel", drive="displacement", sigma=2e-4),
}
#: Of a clean set so many steps and markers are used.
STEPS, MARKERS = 24, 3

#: Exit statuses of the command that computes nothing: the declared model does not converge, the input is wrong.
REFUSED = (1, 2)
#: Outcomes that are right.
RIGHT = ("refused", "named", "cannot tell")


@dataclass(frozen=True)
class Outcome:
    """What the command says of one faulty set.

    Attributes
    ----------
    fault : str
    outcome : str
        "refused" (input error that names it), "refused without naming it", "named" (in the report), "cannot tell",
        "not explained" (no cause is given, but the report says that one is missing), "explained otherwise" (another
        cause is given), "nothing missing" (whatever else the report says).
    verdict : str
        Of the report; empty where the input was refused.
    effects : tuple of str
        That were added.
    text : str
        First words of the error or of the report.
    """

    fault: str
    outcome: str
    verdict: str
    effects: tuple[str, ...]
    text: str

    @property
    def passed(self) -> bool:
        """Named, refused, or left open; never "nothing missing" or another cause."""
        return self.outcome in RIGHT


def run_all(faults: Sequence[Fault], out: Path, processes: int) -> Generator[Outcome, None, None]:
    """Outcomes of all faults, those known first, the others as they are finished.

    Parameters
    ----------
    faults
        See `FAULTS`.
    out
        Receives ``base/DRIVE``, ``sets/NUMBER`` (input of the command), ``reports/NUMBER`` and ``NUMBER.json``.
    processes
        Number of sets at a time.
    """
    for drive, recipe in BASES.items():
        if not (out / "base" / drive).exists():
            make_blind(out / "base" / drive, recipe)
    tasks = {str(_number(fault.name)): fault.name for fault in faults}
    solve, store = partial(run_one, out=out), Folder(out, indent=2)
    with closing(solve_all(tasks, solve, store, processes, silence_exudyn, again=_other_fields)) as found:
        for _, record, _ in found:
            yield Outcome(**{**record, "effects": tuple(record["effects"])})


def _other_fields(record: Record) -> bool:
    """Whether a record is not that of an outcome, as one of an earlier version."""
    return set(record) != {field.name for field in fields(Outcome)}


def _number(name: str) -> int:
    return 1 + [f.name for f in FAULTS].index(name)


def run_one(name: str, out: Path) -> Record:
    """Make the set with this fault, run the command, and judge what it says: the fields of an `Outcome`."""
    number = _number(name)
    fault = FAULTS[number - 1]
    tables = Tables.read(out / "base" / fault.base, STEPS, MARKERS)
    fault.change(tables, np.random.default_rng([3, number]))
    tables.write(out / "sets" / str(number))
    report = out / "reports" / str(number)
    shutil.rmtree(report, ignore_errors=True)
    command = [
        sys.executable,
        "-m",
        "tdcr_fe",
        "identify",
        str(out / "sets" / str(number)),
        "-o",
        str(report),
    ]
    done = subprocess.run([*command, "--processes", "1"], capture_output=True, text=True, check=False)
    return asdict(judge(fault, done.returncode, done.stderr, done.stdout, report))


def judge(fault: Fault, status: int, errors: str, output: str, report: Path) -> Outcome:
    """What the exit status, the messages and the report of the command amount to."""
    if status in REFUSED:
        named = any(word in errors.lower() for word in fault.words)
        outcome = "refused" if named else "refused without naming it"
        return Outcome(fault.name, outcome, "", (), errors[:400])
    result = json.loads((report / "result.json").read_text(encoding="utf-8"))
    verdict, effects = result["verdict"], tuple(e["effect"] for e in result["effects"])
    said = re.sub(r"\s+", " ", f"{output} {errors}")
    # The report's own advice repeats what the errors on the first screen say; candidates are not what is concluded.
    named = any(w in effects or (w not in _EFFECT_LIKE and w in said.lower()) for w in fault.words if w)
    if verdict == "nothing missing":
        outcome = verdict
    elif named:
        outcome = "named"
    elif verdict == "cannot tell":
        outcome = verdict
    else:
        outcome = "explained otherwise" if verdict.startswith("explained") else "not explained"
    return Outcome(fault.name, outcome, verdict, effects, said[:400])


#: Words of faults that are names of effects, and count only as such.
_EFFECT_LIKE = ("marker_offset", "frame_misalignment", "stiffness_scale", "actuator_gain")
