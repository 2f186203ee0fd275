import mujoco
import pytest

from sumo_dist.errors import UsageError
from sumo_dist.model.files import ASSETS, find_model, read_model, valid_model

BALL = "<mujoco><worldbody><body name='ball'><geom size='.1'/></body></worldbody></mujoco>"


def test_the_first_folder_that_has_it_and_assets_by_default(tmp_path):
    (tmp_path / "ball.xml").write_text(BALL)
    (tmp_path / "second").mkdir()
    (tmp_path / "second" / "ball.xml").write_text(BALL)
    assert find_model("ball.xml", (tmp_path, tmp_path / "second")) == tmp_path / "ball.xml"
    assert find_model("ball.xml", (ASSETS, tmp_path / "second")).parent.name == "second"
    assert find_model("objects/box.xml") == ASSETS / "objects/box.xml"


def test_the_home_directory(tmp_path, monkeypatch):
    monkeypatch.setenv("HOME", str(tmp_path))
    (tmp_path / "ball.xml").write_text(BALL)
    assert find_model("~/ball.xml") == tmp_path / "ball.xml"


@pytest.mark.parametrize("file", ["bal.xml", "~/bal.xml", "~nobody_of_this_name/bal.xml", "."])
def test_a_file_that_is_not_there_says_where_it_was_looked_for(tmp_path, file):
    (tmp_path / "ball.urdf").write_text("<robot/>")
    with pytest.raises(UsageError, match=f"unknown model file '{file}', looked for in ") as error:
        find_model(file, (tmp_path, ASSETS))
    assert "valid: /an/absolute/path.xml" in str(error.value)
    assert "objects/box.xml" in str(error.value)
    if file == "bal.xml":
        assert f"in {tmp_path} and in {ASSETS}; valid: /an/absolute/path.xml, ball.urdf, " in str(
            error.value
        )


@pytest.mark.parametrize(
    "content",
    [
        BALL.encode("utf-8-sig"),
        BALL.replace("ball", "Kästchen").encode(),
        b"<!-- von J\xfcrgen\n -->" + BALL.encode(),
    ],
)
def test_names_are_utf_8_and_comments_may_be_anything(tmp_path, content):
    (tmp_path / "ball.xml").write_bytes(content)
    assert read_model(tmp_path / "ball.xml", "it").compile().nbody == 2


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("m.xml", b"<mujoco model='a'>\n<!-- \xfc\n -->\n\xe4</mujoco>", "it: line 4 is not UTF-8"),
        ("m.xml", "<mujoco/>".encode("utf-16"), "it is not UTF-8 text"),
        ("m.urdf", b"<robot name='K\xe4'/>", "it: line 1 is not UTF-8"),
        ("m.urdf", b"<?xml version='1.0' encoding='UTF-8'?><robot name='\xe4'/>", "not UTF-8"),
        ("m.xml", b"<?xml version='1.0' encoding='latin1'?><mujoco model='\xe4'/>", "not UTF-8"),
        ("m.xml", b"", "it is not a valid MuJoCo model"),
        ("m.xml", b"<sdf/>", "it is not a valid MuJoCo model"),
        ("m.urdf", b"<robot>", "it is not a valid MuJoCo model: XML Error"),
        ("m.STL", b"solid", "it is a mesh: name an MJCF or URDF"),
    ],
)
def test_what_is_no_model_is_one_line(tmp_path, name, content, message):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(UsageError, match=message) as error:
        read_model(tmp_path / name, "it")
    assert "\n" not in str(error.value)


def test_a_name_that_is_not_utf_8_in_an_included_file(tmp_path):
    part = b"<mujocoinclude><worldbody><body name='\xe4'><geom size='.1'/></body></worldbody>"
    (tmp_path / "part.xml").write_bytes(part + b"</mujocoinclude>")
    (tmp_path / "m.xml").write_text("<mujoco><include file='part.xml'/></mujoco>")
    spec = read_model(tmp_path / "m.xml", "it")
    message = "it has names that are not UTF-8, or includes a file"
    with pytest.raises(UsageError, match=message), valid_model("it"):
        _ = [body.name for body in spec.bodies]


def test_mujocos_complaints_are_one_line():
    with pytest.raises(UsageError, match="it is not a valid") as error, valid_model("it"):
        mujoco.MjModel.from_xml_string("<mujoco><worldbody><body/></worldbody>")
    assert "\n" not in str(error.value)
