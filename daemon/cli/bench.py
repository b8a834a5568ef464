"""`flightd bench`: figures of the loop, measured on this machine."""

import asyncio
import json
from typing import Annotated

import typer

bench_app = typer.Typer(help="Measure on this machine; nothing is asserted.", no_args_is_help=True)


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.add_typer(bench_app, name="bench")


@bench_app.command()
def loop(
    seconds: Annotated[float, typer.Option(help="How long to measure.", min=1.0, max=3600.0)] = 20.0,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
) -> None:
    """Fly the simulated PX4 over MAVSDK in real time and print the statistics of the control loop.

    Example: flightd bench loop --seconds 60 --json
    """
    from daemon import logs
    from daemon.bench import loop as benchmark

    logs.configure("error")
    figures = benchmark.as_dict(asyncio.run(benchmark.measure(seconds)))
    if as_json:
        typer.echo(json.dumps(figures))
        return
    typer.echo(f"control loop over {figures['seconds']} s of flight, {figures['ticks']} ticks")
    typer.echo(
        f"  period    p50 {figures['period_p50_ms']:.2f}  p99 {figures['period_p99_ms']:.2f}"
        f"  max {figures['period_max_ms']:.2f} ms; late {figures['late']}, missed {figures['missed']}"
    )
    typer.echo(f"  step      p50 {figures['step_p50_us']:.0f}  p99 {figures['step_p99_us']:.0f} us")
    typer.echo(f"  state age p50 {figures['age_p50_ms']:.1f}  p99 {figures['age_p99_ms']:.1f} ms when sent")
    typer.echo(f"  CPU       {figures['cpu_percent']:.1f} % of a core")
