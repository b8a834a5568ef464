"""The benchmark of resets: its figures from paths made up by hand, and one case that is flown."""

from math import cos, degrees, pi, sin

import pytest

from daemon.bench import resets
from daemon.bench.resets import CASES, CONTESTANTS, Case, _Flown, compared
from daemon.messages import IDENTITY
from daemon.sim.faults import EkfReset

ANY = Case(name="any", reset=EkfReset(), bound_m=1.0, bound_2s_m=0.5, bound_deg=30.0)


def path(late_m: float, soon_m: float = 0.0, turned_rad: float = 0.0) -> _Flown:
    turned = (cos(0.5 * turned_rad), sin(0.5 * turned_rad), 0.0, 0.0)
    return _Flown([(1.0, (0.0, soon_m, 0.0), turned), (3.0, (late_m, 0.0, 0.0), IDENTITY)])


def test_departures_are_those_from_the_twin() -> None:
    found = compared(ANY, "law", 3, path(0.9, 0.4, pi / 9), path(0.1, 0.1))
    assert (found.departure_m, found.departure_2s_m) == (pytest.approx(0.8), pytest.approx(0.3))
    assert (found.attitude_deg, found.tilt_deg) == (pytest.approx(20.0), pytest.approx(degrees(pi / 9)))
    assert found.kept


@pytest.mark.parametrize("struck", [path(1.2), path(0.0, 0.6), path(0.0, 0.0, 0.6), _Flown(lost="reason")])
def test_each_bound_is_looked_at(struck: _Flown) -> None:
    assert not compared(ANY, "law", 3, struck, path(0.0)).kept


def test_our_law_does_not_notice_what_makes_the_other_lurch() -> None:
    ours, mavros = resets.flown(CASES[:1], CONTESTANTS)
    assert ours.kept
    assert mavros.departure_m > 1.0
    assert "beyond the bound" in resets.table([ours, mavros]).splitlines()[2]
    assert resets.as_json([ours])[0]["contestant"] == "flightd"
