import json
import subprocess
import sys
from importlib.metadata import version
from pathlib import Path

import pytest
from fake_flight import serving_in_thread
from typer.testing import CliRunner

from daemon.cli import demo, demo_flight, doctor
from daemon.cli.commands import COMMANDS, build
from daemon.cli.common import ANSWER_EXITS, GOAL_EXITS, REQUEST_EXITS
from daemon.cli.settings import parse_value
from daemon.cli.watch import Picture, rows
from daemon.goals.client_errors import NoDaemonError
from daemon.goals.listeners import Telemetry


def test_path_takes_threes_of_numbers(flightd, path):
    with serving_in_thread(path, auto="succeeded") as daemon:
        done = flightd("path", 0, 0, -5, 10, -2.5, "-5", "--through", "fly_by", "--yaw", "-45", "--max-speed", 2)
        assert done.returncode == 0, done.err
        submitted = daemon.calls[0][1]
    assert [point.position for point in submitted.path.waypoints] == [(0, 0, -5), (10, -2.5, -5)]
    assert (submitted.path.through, submitted.path.waypoints[1].yaw_deg) == ("fly_by", -45.0)
    assert submitted.limits.speed_m_s == 2.0


def test_path_with_a_number_too_few_is_refused(flightd):
    done = flightd("path", 0, 0, -5, 10)
    assert done.returncode == 2
    assert "multiple of three" in done.err


def test_fly_submits_the_shape(flightd, path):
    with serving_in_thread(path, auto="succeeded") as daemon:
        turn = ("--radius", 3, "--speed", 2, "--direction", "ccw", "--heading", "target")
        assert flightd("fly", "circle", 0, "-1", -5, *turn).returncode == 0
        assert flightd("fly", "lemniscate", 0, 0, -5, "--length", 8, "--width", 4, "--turns", 2).returncode == 0
        assert flightd("fly", "hold", 3).returncode == 0
        circle, eight, hold = (call[1].trajectory for call in daemon.calls)
    assert (circle.center, circle.radius_m, circle.speed_m_s, circle.direction) == ((0, -1, -5), 3, 2, "ccw")
    assert circle.heading == "target"
    assert (eight.size_m, eight.turns) == ((8, 4), 2)
    assert hold.duration_s == 3


def test_config_shows_and_changes_within_the_range(flightd, path):
    with serving_in_thread(path):
        shown = flightd("config", "get", "guidance.limits.speed_m_s").out
        assert shown == "guidance.limits.speed_m_s = 5.0 m/s (0.1 to 25 m/s)\n"
        assert json.loads(flightd("config", "set", "guidance.limits.speed_m_s", "3.5", "--json").out)["value"] == 3.5
        refused = flightd("config", "set", "guidance.limits.speed_m_s", "-3")
    assert refused.returncode == 2
    assert "value: -3 is not within 0.1 to 25 m/s" in refused.err


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("3", 3),
        ("-3.5", -3.5),
        ("true", True),
        ("[1, 2]", [1, 2]),
        ("fly_by", "fly_by"),
        ("null", "null"),
        ("{}", "{}"),
    ],
)
def test_words_of_the_command_line_become_values(text, value):
    assert parse_value(text) == value


def test_watch_prints_events_as_lines_when_nobody_looks(flightd, path):
    with serving_in_thread(path) as daemon:
        process = flightd.start("watch", "--json")
        daemon.wait_until(lambda: daemon.hub._gates["events"])
        daemon.loop.call_soon_threadsafe(daemon.hub.event, "reset", "the heading was reset")
        line = json.loads(process.stdout.readline())
        assert (line["topic"], line["code"]) == ("events", "reset")
        process.terminate()
        _, err = process.communicate(timeout=120)
    assert (process.returncode, err) == (0, "")


