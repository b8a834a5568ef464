import json
import signal

import pytest
from fake_flight import serving_in_thread

from daemon.config import load


def test_goto_takes_negative_numbers_and_waits_for_the_result(flightd, path):
    with serving_in_thread(path, auto="succeeded") as daemon:
        done = flightd("goto", "10", "0", "-5", "--yaw", "-90", "--frame", "local_enu", "--mode", "only_position")
        assert done.returncode == 0, done.err
        waypoint = daemon.calls[0][1].waypoint
    assert waypoint.position == (10.0, 0.0, -5.0)
    assert (waypoint.yaw_deg, waypoint.frame, waypoint.mode) == (-90.0, "local_enu", "only_position")
    assert "succeeded after 4.2 s, 0.12 m" in done.out
    assert "\x1b" not in done.out + done.err


def test_goto_json_is_one_object(flightd, path):
    with serving_in_thread(path, auto="succeeded"):
        done = flightd("goto", "10", "0", "-.5", "--json")
    assert done.returncode == 0
    assert json.loads(done.out)["outcome"] == "succeeded"


def test_goto_aborted_is_1(flightd, path):
    with serving_in_thread(path, auto="aborted"):
        done = flightd("goto", "10", "0", "-5")
    assert done.returncode == 1
    assert "timeout" in done.out


def test_goto_refused_is_2_with_the_field_and_the_reason(flightd, path):
    with serving_in_thread(path):
        done = flightd("goto", "0", "0", "-250")
        as_json = flightd("goto", "0", "0", "-250", "--json")
    assert done.returncode == 2
    assert "waypoint.position[2]: a height of 250 m is above the fence's ceiling of 120 m" in done.err
    assert json.loads(as_json.out)["error"]["field"] == "waypoint.position[2]"


def test_goto_preempted_is_3(flightd, path):
    with serving_in_thread(path) as daemon:
        first = flightd.start("goto", "1", "0", "-5")
        daemon.wait_until(lambda: daemon.active is not None)
        second = flightd.start("goto", "2", "0", "-5")
        out, _ = first.communicate(timeout=120)
        assert first.returncode == 3
        assert daemon.active in out
        second.send_signal(signal.SIGINT)
        second.communicate(timeout=120)


def test_interrupt_cancels_the_goal_and_is_4(flightd, path):
    with serving_in_thread(path) as daemon:
        process = flightd.start("goto", "1", "0", "-5")
        daemon.wait_until(lambda: daemon.active is not None)
        process.send_signal(signal.SIGINT)
        out, err = process.communicate(timeout=120)
        assert [record["outcome"] for record in daemon.records.values()] == ["canceled"]
    assert process.returncode == 4
    assert "canceled" in out and "canceling" in err


def test_no_daemon_is_5_and_says_what_to_do(flightd):
    done = flightd("status")
    assert done.returncode == 5
    assert "flightd run" in done.err


def test_observer_is_6(flightd, path):
    with serving_in_thread(path, observers=True):
        assert flightd("status").returncode == 0
        done = flightd("land")
    assert done.returncode == 6
    assert "operators" in done.err


def test_a_word_for_a_number_is_refused_before_asking_the_daemon(flightd):
    done = flightd("goto", "1", "two", "-5")
    assert done.returncode == 2
    assert "'two' is not a number" in done.err


@pytest.mark.parametrize("word", ["nan", "inf", "1e999"])
def test_a_number_that_is_not_finite_is_refused_before_asking_the_daemon(flightd, word):
    done = flightd("goto", "1", "0", word)
    assert done.returncode == 2
    assert "is not a finite number" in done.err


def test_unknown_option_is_not_taken_for_a_number(flightd):
    done = flightd("goto", "1", "2", "-5", "--yawn", "3")
    assert done.returncode == 2
    assert "--yawn" in done.err


