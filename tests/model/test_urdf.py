import mujoco
import numpy as np
import pytest

from sumo_dist.errors import UsageError
from sumo_dist.model.urdf import HIDDEN, SEEN, TOUCHED, is_urdf, read_urdf

WEDGE = "v 0 0 0\nv .4 0 0\nv 0 .4 0\nv 0 0 .4\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"
BOX = '<box size=".2 .2 .2"/>'


def mesh(uri):
    return f'<mesh filename="{uri}"/>'


def link(name, *shapes, mass=3.0):
    inertia = '<inertia ixx=".1" iyy=".1" izz=".1" ixy="0" ixz="0" iyz="0"/>'
    drawn = "".join(f"<{kind}><geometry>{shape}</geometry></{kind}>" for kind, shape in shapes)
    return f'<link name="{name}"><inertial><mass value="{mass}"/>{inertia}</inertial>{drawn}</link>'


@pytest.fixture
def urdf(tmp_path):
    """A function that reads a robot of this content from <a folder>/cart/urdf/cart.urdf.

    Two meshes are in cart/meshes.
    """
    for folder in ("urdf", "meshes"):
        (tmp_path / "cart" / folder).mkdir(parents=True)
    for name in ("wedge.obj", "picture.dae"):
        (tmp_path / "cart" / "meshes" / name).write_text(WEDGE)

    def read(content, encoding="utf-8", head=""):
        path = tmp_path / "cart" / "urdf" / "cart.urdf"
        path.write_text(f'{head}<robot name="cart">{content}</robot>', encoding=encoding)
        return read_urdf(path.read_bytes(), path)

    return read


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        (b"<?xml version='1.0'?>\n<!-- a <mujoco> -->\n<robot name='r'>", True),
        (b"<mujoco><!-- <robot> --></mujoco>", False),
        (b"<!-- <robot name='r'/> --><mujoco/>", False),
        (b"", False),
    ],
)
def test_what_a_urdf_is(content, expected):
    assert is_urdf(content) is expected


def test_visuals_are_kept_and_seen_in_place_of_collision_shapes(urdf):
    seen = link("cart", ("visual", BOX), ("collision", BOX))
    model = urdf(seen + link("other", ("collision", BOX))).compile()
    assert model.geom_group.tolist() == [SEEN, HIDDEN, TOUCHED]
    assert model.geom_contype.tolist() == [0, 1, 1]


def test_fixed_links_leave_their_name_to_a_site(urdf):
    both = link("cart", ("collision", BOX)) + link("knob", ("collision", BOX), mass=0.5)
    ends = '<parent link="cart"/><child link="knob"/><origin xyz="1 2 3"/>'
    fixed = f'<joint name="j" type="fixed">{ends}</joint>'
    spec = urdf(both + fixed)
    spec.bodies[1].add_freejoint()
    model = spec.compile()
    np.testing.assert_array_equal(model.body_mass, [0, 3.5])
    np.testing.assert_array_equal(model.site("knob").pos, [1, 2, 3])
    settings = '<mujoco><compiler fusestatic="false"/></mujoco>'
    model = urdf(settings + both + fixed).compile()
    np.testing.assert_array_equal(model.body_mass, [0, 3, 0.5])


@pytest.mark.parametrize(
    "uri",
    [
        "package://cart/meshes/wedge.obj",
        "package://cart_description/meshes/wedge.obj",
        "model://cart/meshes/wedge.obj",
        "../meshes/wedge.obj",
    ],
)
def test_meshes_where_their_package_has_them(urdf, uri):
    model = urdf(link("cart", ("collision", mesh(uri)))).compile()
    assert model.geom_type.tolist() == [mujoco.mjtGeom.mjGEOM_MESH]


def test_meshes_in_the_files_own_meshdir(urdf):
    settings = '<mujoco><compiler meshdir="../meshes"/></mujoco>'
    two = link("cart", ("collision", mesh("/of/another/computer/wedge.obj")), ("visual", BOX))
    other = link("other", ("collision", mesh("wedge.obj")))
    assert urdf(settings + two + other).compile().nmesh == 1


@pytest.mark.parametrize("uri", ["../meshes/picture.dae", "package://cart/meshes/none.obj"])
def test_a_visual_that_mujoco_cannot_read_is_left_out_a_collision_shape_is_missed(urdf, uri):
    spec = urdf(link("cart", ("visual", mesh(uri)), ("collision", BOX)))
    assert spec.compile().geom_group.tolist() == [TOUCHED]
    if uri.endswith("none.obj"):
        with pytest.raises(UsageError, match=r"mesh '.*none.obj' of link 'cart' is neither in"):
            urdf(link("cart", ("collision", mesh(uri))))


def test_visuals_that_mujoco_cannot_have_are_left_out(urdf):
    flat = link("cart", ("visual", '<box size="1 0 1"/>'), ("collision", BOX))
    assert urdf(flat).compile().geom_group.tolist() == [TOUCHED]


def test_what_is_around_the_outermost_element_does_not_matter(tmp_path):
    text = f'\n<?xml version="1.0"?><robot name="r">{link("r", ("collision", BOX))}</robot>\n\0'
    assert read_urdf(text.encode(), tmp_path / "r.urdf").compile().ngeom == 1


def test_a_declared_encoding_counts(urdf):
    head = '<?xml version="1.0" encoding="ISO-8859-1"?>'
    spec = urdf(link("Kästchen", ("collision", BOX)), "latin-1", head)
    assert spec.bodies[1].name == "Kästchen"


def test_a_template_is_to_be_expanded_first(urdf):
    xacro = '<xacro:property xmlns:xacro="http://www.ros.org/wiki/xacro" name="a" value="1"/>'
    with pytest.raises(UsageError, match="a xacro template: expand it first"):
        urdf(xacro + link("cart", ("collision", BOX)))