def test_live_view_shows_error_goal_and_events():
    picture = Picture()
    vector = {"position_ned_m": [1.0, 2.0, -3.0], "velocity_ned_m_s": [0.0, 0.0, 0.0]}
    feedback = {"goal_id": "g-1", "distance_m": 4.0, "angle_deg": 1.0, "progress": 0.5, "eta_s": 3.0}
    event = {"time_s": 1.0, "code": "reset", "text": "the heading was reset", "goal_id": None, "field": None}
    event |= {"reset": None}
    picture.take(Telemetry("state", vector | {"age_s": 0.004}))
    picture.take(Telemetry("reference", vector | {"position_ned_m": [1.0, 2.5, -3.0]}))
    picture.take(Telemetry("goal", feedback | {"notification": "goal.feedback"}))
    picture.take(Telemetry("events", event))
    shown = dict(rows(picture))
    assert "E    -0.50" in shown["error"]
    assert shown["goal"] == "g-1: 50%, 4.0 m, 3 s to go"
    assert "heading was reset" in shown["events"]
    ended = {"goal_id": "g-1", "outcome": "aborted", "reason": "timeout", "notification": "goal.result"}
    picture.take(Telemetry("goal", ended))
    assert "goal" not in dict(rows(picture))
    assert picture.recent[-1] == "g-1 aborted: it took longer than its time limit (timeout)"


def test_doctor_names_what_is_wrong_and_how_to_mend_it(tmp_path, monkeypatch):
    config = tmp_path / "c.yaml"
    config.write_text("link:\n  connection: serial:///dev/nowhere:921600\n")
    found = doctor.check_connection([config], doctor.Asked())
    assert (found.level, found.text) == ("bad", f"there is no /dev/nowhere (of {config})") and found.mend
    config.write_text("link:\n  connexion: 3\n")
    assert doctor.check_connection([config], doctor.Asked()).level == "bad"
    monkeypatch.setattr(doctor, "version", lambda name: "4.1.0")
    monkeypatch.setattr(sys, "executable", "/bin/false")
    assert doctor.check_mavsdk().level == "bad"


def test_doctor_without_a_daemon_warns_and_with_one_asks_it(flightd, path, monkeypatch):
    alone = flightd("doctor", "--json")
    findings = json.loads(alone.out)
    assert alone.returncode == int(any(finding["level"] == "bad" for finding in findings)), findings
    assert {"level": "warning", "name": "daemon"}.items() <= findings[-1].items()
    monkeypatch.setattr(doctor, "ANSWER_TIMEOUT_S", 0.01)
    with serving_in_thread(path):
        found = {finding.name: finding.level for finding in doctor.check_daemon(doctor.ask_daemon(path))}
    assert found == {"daemon": "good", "autopilot": "bad"}


def _serial(device="/dev/ttyS0", **more):
    return doctor.check_connection([], doctor.Asked(connection=f"serial://{device}:57600", **more))


def test_doctor_judges_the_port_of_the_daemon_and_not_the_rights_of_whoever_asks(monkeypatch):
    monkeypatch.setattr("os.access", lambda *_args: False)
    monkeypatch.setattr(Path, "exists", lambda _path: True)
    monkeypatch.setattr(Path, "group", lambda _path: "dialout")
    heard = {"autopilot": {"connected": True}}
    assert _serial(health=heard).level == "good"
    assert "of the running daemon" in _serial(health=heard).text
    assert _serial().level == "good"  # the daemon's rights are not this user's
    alone = _serial(silence=NoDaemonError("none"))
    assert (alone.level, "usermod -aG dialout" in alone.mend) == ("bad", True)


def test_doctor_judges_this_users_real_time_rights_only_where_no_daemon_answers(monkeypatch):
    monkeypatch.setattr("os.geteuid", lambda: 1000)
    monkeypatch.setattr("resource.getrlimit", lambda _which: (0, 0))
    (alone,) = doctor.check_realtime(doctor.Asked(silence=NoDaemonError("none")))
    assert alone.level == "warning"
    info = {"name": "flightd", "version": "1", "protocol": 1}
    assert list(doctor.check_realtime(doctor.Asked(info=info))) == []


def test_doctor_knows_what_is_no_serial_port():
    assert (_serial("/dev/null").level, "is no serial port" in _serial("/dev/null").text) == ("bad", True)


