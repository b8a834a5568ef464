"""What a sample is to the one before it: its motion, a reset, a slide, or a jump to refuse."""

from daemon.estimation import reset_tracker, slide
from daemon.estimation.gate import Sample
from daemon.estimation.reset_tracker import Innovation, ResetParameters
from daemon.estimation.slide import SETTLED, SlideParameters, SlideState
from daemon.frames import add, norm
from daemon.messages import ZERO3, Reset, Vec3
from daemon.values import value

_SHORTEST_S = 1e-3  # between two samples of a clock that was set anew


@value
class Outcome:
    """``reset`` is what the autopilot did, ``through`` what of it comes through with this sample.

    ``name`` and ``cause`` are the event's, empty when there is nothing to tell.
    ``innovation`` is None where motion cannot be compared: after a reset and after a gap. ``counter_steps`` counts
    the autopilot's resets since the sample before, modulo 256.
    """

    slide: SlideState
    innovation: Innovation | None = None
    refused: bool = False
    reset: Reset | None = None
    through: Reset | None = None
    name: str = ""
    cause: str = ""
    counter_steps: int = 0


def compared(
    memory: SlideState,
    before: Sample,
    after: Sample,
    acceleration_ned_m_s2: Vec3,
    *,
    clock_set: bool,
    set_back: bool,
    resets: ResetParameters,
    slides: SlideParameters,
) -> Outcome:
    """Judge ``after``, which came next to ``before``.

    ``clock_set``: the stamps of the two may be of different clocks, or the first came late. ``set_back``: to an
    earlier time; unless the sample continues the one before, the autopilot has rebooted, and its new frame is the
    truth. ``reset.time_s`` is the arrival, loop clock.
    """
    steps = (after.reset_counter - before.reset_counter) % 256
    dt = _between(before, after, acceleration_ned_m_s2, resets) if clock_set else _by_stamps(before, after)
    gap = dt > resets.gap_s
    found = _innovation(before, after, acceleration_ned_m_s2, dt, resets)
    rebooted = set_back and (gap or steps > 0 or slide.jumps(found, parameters=slides))
    if rebooted or (gap and steps):
        variance = before.position_variance_m2
        reset = reset_tracker.identified(found, after.arrival_s, variance, lost=True, parameters=resets)
        return Outcome(SETTLED, None, False, reset, reset, "reset", "rebooted" if rebooted else "after_gap", steps)
    if gap and memory.refused is None:
        return Outcome(SETTLED, name="regained")
    if steps:
        return _announced(memory, before, after, found, steps, resets, slides)
    if gap or slide.jumps(found, parameters=slides):
        return _unannounced(memory, before, after, found, gap, acceleration_ned_m_s2, resets, slides)
    following = slide.followed(memory, found, parameters=slides)
    if norm(following.excess_ned_m) > slides.excess_max_m:
        excess = Innovation(found.dt_s, following.excess_ned_m, ZERO3, 0.0)
        return _fast_slide(following, excess, before, after, False, resets, slides)
    return Outcome(following, found)


def _by_stamps(before: Sample, after: Sample) -> float:
    return max(_SHORTEST_S, (after.stamp_us - before.stamp_us) * 1e-6)


def _innovation(
    before: Sample, after: Sample, acceleration_ned_m_s2: Vec3, dt: float, resets: ResetParameters
) -> Innovation:
    """After a gap nothing is known of what was commanded in it."""
    if dt > resets.gap_s:
        return reset_tracker.innovation(before, after, ZERO3, resets.gap_s)
    return reset_tracker.innovation(before, after, acceleration_ned_m_s2, dt)


def _between(before: Sample, after: Sample, acceleration_ned_m_s2: Vec3, resets: ResetParameters) -> float:
    """Time between two samples about a step of the clock: by arrivals, unless the motion fits the stamps better."""
    arrivals = max(_SHORTEST_S, after.arrival_s - before.arrival_s)
    stamps = (after.stamp_us - before.stamp_us) * 1e-6
    if not 0.0 < stamps <= resets.gap_s:
        return arrivals

    def misfit(dt: float) -> float:
        found = _innovation(before, after, acceleration_ned_m_s2, dt, resets)
        position, velocity = norm(found.position_ned_m), norm(found.velocity_ned_m_s)
        return position / resets.position_noise_m + velocity / resets.velocity_noise_m_s

    return min(arrivals, stamps, key=misfit)


def _announced(
    memory: SlideState,
    before: Sample,
    after: Sample,
    found: Innovation,
    steps: int,
    resets: ResetParameters,
    slides: SlideParameters,
) -> Outcome:
    """The counter stepped: name the kinds. Without any, the sample is motion that is worth an event."""
    reset = reset_tracker.identified(found, after.arrival_s, before.position_variance_m2, parameters=resets)
    cause = reset_tracker.ambiguity(reset, steps)
    if not reset.kinds:
        kept = SlideState(memory.excess_ned_m, memory.excess_ned_m_s)
        return Outcome(kept, name="reset", cause=cause, counter_steps=steps)
    speed, through = slide.absorbed(memory.excess_ned_m_s, reset, parameters=slides)
    return Outcome(SlideState(memory.excess_ned_m, speed), None, False, reset, through, "reset", cause, steps)


def _unannounced(
    memory: SlideState,
    before: Sample,
    after: Sample,
    found: Innovation,
    gap: bool,
    acceleration_ned_m_s2: Vec3,
    resets: ResetParameters,
    slides: SlideParameters,
) -> Outcome:
    """A jump without a counter: refused, for however long, until enough samples follow from each other."""
    agreeing = 1
    if memory.refused is not None:
        dt = (after.stamp_us - memory.refused.stamp_us) * 1e-6
        among = reset_tracker.innovation(memory.refused, after, acceleration_ned_m_s2, dt)
        if dt > 0.0 and not slide.jumps(among, parameters=slides):
            agreeing = memory.agreeing + 1
    if agreeing < slides.agreeing_samples:
        return Outcome(SlideState(memory.excess_ned_m, memory.excess_ned_m_s, after, agreeing), refused=True)
    total = Innovation(
        found.dt_s, add(found.position_ned_m, memory.excess_ned_m), found.velocity_ned_m_s, found.yaw_rad
    )
    return _fast_slide(memory, total, before, after, gap, resets, slides)


def _fast_slide(
    memory: SlideState,
    found: Innovation,
    before: Sample,
    after: Sample,
    gap: bool,
    resets: ResetParameters,
    slides: SlideParameters,
) -> Outcome:
    """The estimate moved by itself: a reset that nobody announced. After a gap nobody can say by how much."""
    variance = before.position_variance_m2
    reset = reset_tracker.identified(found, after.arrival_s, variance, lost=gap, parameters=resets)
    speed, through = slide.absorbed(memory.excess_ned_m_s, reset, parameters=slides)
    kept = SETTLED if speed == ZERO3 else SlideState(ZERO3, speed)
    return Outcome(kept, None, False, reset, through, "fast_slide", "after_gap" if gap else "")
