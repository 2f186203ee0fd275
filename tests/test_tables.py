from dataclasses import dataclass

import pytest

from sumo_dist.errors import UsageError
from sumo_dist.tables import made, read_table


@dataclass(frozen=True)
class Thing:
    name: str
    length: float = 1.0
    parts: tuple[str, ...] = ()


def test_a_table_becomes_a_dataclass_and_whole_numbers_do_for_others(tmp_path):
    path = tmp_path / "thing.toml"
    path.write_text('name = "a"\nlength = 2\nparts = ["b"]\n')
    read = read_table(path, "thing")
    assert made(Thing, read, path, name=str) == Thing("a", 2.0, ("b",))


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"nam": "a"}, "^here: unknown entry 'nam'; valid: length, name, parts$"),
        ({"name": 1}, "^here: name needs a str, got 1$"),
        ({"name": "a", "length": True}, "^here: length needs a float, got True$"),
        ({"name": "a", "parts": "b"}, "^here: parts needs a tuple, got 'b'$"),
    ],
)
def test_what_does_not_fit_is_named(values, message):
    with pytest.raises(UsageError, match=message):
        made(Thing, values, "here", name=str)


def test_no_file_and_no_toml_are_one_line(tmp_path):
    with pytest.raises(UsageError, match=r"^no thing at /.*: No such file"):
        read_table(tmp_path / "none.toml", "thing")
    (tmp_path / "bad.toml").write_text("= 1")
    with pytest.raises(UsageError, match=r"bad.toml is not TOML: "):
        read_table(tmp_path / "bad.toml", "thing")