@pytest.mark.parametrize("name", ["arm", "disarm", "engage", "hold", "land", "return"])
def test_vehicle_commands_ask_for_what_they_are_called(flightd, path, name):
    with serving_in_thread(path) as daemon:
        done = flightd(name, "--json")
        assert [call[0] for call in daemon.calls] == [name]
    assert done.returncode == 0, done.err
    assert json.loads(done.out)["mode"] == {"engage": "offboard", "land": "land", "return": "return"}.get(name, "hold")


def test_takeoff_and_status_in_words(flightd, path):
    with serving_in_thread(path) as daemon:
        assert flightd("takeoff", "5").out == "ready: mode hold, armed, in_air\n"
        assert daemon.calls[0][1].altitude_m == 5.0
        shown = flightd("status").out
    assert "ready" in shown and "battery 87 %" in shown and "N 1.00  E 2.00  D -3.00 m" in shown


def test_wrong_state_tells_the_next_step(flightd, path):
    with serving_in_thread(path) as daemon:
        daemon.state = "standby"
        done = flightd("engage")
    assert done.returncode == 2
    assert "flightd takeoff" in done.err


def test_cancel_names_the_goal(flightd, path):
    with serving_in_thread(path) as daemon:
        process = flightd.start("goto", "1", "0", "-5")
        daemon.wait_until(lambda: daemon.active is not None)
        goal_id = daemon.active
        assert goal_id in flightd("cancel").out
        process.communicate(timeout=120)
        assert process.returncode == 4


@pytest.mark.parametrize("name", ["goto", "takeoff", "status", "cancel", "land"])
def test_help_shows_an_example_and_the_exit_codes(flightd, name):
    shown = flightd(name, "--help").out
    assert f"flightd {name}" in shown
    assert "5 no daemon" in " ".join(shown.split())


def test_a_word_that_is_not_one_of_the_choices_is_refused_in_words_of_the_command_line(flightd):
    done = flightd("goto", 1, 0, -5, "--mode", "foo")
    assert done.returncode == 2
    assert "Invalid value for '--mode': 'foo' is not one of 'full_pose'" in " ".join(done.err.split())


def test_run_refuses_a_connection_that_is_none(flightd):
    done = flightd("run", "--connection", "foo://bar")
    assert done.returncode == 2
    assert "link.connection: 'foo://bar' is no connection" in done.err


def test_the_help_of_a_circle_says_from_where_its_sense_is_seen(flightd):
    said = " ".join(flightd("fly", "circle", "--help").out.split())
    assert "seen along the axis: from above, but from below in local_enu" in said


def test_check_config_answers_in_plain_lines(flightd, tmp_path):
    file = tmp_path / "own.yaml"
    file.write_text("guidance: 5\nfoo: 1\n")
    done = flightd("check-config", file)
    assert (done.returncode, done.out) == (2, "")
    assert done.err == "guidance: must be a section of keys, not 5\nfoo: there is no such key\n"
    told = json.loads(flightd("check-config", file, "--json").out)
    assert told["error"]["faults"] == done.err.splitlines()
    assert json.loads(flightd("check-config", "--json").out) == {"hash": load([]).hash()}
    file.write_text("d: 2026-13-45\n")
    assert flightd("check-config", file).err == f"{file}: not YAML: month must be in 1..12\n"
    assert flightd("check-config").out.startswith("configuration is good (hash ")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--connection", "foo"], "link.connection: 'foo' is no connection"),
        (["--simulate", "--airframe", "nope"], "airframe nope: no such airframe; known: sih, x500"),
    ],
)
def test_tune_refuses_what_it_cannot_fly_before_it_starts(flightd, arguments, words):
    done = flightd("tune", *arguments)
    assert done.returncode == 2
    assert words in done.err


def test_a_scenario_for_a_vehicle_that_is_not_there_says_where(flightd, tmp_path):
    file = tmp_path / "bad_day.yaml"
    file.write_text("- {fault: gps_loss, duration_s: 1}\n- {fault: gps_loss, duration_s: 1, vehicle: 2}\n")
    done = flightd("sim", "--scenario", file, "--port", 25310)
    assert done.returncode == 2
    assert done.err == f"scenario {file}: [1].vehicle: 2; there is only 1 (--vehicles)\n"
