"""The supervisor as people see it: every row in its order, and a diagram that says nothing that is not in the table."""

import re

import pytest
from support.supervisor_text import GROUPS, diagram, rows

from daemon.safety.supervisor import TABLE, State

GROUP = dict(GROUPS)
ARROW = re.compile(r"    (\w+) --> (\w+): (.+)")


def states_of(name: str) -> frozenset[State]:
    return GROUP.get(name) or frozenset({State(name)})


def changes() -> set[tuple[State, State, str]]:
    return {(state, row.to, row.reason) for row in TABLE for state in row.states if state is not row.to}


def drawn() -> set[tuple[State, State, str]]:
    begin = "    [*] --> disconnected\n"
    arrows = [ARROW.fullmatch(line) for line in diagram().partition(begin)[2].splitlines()]
    assert all(arrows)
    return {
        (state, State(arrow[2]), reason)
        for arrow in arrows
        if arrow
        for state in states_of(arrow[1])
        for reason in arrow[3].split(", ")
        if not reason.endswith(" more")
    }


def test_every_arrow_is_in_the_table_and_only_what_starts_everywhere_has_none() -> None:
    assert drawn() <= changes()
    ways = {(state, to) for state, to, _ in drawn()}
    without = {change for change in changes() if change[:2] not in ways}
    assert {reason for _, _, reason in without} == {"link_lost", "autopilot_rebooted", "requested", "disarmed"}
    assert {change for change in without if change[0] in GROUP["ours"]} == {
        (state, State.DISCONNECTED, "link_lost") for state in GROUP["ours"]
    }


def test_every_state_lies_in_its_groups_and_nowhere_else() -> None:
    path: list[str] = []
    seen: dict[State, list[str]] = {}
    for word in (line.strip() for line in diagram().partition("    [*]")[0].splitlines()[2:]):
        if word.startswith("state "):
            path.append(word.split()[1])
        elif word == "}":
            path.pop()
        else:
            seen[State(word)] = list(path)
    assert set(seen) == set(State)
    assert all(
        set(path) == {name for name in ("ours", "flying", "autopilot") if state in GROUP[name]}
        for state, path in seen.items()
    )


def test_an_arrow_with_many_reasons_says_how_many_more() -> None:
    (line,) = [line for line in diagram().splitlines() if line.startswith("    flying --> releasing")]
    reasons = {reason for state, to, reason in changes() if (state, to) == (State.TRACKING, State.RELEASING)}
    assert line.endswith(f", {len(reasons) - 2} more")


def test_the_rows_are_all_there_in_the_order_in_which_they_are_tried() -> None:
    lines = rows().splitlines()[2:]
    assert [line.split(" | ")[2:] for line in lines] == [[f"`{row.to.value}`", f"`{row.reason}` |"] for row in TABLE]


@pytest.mark.parametrize(
    ("reason", "where"),
    [
        ("link_lost", "connected"),
        ("control_stalled", "ours"),
        ("tilt_excess", "flying"),
        ("goal", "`holding`"),
        ("pilot_takeoff", "`standby`"),
    ],
)
def test_a_row_says_where_it_holds(reason: str, where: str) -> None:
    (line,) = [line for line in rows().splitlines() if line.endswith(f"| `{reason}` |")]
    assert line.startswith(f"| {where} |")


def test_a_group_with_one_state_missing_says_which() -> None:
    assert "| not ours but `landing` | `landing_confirmed` and not `overruled` |" in rows()
