"""The examples of docs/protocol.md, played to the whole daemon on the simulated PX4 in virtual time.

`python -m support.protocol_page` writes into the page what the daemon answers now.
"""

import asyncio
import json
import re
from pathlib import Path
from typing import Any

from daemon.goals.dispatch import Dispatcher
from daemon.safety.supervisor import State
from support.flight import CALLER, Flight, fly

PAGE = Path(__file__).parents[2] / "docs" / "protocol.md"
BLOCK = re.compile(r"```text\n(.*?)```", re.DOTALL)
ON_GROUND = ("vehicle.takeoff", "vehicle.arm")
BETWEEN_S, WHILE_STREAMING_S = 2.0, 0.2
PATIENCE_S = 200.0
DIGITS = 3


class _Client:
    """A connection as the dispatcher sees it; keeps what it is sent, but for the feedback, which comes all the time."""

    caller = CALLER
    rate_hz = 10.0
    goals_waiting = 0

    def __init__(self) -> None:
        self.heard: list[Any] = []

    def send(self, line: bytes, *, essential: bool) -> None:
        message = json.loads(line)
        if not (isinstance(message, dict) and message.get("method") == "goal.feedback"):
            self.heard.append(message)

    def started(self) -> None:
        pass

    def finished(self) -> None:
        pass


def blocks() -> list[str]:
    """The page's blocks of examples."""
    return BLOCK.findall(PAGE.read_text())


def played(block: str) -> list[tuple[str, Any]]:
    """The block's `>` lines as they are, each followed by what came back before the next."""
    asked = [line for line in block.splitlines() if line.startswith("> ")]
    lines: list[tuple[str, Any]] = []

    async def scenario(flight: Flight) -> None:
        flight.hub._prefix = "g"
        if any(method in asked[0] for method in ON_GROUND):
            await flight.until(lambda: flight.state is State.STANDBY and flight.records[-1].estimate.newest is not None)
        else:
            await flight.airborne(engage=False)
        client, task = _Client(), flight.vehicle.trajectory
        dispatcher = Dispatcher(flight.service, flight.hub, _at_once)
        for line in asked:
            lines.append((">", line[2:]))
            dispatcher.handle(client, line[2:].encode())  # type: ignore[arg-type]
            await flight.until(lambda line=line: '"id"' not in line or bool(client.heard), PATIENCE_S)
            pause_s = WHILE_STREAMING_S if "stream" in asked[0] else BETWEEN_S
            await flight.until(lambda since_s=flight.now_s, s=pause_s: flight.now_s - since_s > s and not task.canceled)
            lines.extend(("<", message) for message in client.heard)
            client.heard.clear()

    fly(scenario)
    return lines


async def _at_once(_caller: object) -> None:
    await asyncio.sleep(0)


def _short(value: Any) -> Any:
    if isinstance(value, float):
        return round(value, DIGITS)
    if isinstance(value, dict):
        return {key: _short(item) for key, item in value.items()}
    return [_short(item) for item in value] if isinstance(value, list) else value


def _rewritten(block: re.Match[str]) -> str:
    lines = [f"{sign} {text if sign == '>' else json.dumps(_short(text))}\n" for sign, text in played(block[1])]
    return f"```text\n{''.join(lines)}```"


if __name__ == "__main__":
    PAGE.write_text(BLOCK.sub(_rewritten, PAGE.read_text()))
