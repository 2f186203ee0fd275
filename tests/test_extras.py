import pytest

from sumo_dist import extras
from sumo_dist.errors import SumoError

REQUIRES = [
    "numpy<3,>=1.26",
    'pytest<1,>=0.1; extra == "old"',
    "numpy>=2,<3; extra == 'view'",
    'no-such-package>=1; extra == "view"',
    'sumo-dist[old,view]; extra == "all"',
    'numpy; extra == "all"',
]


@pytest.fixture(autouse=True)
def requirements(monkeypatch):
    monkeypatch.setattr(extras, "requires", lambda _name: REQUIRES)


def test_packages_and_bounds_of_an_extra_are_read():
    assert list(extras.required()) == [("numpy", ["<3", ">=1.26"])]
    assert list(extras.required("view")) == [("numpy", [">=2", "<3"]), ("no-such-package", [">=1"])]
    assert list(extras.required("all")) == [("numpy", [])]


def test_what_is_missing_or_out_of_bounds_is_named_with_the_way_out():
    with pytest.raises(SumoError) as missing:
        extras.need("view", "the viewer")
    assert str(missing.value) == (
        "the viewer needs no-such-package, which is not installed: pip install 'sumo-dist[view]'"
    )
    with pytest.raises(
        SumoError, match=r"a test needs pytest <1,>=0.1, not \d.*'sumo-dist\[old\]'"
    ):
        extras.need("old", "a test")
    extras.need("all", "nothing")


def test_an_old_numpy_is_a_reason(monkeypatch):
    monkeypatch.setattr(extras, "version", lambda _name: "1.26.4")
    assert "numpy >=2,<3, not 1.26.4" in extras.lacking("view")


@pytest.mark.parametrize(
    ("found", "bound", "kept"),
    [
        ("4.0.0", ">=4.0", True),
        ("4.1.0", "<4.1", False),
        ("4.0.9", "<4.1", True),
        ("3.10.2", ">=3.9", True),
        ("0.41.3", "==0.41.*", True),
        ("0.42.0", "==0.41.*", False),
    ],
)
def test_versions_are_compared_as_numbers(found, bound, kept):
    assert extras.satisfies(found, bound) is kept