@pytest.mark.parametrize(
    ("connection", "words"), [("serial:///dev/ttyS0:57600", "baud rate"), ("udpin://0.0.0.0:14540", "simulation")]
)
def test_doctor_says_where_to_look_for_an_autopilot_by_the_kind_of_the_connection(connection, words):
    health = {"autopilot": {"connected": False}}
    info = {"name": "flightd", "version": "1", "protocol": 1}
    asked = doctor.Asked(info=info, connection=connection, health=health)
    mends = [finding.mend for finding in doctor.check_daemon(asked) if finding.name == "autopilot"]
    assert [word for word in ("baud rate", "simulation") if word in mends[0]] == [words]


def test_doctor_names_a_parameter_once():
    reasons = [{"code": "taken_off", "text": "it has"}, {"code": "COM_X", "text": "COM_X is 1: set 3"}]
    health = {"autopilot": {"connected": True, "mode": "hold"}, "reasons": reasons}
    info = {"name": "flightd", "version": "1", "protocol": 1}
    found = {finding.name: finding.text for finding in doctor.check_daemon(doctor.Asked(info=info, health=health))}
    assert found["COM_X"] == "is 1: set 3"


def test_each_command_is_in_the_module_that_the_table_names():
    for command in COMMANDS:
        app = build(command)
        names = {info.name or info.callback.__name__ for info in app.registered_commands}
        names |= {group.name for group in app.registered_groups}
        assert command in {name.replace("_", "-").rstrip("-") for name in names}, command


def test_clients_start_without_what_only_the_daemon_needs():
    """`flightd status` must start fast: the client needs none of these."""
    script = "import sys, daemon.cli.vehicle; print({'numpy', 'structlog', 'yaml', 'rich'} & sys.modules.keys())"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True, timeout=120)
    assert done.stdout.strip() == "set()"


def test_shell_completion_is_offered():
    """For the shell that it is called from: the tests may have been started from none."""
    code = f"{sys.executable} -m daemon.cli.main --show-completion; exit"
    shown = subprocess.run(["bash", "-c", code], capture_output=True, text=True, check=True)
    assert "_FLIGHTD_COMPLETE" in shown.stdout


@pytest.mark.parametrize("command", [None, *COMMANDS])
def test_every_help_page_opens(command):
    shown = CliRunner().invoke(build(command), [command, "--help"] if command else ["--help"], prog_name="flightd")
    assert shown.exit_code == 0
    assert f"Usage: flightd {command or '[OPTIONS]'}" in shown.output


@pytest.mark.parametrize(
    "command",
    [["goto"], ["path"], ["cancel"], ["takeoff"], ["fly", "circle"], ["config", "set"], ["replay"], ["report"]],
)
def test_a_help_page_shows_names_and_no_types_of_python(command):
    shown = CliRunner().invoke(build(command[0]), [*command, "--help"], prog_name="flightd")
    names = [line.split("  ")[1] for line in shown.output.splitlines() if line.startswith("  ") and line[2] != " "]
    assert any(name.startswith("--json") for name in names)
    assert not [name for name in names if "<" in name]


@pytest.mark.parametrize("command", ["status", "takeoff", "doctor"])
def test_a_socket_that_does_not_let_the_user_in_says_what_to_do(command, path, monkeypatch):
    def refuse(*_args, **_more):
        raise PermissionError

    path.touch()
    monkeypatch.setattr("os.access", lambda *_args, **_more: False)  # root may read all
    monkeypatch.setattr("asyncio.open_unix_connection", refuse)
    words = ["5"] if command == "takeoff" else []
    done = CliRunner().invoke(build(command), [command, *words, "--socket", str(path)])
    assert "does not let this user in: ask for membership in its group (and log in again)" in done.output
    assert command == "doctor" or done.exit_code == 6


def test_the_version_is_told():
    done = CliRunner().invoke(build(None), ["--version"])
    assert (done.exit_code, done.output) == (0, f"flightd {version('flightd')}\n")


