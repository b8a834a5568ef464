"""A daemon that is there and does not answer; a second Ctrl-C; what comes with a refusal."""

import signal
import socket

import pytest
from fake_flight import serving_in_thread

from daemon.goals.errors import ErrorCode, ProtocolError


@pytest.fixture
def silent(path):
    """A socket that takes connections and never answers, as of a process that was stopped."""
    with socket.socket(socket.AF_UNIX) as listening:
        listening.bind(str(path))
        listening.listen()
        yield


@pytest.mark.parametrize("command", [["status"], ["config", "get", "guidance.limits.speed_m_s"], ["doctor"]])
def test_a_question_to_a_daemon_that_does_not_answer_ends(flightd, silent, command):
    done = flightd(*command)
    assert done.returncode == (1 if command == ["doctor"] else 5)
    assert "does not answer" in done.out + done.err


@pytest.mark.parametrize("command", [["land"], ["goto", 1, 0, -5], ["watch"]])
def test_whoever_waits_for_a_daemon_that_does_not_answer_is_told(flightd, silent, command):
    process = flightd.start(*command)
    assert "the daemon does not answer yet" in process.stderr.readline()
    process.send_signal(signal.SIGINT)
    if command[0] == "goto":  # the first asks to cancel what may have been accepted
        assert "canceling" in process.stderr.readline()
        process.send_signal(signal.SIGINT)
    _, err = process.communicate(timeout=120)
    assert process.returncode == (0 if command == ["watch"] else 130)
    assert "what was asked for goes on" in err or command == ["watch"]


def test_a_second_interrupt_says_that_the_cancel_was_sent(flightd, path):
    with serving_in_thread(path) as daemon:
        asked = []
        daemon.goal_cancel = lambda params, caller: _never(params, asked)
        process = flightd.start("goto", 1, 0, -5)
        daemon.wait_until(lambda: daemon.active is not None)
        process.send_signal(signal.SIGINT)
        daemon.wait_until(lambda: asked)
        process.send_signal(signal.SIGINT)
        _, err = process.communicate(timeout=120)
    assert process.returncode == 130
    assert "the cancel was sent" in err and "goes on" not in err


async def _never(params, asked):
    asked.append(params)
    return {"goal_id": params.goal_id}


def _refusing(code, reason, field=None):
    async def refuse(*_args, **_more):
        raise ProtocolError(code, reason, field)

    return refuse


def test_advice_is_for_those_who_want_to_fly(flightd, path):
    with serving_in_thread(path) as daemon:
        daemon.config_set = _refusing(ErrorCode.REFUSED, "goals.engage_on_submit cannot be changed", "path")
        setting = flightd("config", "set", "goals.engage_on_submit", "true")
        daemon.vehicle_disarm = _refusing(ErrorCode.WRONG_STATE, "the vehicle is not landed; land it first")
        disarmed = flightd("disarm")
        daemon.vehicle_engage = _refusing(ErrorCode.WRONG_STATE, "cannot engage: landed state is landing")
        engaged = flightd("engage")
        daemon.state = "disconnected"
        daemon.vehicle_arm = _refusing(ErrorCode.WRONG_STATE, "no autopilot is connected")
        armed = flightd("arm")
    assert setting.err == "path: goals.engage_on_submit cannot be changed\n"
    assert disarmed.err == "the vehicle is not landed; land it first\n"
    assert engaged.err.splitlines()[1].startswith("to be taken the vehicle has to be in the air and in Hold")
    assert (
        armed.err
        == "no autopilot is connected\ncheck the cable, or that the simulator runs; `flightd doctor` tells more\n"
    )
    assert {done.returncode for done in (setting, disarmed, engaged, armed)} == {2}


def test_preempted_is_what_a_newer_request_overtook_and_nothing_that_is_called_so(flightd, path):
    with serving_in_thread(path) as daemon:
        assert flightd("cancel", "superseded").returncode == 2
        daemon.vehicle_land = _refusing(ErrorCode.WRONG_STATE, "superseded by a newer vehicle request")
        assert flightd("land").returncode == 3


@pytest.mark.parametrize(
    ("reason", "words"),
    [
        ("engage_refused", "the autopilot did not go to offboard within 2 s (engage_refused)"),
        ("stopping", "the daemon was told to stop (stopping)"),
        ("the daemon was restarted", ": the daemon was restarted\n"),
    ],
)
def test_a_goal_that_was_aborted_says_why_in_words(flightd, path, reason, words):
    with serving_in_thread(path) as daemon:
        process = flightd.start("goto", 1, 0, -5)
        daemon.wait_until(lambda: daemon.active is not None)
        daemon.loop.call_soon_threadsafe(daemon.end, daemon.active, "aborted", None, reason)
        out, _ = process.communicate(timeout=120)
    assert words in out and "`flightd status` tells" in out
