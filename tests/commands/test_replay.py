import pytest

from sumo_dist.cli import main


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (None, "no recording at "),
        (b"", "is not a recording of sumo-dist"),
        (b"PK\x03\x04 half a zip", "is not a recording of sumo-dist"),
    ],
)
def test_a_missing_or_broken_recording_is_one_line(tmp_path, capsys, content, message):
    if content is not None:
        (tmp_path / "run.npz").write_bytes(content)
    assert main(["replay", str(tmp_path)]) == 2
    err = capsys.readouterr().err
    assert err.startswith("sumo-dist: ")
    assert message in err
    assert err.count("\n") == 1


def test_a_film_of_an_unknown_kind_names_the_valid_ones(tmp_path, capsys, short_run):
    short_run.save(tmp_path / "run.npz")
    assert main(["replay", str(tmp_path), "--render", str(tmp_path / "film.avi")]) == 2
    assert "cannot render film.avi; valid endings: .gif, " in capsys.readouterr().err
