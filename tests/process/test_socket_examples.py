"""Each program in examples/ runs against a daemon without a vehicle."""

import csv
import json
import os
import shutil
import socket
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PATIENCE_S = 120.0
sys.path.append(str(ROOT / "tests" / "unit" / "goals"))

from fake_flight import serving_in_thread  # noqa: E402


def start(path, name, *arguments):
    command = (
        [sys.executable, str(ROOT / "examples" / name)] if name.endswith(".py") else [str(ROOT / "examples" / name)]
    )
    environment = os.environ | {"FLIGHTD_SOCKET": str(path), "PYTHONPATH": str(ROOT)}
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    return subprocess.Popen([*command, *map(str, arguments)], env=environment, **pipes)


def finish(process):
    try:
        out, err = process.communicate(timeout=PATIENCE_S)
    finally:
        process.kill()
    assert process.returncode == 0, err
    return out


@pytest.fixture
def path(tmp_path):
    return tmp_path / "s"


def submitted(daemon):
    return [params for name, params in daemon.calls if name == "submit"]


def test_survey_grid_flies_its_lanes_to_and_fro(path):
    with serving_in_thread(path, auto="succeeded") as daemon:
        assert "succeeded" in finish(start(path, "survey_grid.py", 10, 4, 2, 5))
        positions = [waypoint.position for waypoint in submitted(daemon)[0].path.waypoints]
    assert positions == [(0, 0, -5), (10, 0, -5), (10, 2, -5), (0, 2, -5), (0, 4, -5), (10, 4, -5)]


def test_follow_target_moves_its_goal_and_cancels_it(path):
    with serving_in_thread(path) as daemon:
        assert "canceled" in finish(start(path, "follow_target.py", 2))
        assert len(submitted(daemon)) == 1
        assert len([name for name, _ in daemon.calls if name == "update"]) >= 2


def test_inspect_point_looks_at_it_from_four_sides(path):
    with serving_in_thread(path, auto="succeeded") as daemon:
        finish(start(path, "inspect_point.py", 10, 0, -5, 4))
        looks = [(goal.waypoint.position, goal.waypoint.yaw_deg) for goal in submitted(daemon)]
    assert looks == [((14, 0, -5), 180), ((10, 4, -5), -90), ((6, 0, -5), 0), ((10, -4, -5), 90)]


def test_circle_and_lemniscate(path):
    with serving_in_thread(path, auto="succeeded") as daemon:
        finish(start(path, "circle_and_lemniscate.py", 7))
        assert [goal.trajectory.kind for goal in submitted(daemon)] == ["circle", "lemniscate"]


def test_log_telemetry_writes_rows(path, tmp_path):
    state = {"time_s": 1.5, "position_ned_m": [1.0, 2.0, -3.0]}

    def publish():
        daemon.hub.publish("reference", {"position_ned_m": [1.0, 2.5, -3.0]})
        daemon.hub.publish("state", state)
        daemon.loop.call_later(0.01, publish)

    with serving_in_thread(path) as daemon:
        daemon.loop.call_soon_threadsafe(publish)
        finish(start(path, "log_telemetry.py", tmp_path / "log.csv", 3))
    rows = list(csv.DictReader((tmp_path / "log.csv").open()))
    assert len(rows) == 3
    assert (rows[-1]["east_m"], rows[-1]["reference_east_m"]) == ("2.0", "2.5")


def test_mocap_bridge_feeds_the_estimator(path):
    poses = []
    with serving_in_thread(path) as daemon:
        daemon.estimator_pose = lambda params, caller: poses.append(params)
        process = start(path, "mocap_bridge.py", 0, 1)
        port = int(process.stdout.readline().split()[-1])
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
            message = {"position": [1, 2, -3], "orientation": [1, 0, 0, 0]}
            sender.sendto(json.dumps(message).encode(), ("127.0.0.1", port))
        finish(process)
    assert poses[0].position == (1, 2, -3)
    assert len(poses[0].covariance) == 6 and poses[0].stamp_s > 0


@pytest.mark.parametrize("name", ["inspect_point.py", "log_telemetry.py", "mocap_bridge.py", "goto.sh"])
def test_without_its_arguments_an_example_says_which_it_takes(path, name):
    process = start(path, name)
    _, err = process.communicate(timeout=PATIENCE_S)
    assert process.returncode != 0
    assert err.startswith(f"usage: {name} ") and err.count("\n") == 1


@pytest.mark.skipif(shutil.which("socat") is None, reason="needs socat")
def test_shell_script_flies_and_prints_the_result(path):
    with serving_in_thread(path, auto="succeeded") as daemon:
        out = finish(start(path, "goto.sh", 10, 0, -5))
        assert submitted(daemon)[0].waypoint.position == (10, 0, -5)
    assert json.loads(out)["params"]["outcome"] == "succeeded"


@pytest.mark.skipif(shutil.which("socat") is None, reason="needs socat")
def test_shell_script_says_by_its_exit_code_that_nothing_flew(path):
    assert start(path, "goto.sh", 10, 0, -5).wait(PATIENCE_S) == 5  # no daemon
    with serving_in_thread(path, auto="aborted"):
        assert start(path, "goto.sh", 10, 0, -5).wait(PATIENCE_S) == 1
        assert start(path, "goto.sh", "x", 0, -5).wait(PATIENCE_S) == 2
