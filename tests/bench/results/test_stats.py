import itertools
import math

import pytest

from sumo_dist.bench.results import stats


@pytest.mark.parametrize(
    ("successes", "trials", "p"),
    [
        # Fisher's lady tasting tea: (1 + 16 + 16 + 1) of 70 ways, and 1 + 1 of 70.
        ((3, 1), (4, 4), 34 / 70),
        ((4, 0), (4, 4), 2 / 70),
        ((5, 5), (10, 10), 1.0),
        # 12 of 32 chosen: none of the first 18 in 91 ways, one of them in 18 * 364.
        ((1, 11), (18, 14), (91 + 18 * 364) / math.comb(32, 12)),
    ],
)
def test_fisher(successes, trials, p):
    assert stats.fisher(successes, trials) == pytest.approx(p, rel=1e-3)


def test_fisher_does_not_care_which_comes_first():
    assert stats.fisher((3, 9), (12, 10)) == pytest.approx(stats.fisher((9, 3), (10, 12)))


def test_newcombe():
    # Newcombe (1998), example (a): 56/70 - 48/80, interval 0.0524 to 0.3339.
    assert stats.newcombe((48, 56), (80, 70)) == pytest.approx((0.0524, 0.3339), abs=1e-4)


def brute_force(differences):
    """The p of signed ranks by trying all signs."""
    sizes = sorted(abs(d) for d in differences if d)
    ranks = [sizes.index(s) + (sizes.count(s) + 1) / 2 for s in map(abs, filter(None, differences))]
    signs = [1 if d > 0 else -1 for d in differences if d]
    seen = abs(sum(s * r for s, r in zip(signs, ranks, strict=True)))
    sums = [
        abs(sum(s * r for s, r in zip(flipped, ranks, strict=True)))
        for flipped in itertools.product((1, -1), repeat=len(ranks))
    ]
    return sum(total >= seen for total in sums) / len(sums)


@pytest.mark.parametrize(
    "differences",
    [
        [1.0, 2.0, 3.0, 4.0, 5.0, 6.0],
        [1.0, -2.0, 3.0, 4.0, -5.0, 6.5, 7.0],
        [1.0, 1.0, -1.0, 2.0, 2.0, 0.0, 3.0],
        [-0.5, 0.5],
        [0.0],
        [],
    ],
)
def test_signed_rank_is_exact(differences):
    assert stats.signed_rank(differences) == pytest.approx(brute_force(differences))


def test_paired_ratio_of_samples_that_differ_by_a_factor():
    first = [4.0, 5.0, 7.0, 9.0, 12.0, 15.0]
    ratio = stats.paired_ratio(first, [2 * t for t in first])
    assert ratio == pytest.approx((6, 2.0, 2.0, 2.0, 2 / 64))


def test_paired_ratio_has_its_tabulated_interval():
    # For 10 pairs the 95 % interval leaves out 8 of the 55 Walsh averages on either side.
    second = [math.exp(d) for d in (0.1, 0.2, 0.35, 0.4, 0.55, 0.6, 0.75, 0.8, 0.95, 1.3)]
    walsh = sorted(
        (math.log(a) + math.log(b)) / 2
        for a, b in itertools.combinations_with_replacement(second, 2)
    )
    ratio = stats.paired_ratio([1.0] * 10, second)
    assert (ratio.low, ratio.high) == pytest.approx((math.exp(walsh[8]), math.exp(walsh[-9])))
    assert ratio.value == pytest.approx(math.exp(walsh[27]))


def test_too_few_pairs_have_no_interval():
    assert stats.paired_ratio([1.0, 2.0], [2.0, 1.5])[2:4] == (0.0, math.inf)


def test_holm():
    assert stats.holm([0.01, 0.04, 0.03, 0.5]) == pytest.approx([0.04, 0.09, 0.09, 0.5])
    assert stats.holm([]) == []


def test_the_bootstrap_finds_the_interval_of_a_mean():
    # Of 400 alternating 0 and 1 the mean's standard error is 0.025.
    values = [i % 2 for i in range(400)]
    assert stats.bootstrap_ratio(values, [1] * 400) == pytest.approx((0.451, 0.549), abs=0.006)
    assert stats.bootstrap_ratio(values, [1] * 400) == stats.bootstrap_ratio(values, [1] * 400)


def test_a_ratio_whose_denominator_may_be_nothing_has_no_end():
    low, high = stats.bootstrap_ratio([2.0, 2.0, 2.0], [1, 0, 0])
    assert (low, high) == (2.0, math.inf)
    assert stats.bootstrap_ratio([2.0], [0]) == (math.inf, math.inf)
