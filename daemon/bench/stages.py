"""What each stage of a step costs: recorded inputs through the flow once more, with a clock about each stage."""

from collections.abc import Callable
from contextlib import ExitStack
from time import perf_counter_ns
from typing import Any
from unittest.mock import patch

from daemon import pipeline
from daemon.bench.quantiles import quantile
from daemon.control import controller
from daemon.estimation import estimator, predictor
from daemon.pipeline import Inputs, PipelineState
from daemon.safety import supervision

_STAGES: tuple[tuple[str, Any, str], ...] = (
    ("estimator", estimator, "step"),
    ("supervisor", supervision, "step"),
    ("predictor", predictor, "predict"),
    ("control law", controller, "step"),
    ("whole step", pipeline, "step"),
)


def stage_costs_us(state: PipelineState, ticks: list[tuple[Inputs, float, float]]) -> dict[str, float]:
    """Median microseconds of each stage; ``ticks`` are the inputs, now and dt of a flight that began in ``state``."""
    costs: dict[str, list[int]] = {name: [] for name, _, _ in _STAGES}
    with ExitStack() as stack:
        for name, module, function in _STAGES:
            stack.enter_context(patch.object(module, function, _timed(getattr(module, function), costs[name])))
        for inputs, now_s, dt_s in ticks:
            state, _, _ = pipeline.step(state, inputs, now_s, dt_s)
    return {name: 1e-3 * quantile(values, 0.5) for name, values in costs.items() if values}


def _timed(function: Callable[..., Any], costs_ns: list[int]) -> Callable[..., Any]:
    def timed(*args: Any, **kwargs: Any) -> Any:
        begun_ns = perf_counter_ns()
        result = function(*args, **kwargs)
        costs_ns.append(perf_counter_ns() - begun_ns)
        return result

    return timed
