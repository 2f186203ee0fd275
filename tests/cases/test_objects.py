"""Objects, fixtures and articulated things as people publish them."""

import pytest

FAST = ("--workers", "0", "--viewer", "none", "--threads", "1", "--time-limit", "0.02")
FAST += ("--set", "rollouts=4", "--set", "horizon=0.4")
TASK = """
from dataclasses import replace
from sumo_dist.costs.terms import CostTerm
from sumo_dist.model.scene import SceneObject
from sumo_dist.tasks.families import Manipuland, move


def task():
    moved = move(Manipuland({name!r}, {file!r}, rest_z=0.3))
    scene = replace(moved.scene, fixtures={fixtures})
    joints = tuple(CostTerm(j, lambda r, j=j: abs(r.joints[j].pos) + abs(r.joints[j].vel), 1.0)
                   for j in {joints})
    return replace(moved, name="spot/case", scene=scene, cost=(*moved.cost, *joints))
"""
BOX = '<geom name="side" type="box" size=".3 .2 .3" mass="4"/>'
LID = (
    '<body name="lid" pos="0 0 .32"><joint name="hinge" axis="1 0 0" pos="0 .2 0" range="0 90"/>'
    '<geom type="box" size=".3 .2 .02" mass="1"/></body>'
)
CHEST = f'<body name="chest"><freejoint name="free"/>{BOX}{LID}</body>'


def world(body, rest="", head=""):
    return f"<mujoco>{head}<worldbody>{body}</worldbody>{rest}</mujoco>"


@pytest.fixture
def answers(ask, tmp_path):
    """Return a function that runs a task with a model file, and looks at what is printed.

    What works ends by its time limit (exit 1).
    """

    def answers(kind, brought, model, says="not solved: timeout", code=1, ending="xml", **parts):
        file = f"thing.{ending}"
        (tmp_path / file).write_bytes(model.encode() if isinstance(model, str) else model)
        values = {"name": "thing", "file": file, "fixtures": (), "joints": (), **parts}
        (tmp_path / "task.py").write_text(TASK.format(**values))
        out = ("--out", tmp_path / "run")
        return ask(kind, brought, "run", tmp_path / "task.py", *FAST, *out, code=code, says=says)

    return answers


@pytest.mark.parametrize(
    ("brought", "rest"),
    [
        (
            "contacts of the root with a nested body excluded",
            '<contact><exclude body1="chest" body2="lid"/></contact>',
        ),
        (
            "sensors of the root, and relative to it",
            '<sensor><subtreecom body="chest"/><framepos objtype="xbody" objname="lid" '
            'reftype="body" refname="chest"/></sensor>',
        ),
        (
            "the root tied to the world, and in a tuple with its free joint",
            '<equality><weld body1="chest" active="false"/></equality><custom><tuple name="it">'
            '<element objtype="body" objname="chest"/><element objtype="joint" objname="free"/>'
            "</tuple></custom>",
        ),
    ],
)
def test_references_to_the_root(answers, brought, rest):
    kind = "references to an object's root body or free joint"
    light = '<body name="lamp"><light mode="targetbody" target="chest"/></body></body>'
    camera = '<camera name="eye" mode="targetbodycom" target="chest" pos="0 2 1"/>'
    answers(kind, brought, world(CHEST.removesuffix("</body>") + light + camera, rest))


@pytest.mark.parametrize(
    ("brought", "compiler", "says"),
    [
        ("settotalmass, an old setting", 'settotalmass="7"', "MuJoCo warns: .*settotalmass"),
        ("boundmass and boundinertia", 'boundmass="2" boundinertia=".3"', "not solved"),
        ("radians and zyx", 'angle="radian" eulerseq="zyx"', "not solved"),
        ("discardvisual and fusestatic", 'discardvisual="true" fusestatic="true"', "not solved"),
    ],
)
def test_compiler_settings(answers, brought, compiler, says):
    kind = "compiler settings of the object lost when attached"
    answers(kind, brought, world(CHEST, head=f"<compiler {compiler}/>"), says)


