import resource

import numpy as np
import pytest
import rerun as rr

from sumo_dist.view.outputs import Outputs
from sumo_dist.view.rrd_file import RrdFile


def fill(out, writes):
    rng = np.random.default_rng(0)
    for tick in range(writes):
        out.log("noise", rr.Scalars(rng.random(1000)), tick=tick)  # 8 kB that do not compress


def test_the_file_ends_at_its_limit_and_says_so_once(tmp_path, read_rrd):
    told = []
    path = tmp_path / "run.rrd"
    with Outputs("test", RrdFile(path, told.append, limit=5_000_000)) as out:
        fill(out, 1200)
    assert 3_000_000 < path.stat().st_size <= 5_000_000
    assert told == [f"{path} has reached its limit of 5 MB and ends here"]
    assert len(read_rrd(path).timed["/noise"]["sim_time"]) == 600  # and it is whole


def test_a_file_that_cannot_be_opened_is_reported_once_and_the_rest_goes_on(tmp_path):
    told = []
    with Outputs("test", RrdFile(tmp_path / "no" / "run.rrd", told.append)) as out:
        fill(out, 600)
    assert told == [f"{tmp_path / 'no' / 'run.rrd'} cannot be written: No such file or directory"]


def test_a_disk_that_fills_up_is_reported_once_and_leaves_a_whole_file(tmp_path, read_rrd):
    told = []
    path = tmp_path / "run.rrd"
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (2_000_000, before[1]))  # a full disk's short write
    try:
        with Outputs("test", RrdFile(path, told.append)) as out:
            fill(out, 600)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert told == [f"{path} cannot be written on: no space left"]
    assert len(read_rrd(path).timed["/noise"]["sim_time"]) == 200


def test_robot_time_is_the_only_timeline(tmp_path, read_rrd):
    with Outputs("test", RrdFile(tmp_path / "run.rrd", pytest.fail)) as out:
        out.log("seen", rr.Scalars(1.0), tick=50)
        out.log("always", rr.Scalars(2.0))
        out.send("sent", [1, 2], rr.Scalars.columns(scalars=[3.0, 4.0]))
    rrd = read_rrd(tmp_path / "run.rrd")
    assert set(rrd.timed["/seen"]) == {"rerun.controls.RowId", "sim_time", "Scalars:scalars"}
    assert rrd.timed["/seen"]["sim_time"][0].total_seconds() == 1.0
    assert rrd.static["/always"]["Scalars:scalars"] == [[2.0]]
    assert [t.total_seconds() for t in rrd.timed["/sent"]["sim_time"]] == [0.02, 0.04]
