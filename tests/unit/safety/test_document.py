"""The document says what the code does."""

from pathlib import Path

from support.fault_cases import CASES
from support.fault_table import MATRIX, SUPERVISOR, between, diagram

DOCUMENT = Path(__file__).parents[3] / "docs" / "safety.md"


def test_the_diagram_is_drawn_from_the_table() -> None:
    assert between(DOCUMENT.read_text(), SUPERVISOR)[1] == diagram(), "run `make fault-matrix`"


def test_the_matrix_has_a_row_for_every_fault() -> None:
    rows = between(DOCUMENT.read_text(), MATRIX)[1].splitlines()[2:]
    written = [tuple(cell.strip() for cell in row.split("|")[1:3]) for row in rows]
    assert written == [(case.name, case.sentence) for case in CASES], "run `make fault-matrix`"
