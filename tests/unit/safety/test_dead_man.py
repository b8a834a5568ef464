"""The dead-man: silence is levelled, then latched; a stalled machine is not blamed on the loop."""

import threading
from itertools import pairwise

import pytest

from daemon.messages import FlightMode, Setpoint
from daemon.safety.dead_man import Action, DeadMan, DeadManTiming, SetpointGate, Watch

POLL_S = 0.02


class Sender:
    def __init__(self) -> None:
        self.setpoints: list[Setpoint] = []
        self.modes: list[FlightMode] = []
        self.asked = threading.Event()

    def send_setpoint(self, setpoint: Setpoint) -> bool:
        self.setpoints.append(setpoint)
        return True

    def request_mode(self, mode: FlightMode) -> bool:
        self.modes.append(mode)
        self.asked.set()
        return True


def polled(watch: Watch, times_s: list[float], ticks: list[int], ours: bool = True) -> list[Action]:
    return [watch.poll(t, n, ours) for t, n in zip(times_s, ticks, strict=True)]


def test_silence_is_levelled_once_and_latched() -> None:
    times = [i * POLL_S for i in range(40)]
    actions = polled(Watch(DeadManTiming()), times, [7] * 40)
    assert actions.count(Action.LEVEL) == 1
    level, latch = actions.index(Action.LEVEL), actions.index(Action.LATCH)
    assert 0.1 <= times[level] <= 0.1 + 2 * POLL_S
    assert 0.3 <= times[latch] <= 0.3 + 2 * POLL_S


def test_a_ticking_loop_is_left_alone() -> None:
    times = [i * POLL_S for i in range(100)]
    assert set(polled(Watch(DeadManTiming()), times, list(range(100)))) == {Action.NOTHING}


def test_a_stall_of_the_whole_machine_is_not_blamed_on_the_loop() -> None:
    watch = Watch(DeadManTiming())
    polled(watch, [0.0, 0.02, 0.04], [1, 3, 5])
    # Both stand still for 170 ms; the loop goes on a poll later.
    assert polled(watch, [0.21, 0.23, 0.25], [5, 6, 8]) == [Action.NOTHING] * 3


def test_a_gap_of_the_own_clock_latches_before_anything_is_sent() -> None:
    watch = Watch(DeadManTiming())
    polled(watch, [0.0, 0.02], [1, 3])
    assert watch.poll(0.4, 4, True) is Action.SHUT


def test_silence_while_the_vehicle_is_not_ours_is_nothing() -> None:
    times = [i * POLL_S for i in range(100)]
    assert set(polled(Watch(DeadManTiming()), times, [7] * 100, ours=False)) == {Action.NOTHING}


def test_a_latched_gate_lets_nothing_out_until_it_is_opened() -> None:
    sender = Sender()
    gate = SetpointGate(sender)
    setpoint = Setpoint((0.1, 0.2, 0.3), 0.5)
    assert gate.tick(setpoint, 0.5)
    gate.latch()
    gate.latch()
    assert not gate.tick(setpoint, 0.5)
    gate.level_once()
    assert sender.setpoints == [setpoint]
    assert sender.modes == [FlightMode.HOLD]
    gate.unlatch()
    assert gate.tick(setpoint, 0.5)


def test_the_level_setpoint_has_no_rates_and_the_hover_thrust_of_the_last_tick() -> None:
    sender = Sender()
    gate = SetpointGate(sender)
    gate.tick(Setpoint((1.0, 1.0, 1.0), 0.9), 0.43)
    gate.level_once()
    assert sender.setpoints[-1].rates_frd_rad_s == (0.0, 0.0, 0.0)
    assert sender.setpoints[-1].thrust == 0.43


def test_the_thread_latches_a_loop_that_stands_still() -> None:
    sender = Sender()
    gate = SetpointGate(sender)
    timing = DeadManTiming(level_after_s=0.02, latch_after_s=0.05, clock_gap_s=10.0, poll_s=0.005)
    gate.tick(Setpoint((0.0, 0.0, 0.0), 0.5), 0.5)
    dead_man = DeadMan(gate, timing)
    dead_man.start()
    assert sender.asked.wait(10.0)
    dead_man.stop()
    assert gate.latched
    assert sender.modes == [FlightMode.HOLD]


