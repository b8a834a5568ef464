"""The spline of least snap against scipy's interpolating spline of degree 7."""

import numpy as np
import pytest
from scipy.interpolate import make_interp_spline

from daemon.guidance.snap_spline import interpolated


def splines(places):
    """Random times and places with three derivatives at both ends: scipy's spline through them, and ours."""
    random = np.random.default_rng(places)
    through = 10.0 * random.normal(size=(places, 3))
    times_s = np.concatenate(([0.0], np.cumsum(random.uniform(0.5, 4.0, places - 1))))
    first, last = random.normal(size=(2, 3, 3))
    begin, end = ([(i + 1, value) for i, value in enumerate(values)] for values in (first, last))
    oracle = make_interp_spline(times_s, through, k=7, bc_type=(begin, end))
    return times_s, oracle, interpolated(times_s, through, first, last)


@pytest.mark.parametrize("places", [2, 3, 4, 50])
@pytest.mark.parametrize("order", [0, 1, 2, 3, 4, 6])
def test_it_is_the_spline_of_degree_seven_with_three_derivatives_given_at_both_ends(places: int, order: int) -> None:
    times_s, oracle, spline = splines(places)
    looks = np.linspace(0.0, times_s[-1], 500)
    expected = oracle(looks, order)
    assert spline(looks, order) == pytest.approx(expected, abs=1e-7 * np.abs(expected).max())


@pytest.mark.parametrize("places", [2, 50])
def test_at_one_time_it_is_the_same_with_its_derivatives(places: int) -> None:
    times_s, oracle, spline = splines(places)
    for time_s in (*np.linspace(0.0, times_s[-1], 200).tolist(), *times_s.tolist()):
        for order, found in enumerate(spline.at(time_s)):
            expected = oracle(time_s, order)
            assert found == pytest.approx(expected.tolist(), abs=1e-6 * np.abs(oracle(times_s, order)).max())
