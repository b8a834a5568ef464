"""The fault matrix: each fault strikes a flight to a goal, in virtual time, and is answered as it should be."""

import pytest
from support.fault_cases import CASES
from support.fault_matrix import Case, differences, strike


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
def test_a_fault_is_answered(case: Case) -> None:
    assert differences(case, strike(case)) == []
