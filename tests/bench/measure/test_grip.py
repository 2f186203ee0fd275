import json
import re

import pytest

from sumo_dist.bench.measure import grip
from sumo_dist.bench.measure.grip import PLANS, PLANTS, RAILS, planning_and_plant
from sumo_dist.bench.measure.hold import ALONG, MOST, OUT, SLIPS, Bar, Dragged, Grip, Rail, most
from sumo_dist.cli import main
from sumo_dist.model.scene import SceneObject

MODELS = planning_and_plant()
ROUND = Bar("round", 0.03)
SLED = """<mujoco><worldbody><body><freejoint/>
<geom type="box" size="0.3 0.3 0.05" pos="0.4 0 0.05" mass="{mass}"/>
<geom name="{name}" type="capsule" size="0.015" fromto="0 -0.2 0.1 0 0.2 0.1" mass="0.1"
  friction="1 0.005 0.0001" priority="6" contype="0" conaffinity="1"/>
</body></worldbody></mujoco>"""


@pytest.fixture(scope="module")
def closed():
    return Grip(ROUND, MODELS[PLANTS])


@pytest.fixture
def sled(tmp_path):
    def write(mass: float = 10.0, name: str = "bar") -> Rail:
        path = tmp_path / "sled.xml"
        path.write_text(SLED.format(mass=mass, name=name))
        return Rail(SceneObject("sled", str(path)), "bar")

    return write


@pytest.mark.parametrize("threshold", [0, 1, 37, 125, MOST])
def test_the_force_that_is_held_is_found_to_a_newton(threshold):
    assert most(lambda force: force <= threshold) == threshold


@pytest.mark.parametrize("direction", [OUT, ALONG])
def test_a_newton_more_than_is_held_slips(closed, direction):
    held = closed.holds(direction)
    assert 0 < held < MOST
    assert closed.pull(held, direction).moved <= SLIPS < closed.pull(held + 1, direction).moved


def test_a_closed_jaw_squeezes_the_bar_and_hardly_enters_it(closed):
    assert closed.mass == 10.0
    assert closed.torque == pytest.approx(-16.0 * closed.angle, rel=0.01)  # the servo's 16 N m/rad
    lever = (
        closed.torque / closed.squeeze
    )  # the jaw's hinge is 0.12 m before the wrist, the bar 0.17
    assert 0.04 < lever < 0.07
    assert 0.0 < closed.pull(50.0, OUT).deepest < 0.001


@pytest.mark.parametrize("friction", [0.3, 1.0])
def test_along_the_bar_it_is_friction_that_holds(friction):
    hold = Grip(Bar("round", 0.03, friction), MODELS[PLANTS])
    bound = 2.0 * friction * hold.squeeze  # of the upper jaw and of the lower one
    assert 0.75 * bound < hold.holds(ALONG) <= bound


def test_the_same_figures_every_time(closed):
    again = Grip(ROUND, MODELS[PLANTS])
    assert again.pull(60.0, OUT) == closed.pull(60.0, OUT) == closed.pull(60.0, OUT)
    assert (again.squeeze, again.angle) == (closed.squeeze, closed.angle)


def test_the_planning_model_holds_less_and_its_time_step_is_why(closed):
    held = {name: Grip(ROUND, options).holds(OUT) for name, options in MODELS.items()}
    plant, slow, quick, plan, fine = held.values()
    assert max(slow, plan) < 0.95 * min(plant, quick, fine)
    soft = Bar("round", 0.03, solref=0.04)  # the least that a step of 0.02 s makes of any contact
    plant, plan = (Grip(soft, MODELS[name]).holds(ALONG) for name in (PLANTS, PLANS))
    assert plan == pytest.approx(plant, abs=3)


def test_a_bar_of_lower_priority_is_as_slippery_as_the_robot():
    hold = Grip(Bar("round", 0.03, friction=1.0, priority=3), MODELS[PLANTS])
    assert hold.friction == 0.15
    assert hold.holds(OUT) < 40


@pytest.mark.parametrize("rail", RAILS, ids=lambda rail: rail.name)
@pytest.mark.parametrize("model", [PLANTS, PLANS])
def test_the_jaw_closes_on_the_rails_of_objects(rail, model):
    hold = Grip(rail, MODELS[model])
    assert hold.angle < -0.05  # something is in it
    assert hold.squeeze > 10.0
    assert hold.friction > 0.0


def test_a_rail_is_held_as_a_bar_with_its_numbers_is(closed, sled):
    hold = Grip(sled(), MODELS[PLANTS])
    assert hold.mass == pytest.approx(10.1)
    assert hold.holds(OUT) == pytest.approx(closed.holds(OUT), abs=3)


def test_an_object_is_dragged_by_what_rubs_on_the_floor(sled):
    slides, moves, how = Dragged(sled(mass=5.0)).drag()
    assert slides == pytest.approx(0.7 * 5.1 * 9.81, rel=0.01)
    assert how == "slides"
    assert moves == pytest.approx(slides, abs=3.0)
    assert Dragged(sled(mass=60.0)).drag().moves == MOST + 1


def test_a_light_hold_on_the_end_of_a_tall_thing_tips_it():
    rack = SceneObject("rack", "objects/rack.xml")
    assert Dragged(Rail(rack, "cross_rear")).drag().how == "tips"
    assert Dragged(Rail(rack, "left_rear")).drag().how == "turns"


def test_the_command(monkeypatch, capsys):
    monkeypatch.setattr(grip, "BARS", (ROUND,))
    monkeypatch.setattr(grip, "FINE", 0.005)
    assert main(["bench", "grip", "--json"]) == 0
    result = json.loads(capsys.readouterr().out)
    (bar,) = result["bars"]
    assert bar["name"] == "30 mm round"
    assert bar[PLANTS]["out"] > bar[PLANS]["out"] > 50
    assert [row["model"] for row in result["models"]] == list(planning_and_plant())
    assert [row["name"] for row in result["rails"]] == [rail.name for rail in RAILS]


def test_a_bar_of_ones_own(sled, tmp_path, monkeypatch, capsys):
    sled()
    monkeypatch.chdir(tmp_path)
    assert (
        main(["bench", "grip", "--mjcf", "sled.xml", "--part", "bar", "--floor-friction", "1"]) == 0
    )
    said = capsys.readouterr().out
    assert re.search(r"\| sled/bar +\| 1, 6, 3, 0.02 .* \| 10.1 .* \| 99 .* slides", said)
    assert "bench grip --mjcf sled.xml --part bar --approach 1 0 0 --floor-friction 1\n" in said
    assert "hang on nothing" not in said


@pytest.mark.parametrize(
    ("file", "part", "approach", "reason"),
    [
        ("rack", "nothing", "1 0 0", "unknown bar 'rack/nothing'; valid: .*rack/cross_rear"),
        ("rack", "left_top", "1 0 0", "rack/left_top lies along .*: approach it from a side"),
        ("rack", "cross_rear", "0 0 -1", "rack/cross_rear is approached from above"),
        ("box", "collision", "0 1 0", "the open jaw does not fit around box/collision.*left_jaw"),
    ],
)
def test_bars_that_cannot_be_held(file, part, approach, reason, capsys):
    own = ["--mjcf", f"objects/{file}.xml", "--part", part, "--approach", *approach.split()]
    assert main(["bench", "grip", *own]) == 2
    *_, error = capsys.readouterr().err.splitlines()
    assert re.search(reason, error)


def test_a_part_needs_its_file(capsys):
    assert main(["bench", "grip", "--part", "rail"]) == 2
    assert "needs both: --mjcf FILE --part GEOM" in capsys.readouterr().err
