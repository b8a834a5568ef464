"""`flightd bench`: figures of the loop, measured on this machine."""

import asyncio
import json
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Protocol, TypeVar

import typer

from daemon.cli.common import writable

if TYPE_CHECKING:
    from daemon.bench.manoeuvres import Manoeuvre
    from daemon.bench.track import Run

bench_app = typer.Typer(help="Measure on this machine; nothing is asserted.", no_args_is_help=True)


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.add_typer(bench_app, name="bench")


@bench_app.command(short_help="Time the daemon against plain clients.")
def loop(
    seconds: Annotated[
        float, typer.Option(metavar="NUMBER", help="How long each flight is measured.", min=1.0, max=3600.0)
    ] = 5.0,
    rounds: Annotated[int, typer.Option(metavar="N", help="Rounds through all flights.", min=1, max=100)] = 1,
    rate: Annotated[
        float, typer.Option(metavar="NUMBER", help="The daemon's rate, Hz, if not named.", min=50.0, max=250.0)
    ] = 100.0,
    only: Annotated[list[str] | None, typer.Option(metavar="NAME", help="Only this flight; may be repeated.")] = None,
    grpc_python: Annotated[Path | None, typer.Option(metavar="PATH", help="A Python that has mavsdk-grpc.")] = None,
    against: Annotated[
        Path | None,
        typer.Option(
            metavar="PATH", exists=True, dir_okay=False, help="JSON of an earlier run to compare ratios with."
        ),
    ] = None,
    out: Annotated[Path | None, typer.Option(metavar="PATH", help="File for the JSON.")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
) -> None:
    """Time the daemon and plain clients, in real time over UDP, against an autopilot's end that keeps time.

    Example: flightd bench loop --seconds 10 --rounds 3 --only flightd --only "synchronous plugin"
    """
    from daemon.bench import loop as benchmark
    from daemon.bench import loop_report

    if out is not None:
        writable(out.parent, as_json)
    flights = _named(benchmark.programme(rate, str(grpc_python) if grpc_python else None), only, "flight")
    figures = asyncio.run(benchmark.measure(flights, seconds, rounds, lambda text: typer.echo(text, err=True)))
    result = {"seconds": seconds, "rounds": rounds, "rate_hz": rate, "flights": figures}
    if out is not None:
        out.write_text(json.dumps(result, indent=1) + "\n")
    if as_json:
        typer.echo(json.dumps(result))
        return
    typer.echo(loop_report.table(figures))
    if ratios := loop_report.compared(figures, json.loads(against.read_text()) if against else None):
        typer.echo("\n" + ratios)


@bench_app.command(short_help="Time the daemon's start.")
def start(
    count: Annotated[int, typer.Option(metavar="N", help="How often it is started.", min=1, max=1000)] = 5,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
) -> None:
    """Start the daemon as systemd does: from exec to READY.

    Example: flightd bench start --count 10
    """
    from daemon.bench import start as benchmark
    from daemon.bench.quantiles import quantile

    seconds = [benchmark.seconds_to_ready() for _ in range(count)]
    if as_json:
        typer.echo(json.dumps({"starts": count, "ready_p50_s": quantile(seconds, 0.5), "ready_max_s": max(seconds)}))
        return
    typer.echo(f"{count} starts, exec to READY: p50 {quantile(seconds, 0.5):.2f}, most {max(seconds):.2f} s")


@bench_app.command(short_help="Fly the tracking benchmark.")
def track(
    manoeuvre: Annotated[list[str] | None, typer.Option(metavar="NAME", help="Only this one; may be repeated.")] = None,
    condition: Annotated[list[str] | None, typer.Option(metavar="NAME", help="Only this one; may be repeated.")] = None,
    px4: Annotated[
        str | None, typer.Option(metavar="URL", help="MAVSDK URL of a PX4 simulator that runs on this machine.")
    ] = None,
    hover_thrust: Annotated[
        float, typer.Option(metavar="NUMBER", help="What the law believes of the PX4's.", min=0.1, max=0.9)
    ] = 0.5,
    drag: Annotated[
        float, typer.Option(metavar="NUMBER", help="Drag over mass of the PX4's vehicle, 1/s.", min=0.0, max=5.0)
    ] = 1.0,
    out: Annotated[
        Path | None, typer.Option(metavar="PATH", help="Folder for track.json, track.md and track.png.")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
    seed: Annotated[int, typer.Option(metavar="N", help="Seed of noise and gusts.")] = 1,
) -> None:
    """Fly the tracking benchmark: flightd's law, the one of mavros_controllers and, with --px4, PX4's own.

    On the simulated PX4 in virtual time; the whole programme takes some minutes.

    Example: flightd bench track --manoeuvre lemniscate_5 --condition calm --condition noise
    """
    from daemon import logs
    from daemon.bench import manoeuvres, track, track_report

    logs.configure("error")
    if out is not None:
        writable(out, as_json)
    chosen = _named(manoeuvres.all_manoeuvres(), manoeuvre, "manoeuvre")
    if px4 is not None:
        runs = asyncio.run(_on_px4(px4, chosen, hover_thrust, drag))
    else:
        conditions = _named(track.CONDITIONS, condition, "condition")
        flights = track.programme(chosen, conditions)
        if manoeuvre and condition:
            flights = [(m, c) for c in conditions for m in chosen]
        runs = list(_told(track.simulated(flights, seed=seed)))
    if out is not None:
        (out / "track.json").write_text(json.dumps(track_report.as_json(runs), indent=1) + "\n")
        (out / "track.md").write_text(track_report.markdown(runs) + "\n")
        (out / "track.png").write_bytes(track_report.picture(runs))
    typer.echo(json.dumps(track_report.as_json(runs)) if as_json else track_report.table(runs))


@bench_app.command(short_help="Tell what the simulator costs.")
def sim(
    seconds: Annotated[
        float, typer.Option(metavar="NUMBER", help="How long the fleet flies.", min=1.0, max=3600.0)
    ] = 60.0,
    vehicles: Annotated[int, typer.Option(metavar="N", help="How many there are.", min=1, max=50)] = 4,
) -> None:
    """Tell what the simulator costs: a minute of flight in virtual time, and a fleet over UDP in real time.

    Example: flightd bench sim --seconds 60 --vehicles 4
    """
    from daemon import logs
    from daemon.bench import simulator

    logs.configure("error")
    for line in simulator.lines(simulator.virtual_minute(60.0), simulator.fleet(vehicles, seconds)):
        typer.echo(line)


class _Named(Protocol):
    @property
    def name(self) -> str: ...


N = TypeVar("N", bound=_Named)


def _named(choice: Iterable[N], names: list[str] | None, what: str) -> list[N]:
    """Those of the choice that are named, all when none is."""
    by_name = {one.name: one for one in choice}
    unknown = [name for name in names or [] if name not in by_name]
    if unknown:
        raise typer.BadParameter(f"no {what} {unknown[0]}; there are {', '.join(map(json.dumps, by_name))}")
    return [by_name[name] for name in names or by_name]


async def _on_px4(url: str, chosen: "list[Manoeuvre]", hover_thrust: float, drag_1_s: float) -> "list[Run]":
    from daemon.bench.track_px4 import connected

    runs = []
    async for run in connected(url, chosen, hover_thrust=hover_thrust, drag_1_s=(drag_1_s, drag_1_s, drag_1_s)):
        _tell(run)
        runs.append(run)
    return runs


def _told(runs: "Iterator[Run]") -> "Iterator[Run]":
    for run in runs:
        _tell(run)
        yield run


def _tell(run: "Run") -> None:
    lost = f", lost: {run.lost}" if run.lost else ""
    typer.echo(f"{run.manoeuvre}, {run.condition}, {run.contestant}: rms {run.rms_m:.3f} m{lost}", err=True)


@bench_app.command(short_help="Reset the estimate in flight.")
def resets(
    seeds: Annotated[
        int, typer.Option(metavar="N", help="How many noises every flight is flown in.", min=1, max=100)
    ] = 1,
    out: Annotated[Path | None, typer.Option(metavar="PATH", help="File for the JSON.")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
) -> None:
    """Reset the simulated PX4's estimate in flight, under flightd's law and the one of mavros_controllers.

    How far the vehicle departs from its twin of the same seed without a reset. In virtual time, half a minute a seed.

    Example: flightd bench resets --seeds 3
    """
    from daemon import logs
    from daemon.bench import resets as benchmark

    logs.configure("error")
    if out is not None:
        writable(out.parent, as_json)
    figures = [one for seed in range(3, 3 + seeds) for one in benchmark.flown(seed=seed)]
    if out is not None:
        out.write_text(json.dumps(benchmark.as_json(figures), indent=1) + "\n")
    typer.echo(json.dumps(benchmark.as_json(figures)) if as_json else benchmark.table(figures))


@bench_app.command(short_help="Time the estimators.")
def estimators(
    rounds: Annotated[
        int, typer.Option(metavar="N", help="Rounds through all estimators; the best is reported.", min=1)
    ] = 5,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
) -> None:
    """Time a tick of each estimator on the telemetry of a simulated flight.

    Example: flightd bench estimators --rounds 3
    """
    from daemon import logs
    from daemon.bench import estimators as benchmark

    logs.configure("error")
    costs = benchmark.measured(benchmark.recorded(), rounds)
    typer.echo(json.dumps(benchmark.as_json(costs)) if as_json else benchmark.table(costs))


@bench_app.command(short_help="Time the planning of goals.")
def plan(
    rounds: Annotated[int, typer.Option(metavar="N", help="How often each goal is planned.", min=1, max=10000)] = 200,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
) -> None:
    """Time planning: to accept a goal, to plan it with its first reference window, and each window after it.

    Example: flightd bench plan --rounds 500
    """
    from daemon.bench import plan as benchmark

    figures = benchmark.measure(rounds)
    if as_json:
        typer.echo(json.dumps(figures))
        return
    typer.echo(f"{'ms':38} {'check p50':>10} {'p99':>7} {'plan p50':>10} {'p99':>7} {'window p50':>10} {'p99':>7}")
    for name, f in figures.items():
        row = " ".join(
            f"{f[f'{what}_p50_ms']:10.2f} {f[f'{what}_p99_ms']:7.2f}" for what in ("check", "plan", "window")
        )
        typer.echo(f"{name:38} {row}")


@bench_app.command(short_help="Time goals from request to setpoint.")
def goals(
    count: Annotated[int, typer.Option(metavar="N", help="How many goals.", min=1, max=100000)] = 1000,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
) -> None:
    """Submit goals as fast as they are answered: from the request to the first setpoint that flies it.

    Example: flightd bench goals --count 10000
    """
    from daemon.bench import goals as benchmark

    figures = asyncio.run(benchmark.measure(count))
    if as_json:
        typer.echo(json.dumps(figures))
        return
    typer.echo(f"{figures['goals']} goals, {figures['goals_per_s']:.0f} a second, results {figures['outcomes']}")
    delay = f"p50 {figures['delay_p50_ms']:.1f}  p99 {figures['delay_p99_ms']:.1f} ms"
    typer.echo(f"from submit to the first setpoint that flies it: {delay} ({figures['flown']} goals lived that long)")
