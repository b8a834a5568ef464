"""Flies the fault matrix and writes its table, and the supervisor's diagram, into a document.

``PYTHONPATH=tests python -m support.fault_table docs/safety.md``
"""

import asyncio
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

from daemon import logs
from support.fault_cases import CASES
from support.fault_cases_live import CASES as LIVE_CASES
from support.fault_live import LiveCase, LiveSeen, live_differences, strike_live
from support.fault_matrix import Case, Seen, differences, strike
from support.supervisor_text import diagram, rows

MATRIX, LIVE_MATRIX, SUPERVISOR = "fault matrix", "fault matrix, live", "supervisor"
HEAD = (
    "| fault | expected | silent after, s | Hold after, s | largest tilt, deg | goal | ends in |",
    "|---|---|---|---|---|---|---|",
)


def row(case: Case, seen: Seen) -> str:
    """One line of the table of virtual time."""
    outcome = ", ".join(filter(None, (seen.ended[0].outcome, seen.ended[0].reason))) if seen.ended else "-"
    ends = f"`{seen.state.value}`, {seen.mode.value}{', exit code 1' if seen.ends else ''}"
    return _line(case.name, case.sentence, seen.silent_s, seen.hold_s, seen.tilt_deg, outcome, ends)


def live_row(case: LiveCase, seen: LiveSeen) -> str:
    """One line of the table of real time."""
    how = f"exit code {seen.exits}" if seen.exits is not None else f"`{seen.state}`"
    ends = f"{how}, {seen.mode.value}{'; the watchdog starved' if seen.starves else ''}"
    return _line(case.name, case.words, seen.silent_s, seen.hold_s, seen.tilt_deg, seen.outcome, ends)


def _line(
    name: str, expected: str, silent_s: float | None, hold_s: float | None, tilt_deg: float, outcome: str, ends: str
) -> str:
    figures = (_seconds(silent_s), _seconds(hold_s), f"{tilt_deg:.0f}")
    return "| " + " | ".join((name, expected, *figures, outcome, ends)) + " |"


def between(text: str, name: str) -> tuple[str, str, str]:
    """What is before, between and after the marks of a part. Raises ``ValueError`` when a mark is missing."""
    begin, end = f"<!-- {name}: begin -->\n", f"<!-- {name}: end -->"
    first, last = text.index(begin) + len(begin), text.index(end)
    return text[:first], text[first:last], text[last:]


def replaced(text: str, name: str, body: str) -> str:
    """The text with another body between the marks of a part."""
    before, _, after = between(text, name)
    return before + body + after


def supervisor() -> str:
    """The supervisor's diagram and table."""
    return f"```mermaid\n{diagram()}\n```\n\n{rows()}\n"


def _seconds(value: float | None) -> str:
    return "-" if value is None else f"{value:.2f}"


def main(document: Path) -> int:
    """Fly all, print and write the tables; 1 when a response was not the expected one."""
    logs.configure("error")
    lines, live_lines, wrong = list(HEAD), list(HEAD), 0
    for case in CASES:
        seen = strike(case)
        lines.append(row(case, seen))
        wrong += _told(case.name, lines[-1], differences(case, seen))
    for live in LIVE_CASES:
        with TemporaryDirectory() as folder:
            live_seen = asyncio.run(strike_live(live, Path(folder)))
        live_lines.append(live_row(live, live_seen))
        wrong += _told(live.name, live_lines[-1], live_differences(live, live_seen))
    text = replaced(document.read_text(), MATRIX, "\n".join(lines) + "\n")
    text = replaced(text, LIVE_MATRIX, "\n".join(live_lines) + "\n")
    document.write_text(replaced(text, SUPERVISOR, supervisor()))
    return int(wrong > 0)


def _told(name: str, line: str, wrong: list[str]) -> int:
    print(line, flush=True)
    for difference in wrong:
        print(f"  {name}: {difference}", file=sys.stderr)
    return len(wrong)


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1])))
