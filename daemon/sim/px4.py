"""A simulated PX4 quadrotor without a transport: steps of 4 ms in, MAVLink messages in and out.

Behaviour follows recordings of PX4 1.17 SITL (see docs/simulator.md for what was compared and what is not modelled).
"""

from math import isfinite

from daemon.frames import from_yaw
from daemon.messages import ZERO3, FlightMode, GlobalPosition, Setpoint, Vec3
from daemon.sim.airframe import Airframe
from daemon.sim.announcer import Announcer
from daemon.sim.battery import BatteryState
from daemon.sim.commander import Commander
from daemon.sim.estimator import BOOT_RESETS, Estimator
from daemon.sim.fault_board import FaultBoard
from daemon.sim.faults import Fault
from daemon.sim.land_detector import patience
from daemon.sim.link_faults import LinkFaults
from daemon.sim.navigator import Navigator
from daemon.sim.noise import normals
from daemon.sim.parameters import Parameters
from daemon.sim.rate_control import RateLoop
from daemon.sim.receiver import Receiver
from daemon.sim.sample import Fields, Sample
from daemon.sim.sender import Sender
from daemon.sim.sensors import Sensors
from daemon.sim.vehicle import Surroundings, VehicleState, step
from daemon.sim.wind import Wind

STEP_US = 4000
STEP_S = 0.004
DEFAULT_HOME = GlobalPosition(47.397742, 8.545594, 489.4)
_COMMANDER_US = 10_000
_ESTIMATOR_STEPS = 2
_STATUS_STEPS = 125  # vehicle_status is published at 2 Hz and on every change
_HEADING_STABLE_S = 2.0  # after boot
_ARMABLE_S = 5.0
_SILENT_AFTER_BOOT_S = 1.5


