"""One daemon a vehicle."""

import asyncio
import os
from pathlib import Path

import pytest

from daemon.config import load
from daemon.endpoint import EndpointInUseError, canonical, claim
from daemon.tuning.live import record


def test_a_claimed_endpoint_is_refused_with_the_pid_until_it_is_free_again() -> None:
    url = f"udpin://127.0.0.1:{50_000 + os.getpid() % 10_000}"
    with claim(url), pytest.raises(EndpointInUseError, match=f"process {os.getpid()} already flies"):
        claim(url)
    with claim(url):
        pass


def test_the_same_endpoint_is_known_under_its_other_names(tmp_path: Path) -> None:
    device, link = tmp_path / "ttyX0", tmp_path / "autopilot"
    device.touch()
    link.symlink_to(device)
    assert canonical(f"serial://{device}:921600") == canonical(f"serial://{link}:57600")
    assert canonical("udpin://0.0.0.0:14540") == canonical("udpin://127.0.0.1:14540") == canonical("udp://:14540")


@pytest.mark.parametrize(
    ("one", "other"),
    [
        ("udpin://0.0.0.0:14540", "udpin://0.0.0.0:14541"),
        ("udpin://0.0.0.0:14540", "tcpin://0.0.0.0:14540"),
        ("udpout://10.0.0.1:14540", "udpout://10.0.0.2:14540"),
        ("serial:///dev/ttyAMA0:921600", "serial:///dev/ttyAMA1:921600"),
    ],
)
def test_different_endpoints_do_not_hinder_each_other(one: str, other: str) -> None:
    assert canonical(one) != canonical(other)


def test_a_measuring_flight_is_refused_beside_a_daemon_that_has_the_vehicle() -> None:
    url = f"udpin://127.0.0.1:{40_000 + os.getpid() % 10_000}"
    with claim(url), pytest.raises(EndpointInUseError, match=f"process {os.getpid()} already flies"):
        asyncio.run(record(url, load([]), takeoff_m=None, tell=print))
