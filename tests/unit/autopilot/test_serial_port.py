"""The device of a serial connection: another one is told from the one that was opened."""

from pathlib import Path

import pytest

from daemon.autopilot.serial_port import SerialPort


@pytest.fixture
def link(tmp_path: Path) -> Path:
    for name in ("ttyACM0", "ttyACM1"):
        (tmp_path / name).touch()
    path = tmp_path / "flightd-autopilot"
    path.symlink_to(tmp_path / "ttyACM0")
    return path


def opened(link: Path) -> SerialPort:
    port = SerialPort(f"serial://{link}:921600")
    port.opened()
    return port


def test_a_device_that_stays_is_the_same(link: Path) -> None:
    port = opened(link)
    (link.parent / "ttyACM0").chmod(0o660)  # as udev does, after it has made it
    assert not port.is_another()


def test_a_link_that_leads_elsewhere_is_another_device_until_that_is_opened(link: Path) -> None:
    port = opened(link)
    link.unlink()
    link.symlink_to(link.parent / "ttyACM1")
    assert port.is_another() and port.is_another()
    port.opened()
    assert not port.is_another()


def test_a_device_that_was_away_is_another_and_one_that_is_away_is_none(link: Path) -> None:
    port = opened(link)
    link.rename(link.with_name("away"))
    assert not port.is_another()
    link.with_name("away").rename(link)
    assert port.is_another()


def test_what_is_not_serial_has_no_device() -> None:
    port = SerialPort("udpin://127.0.0.1:14540")
    port.opened()
    assert not port.is_another()