def test_a_gap_between_two_ticks_latches_before_the_setpoint_leaves() -> None:
    sender, now = Sender(), [10.0]
    gate = SetpointGate(sender, lambda: now[0], gap_s=0.3)
    setpoint = Setpoint((0.1, 0.2, 0.3), 0.5)
    assert gate.tick(setpoint, 0.5)
    now[0] += 0.29
    assert gate.tick(setpoint, 0.5)
    now[0] += 0.31
    assert not gate.tick(setpoint, 0.5)
    assert gate.latched
    assert len(sender.setpoints) == 2


@pytest.mark.parametrize("gap_s", [0.31, 0.9, 1.2, 60.0])
def test_after_a_gap_in_which_the_autopilot_or_a_pilot_may_have_taken_the_vehicle_nothing_is_commanded(
    gap_s: float,
) -> None:
    sender, now = Sender(), [10.0]
    gate = SetpointGate(sender, lambda: now[0], gap_s=0.3)
    gate.tick(Setpoint((0.1, 0.2, 0.3), 0.5), 0.5)
    now[0] += gap_s
    gate.check_gap()
    assert gate.latched
    assert sender.modes == []


@pytest.mark.parametrize("setpoint", [None, Setpoint((0.0, 0.0, 0.0), 0.5)])
def test_a_gap_is_told_once_before_anything_is_computed_whoever_has_the_vehicle(setpoint: Setpoint | None) -> None:
    now, told = [10.0], list[float]()
    gate = SetpointGate(Sender(), lambda: now[0], gap_s=0.3)
    gate.gap_listeners.append(told.append)
    for gap_s in (0.0, 0.25, 0.01, 20.0, 0.01):
        now[0] += gap_s
        gate.check_gap()
        gate.tick(setpoint, 0.5)
    assert told == [20.0]


def test_the_time_before_the_first_tick_is_no_gap() -> None:
    told = list[float]()
    gate = SetpointGate(Sender(), lambda: 5000.0)
    gate.gap_listeners.append(told.append)
    gate.check_gap()
    assert told == []


def test_a_thread_that_stood_still_itself_shuts_the_gate_and_asks_for_nothing() -> None:
    sender, events = Sender(), list[str]()
    gate = SetpointGate(sender)
    gate.tick(Setpoint((0.0, 0.0, 0.0), 0.5), 0.5)
    shut = threading.Event()

    def report(event: str) -> None:
        events.append(event)
        shut.set()

    dead_man = DeadMan(gate, DeadManTiming(clock_gap_s=0.0, poll_s=0.005), report)
    dead_man.start()
    assert shut.wait(10.0)
    dead_man.stop()
    assert gate.latched
    assert sender.modes == [] and events == ["dead_man_shut"]


def test_a_gap_while_the_vehicle_is_not_ours_is_nothing() -> None:
    sender, now = Sender(), [10.0]
    gate = SetpointGate(sender, lambda: now[0], gap_s=0.3)
    gate.tick(None, 0.5)
    now[0] += 100.0
    gate.tick(None, 0.5)
    assert not gate.latched
    assert sender.modes == []


def test_the_latch_asks_nothing_of_a_vehicle_that_is_not_ours() -> None:
    sender = Sender()
    gate = SetpointGate(sender)
    gate.tick(None, 0.5)
    gate.latch()
    assert gate.latched
    assert sender.modes == []


def test_a_log_that_cannot_be_written_does_not_end_the_thread() -> None:
    sender = Sender()
    gate = SetpointGate(sender)

    def broken(_event: str) -> None:
        raise BrokenPipeError

    timing = DeadManTiming(level_after_s=0.02, latch_after_s=0.05, clock_gap_s=10.0, poll_s=0.005)
    gate.tick(Setpoint((0.0, 0.0, 0.0), 0.5), 0.5)
    dead_man = DeadMan(gate, timing, broken)
    dead_man.start()
    assert sender.asked.wait(10.0), "levelling was reported first, and that failed"
    dead_man.stop()


# Times that floats hold exactly, to stand upon a bound.
EXACT = DeadManTiming(level_after_s=0.125, latch_after_s=0.25, clock_gap_s=0.5, poll_s=0.0625)


def test_silence_counts_from_its_bound_on() -> None:
    times = [i * 0.0625 for i in range(6)]
    nothing = Action.NOTHING
    assert polled(Watch(EXACT), times, [7] * 6) == [nothing, nothing, Action.LEVEL, nothing, Action.LATCH, Action.LATCH]


