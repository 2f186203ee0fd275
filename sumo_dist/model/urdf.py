"""URDF for MuJoCo, which would drop what is only seen, mesh files' folders and links' names."""

import re
from pathlib import Path
from xml.etree import ElementTree

import mujoco

from sumo_dist.errors import UsageError

READABLE = (".obj", ".stl", ".msh")
SEEN, TOUCHED, HIDDEN = 1, 0, 3  # geom groups: MuJoCo's of a URDF's visuals and collisions; ours


def is_urdf(content: bytes) -> bool:
    """Whether a file's outermost element is a URDF's."""
    text = re.sub(rb"<!--.*?-->", b"", content, flags=re.DOTALL)
    outermost = re.search(rb"<\s*([A-Za-z]\w*)", text)
    return outermost is not None and outermost[1] == b"robot"


def read_urdf(content: bytes, path: Path) -> mujoco.MjSpec:
    """Parse a URDF with all it holds, visuals included, meshes wherever its package has them.

    A link that has visuals shows them in place of its collision shapes. MuJoCo makes a link that is
    fixed to another a part of that one: a site keeps its name and its place.

    Args:
        content: of the file.
        path: of the file.

    Raises:
        UsageError: a mesh is missing, or the file is a template that xacro has not expanded.
        ValueError: MuJoCo does not take it.
    """
    try:
        robot = ElementTree.fromstring(content[content.find(b"<") : content.rfind(b">") + 1])
    except ElementTree.ParseError as error:
        raise ValueError(f"XML Error: {error}") from None
    if any("xacro" in str(element.tag) for element in robot.iter()):
        raise UsageError(f"{path} is a xacro template: expand it first (xacro FILE > NAME.urdf)")
    _locate_meshes(robot, path, _settings(robot))
    spec = _without_bad_visuals(robot)
    for body in spec.bodies[1:]:
        if not body.joints:
            body.add_site(name=body.name, group=HIDDEN)
        if any(geom.group == SEEN for geom in body.geoms):
            for geom in body.geoms:
                geom.group = HIDDEN if geom.group == TOUCHED else geom.group
    return spec


def _without_bad_visuals(robot: ElementTree.Element) -> mujoco.MjSpec:
    """Parse a URDF; without its visuals, as MuJoCo by default, if it cannot have them."""
    spec = mujoco.MjSpec.from_string(ElementTree.tostring(robot, "unicode"))
    try:
        spec.copy().compile()
    except ValueError:
        for link in robot.iter("link"):
            for visual in link.findall("visual"):
                link.remove(visual)
        spec = mujoco.MjSpec.from_string(ElementTree.tostring(robot, "unicode"))
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
    settings.attrib.setdefault("discardvisual", "false")  # a file's own setting has the last word
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
