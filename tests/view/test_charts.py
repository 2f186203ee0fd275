"""Charts: every line within its box, every name beside its own and on no other."""

import numpy as np
import pytest

from sumo_dist.view.charts import HEIGHT, WIDTH, Chart, Curve
from sumo_dist.view.outputs import Outputs
from sumo_dist.view.rrd_file import RrdFile

CHART = Chart("chart", "s")
RED, GREY = (200, 0, 0), (90, 90, 90)


@pytest.fixture
def drawn(tmp_path, read_rrd):
    """A function that draws curves: returns strips, and what is written where."""

    def drawn(*curves, x_most=2.0, y_range=(0.0, 10.0)):
        with Outputs("test", RrdFile(tmp_path / "a.rrd", pytest.fail)) as out:
            CHART.log(out, 3, curves, x_most, y_range)
        timed = read_rrd(tmp_path / "a.rrd").timed
        strips = [np.array(s) for s in timed["/chart/lines"]["LineStrips2D:strips"][0]]
        words = timed["/chart/words"]
        places = np.array(words["Points2D:positions"][0])
        return strips, dict(zip(words["Points2D:labels"][0], places, strict=True))

    return drawn


def test_a_curve_is_drawn_to_scale_and_cut_at_the_top(drawn):
    x = np.array([0.0, 1.0, 2.0])
    strips, words = drawn(Curve("cost", x, np.array([0.0, 5.0, 40.0]), RED))
    [line] = [s for s in strips[2:] if len(s) == 3]
    assert line == pytest.approx(np.array([[0, HEIGHT], [WIDTH / 2, HEIGHT / 2], [WIDTH, 0]]))
    assert {"0", "10", "2 s", "cost"} == words.keys()


def test_a_bar_is_around_each_point_that_has_a_spread(drawn):
    x, y = np.array([0.5, 1.5]), np.array([5.0, 2.0])
    strips, _ = drawn(Curve("", x, y, GREY, np.array([1.0, 3.0])))
    first, second = strips[-2:]
    assert first == pytest.approx(np.array([[WIDTH / 4, 60.0], [WIDTH / 4, 40.0]]))
    assert second[:, 1] == pytest.approx([HEIGHT, 50.0])  # its foot is cut off


@pytest.mark.parametrize("ends", [[0, 0, 0, 0, 0], [10, 10, 10, 10], [5, 5, 5], [9, 9.1, 0, 5, 5]])
def test_names_stand_apart_and_in_the_order_of_their_lines(drawn, ends):
    x = np.array([0.0, 2.0])
    curves = [Curve(f"n{i}", x, np.array([0.0, end]), RED) for i, end in enumerate(ends)]
    _, words = drawn(*curves)
    heights = np.array([words[f"n{i}"][1] for i in range(len(ends))])
    assert np.diff(np.sort(heights)).min() >= 14.9
    assert heights.max() <= HEIGHT
    for i, one in enumerate(ends):
        for j, other in enumerate(ends):
            assert one <= other or heights[i] < heights[j]