def test_silence_that_steps_over_its_bound_is_levelled_too() -> None:
    watch = Watch(DeadManTiming(level_after_s=0.15, latch_after_s=0.25, clock_gap_s=0.5, poll_s=0.0625))
    nothing = Action.NOTHING
    assert polled(watch, [i * 0.0625 for i in range(5)], [7] * 5) == [nothing] * 3 + [Action.LEVEL, Action.LATCH]


@pytest.mark.parametrize("after", [1, 2])
def test_only_more_than_the_gap_of_the_clock_shuts(after: int) -> None:
    for gap_s, action in ((0.5, Action.NOTHING), (0.5625, Action.SHUT), (3.0, Action.SHUT)):
        watch = Watch(EXACT)
        watch.poll(0.0, 1, True)
        assert watch.poll(gap_s, after, True) is action


@pytest.mark.parametrize(("period_s", "latched"), [(2.4 * POLL_S, True), (2.6 * POLL_S, False)])
def test_polls_that_come_late_do_not_count_as_silence(period_s: float, latched: bool) -> None:
    actions = polled(Watch(DeadManTiming()), [i * period_s for i in range(30)], [7] * 30)
    assert (Action.LATCH in actions) is latched


def test_a_tick_ends_the_silence_and_the_next_one_is_levelled_again() -> None:
    watch = Watch(EXACT)
    assert polled(watch, [0.0, 0.0625, 0.125], [7, 7, 7])[-1] is Action.LEVEL
    assert polled(watch, [0.1875, 0.25, 0.3125], [8, 8, 8])[-1] is Action.LEVEL


def test_every_tick_is_counted_whether_it_sends_or_not() -> None:
    gate = SetpointGate(Sender())
    setpoint = Setpoint((0.0, 0.0, 0.0), 0.5)
    counts = [gate.ticks]
    for sent in (setpoint, None, setpoint):
        gate.tick(sent, 0.5)
        counts.append(gate.ticks)
    gate.latch()
    gate.tick(setpoint, 0.5)
    counts.append(gate.ticks)
    assert [b - a for a, b in pairwise(counts)] == [1, 1, 1, 1]


@pytest.mark.parametrize(("gap_s", "latched"), [(0.29, False), (0.31, True)])
def test_a_gap_of_three_tenths_latches_unless_told_otherwise(gap_s: float, latched: bool) -> None:
    now = [10.0]
    gate = SetpointGate(Sender(), lambda: now[0])
    gate.tick(Setpoint((0.0, 0.0, 0.0), 0.5), 0.5)
    now[0] += gap_s
    gate.check_gap()
    assert gate.latched is latched


def test_the_gap_itself_is_none() -> None:
    for gap_s, latched in ((0.25, False), (0.3125, True)):
        now = [16.0]
        gate = SetpointGate(Sender(), lambda now=now: now[0], gap_s=0.25)
        gate.tick(Setpoint((0.0, 0.0, 0.0), 0.5), 0.5)
        now[0] += gap_s
        gate.check_gap()
        assert gate.latched is latched


def test_a_latch_asks_for_hold_up_to_the_second_in_which_the_autopilot_acts() -> None:
    for silent_s, modes in ((0.25, [FlightMode.HOLD]), (1.0, [FlightMode.HOLD]), (1.25, [])):
        sender, now = Sender(), [16.0]
        gate = SetpointGate(sender, lambda now=now: now[0])
        gate.tick(Setpoint((0.0, 0.0, 0.0), 0.5), 0.5)
        now[0] += silent_s
        gate.latch()
        assert gate.latched
        assert sender.modes == modes


class TickingGate(SetpointGate):
    """A gate whose task ticks before each poll, and that tells of its twentieth."""

    def __init__(self, sender: Sender) -> None:
        super().__init__(sender)
        self.polled_often = threading.Event()

    def __getattribute__(self, name: str) -> object:
        if name == "ticks":
            self.__dict__["ticks"] += 1
            if self.__dict__["ticks"] > 20:
                self.polled_often.set()
        return super().__getattribute__(name)


def test_the_thread_leaves_a_task_that_ticks_alone() -> None:
    sender, events = Sender(), list[str]()
    gate = TickingGate(sender)
    gate.tick(Setpoint((0.0, 0.0, 0.0), 0.5), 0.5)
    dead_man = DeadMan(gate, DeadManTiming(clock_gap_s=10.0, poll_s=0.001), events.append)
    dead_man.start()
    assert gate.polled_often.wait(10.0)
    dead_man.stop()
    assert not gate.latched
    assert len(sender.setpoints) == 1 and sender.modes == [] and events == []
