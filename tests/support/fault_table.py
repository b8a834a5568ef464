"""Flies the fault matrix and writes its table, and the supervisor's diagram, into a document.

``PYTHONPATH=tests python -m support.fault_table docs/safety.md``
"""

import sys
from pathlib import Path

from daemon import logs
from daemon.safety.supervisor import to_mermaid
from support.fault_cases import CASES
from support.fault_matrix import Case, Seen, differences, strike

MATRIX, SUPERVISOR = "fault matrix", "supervisor"
HEAD = (
    "| fault | expected | silent after, s | Hold after, s | largest tilt, deg | goal | ends in |",
    "|---|---|---|---|---|---|---|",
)


def row(case: Case, seen: Seen) -> str:
    """One line of the table."""
    outcome = ", ".join(filter(None, (seen.ended[0].outcome, seen.ended[0].reason))) if seen.ended else "-"
    figures = (_seconds(seen.silent_s), _seconds(seen.hold_s), f"{seen.tilt_deg:.0f}")
    ends = f"`{seen.state.value}`, {seen.mode.value}"
    return "| " + " | ".join((case.name, case.sentence, *figures, outcome, ends)) + " |"


def between(text: str, name: str) -> tuple[str, str, str]:
    """What is before, between and after the marks of a part. Raises ``ValueError`` when a mark is missing."""
    begin, end = f"<!-- {name}: begin -->\n", f"<!-- {name}: end -->"
    first, last = text.index(begin) + len(begin), text.index(end)
    return text[:first], text[first:last], text[last:]


def replaced(text: str, name: str, body: str) -> str:
    """The text with another body between the marks of a part."""
    before, _, after = between(text, name)
    return before + body + after


def diagram() -> str:
    """The supervisor's table as Mermaid, for Markdown."""
    return f"```mermaid\n{to_mermaid()}\n```\n"


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
    text = replaced(document.read_text(), MATRIX, "\n".join(lines) + "\n")
    document.write_text(replaced(text, SUPERVISOR, diagram()))
    return int(wrong > 0)


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1])))
