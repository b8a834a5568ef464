"""The document says what the code does."""

from collections.abc import Sequence
from pathlib import Path

import pytest
from support.fault_cases import CASES
from support.fault_cases_live import CASES as LIVE_CASES
from support.fault_live import LiveCase
from support.fault_matrix import Case
from support.fault_table import LIVE_MATRIX, MATRIX, SUPERVISOR, between, supervisor

DOCUMENT = Path(__file__).parents[3] / "docs" / "safety.md"


def test_the_supervisor_is_shown_as_it_is() -> None:
    assert between(DOCUMENT.read_text(), SUPERVISOR)[1] == supervisor(), "run `make fault-matrix`"


@pytest.mark.parametrize(("name", "cases"), [(MATRIX, CASES), (LIVE_MATRIX, LIVE_CASES)])
def test_the_matrix_has_a_row_for_every_fault(name: str, cases: Sequence[Case | LiveCase]) -> None:
    rows = between(DOCUMENT.read_text(), name)[1].splitlines()[2:]
    written = [tuple(cell.strip() for cell in row.split("|")[1:3]) for row in rows]
    assert written == [(case.name, case.sentence) for case in cases], "run `make fault-matrix`"