class SimulatedPx4:
    """One vehicle. Deterministic: the same seed, messages and faults give the same messages.

    The noise of gyro and estimate is a matter of seed and step alone, whatever is sent when; that of HIGHRES_IMU, of
    the wind and of each direction of the link comes from streams of their own.

    ``booted_for_s``: how long it has been running when the simulation begins (armable after 5 s).
    ``truth`` is the physics' state; ``mode``, ``armed`` and so on are read from ``commander``. ``told``: the mode and
    the intended one that messages have; a command is answered by a message with those of before, and the next turn's.
    """

    def __init__(
        self,
        *,
        airframe: Airframe,
        seed: int = 0,
        system_id: int = 1,
        noise: bool = True,
        home: GlobalPosition = DEFAULT_HOME,
        booted_for_s: float = 15.0,
        parameters: dict[str, float | int] | None = None,
    ) -> None:
        self.airframe = airframe
        self.system_id = system_id
        self.home = home
        self.parameters = Parameters(
            {
                "MAV_SYS_ID": system_id,
                "MPC_THR_HOVER": round(airframe.hover_thrust, 1),
                "THR_MDL_FAC": airframe.thrust_curve,
            }
            | (parameters or {})
        )
        draw = normals(seed)
        self._noise = noise
        self._draw = draw
        self.sensors = Sensors(draw, normals(seed, 4), noise=noise)
        self.truth = VehicleState(signals=tuple(0.0 for _ in airframe.rotors))
        self.wind = Wind(normals(seed, 1))
        self.payload_kg = 0.0
        self.rotor_efficiency = tuple(1.0 for _ in airframe.rotors)
        self.battery = BatteryState(airframe.battery)
        self._surroundings = Surroundings()
        self._seen: tuple[Vec3, float, tuple[float, ...], float] | None = None
        self.simulated_us = 0
        self._outgoing: list[tuple[str, Fields]] = []
        self.clock_offset_us = 0
        self.links = {"up": LinkFaults(normals(seed, 2)), "down": LinkFaults(normals(seed, 3))}
        self.faults = FaultBoard(self)
        self._boot(round(booted_for_s * 1e6))

    # -- the interface of the transports

    @property
    def time_us(self) -> int:
        """The autopilot's clock since boot, microseconds."""
        return self.simulated_us - self._booted_us + self.clock_offset_us

    @property
    def mode(self) -> FlightMode:
        """The mode that flies."""
        return self.commander.mode

    @property
    def armed(self) -> bool:
        """Whether the motors are allowed to turn."""
        return self.commander.armed

    def receive(self, name: str, fields: Fields, *, sender_system: int = 1, sender_component: int = 195) -> None:
        """A decoded MAVLink message arrives."""
        message = (name, fields, (sender_system, sender_component))
        link = self.links["up"]
        if link.is_perfect:
            self.receiver.receive(*message)
        else:
            link.send(message, self.simulated_us)

    def take_outgoing(self) -> list[tuple[str, Fields]]:
        """What was sent since the last call, oldest first."""
        taken, self._outgoing = self._outgoing, []
        link = self.links["down"]
        if link.is_perfect:
            return taken
        for name, fields in taken:
            link.send((name, fields, (self.system_id, 1)), self.simulated_us)
        return [(name, fields) for name, fields, _ in link.arrived(self.simulated_us)]

    def inject(self, fault: Fault) -> None:
        """Begin a fault now. Raises ValueError when it does not fit this vehicle."""
        self.faults.inject(fault)

    def step(self) -> None:
        """Advance by 4 ms: physics, sensors, controllers, commander, streams."""
        self.simulated_us += STEP_US
        self._steps += 1
        self.faults.step(self.simulated_us)
        if not self.links["up"].is_perfect:
            for message in self.links["up"].arrived(self.simulated_us):
                self.receiver.receive(*message)
        self._fly()
        if self._steps % _ESTIMATOR_STEPS == 0:
            self._estimate()
        if self.simulated_us >= self._next_commander_us:
            self._next_commander_us += _COMMANDER_US
            self._command()
        self.sender.note_sensors()
        self.receiver.echo_parameters()
        if self.uptime_s > self._silent_until_s:
            self.sender.step()
        if self.reboot_soon:
            self.reboot()

    def start_in_air(self, altitude_m: float, yaw_rad: float = 0.0) -> None:
        """Begin hovering in Hold at a height above home instead of on the ground."""
        self.truth = VehicleState(
            (0.0, 0.0, -altitude_m),
            attitude_wb=from_yaw(yaw_rad),
            signals=self.rate_loop.run(ZERO3, self.airframe.hover_thrust, False),
            on_ground=False,
        )
        self.navigator.setpoint = Setpoint(ZERO3, self.airframe.hover_thrust)
        self.commander.start_in_air()
        self.estimator.start_in_air()
        self.estimator.step(self.truth, self.time_us)

    # -- what the parts see of the vehicle

    @property
    def uptime_s(self) -> float:
        """Seconds since boot, whatever the clock says."""
        return (self.simulated_us - self._booted_us) * 1e-6

    @property
    def heading_stable(self) -> bool:
        """Whether the estimator has found its heading since boot."""
        return self.uptime_s > _HEADING_STABLE_S

    @property
    def position_valid(self) -> bool:
        """Whether PX4's checks take the position as usable."""
        return self.estimator.position_valid and self.uptime_s > _ARMABLE_S

    @property
    def present(self) -> Sample:
        """Estimate, rates and truth of this moment."""
        return Sample(self.time_us, self.estimator.estimate, self.rate_loop.filtered_rates, self.truth)

    @property
    def height_m(self) -> float:
        """True height above ground."""
        return -self.truth.position_ned_m[2]

    @property
    def height_variance_m2(self) -> float:
        """Claimed variance of the local z."""
        return 0.0018 + 0.3 * self.estimator.lost_s * 1e-3

    def send(self, name: str, fields: Fields) -> None:
        """Queue a message to the link."""
        self._outgoing.append((name, fields))

    def pilot_switches_to(self, mode: FlightMode) -> None:
        """A pilot's mode switch."""
        self._look()
        self.commander.pilot_switches_to(mode)

    def reboot(self) -> None:
        """Start anew: clock at zero, disarmed, streams and estimator as after power-up."""
        self._boot(0)
        self._silent_until_s = _SILENT_AFTER_BOOT_S

    # -- parts

    def _boot(self, already_us: int) -> None:
        self._booted_us = self.simulated_us - already_us
        self._steps = 0
        self._silent_until_s = 0.0
        self.reboot_soon = False
        self._next_commander_us = self.simulated_us
        self.announcer = Announcer(self.send)
        chance = next(self._draw) if self._noise else 1.0
        self.commander = Commander(self.parameters, self.announcer, self.send, patience(chance))
        self.told = (self.commander.mode, self.commander.intended)
        self.receiver = Receiver(self)
        self.sender = Sender(self)
        self.estimator = Estimator(self._draw, noise=self._noise)
        self.rate_loop = RateLoop(self.airframe, self.parameters["THR_MDL_FAC"])
        self.signals = self.rate_loop.stop()
        self._fusing = True
        self.estimator.step(self.truth, self.time_us)
        self.navigator = Navigator(self)

    def _fly(self) -> None:
        """Physics and the rate loop."""
        truth = self.truth
        self.rate_loop.sense(self.sensors.gyro(truth))
        if self.commander.armed and not self.commander.killed:
            wanted = self.navigator.setpoint
            self.signals = self.rate_loop.run(wanted.rates_frd_rad_s, wanted.thrust, self.commander.detector.landed)
        else:
            self.signals = self.rate_loop.stop()
        self.truth = step(truth, self.signals, self.airframe, self._look_around(), STEP_S)

    def _look_around(self) -> Surroundings:
        """What acts on the vehicle now; the same object as before when nothing has changed."""
        seen = (
            self.wind.step(STEP_S, self.height_m),
            self.payload_kg,
            self.rotor_efficiency,
            self.battery.thrust_share,
        )
        if seen != self._seen:
            wind, payload_kg, efficiencies, share = self._seen = seen
            scaled = tuple([efficiency * share for efficiency in efficiencies])
            self._surroundings = Surroundings(wind, payload_kg, scaled)
        return self._surroundings

    def _estimate(self) -> None:
        """The estimator's turn, and that of the controllers that hang on it."""
        if self.uptime_s < _ARMABLE_S:
            self.estimator.reset_counter = [count for after, count in BOOT_RESETS if self.uptime_s >= after][-1]
        estimate = self.estimator.step(self.truth, self.time_us)
        self.sender.note_estimate()
        self.navigator.step(estimate)

    def _command(self) -> None:
        """The commander's turn."""
        commander = self.commander
        told, self.told = self.told, (commander.mode, commander.intended)
        self._look()
        was_armed = commander.armed
        commander.tick(_COMMANDER_US * 1e-6)
        if commander.armed != was_armed:
            self.navigator.set_home()
            if was_armed and self.parameters["SIM_BAT_DRAIN"] > 0.0:
                self.battery.set(1.0)
        self.battery.step(
            _COMMANDER_US * 1e-6,
            commander.armed,
            commander.inputs.thrust_share,
            self.parameters["SIM_BAT_DRAIN"],
            0.01 * self.parameters["SIM_BAT_MIN_PCT"] if self.parameters["SIM_BAT_DRAIN"] > 0.0 else 0.0,
        )
        self.estimator.gps = self.parameters["SIM_GPS_USED"] > 0
        if commander.changed or told != self.told or self._steps % _STATUS_STEPS < 3:
            commander.changed = False
            self.sender.status_us = self.simulated_us

    def _look(self) -> None:
        """What the commander sees."""
        seen = self.commander.inputs
        self.announcer.time_boot_ms = self.time_us // 1000
        hover, thrust = self.airframe.hover_thrust, self.navigator.setpoint.thrust
        seen.on_ground = self.truth.on_ground
        seen.thrust_share = thrust / hover if isfinite(thrust) else 0.0
        seen.position_valid = self.position_valid
        seen.heading_stable = self.heading_stable
        if self.estimator.fusing != self._fusing:
            self._fusing = self.estimator.fusing
            self.announcer.say("gnss_fusion_started" if self._fusing else "gnss_fusion_stopped")
        seen.compass_fault = self.estimator.heading_fault
        seen.task_finished = self.navigator.tasks.finished
        seen.battery_fraction = self.battery.fraction
        seen.setpoint_age_s = self.receiver.setpoint_age_s
        seen.sticks_age_s = self.receiver.sticks_age_s
