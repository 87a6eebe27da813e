"""A sweep over a cluster of dask.distributed that loses a worker on the way."""

from __future__ import annotations

import os
import signal

import pytest
from sweep_files import InProcess, write_files

import tdcr_fe as tdcr

distributed = pytest.importorskip("distributed")

CASES = """
scenario = "scenario.toml"
[[vary]]
key = "steps[0].tensions.t1"
range = { start = 0.1, stop = 1.2, count = 40 }
"""


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
    assert killed and killed[0] < 40
    assert result.counts == {"converged": 40}
    tdcr.sweep(path, tmp_path / "here", executor=InProcess(), report=False)
    assert (tmp_path / "out" / "cases.csv").read_bytes() == (tmp_path / "here" / "cases.csv").read_bytes()
