"""A session that has heard one heartbeat of the autopilot."""

import pytest
from support.session_rig import heartbeat

from daemon.autopilot.session import Px4Session, SessionParams


@pytest.fixture
def session() -> Px4Session:
    session = Px4Session(SessionParams(system_id=1, component_id=195))
    session.receive("HEARTBEAT", heartbeat(), 0.0)
    session.take_outgoing()
    return session