def test_meshes_without_their_folders(answers, tmp_path):
    (tmp_path / "parts").mkdir()
    (tmp_path / "parts" / "wedge.obj").write_text(
        "v 0 0 0\nv .4 0 0\nv 0 .4 0\nv 0 0 .4\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"
    )
    head = (
        '<compiler meshdir="parts" strippath="true"/>'
        r'<asset><mesh name="wedge" file="C:\Users\me\wedge.obj"/></asset>'
    )
    mesh = '<body name="wedge"><geom type="mesh" mesh="wedge" mass="2"/></body>'
    kind = "compiler settings of the object lost when attached"
    answers(kind, "strippath and a path of another computer", world(mesh, head=head))


FLOOR = '<geom name="ground" type="plane" size="4 4 .1"/>'


@pytest.mark.parametrize(
    ("brought", "model", "says"),
    [
        ("its own floor", world(FLOOR + CHEST), "left out geom 'ground': the scene has a floor$"),
        ("its own light", world("<light pos='0 0 3'/>" + CHEST), "light: the scene has lights$"),
        (
            "a table that it stands on",
            world('<body name="table"><geom size=".2"/></body>' + CHEST),
            "left out body 'table': what stands still belongs in a fixture$",
        ),
        (
            "options, sizes and keyframes",
            world(
                CHEST,
                '<keyframe><key qpos="0 0 1 1 0 0 0 0"/></keyframe>',
                '<option gravity="0 0 -1.6" solver="CG"/><size njmax="99" nuser_body="1"/>',
            ),
            "left out option gravity, solver; size njmax; keyframes",
        ),
        (
            "several bodies that move freely",
            world(CHEST + '<body name="ball" pos="2 0 0"><freejoint/><geom size=".1"/></body>'),
            "object 'thing' is body 'chest', the first of several",
        ),
        (
            "several bodies and no free joint",
            world('<body name="left"><geom size=".2"/></body><body name="right" pos="0 1 0">'
                  '<geom size=".2"/></body>'),
            "body 'left', body 'right' move as one object",
        ),
    ],
)  # fmt: skip
def test_what_a_file_brings_along_is_said_once(answers, brought, model, says):
    printed = answers("what a file brings along besides its body", brought, model, says)
    assert printed.count("thing.xml") == 1, printed
    assert "WARNING" not in printed


def test_a_fixtures_floor(answers, tmp_path):
    (tmp_path / "hall.xml").write_text(
        world(FLOOR + '<geom type="box" size=".1 2 1" pos="4 0 1"/>')
    )
    answers(
        "what a file brings along besides its body",
        "a fixture's own floor",
        world(CHEST),
        "hall.xml: left out geom 'ground': the scene has a floor",
        fixtures='(SceneObject("hall", "hall.xml"),)',
    )


CANNOT = "content that cannot work, blamed on something else"
LINK = (
    '<link name="{}"><inertial><mass value="3"/><inertia ixx=".1" iyy=".1" izz=".1" ixy="0" '
    'ixz="0" iyz="0"/></inertial><collision><geometry>{}</geometry></collision></link>'
)
CUBE = '<box size=".6 .6 .6"/>'


@pytest.mark.parametrize(
    ("brought", "model", "says"),
    [
        (
            "a motor in the object",
            world(CHEST, '<actuator><motor name="opener" joint="hinge"/></actuator>'),
            "thing.xml has actuators, actuator 'opener', .*remove them",
        ),
        (
            "cloth",
            world('<flexcomp name="rag" type="grid" dim="2" count="3 3 1" spacing=".1 .1 .1" '
                  'mass="1" radius=".01"/>'),
            "thing.xml has soft bodies, flex 'rag', .*rigid bodies",
        ),
        (
            "a mocap body",
            world('<body name="ghost" mocap="true"><geom size=".2"/></body>'),
            "thing.xml: body 'ghost' is a mocap body, .*fixture",
        ),
        ("nothing but a floor", world(FLOOR), "thing.xml has no body that could be an object"),
        (
            "a door that hangs in the world",
            world('<body name="leaf"><joint name="pin"/><geom size=".2"/></body>'),
            "body 'leaf' hangs in the world by joint 'pin', .*fixture",
        ),
    ],
)  # fmt: skip
def test_what_cannot_work_is_refused_by_name(answers, brought, model, says):
    answers(CANNOT, brought, model, says, code=2)


