"""The completion script, tried in bash."""

from __future__ import annotations

import shutil
import subprocess

import pytest

from tdcr_fe import cli

needs_bash = pytest.mark.skipif(shutil.which("bash") is None, reason="needs bash")


@pytest.fixture
def script(capsys):
    assert cli.main(["completion", "bash"]) == 0
    return capsys.readouterr().out


def complete(script, folder, *words):
    """What bash offers for the last word."""
    typed = " ".join(f"'{w}'" for w in ("tdcr-fe", *words))
    call = f"COMP_WORDS=({typed}); COMP_CWORD={len(words)}; _tdcr_fe; printf '%s\\n' \"${{COMPREPLY[@]}}\""
    done = subprocess.run(
        ["bash", "--norc", "-c", f"{script}\n{call}"], cwd=folder, capture_output=True, text=True, check=True
    )
    assert not done.stderr
    return done.stdout.split()


@needs_bash
def test_commands_options_values_and_files(script, tmp_path):
    (tmp_path / "sweep.toml").write_text("")
    assert complete(script, tmp_path, "sw") == ["sweep"]
    assert {"run", "identify", "sweep", "new", "--version"} <= set(complete(script, tmp_path, ""))
    assert complete(script, tmp_path, "sweep", "--pro") == ["--processes"]
    assert complete(script, tmp_path, "sweep", "--table", "") == ["csv", "parquet"]
    assert complete(script, tmp_path, "run", "--schema", "s") == ["scenario", "sweep"]
    assert complete(script, tmp_path, "new", "") == ["robot", "experiment", "sweep"]
    assert complete(script, tmp_path, "sweep", "sw") == ["sweep.toml"]
    assert "--hold-out" in complete(script, tmp_path, "identify", "data", "--")
    assert complete(script, tmp_path, "completion", "z") == ["zsh"]


def test_zsh_loads_the_completion_of_bash_first(capsys):
    assert cli.main(["completion", "zsh"]) == 0
    printed = capsys.readouterr().out
    assert "bashcompinit && bashcompinit\n_tdcr_fe()" in printed and "tdcr-fe completion zsh" in printed
