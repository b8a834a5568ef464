"""The supervisor's table for people: a Mermaid diagram of its usual ways, and all of its rows."""

from daemon.safety.supervisor import FLYING, OURS, TABLE, Row, State

_AUTOPILOT = frozenset({State.TAKING_OFF, State.READY, State.LANDING})
_ANY = frozenset(State) - {State.DISCONNECTED}
_NOT_OURS = _ANY - OURS
GROUPS = (("connected", _ANY), ("not ours", _NOT_OURS), ("ours", OURS), ("autopilot", _AUTOPILOT), ("flying", FLYING))
_DRAWN = GROUPS[2:]
_MOST_REASONS = 4
_FROM_EVERYWHERE = 5  # from so many states in one row, the arrows would hide the others


def diagram() -> str:
    """The states in their groups, and the changes that have few beginnings, those of a whole group as one arrow."""
    drawn = [row for row in TABLE if len(row.states - {row.to}) < _FROM_EVERYWHERE]
    begin: dict[tuple[str, State], set[State]] = {}
    for row in drawn:
        begin.setdefault((row.reason, row.to), set()).update(row.states - {row.to})
    arrows: dict[tuple[str, str], list[str]] = {}
    for (reason, to), states in begin.items():
        for name in covered(frozenset(states), to):
            arrows.setdefault((name, to.value), []).append(reason)
    lines = ["stateDiagram-v2", "    direction LR", *_nested(frozenset(State), dict(_DRAWN), 1)]
    lines.append("    [*] --> disconnected")
    return "\n".join([*lines, *(f"    {a} --> {b}: {_said(reasons)}" for (a, b), reasons in arrows.items())])


def _nested(states: frozenset[State], groups: dict[str, frozenset[State]], depth: int) -> list[str]:
    """The states, those of each group inside of it; a group lies within another one or apart from it."""
    indent, lines, left = "    " * depth, [], set(states)
    for name, group in groups.items():
        if group <= left:
            inner = {other: members for other, members in groups.items() if members < group}
            lines += [f"{indent}state {name} {{", *_nested(group, inner, depth + 1), f"{indent}}}"]
            left -= group
    return [*lines, *(f"{indent}{state.value}" for state in State if state in left)]


def _said(reasons: list[str]) -> str:
    """The first of many; the table has them all."""
    if len(reasons) > _MOST_REASONS:
        reasons = [*reasons[:2], f"{len(reasons) - 2} more"]
    return ", ".join(reasons)


def covered(states: frozenset[State], to: State) -> list[str]:
    """The states as groups that are whole and do not hold ``to``, and those that are left."""
    names, left = [], set(states)
    for name, group in _DRAWN:
        if group <= left and to not in group:
            names.append(name)
            left -= group
    return names + sorted(state.value for state in left)


def rows() -> str:
    """The table as Markdown, in its order."""
    lines = ["| in | when | goes to | for |", "|---|---|---|---|"]
    for row in TABLE:
        when = " and ".join(f"not `{name[1:]}`" if name.startswith("!") else f"`{name}`" for name in row.when)
        lines.append(f"| {_states(row)} | {when} | `{row.to.value}` | `{row.reason}` |")
    return "\n".join(lines)


def _states(row: Row) -> str:
    """The group with what is missing of it, or the states one by one."""
    for name, group in GROUPS:
        missing = group - row.states
        if row.states <= group and len(missing) <= (len(group) > len(_AUTOPILOT)):
            return name + "".join(f" but `{state.value}`" for state in missing)
    return ", ".join(f"`{state.value}`" for state in State if state in row.states)
