"""A sweep over a cluster of dask.distributed that loses a worker on the way."""

from __future__ import annotations

import os
import signal

import pytest
from sweep_files import InProcess, write_files

import tdcr_fe as tdcr
from tdcr_fe import cli

distributed = pytest.importorskip("distributed")

CASES = """
scenario = "scenario.toml"
[[vary]]
key = "steps[0].tensions.t1"
range = { start = 0.1, stop = 1.2, count = 40 }
"""


@pytest.mark.integration
@pytest.mark.skipif(os.name != "posix", reason="signals of POSIX")
@pytest.mark.filterwarnings("ignore")
def test_a_cluster_that_loses_one_of_two_workers_solves_all_cases(tmp_path):
    path = write_files(tmp_path, CASES)
    killed = []
    with (
        distributed.LocalCluster(
            n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None
        ) as cluster,
        distributed.Client(cluster) as client,
    ):
        processes = sorted(client.run(os.getpid).values())
        assert len(processes) == 2

        def progress(finished, total):
            if finished >= 5 and not killed:
                os.kill(processes[0], signal.SIGKILL)
                killed.append(finished)

        result = tdcr.sweep(
            path,
            tmp_path / "out",
            executor=client.get_executor(),
            in_flight=4,
            report=False,
            progress=progress,
        )
        out = str(tmp_path / "command")
        options = ["-o", out, "--dask", cluster.scheduler_address, "-q", "--no-pictures"]
        assert cli.main(["sweep", str(path), *options]) == 0
    assert killed and killed[0] < 40
    assert result.counts == {"converged": 40}
    tdcr.sweep(path, tmp_path / "here", executor=InProcess(), report=False)
    expected = (tmp_path / "here" / "cases.csv").read_bytes()
    assert all((tmp_path / name / "cases.csv").read_bytes() == expected for name in ("out", "command"))


def test_an_address_without_a_scheduler_is_refused(tmp_path, capsys, monkeypatch):
    path = write_files(tmp_path, CASES)

    def client(address, timeout):
        raise OSError("timed out")

    monkeypatch.setattr(distributed, "Client", client)
    assert cli.main(["sweep", str(path), "-o", str(tmp_path / "out"), "--dask", "tcp://127.0.0.1:1"]) == 2
    assert "no scheduler answers there" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
