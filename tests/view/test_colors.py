import numpy as np

from sumo_dist.view.colors import cost_colors


def luminance(colors):
    return colors.astype(float) @ [0.2126, 0.7152, 0.0722]


def test_cheaper_is_brighter_whatever_the_scale():
    costs = np.array([3.0, 1.0, 2.0, 1e9])
    shades = luminance(cost_colors(costs))
    assert list(np.argsort(-shades)) == [1, 2, 0, 3]
    assert shades.max() > 200
    assert shades.min() < 30


def test_one_candidate_is_the_best():
    assert luminance(cost_colors(np.array([7.0])))[0] > 200