@pytest.mark.parametrize(
    "arguments", [["sim"], ["report", "FLIGHT.mcap"], ["bench", "loop"], ["demo"], ["tune", "--simulate"]]
)
def test_a_command_without_its_extra_says_what_to_install(arguments):
    packages = {"report": "matplotlib", "demo": "matplotlib"}
    code = f"""
import sys
sys.modules["pymavlink"] = sys.modules["matplotlib"] = None  # as if they were not installed
sys.argv = {["flightd", *arguments]}
from daemon.cli.main import main
main()
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 2
    assert done.stderr.startswith(f"this needs {packages.get(arguments[0], 'pymavlink')}")
    assert "pip install" in done.stderr
    assert "Traceback" not in done.stderr


@pytest.mark.parametrize(
    ("command", "codes"),
    [
        (["goto"], GOAL_EXITS),
        (["takeoff"], REQUEST_EXITS),
        (["status"], ANSWER_EXITS),
        (["doctor"], "0 nothing is bad, 1 something is bad"),
        (["run"], "0 stopped, 1 failed, 2 the configuration is bad, 3 another daemon has the socket or the connection"),
        (["protocol"], None),
    ],
)
def test_a_help_page_lists_the_exit_codes_that_its_command_has(command, codes):
    said = " ".join(CliRunner().invoke(build(command[0]), [*command, "--help"]).output.split())
    assert (f"Exit codes: {codes}." in said) if codes else ("Exit codes" not in said)


@pytest.mark.parametrize(
    ("command", "usage"),
    [
        (["goto"], "goto [OPTIONS] N E D\n"),
        (["path"], "path [OPTIONS] N E D...\n"),
        (["check-config"], "check-config [OPTIONS] [FILE...]\n"),
        (["config", "get"], "config get [OPTIONS] PATH\n"),
        (["replay"], "replay [OPTIONS] FLIGHT.mcap...\n"),
    ],
)
def test_a_usage_line_shows_arguments_as_people_type_them(command, usage):
    assert usage in CliRunner().invoke(build(command[0]), [*command, "--help"]).output


def test_the_commands_of_bench_are_told_whole():
    assert "..." not in CliRunner().invoke(build("bench"), ["bench", "--help"]).output.partition("Commands")[2]


def test_what_is_refused_is_shown_as_it_was_typed(flightd):
    said = flightd("goto", 1, 0, -5, "--frame", "-5").err
    assert "'-5' is not one of" in said and "\N{MINUS SIGN}" not in said


def test_replay_of_something_else_says_so(flightd, tmp_path):
    file = tmp_path / "notes.mcap"
    file.write_text("these are notes\n")
    done = flightd("replay", file)
    assert (done.returncode, done.err) == (2, f"{file}: is not a flight record\n")


@pytest.mark.parametrize(
    "command",
    [
        ["demo"],
        ["tune", "--simulate"],
        ["bench", "track"],
        ["bench", "resets"],
        ["report", "RECORD"],
    ],
)
def test_a_folder_that_nothing_can_be_written_into_is_refused_before_anything_flies(flightd, tmp_path, command):
    file = tmp_path / "file"
    file.touch()
    record = Path(__file__).parents[2] / "replay" / "simulated_goals.mcap"
    done = flightd(*[record if word == "RECORD" else word for word in command], "--out", file / "folder")
    assert (done.returncode, done.out) == (2, "")
    assert done.err.startswith(f"cannot write into {file}")
    assert len(done.err.splitlines()) == 1


@pytest.mark.parametrize("place", ["file/sim.sock", f"{'long' * 30}.sock"])
def test_a_control_socket_that_cannot_be_is_refused_in_one_line(flightd, tmp_path, place):
    (tmp_path / "file").touch()
    done = flightd("sim", "--port", 25312, "--control", tmp_path / place)
    assert done.returncode == 2
    assert done.err.startswith(f"--control {tmp_path / place}: ") and len(done.err.splitlines()) == 1


def test_the_demo_shows_no_error_of_a_goal_that_was_left_on_the_way(capsys):
    demo._show([demo_flight.Row("goal", "preempted", "preempted", 1.0, 6.87, 12.0, 0.1, 10.0)])
    assert "6.87" not in capsys.readouterr().out
