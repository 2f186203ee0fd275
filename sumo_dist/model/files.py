"""Model files, MJCF or URDF, as people publish them: finding, reading and checking one."""

import os
import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import mujoco

from sumo_dist.errors import UsageError
from sumo_dist.model.urdf import is_urdf, read_urdf

ASSETS = Path(__file__).parents[1] / "assets"
MODELS = (".xml", ".urdf")
_WAYS_OUT = {
    "mjMINVAL": "give what is to move a mass and an inertia, or leave <inertial> out of its file",
    "positive eigenvalues": "leave <inertial> out, then the shapes have a density",
}
MESHES = (".obj", ".stl", ".msh", ".ply", ".dae", ".glb", ".gltf", ".fbx", ".usd", ".usda")


def find_model(file: str, folders: Sequence[Path] = (ASSETS,)) -> Path:
    """Where a model file is.

    Args:
        file: relative to one of the folders, or absolute; `~` is the home directory.
        folders: searched in this order.

    Raises:
        UsageError: it is in none of them; the message says where it was looked for.
    """
    places = [folder / os.path.expanduser(file) for folder in folders]
    for place in places:
        if place.is_file():
            return place
    searched = list(dict.fromkeys(str(place.parent) for place in places))
    beside = [p for folder in searched if Path(folder).is_dir() for p in Path(folder).iterdir()]
    theirs = sorted(p.name for p in beside if p.suffix in MODELS and ASSETS not in p.parents)
    ours = sorted(str(p.relative_to(ASSETS)) for p in ASSETS.rglob("*.xml"))
    raise UsageError(
        f"unknown model file {file!r}, looked for in {' and in '.join(searched)}; valid: "
        + ", ".join(["/an/absolute/path.xml", *theirs, *ours])
    )


def read_model(path: Path, what: str) -> mujoco.MjSpec:
    """Parse a model file; nothing is compiled.

    Args:
        path: of an MJCF or a URDF.
        what: the file, as messages call it.

    Raises:
        UsageError: it is neither.
    """
    if path.suffix.lower() in MESHES:
        raise UsageError(f"{what} is a mesh: name an MJCF or URDF that has it as an asset")
    try:
        content = path.read_bytes()
    except OSError as error:
        raise UsageError(f"cannot read {what}: {error.strerror}") from None
    with valid_model(what):
        urdf = is_urdf(content)
        if not (urdf and _declares_encoding(content)):
            _check_encoding(content, what)
        if urdf:
            return read_urdf(content, path)
        return mujoco.MjSpec.from_file(str(path))


@contextmanager
def valid_model(what: str) -> Iterator[None]:
    """Turn MuJoCo's complaint into a one-line UsageError that names its subject."""
    try:
        yield
    except UnicodeDecodeError:
        raise UsageError(
            f"{what} has names that are not UTF-8, or includes a file that has: save it as UTF-8"
        ) from None
    except ValueError as error:
        reason = " ".join(str(error).split())
        reason += "".join(f": {way}" for sign, way in _WAYS_OUT.items() if sign in reason)
        raise UsageError(f"{what} is not a valid MuJoCo model: {reason}") from None


def _declares_encoding(content: bytes) -> bool:
    """Whether a file says that it is in something else than UTF-8, which MuJoCo does not heed."""
    declared = re.match(rb"\s*<\?xml[^>]*encoding\s*=\s*[\"']([^\"']+)", content)
    return declared is not None and declared[1].lower() not in (b"utf-8", b"us-ascii")


def _check_encoding(content: bytes, what: str) -> None:
    """See that names are UTF-8, which MuJoCo takes for granted; comments may be anything."""
    blank = re.sub(rb"<!--.*?-->", lambda c: b"\n" * c[0].count(b"\n"), content, flags=re.DOTALL)
    if b"\0" in content:
        raise UsageError(f"{what} is not UTF-8 text: name an MJCF or URDF")
    try:
        blank.decode()
    except UnicodeDecodeError as error:
        line = blank.count(b"\n", 0, error.start) + 1
        raise UsageError(f"{what}: line {line} is not UTF-8: save the file as UTF-8") from None
