import json
import logging
import os
import subprocess
import sys

from sumo_dist.launch.logs import JsonLines


def test_a_record_is_one_object_on_one_line():
    try:
        raise ValueError("two\nlines")
    except ValueError:
        record = logging.LogRecord(
            *("sumo_dist.robot", logging.WARNING, "f.py", 3, "tick %d\nlate", (7,)), sys.exc_info()
        )
    line = JsonLines().format(record)
    assert "\n" not in line
    said = json.loads(line)
    assert (said["source"], said["level"], said["text"]) == ("robot", "warning", "tick 7\nlate")
    assert said["pid"] == os.getpid()
    assert "ValueError: two" in said["exception"]


def service(form, endpoint):
    command = [sys.executable, "-m", "sumo_dist", "router", "--listen", endpoint]
    env = {**os.environ, "SUMO_DIST_LOG": form}
    return subprocess.Popen(command, stderr=subprocess.PIPE, text=True, env=env)


def test_services_log_as_the_environment_says(endpoint):
    router = service("json", endpoint)
    assert router.stderr is not None
    said = json.loads(router.stderr.readline())
    router.terminate()
    router.communicate(timeout=20)
    assert said["text"] == f"router listening on {endpoint}"


def test_an_unknown_form_names_the_valid_ones(endpoint):
    router = service("xml", endpoint)
    _, err = router.communicate(timeout=20)
    assert router.returncode == 2
    assert err == "sumo-dist: unknown SUMO_DIST_LOG 'xml'; valid: json, text\n"
