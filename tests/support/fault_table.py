"""Flies the fault matrix and writes its table into a document: ``python -m support.fault_table docs/safety.md``."""

import sys
from pathlib import Path

from daemon import logs
from support.fault_cases import CASES
from support.fault_matrix import Case, Seen, differences, strike

BEGIN, END = "<!-- fault matrix: begin -->", "<!-- fault matrix: end -->"
HEAD = (
    "| fault | expected | silent after, s | Hold after, s | largest tilt, deg | goal | ends in |",
    "|---|---|---|---|---|---|---|",
)


def row(case: Case, seen: Seen) -> str:
    """One line of the table."""
    outcome = ", ".join(filter(None, (seen.goal.outcome, seen.goal.reason)))
    figures = (_seconds(seen.silent_s), _seconds(seen.hold_s), f"{seen.tilt_deg:.0f}")
    ends = f"`{seen.state.value}`, {seen.mode.value}"
    return "| " + " | ".join((case.name, case.sentence, *figures, outcome, ends)) + " |"


def replaced(text: str, begin: str, end: str, body: str) -> str:
    """The text with what lies between two marks replaced. Raises ``ValueError`` when a mark is missing."""
    return text[: text.index(begin) + len(begin)] + "\n" + body + "\n" + text[text.index(end) :]


def _seconds(value: float | None) -> str:
    return "-" if value is None else f"{value:.2f}"


def main(document: Path) -> int:
    """Fly all, print and write the table; 1 when a response was not the expected one."""
    logs.configure("error")
    lines, wrong = list(HEAD), 0
    for case in CASES:
        seen = strike(case)
        lines.append(row(case, seen))
        print(lines[-1], flush=True)
        for difference in differences(case, seen):
            wrong += 1
            print(f"  {case.name}: {difference}", file=sys.stderr)
    document.write_text(replaced(document.read_text(), BEGIN, END, "\n".join(lines)))
    return int(wrong > 0)


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1])))
