import pytest

from sumo_dist.view.fleet import Fleet
from sumo_dist.view.outputs import Outputs
from sumo_dist.view.plots import FLEET, PlotLog, plots
from sumo_dist.view.rrd_file import RrdFile


def test_the_pool_in_numbers(move_box, tmp_path, read_rrd):
    with Outputs("test", RrdFile(tmp_path / "a.rrd", pytest.fail)) as out:
        rows = PlotLog(out, move_box, plots(move_box, True, ()))
        fleet = Fleet(rows)
        fleet.set_alive(4)
        for name, state, pace in (
            ("a", "answers", 10.0),
            ("b", "answers", 30.0),
            ("c", "answers", 50.0),
            ("d", "passed over", 1.0),
        ):
            fleet.add_worker(name, state, pace)
        fleet.count("robot", "dropped stale", 2)
        fleet.count("host-7", "dropped schema", 3)  # the optimizer
        fleet.count("a", "dropped stale", 4)
        fleet.count("a", "dropped run", 99)  # of another run: no loss
        fleet.count("a", "answered", 99)
        fleet.log(0, dropped_here=6)
        fleet.remove_worker("a")
        fleet.log(5, dropped_here=6)
        rows.flush()
    timed = read_rrd(tmp_path / "a.rrd").timed
    shown = {plot.origin: timed.get(f"/plots/{plot.origin}") for plot in FLEET}
    assert shown["pace"]["Scalars:scalars"] == [[50.0, 30.0, 10.0], [50.0, 40.0, 30.0]]
    assert shown["workers"]["Scalars:scalars"] == [[3.0, 4.0], [2.0, 4.0]]
    assert shown["dropped"]["Scalars:scalars"] == [[5.0, 4.0, 6.0]] * 2  # what is lost stays lost
