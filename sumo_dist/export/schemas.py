"""JSON schemas of the messages in an MCAP file.

Those named foxglove.* are what Foxglove knows by these names (docs.foxglove.dev/docs/sdk/schemas),
as far as an export uses their fields; the others are ours.
"""

from typing import Any

Schema = dict[str, Any]

INFO = 2  # level of foxglove.Log

_NUMBER: Schema = {"type": "number"}
_MAYBE: Schema = {"type": ["number", "null"]}
_COUNT: Schema = {"type": "integer", "minimum": 0}
_TEXT: Schema = {"type": "string"}


def _object(title: str = "", **properties: Schema) -> Schema:
    named = {"title": title} if title else {}
    return {**named, "type": "object", "properties": properties}


def _list(items: Schema) -> Schema:
    return {"type": "array", "items": items}


def _by_name(numbers: Schema) -> Schema:
    return {"type": "object", "additionalProperties": numbers}


_TIME = _object("time", sec=_COUNT, nsec={**_COUNT, "maximum": 999_999_999})
_DURATION = _object("duration", sec={"type": "integer"}, nsec={**_COUNT, "maximum": 999_999_999})
_VECTOR = _object("foxglove.Vector3", x=_NUMBER, y=_NUMBER, z=_NUMBER)
_POINT = _object("foxglove.Point3", x=_NUMBER, y=_NUMBER, z=_NUMBER)
_QUATERNION = _object("foxglove.Quaternion", x=_NUMBER, y=_NUMBER, z=_NUMBER, w=_NUMBER)
_POSE = _object("foxglove.Pose", position=_VECTOR, orientation=_QUATERNION)
_COLOR = _object("foxglove.Color", r=_NUMBER, g=_NUMBER, b=_NUMBER, a=_NUMBER)
_SOLID = {"pose": _POSE, "size": _VECTOR, "color": _COLOR}

_TRANSFORM = _object(
    "foxglove.FrameTransform",
    timestamp=_TIME,
    parent_frame_id=_TEXT,
    child_frame_id=_TEXT,
    translation=_VECTOR,
    rotation=_QUATERNION,
)
_ENTITY = _object(
    "foxglove.SceneEntity",
    timestamp=_TIME,
    frame_id=_TEXT,
    id=_TEXT,
    lifetime=_DURATION,
    frame_locked={"type": "boolean"},
    metadata=_list(_object("foxglove.KeyValuePair", key=_TEXT, value=_TEXT)),
    arrows=_list({"type": "object"}),
    cubes=_list(_object("foxglove.CubePrimitive", **_SOLID)),
    spheres=_list(_object("foxglove.SpherePrimitive", **_SOLID)),
    cylinders=_list(
        _object("foxglove.CylinderPrimitive", **_SOLID, bottom_scale=_NUMBER, top_scale=_NUMBER)
    ),
    lines=_list({"type": "object"}),
    triangles=_list(
        _object(
            "foxglove.TriangleListPrimitive",
            pose=_POSE,
            points=_list(_POINT),
            color=_COLOR,
            colors=_list(_COLOR),
            indices=_list(_COUNT),
        )
    ),
    texts=_list({"type": "object"}),
    models=_list({"type": "object"}),
)
_SCENE = _object(
    "foxglove.SceneUpdate", deletions=_list({"type": "object"}), entities=_list(_ENTITY)
)
_LOG = _object(
    "foxglove.Log",
    timestamp=_TIME,
    level={"title": "foxglove.LogLevel", "type": "integer"},
    message=_TEXT,
    name=_TEXT,
    file=_TEXT,
    line=_COUNT,
)
_JOINT = _object(position=_NUMBER, velocity=_NUMBER, target=_MAYBE)
_PLAN = _object(
    "sumo_dist.Plan",
    timestamp=_TIME,
    number=_COUNT,
    wall_ms=_NUMBER,
    age_ms=_NUMBER,
    rollouts=_COUNT,
    lost=_COUNT,
    best=_MAYBE,
    median=_MAYBE,
    total=_NUMBER,
    terms=_by_name(_NUMBER),
    weights=_by_name(_NUMBER),
    parameters=_by_name(_NUMBER),
)

TOPICS: dict[str, tuple[str, Schema]] = {
    "/tf": (
        "foxglove.FrameTransforms",
        _object("foxglove.FrameTransforms", transforms=_list(_TRANSFORM)),
    ),
    "/scene": ("foxglove.SceneUpdate", _SCENE),
    "/goal": ("foxglove.SceneUpdate", _SCENE),
    "/joints": (
        "sumo_dist.Joints",
        _object("sumo_dist.Joints", timestamp=_TIME, joints=_by_name(_JOINT)),
    ),
    "/plan": ("sumo_dist.Plan", _PLAN),
    "/events": ("foxglove.Log", _LOG),
}
"""Topic -> name and schema of its messages. Lengths are in m, angles in rad."""
