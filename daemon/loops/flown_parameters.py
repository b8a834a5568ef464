"""The one writer of the flow's parameters: configuration, the autopilot's hover thrust, and where the fence is."""

from dataclasses import replace

from daemon import demands
from daemon.guidance.parameters import GuidanceParameters
from daemon.latest import Latest
from daemon.messages import ZERO3, FrameShift
from daemon.parameters import geofence, guidance_parameters, pipeline_parameters
from daemon.pipeline import Parameters
from daemon.safety.geofence import Geofence
from daemon.settings import Config


class FlownParameters:
    """Each change keeps what the others have set. ``cell`` is what the flow reads."""

    def __init__(self, config: Config) -> None:
        self.config = config
        self.guidance: GuidanceParameters = guidance_parameters(config)
        self.cell: Latest[Parameters] = Latest(pipeline_parameters(config, geofence(config, ZERO3)))

    @property
    def hover_thrust(self) -> float:
        """What the law starts with."""
        return self.cell.value.control.hover_thrust

    def set_config(self, config: Config, hover_thrust: float) -> None:
        """Other gains and limits, for a vehicle that hovers with this thrust now.

        Raises ``ValueError`` and changes nothing when they leave it less thrust than it needs and than it had.
        """
        demands.require_no_worse(self.config, config, hover_thrust)
        made, guidance = self._made(config, self.hover_thrust), guidance_parameters(config)
        self.cell.set(made)
        self.guidance = guidance
        self.config = config

    def take_hover(self, hover_thrust: float) -> None:
        """Start with the autopilot's hover thrust, where none is configured."""
        self.cell.set(self._made(self.config, hover_thrust))

    def place_fence(self, fence: Geofence, shift: FrameShift) -> None:
        """The fence, as the local frame of this shift calls it."""
        before = self.cell.value
        if fence != before.bounds.fence or shift.count != before.fence_shift.count:
            self.cell.set(replace(before, bounds=replace(before.bounds, fence=fence), fence_shift=shift))

    def cannot_hover(self) -> list[str]:
        """Why the thrust limits do not let the vehicle hover, in words; empty when they do."""
        return demands.unmet(demands.hover(self.config.control, self.hover_thrust))

    def cannot_fly(self) -> list[str]:
        """The same, and which limits of motion the thrust does not allow."""
        return demands.unmet(demands.demands(self.config, self.hover_thrust))

    def _made(self, config: Config, hover_thrust: float) -> Parameters:
        before = self.cell.value
        made = pipeline_parameters(config, before.bounds.fence, hover_thrust)
        return replace(made, fence_shift=before.fence_shift)