@pytest.mark.parametrize(
    ("brought", "model"),
    [
        ("a URDF of one link", f'<robot name="cube">{LINK.format("cube", CUBE)}</robot>'),
        (
            "a URDF that is fixed in the world",
            f'<robot name="cube"><link name="world"/>{LINK.format("cube", CUBE)}<joint name="glue" '
            'type="fixed"><parent link="world"/><child link="cube"/></joint></robot>',
        ),
    ],
)
def test_a_urdf(answers, brought, model):
    answers(CANNOT, brought, model, ending="urdf")


def test_a_urdf_without_its_mesh(answers):
    link = LINK.format("mug", '<mesh filename="package://mugs/mug.stl"/>')
    says = "thing.urdf: mesh 'package://mugs/mug.stl' of link 'mug' is neither in"
    answers(CANNOT, "a URDF without its mesh", f"<robot name='m'>{link}</robot>", says, 2, "urdf")


def test_a_bare_mesh(answers):
    says = "thing.obj is a mesh: name an MJCF or URDF that has it as an asset"
    answers(CANNOT, "a mesh in place of a model", "v 0 0 0\n", says, 2, "obj")


ARTICULATED = "articulated objects"
CABINET = f"""<robot name="cabinet">{LINK.format("frame", CUBE)}
{LINK.format("door", '<box size=".02 .5 .5"/>')}{LINK.format("drawer", '<box size=".4 .4 .1"/>')}
<joint name="door hinge" type="revolute"><parent link="frame"/><child link="door"/>
<origin xyz=".32 -.25 0"/><axis xyz="0 0 1"/><limit lower="0" upper="1.5" effort="1" velocity="1"/>
</joint><joint name="rail" type="prismatic"><parent link="frame"/><child link="drawer"/>
<origin xyz="0 0 .4"/><axis xyz="1 0 0"/><limit lower="0" upper=".3" effort="1" velocity="1"/>
</joint></robot>"""


def test_a_lid(answers):
    answers(ARTICULATED, "a cost of a lid's joint", world(CHEST), joints=("thing/hinge",))


def test_a_door_and_a_drawer(answers):
    joints = ("thing/door hinge", "thing/rail")
    answers(ARTICULATED, "costs of a URDF's joints", CABINET, ending="urdf", joints=joints)


def test_joints_without_a_name(answers):
    drawers = '<body><joint type="slide"/><geom size=".1"/></body>' * 2
    model = world(f'<body name="chest">{BOX}{drawers}</body>')
    joints = ("thing/joint_1", "thing/joint_2")
    answers("unnamed bodies", "costs of two unnamed drawers", model, joints=joints)


def test_terrain(answers, tmp_path):
    heights = " ".join(str((7 * i) % 10 / 10) for i in range(36))
    hills = f'<hfield name="h" nrow="6" ncol="6" size="4 4 .1 .1" elevation="{heights}"/>'
    (tmp_path / "hills.xml").write_text(
        world('<geom type="hfield" hfield="h"/>', f"<asset>{hills}</asset>")
    )
    fixtures = '(SceneObject("hills", "hills.xml"),)'
    answers("terrain", "a height field as a fixture", world(CHEST), fixtures=fixtures)


def test_names_that_are_not_utf_8(answers):
    model = world(CHEST).replace("chest", "Kä").replace("><", ">\n<").encode("latin-1")
    says = "thing.xml: line 3 is not UTF-8: save the file as UTF-8"
    answers("environment", "Latin-1 names in a model", model, says, 2)


NAMES = "names and paths"


@pytest.mark.parametrize(
    ("brought", "parts", "says"),
    [
        ("a mistyped model", {"file": "thin.xml"}, "'thin.xml', looked for in .*, thing.xml, "),
        ("a model at home", {"file": "~/no/such.xml"}, r"looked for in /\S+/no; valid"),
        ("an object called floor", {"name": "floor"}, "can be called 'floor': that is the scene's"),
        ("a name of the robot's", {"name": "arm_link_sh0"}, "'arm_link_sh0' is a body of robot"),
    ],
)
def test_names(answers, brought, parts, says):
    answers(NAMES, brought, world(CHEST), says, 2, **parts)
