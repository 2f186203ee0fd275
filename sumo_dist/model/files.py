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
    with valid_model(what):
        try:
            return read_urdf(path) if is_urdf(path) else mujoco.MjSpec.from_file(str(path))
        except OSError as error:
            raise UsageError(f"cannot read {what}: {error.strerror}") from None


def compile_alone(spec: mujoco.MjSpec, path: Path, what: str) -> mujoco.MjModel:
    """Compile a file's model before it becomes a part of a scene, so that an error names the file.

    Raises:
        UsageError: MuJoCo does not take it, or its names are not UTF-8.
    """
    with valid_model(what):
        model = spec.compile()
    try:
        model.names.decode()
    except UnicodeDecodeError:
        raise UsageError(
            f"{what} has names that are not UTF-8{_place(path)}: save it as UTF-8"
        ) from None
    return model


@contextmanager
def valid_model(what: str) -> Iterator[None]:
    """Turn MuJoCo's complaint into a one-line UsageError that names its subject."""
    try:
        yield
    except UnicodeDecodeError:  # MuJoCo quotes a name or path in its message as it stands
        raise UsageError(f"{what} has names that are not UTF-8: save it as UTF-8") from None
    except ValueError as error:
        reason = " ".join(str(error).split())
        raise UsageError(f"{what} is not a valid MuJoCo model: {reason}") from None


def _place(path: Path) -> str:
    """The first line that is not UTF-8, if it is in this file and not in one it includes."""
    for number, line in enumerate(path.read_bytes().splitlines(), 1):
        if re.sub(rb"[\x00-\x7f]", b"", line).decode(errors="replace").count("\ufffd"):
            return f", first in line {number}"
    return ""
