"""An MCAP file of a run, read back by the library of those who made the format."""

import json
from collections import Counter
from dataclasses import replace

import mujoco
import numpy as np
import pytest
from mcap.reader import make_reader

from sumo_dist.export.mcap_file import write_mcap
from sumo_dist.export.schemas import TOPICS
from sumo_dist.export.shapes import entities
from sumo_dist.record.world import World


@pytest.fixture(scope="module")
def messages(short_run, tmp_path_factory):
    """Topic, schema's name, time [s] and content of all messages."""
    path = tmp_path_factory.mktemp("mcap") / "run.mcap"
    said = {"tick": 3, "number": 0, "sender": "ann", "verb": "weight", "name": "goal", "value": "5"}
    write_mcap(replace(short_run, operator=[said]), path)
    with path.open("rb") as file:
        return [
            (channel.topic, schema.name, message.log_time * 1e-9, json.loads(message.data))
            for schema, channel, message in make_reader(file).iter_messages()
        ]


def fits(value, schema):
    """Whether a value has what a JSON schema says, and nothing that it does not name."""
    kinds = {"object": dict, "array": list, "string": str, "integer": int, "boolean": bool}
    kinds |= {"number": (int, float), "null": type(None)}
    wanted = schema["type"] if isinstance(schema["type"], list) else [schema["type"]]
    assert any(isinstance(value, kinds[kind]) for kind in wanted), (value, schema)
    if isinstance(value, list):
        for item in value:
            fits(item, schema["items"])
    if isinstance(value, dict):
        named, others = schema.get("properties", {}), schema.get("additionalProperties")
        assert others or set(value) == set(named), (set(value), set(named))
        for key, item in value.items():
            fits(item, named.get(key, others))


def test_every_message_is_what_its_schema_says(messages):
    for topic, name, _, content in messages:
        assert TOPICS[topic][0] == name
        fits(content, TOPICS[topic][1])


def test_topics_have_a_message_a_tick_or_a_plan_in_the_order_of_time(messages):
    counts = Counter(topic for topic, *_ in messages)
    assert counts == {"/tf": 26, "/joints": 26, "/plan": 10, "/goal": 10, "/scene": 1, "/events": 2}
    times = [time for _, _, time, _ in messages]
    assert times == sorted(times)
    assert times[-1] == pytest.approx(0.5)


def test_frames_are_where_mujoco_puts_the_bodies(messages, short_run):
    model = World.of(short_run).model
    data = mujoco.MjData(model)
    content = [content for topic, _, _, content in messages if topic == "/tf"][12]
    data.qpos[:] = short_run.states[12][: model.nq]
    mujoco.mj_kinematics(model, data)
    assert len(content["transforms"]) == model.nbody - 1
    for transform in content["transforms"]:
        body = data.body(transform["child_frame_id"])
        assert np.allclose([transform["translation"][axis] for axis in "xyz"], body.xpos, atol=1e-6)
        assert np.allclose([transform["rotation"][axis] for axis in "wxyz"], body.xquat, atol=1e-6)
        assert transform["timestamp"] == {"sec": 0, "nsec": 240_000_000}


def test_plans_joints_and_events_hold_the_recorded_numbers(messages, short_run):
    plans = [content for topic, _, _, content in messages if topic == "/plan"]
    assert [plan["terms"]["gripper"] for plan in plans] == np.array(short_run.terms)[:, 1].tolist()
    assert plans[3]["best"] == np.array(short_run.costs)[3].min()
    joints = [content["joints"] for topic, _, _, content in messages if topic == "/joints"]
    assert joints[4]["fl_hx"]["target"] == short_run.targets[4][0]
    assert joints[25]["fl_hx"]["target"] is None
    events = [(time, said["message"]) for topic, _, time, said in messages if topic == "/events"]
    assert events[0] == (pytest.approx(0.06), "weight goal=5 by ann")
    assert events[1][1] == "the run has ended: timeout"


XML = """<mujoco>
<asset><mesh name="m" vertex="0 0 0 1 0 0 0 1 0 0 0 1"/>
  <hfield name="h" nrow="9" ncol="5" size="2 1 0.3 0.1"/></asset>
<worldbody><geom type="plane" size="0 0 1"/><geom type="hfield" hfield="h"/>
<body name="a"><freejoint/><geom type="capsule" size="0.1 0.2"/><geom type="mesh" mesh="m"/>
  <geom type="ellipsoid" size="0.1 0.2 0.3"/><geom type="cylinder" size="0.1 0.2"/>
  <geom type="box" size="1 1 1" group="3"/></body>
<body name="b"><freejoint/><geom type="box" size="1 2 3" group="3"/></body>
</worldbody></mujoco>"""


def test_every_kind_of_shape_is_in_the_frame_of_its_body():
    """Of a thing that has nothing else to see, the shapes of collision."""
    found = {each["id"]: each for each in entities(mujoco.MjModel.from_xml_string(XML))}
    kinds = ("cubes", "spheres", "cylinders", "triangles")
    counts = {name: [len(each[kind]) for kind in kinds] for name, each in found.items()}
    assert counts == {"world": [1, 0, 0, 1], "a": [0, 3, 2, 1], "b": [1, 0, 0, 0]}
    assert found["b"]["cubes"][0]["size"] == {"x": 2, "y": 4, "z": 6}
    (mesh,), (field,) = found["a"]["triangles"], found["world"]["triangles"]
    assert (len(mesh["points"]), len(mesh["indices"])) == (4, 12)
    assert (len(field["points"]), len(field["indices"])) == (45, 8 * 4 * 6)
    for each in found.values():
        fits(each, TOPICS["/scene"][1]["properties"]["entities"]["items"])
