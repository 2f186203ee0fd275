import pytest

KIND = "an object that does not rest where the task says"
SOLID = '<geom type="cylinder" size="0.2 0.3" mass="4" {}/>'
BODY = '<mujoco>{}<worldbody><body name="drum">{}</body></worldbody></mujoco>'
HILL = '<asset><hfield name="h" nrow="2" ncol="2" size=".3 .3 .2 .1" elevation="0 1 1 0"/></asset>'
INERTIA = '<inertial mass="4" pos="0 0 0" diaginertia=".1 .1 .1"/>'
GHOST = BODY.format("", SOLID.format('contype="0" conaffinity="0"'))
SHY = BODY.format("", SOLID.format('contype="4" conaffinity="4"'))
HILLY = BODY.format(HILL, f'{INERTIA}<geom type="hfield" hfield="h"/>')
LEANING = BODY.format("", '<geom type="capsule" size="0.05 0.4" mass="4"/>')
DRUM_AT = "move(Manipuland('drum', 'drum.xml', rest_z={}))"


@pytest.mark.parametrize(
    ("brought", "returns", "model", "says"),
    [
        (
            "too high",
            DRUM_AT.format(0.6),
            None,
            "FAIL +rest .*drum drops by 300 mm before it rests",
        ),
        ("a bit too high", DRUM_AT.format(0.33), None, "FAIL +rest .*drum drops by 30 mm"),
        ("in the floor", DRUM_AT.format(0.25), None, "FAIL +start .*drum overlap by 50 mm"),
        (
            "geoms that touch nothing",
            "move(DRUM)",
            GHOST,
            "FAIL +model .*none of its geoms touches",
        ),
        ("dropped, touching nothing", "upright(DRUM)", GHOST, "FAIL +model .*none of its geoms"),
        (
            "geoms that miss the floor",
            "move(DRUM)",
            SHY,
            "FAIL +rest .*drum falls for ever: none of",
        ),
        (
            "dropped through the floor",
            "upright(DRUM)",
            SHY,
            "FAIL +reset .*falls through the floor",
        ),
        ("a height field", "move(DRUM)", HILLY, "FAIL +rest .*falls for ever: planes and height"),
        (
            "a height field, dropped",
            "upright(DRUM)",
            HILLY,
            "FAIL +reset .*planes and height fields",
        ),
        ("what cannot stand", DRUM_AT.format(0.45), LEANING, "FAIL +rest .*drum (drops|tips)"),
    ],
)
def test_an_object_that_does_not_stay_is_told(ask, write_task, brought, returns, model, says):
    path = write_task(returns, **({"model": model} if model else {}))
    ask(KIND, brought, "task", "check", path, "--seeds", 2, code=1, says=says)


@pytest.mark.parametrize(
    ("brought", "goal", "says"),
    [
        (
            "a goal in the air",
            "Goal('object', 0.9)",
            "FAIL +goal .*put there, drum drops by 600 mm",
        ),
        (
            "a goal out of bounds",
            "(9.0, 0.0, 0.3)",
            "FAIL +goal .*makes the failure 'left the work",
        ),
    ],
)
def test_a_goal_that_cannot_be_reached_is_told(ask, write_task, brought, goal, says):
    path = write_task(f"replace(move(DRUM), goal={goal})")
    ask(KIND, brought, "task", "check", path, "--seeds", 2, code=1, says=says)
