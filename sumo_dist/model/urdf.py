"""URDF for MuJoCo: it would drop what is only seen, strip folders off mesh files, merge links."""

import re
from pathlib import Path
from xml.etree import ElementTree

import mujoco

from sumo_dist.errors import UsageError

# MuJoCo's defaults for URDF are the opposite; a file's own <mujoco><compiler> has the last word.
KEEP = {"discardvisual": "false", "fusestatic": "false"}
READABLE = (".obj", ".stl", ".msh")
SEEN, TOUCHED, HIDDEN = 1, 0, 3  # geom groups: MuJoCo's of a URDF's visuals and collisions; ours


def is_urdf(content: bytes) -> bool:
    """Whether a file's outermost element is a URDF's."""
    text = re.sub(rb"<!--.*?-->", b"", content, flags=re.DOTALL)
    outermost = re.search(rb"<\s*([A-Za-z]\w*)", text)
    return outermost is not None and outermost[1] == b"robot"


def read_urdf(path: Path) -> mujoco.MjSpec:
    """Parse a URDF with all it holds: visuals, fixed links, meshes wherever its package has them.

    A link that has visuals shows them in place of its collision shapes.

    Raises:
        UsageError: a mesh is missing, or the file is a template that xacro has not expanded.
        ValueError: MuJoCo does not take it.
    """
    try:
        robot = ElementTree.parse(path).getroot()
    except ElementTree.ParseError as error:
        raise ValueError(f"XML Error: {error}") from None
    if any("xacro" in str(element.tag) for element in robot.iter()):
        raise UsageError(f"{path} is a xacro template: expand it first (xacro FILE > NAME.urdf)")
    _locate_meshes(robot, path, _settings(robot))
    spec = mujoco.MjSpec.from_string(ElementTree.tostring(robot, "unicode"))
    for body in spec.bodies:
        if any(geom.group == SEEN for geom in body.geoms):
            for geom in body.geoms:
                geom.group = HIDDEN if geom.group == TOUCHED else geom.group
    return spec


def _settings(robot: ElementTree.Element) -> ElementTree.Element:
    """The <compiler> of MuJoCo's extension to URDF, added if there is none."""
    extension = robot.find("mujoco")
    if extension is None:
        extension = ElementTree.Element("mujoco")
        robot.insert(0, extension)
    settings = extension.find("compiler")
    if settings is None:
        settings = ElementTree.SubElement(extension, "compiler")
    for key, value in KEEP.items():
        settings.attrib.setdefault(key, value)
    return settings


def _locate_meshes(robot: ElementTree.Element, path: Path, settings: ElementTree.Element) -> None:
    """Give every mesh its absolute path; a visual whose mesh MuJoCo cannot have is left out."""
    folder = path.absolute().parent / settings.attrib.pop("meshdir", "")
    settings.set("strippath", "false")
    for link in robot.iter("link"):
        for shape in link.findall("visual") + link.findall("collision"):
            mesh = shape.find("geometry/mesh")
            if mesh is None:
                continue
            name = mesh.get("filename", "")
            found = next((place for place in _places(name, folder) if place.is_file()), None)
            if shape.tag == "visual" and (found is None or found.suffix.lower() not in READABLE):
                link.remove(shape)
            elif found is None:
                raise UsageError(
                    f"{path}: mesh {name!r} of link {link.get('name')!r} is neither in {folder} "
                    "nor, as part of a package, in a folder above"
                )
            else:
                mesh.set("filename", str(found))


def _places(name: str, folder: Path) -> list[Path]:
    """Where a mesh may be: where it says, in the folder itself, in its package."""
    rest = Path(re.sub(r"^(package|model|file)://", "", name.replace("\\", "/")))
    places = [folder / rest, folder / rest.name]
    if name.startswith(("package://", "model://")):
        inside = Path(*rest.parts[1:])  # the package's folder may have another name
        places += [root / part for root in (folder, *folder.parents) for part in (rest, inside)]
    return places
