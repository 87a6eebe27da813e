"""Compiled and plain friction paths are the same; what is used is said."""

import importlib.util
import sys
from types import SimpleNamespace

import numpy as np
import pytest

from tdcr_fe import compiled, simulate
from tdcr_fe.io.result_files import versions
from tdcr_fe.solve.friction_path import follow
from tdcr_fe.validation.random_robots import draw


@pytest.fixture(autouse=True)
def looked_up_again():
    """Whether functions are compiled is looked up once in a process."""
    compiled.is_compiled.cache_clear()
    yield
    compiled.is_compiled.cache_clear()


def test_switched_off_it_is_plain(monkeypatch):
    monkeypatch.setenv(compiled.SWITCH, "0")
    assert not compiled.is_compiled() and versions()["numba"] == "not used"


def test_an_installed_numba_that_cannot_be_imported_is_said(monkeypatch):
    monkeypatch.delenv(compiled.SWITCH, raising=False)

    class Broken:
        @staticmethod
        def find_spec(name, *rest):
            if name == "numba":
                raise ImportError("Numba needs another NumPy")

    monkeypatch.delitem(sys.modules, "numba", raising=False)
    monkeypatch.setattr(sys, "meta_path", [Broken, *sys.meta_path])
    monkeypatch.setattr(compiled, "_numba", compiled._numba.__wrapped__)  # as if it were not imported yet
    with pytest.warns(UserWarning, match="numba is installed and cannot be imported"):
        assert not compiled.is_compiled()


def test_plain_where_a_compiled_function_meets_a_singular_matrix(monkeypatch):
    def singular(value):
        raise np.linalg.LinAlgError

    monkeypatch.setattr(compiled, "_compiled", lambda function: singular)
    assert compiled.run_compiled(lambda value: value + 1, 2) == 3


def test_plain_from_then_on_where_numba_cannot_compile(monkeypatch):
    class NumbaError(Exception):
        pass

    def unknown(value):
        raise NumbaError("unknown type")

    numba = SimpleNamespace(
        __version__="0.1", core=SimpleNamespace(errors=SimpleNamespace(NumbaError=NumbaError))
    )
    monkeypatch.setenv(compiled.SWITCH, "1")
    monkeypatch.setattr(compiled, "_numba", lambda: numba)
    monkeypatch.setattr(compiled, "_compiled", lambda function: unknown)
    assert compiled.is_compiled()
    with pytest.warns(UserWarning, match="numba 0.1 cannot compile"):
        assert compiled.run_compiled(lambda value: value + 1, 2) == 3
    assert not compiled.is_compiled()


@pytest.mark.campaign
@pytest.mark.skipif(importlib.util.find_spec("numba") is None, reason="numba is not installed")
def test_random_robots_are_the_same_both_ways(monkeypatch):
    """All states of twenty robots to 1e-7 of their length: round-off, and what Newton's tolerance makes of it."""
    paths = {True: 0, False: 0}

    def counted(run, way):
        def count(*given):
            paths[way] += 1
            return run(*given)

        return count

    plain, fast = follow._integrated, follow.run_compiled
    monkeypatch.setattr(follow, "run_compiled", counted(lambda _, *given: fast(plain, *given), True))
    monkeypatch.setattr(follow, "_integrated", counted(plain, False))
    for seed in range(20):
        case, found = draw(seed), []
        for switch in ("1", "0"):
            monkeypatch.setenv(compiled.SWITCH, switch)
            compiled.is_compiled.cache_clear()
            found.append(simulate(case.robot, case.model, case.steps))
        for a, b in zip(*(result.steps for result in found), strict=True):
            assert np.abs(a.positions - b.positions).max() <= 1e-7 * case.robot.backbone.length
    assert paths[True] == paths[False] > 50
