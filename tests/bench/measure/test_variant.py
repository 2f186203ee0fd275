import time

import numpy as np

from sumo_dist.bench.measure.variant import Round, Variant, interleave, row, timed


def spin(seconds):
    until = time.process_time() + seconds
    while time.process_time() < until:
        pass


def test_processor_time_is_told_from_wall_time():
    slept = timed(lambda: time.sleep(0.05))
    spun = timed(lambda: spin(0.05))
    assert slept[0] >= 50.0 > 25.0 > slept[1]
    assert spun[1] >= 50.0


def test_variants_take_turns_in_going_first():
    called = []

    def variant(name):
        return lambda: called.append(name) or Round(1.0, 1.0, np.zeros((1, 2)))

    a, b = Variant("a", 0.0, 0.01), Variant("b", 0.0, 0.01)
    rounds = interleave({a: variant("a"), b: variant("b")}, repeats=2, tell=print)
    assert called == ["a", "b", "a", "b", "b", "a"]  # the first two only warm up
    assert [len(of_it) for of_it in rounds.values()] == [2, 2]


def test_a_row_has_median_minimum_and_what_diverged():
    final = np.array([[0.0, 1.0], [np.nan, np.nan]])
    rounds = [Round(wall, wall * 2, final) for wall in (3.0, 1.0, 9.0)]
    found = row(Variant("engine", 1.0, 0.02), rounds)
    assert (found["wall_ms_median"], found["wall_ms_min"]) == (3.0, 1.0)
    assert (found["cpu_ms_median"], found["cpu_ms_min"]) == (6.0, 2.0)
    assert (found["engine"], found["density"], found["timestep"]) == ("engine", 1.0, 0.02)
    assert found["diverged"] == 1
