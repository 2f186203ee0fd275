import pytest

from sumo_dist.errors import UsageError
from sumo_dist.model.part import read_part

BALL = '<geom size=".1"/>'
PLANE = '<geom type="plane" size="1 1 1"/>'
FREE = f'<body name="{{}}"><freejoint/>{BALL}</body>'
STILL = f'<body name="{{}}">{BALL}</body>'
HUNG = f'<body name="{{}}"><joint name="pin"/>{BALL}</body>'
MOCAP = f'<body name="{{}}" mocap="true">{BALL}</body>'


@pytest.fixture
def part(tmp_path):
    """A function that reads a file with these top-level elements."""

    def part(*elements, name="it", free=True):
        path = tmp_path / "thing.xml"
        path.write_text(f"<mujoco><worldbody>{''.join(elements)}</worldbody></mujoco>")
        return read_part(str(path), name, free)

    return part


def top(part):
    return [body.name for body in part.spec.worldbody.bodies]


@pytest.mark.parametrize(
    ("elements", "root", "stays"),
    [
        ([STILL.format("a")], "a", ["a"]),
        ([f"<frame pos='1 0 0'>{STILL.format('a')}</frame>"], "a", ["a"]),
        ([f'<body name="a"><joint type="free"/>{BALL}</body>'], "a", ["a"]),
        ([STILL.format("shelf"), FREE.format("a"), BALL], "a", ["a"]),
        ([HUNG.format("door"), FREE.format("a")], "a", ["door", "a"]),
        ([f'<body name="ground">{PLANE}</body>', FREE.format("a"), PLANE], "a", ["a"]),
        ([FREE.format("b"), FREE.format("it")], "it", ["b", "it"]),
        ([FREE.format("b"), FREE.format("c")], "b", ["b", "c"]),
        ([MOCAP.format("hand"), FREE.format("a")], "a", ["a"]),
        ([MOCAP.format("hand"), STILL.format("a")], "a", ["a"]),
    ],
)
def test_which_body_is_the_object_and_what_stays_with_it(part, elements, root, stays):
    got = part(*elements)
    assert got.root.name == root
    assert len(got.root.joints) == 1
    assert top(got) == stays
    assert [*got.spec.worldbody.geoms] == got.floors


@pytest.mark.parametrize(
    "elements",
    [
        [STILL.format("left"), STILL.format("right")],
        [STILL.format("frame"), HUNG.format("leaf")],
        [BALL],
    ],
)
def test_what_has_no_free_body_is_one_object_as_a_whole(part, elements):
    got = part(*elements)
    assert got.root is None
    assert len(top(got)) + len(got.spec.worldbody.geoms) == len(elements)


def test_masses_that_a_file_states_move_along_with_fixed_links(tmp_path):
    inertia = '<inertia ixx=".1" iyy=".1" izz=".1" ixy="0" ixz="0" iyz="0"/>'
    link = f'<link name="{{}}"><inertial><mass value="3"/>{inertia}</inertial></link>'
    (tmp_path / "two.urdf").write_text(
        f'<robot name="two">{link.format("left")}{link.format("right")}</robot>'
    )
    part = read_part(str(tmp_path / "two.urdf"), "it", free=True)
    assert part.root is None
    assert part.spec.compile().body_mass.tolist() == [0, 3, 3]


@pytest.mark.parametrize(
    ("elements", "message"),
    [
        ([HUNG.format("leaf")], "body 'leaf' hangs in the world by joint 'pin', .*as a fixture"),
        ([MOCAP.format("hand")], "body 'hand' is a mocap body, .*as a fixture"),
        ([MOCAP.format("l"), MOCAP.format("r")], "body 'l', body 'r' is a mocap body"),
        ([PLANE], "has no body that could be an object"),
        (['<body><site name="s"/></body>'], "mass and inertia of moving bodies"),
    ],
)
def test_what_cannot_be_an_object(part, elements, message):
    with pytest.raises(UsageError, match=f"thing.xml.*{message}"):
        part(*elements)


def test_what_is_left_out_of_an_object_is_said(part):
    wall = '<geom name="wall" type="box" size="1 .1 1" pos="0 3 1"/>'
    said = part(wall, BALL, STILL.format("shelf"), FREE.format("a")).remarks
    assert said == [
        "left out geom 'wall', an unnamed geom, body 'shelf': what stands still belongs in a "
        "fixture"
    ]
    assert part(wall, STILL.format("shelf"), free=False).remarks == []
    assert part(FREE.format("a")).remarks == []


@pytest.mark.parametrize(
    ("plane", "is_the_floor"),
    [
        (PLANE, True),
        ('<body pos="0 0 1"><geom type="plane" size="1 1 1" pos="0 0 -1"/></body>', True),
        ('<geom type="plane" size="1 1 1" pos="0 0 .2"/>', False),
        ('<geom type="plane" size="1 1 1" euler="10 0 0"/>', False),
    ],
)  # fmt: skip
def test_a_fixtures_planes_stay_unless_they_are_the_floor(part, plane, is_the_floor):
    assert len(part(plane, STILL.format("shelf"), free=False).floors) == is_the_floor


def test_every_body_and_joint_has_a_name_of_its_own(part):
    drawers = f'<body><joint/><joint type="slide"/>{BALL}</body>' * 2
    spec = part(f'<body>{BALL}{drawers}<body name="body_2">{BALL}</body></body>').spec
    bodies, joints = ([e.name for e in elements] for elements in (spec.bodies, spec.joints))
    assert all(bodies)
    assert all(joints)
    assert len({*bodies}) == len(bodies) == 5
    assert len({*joints}) == len(joints) == 5
