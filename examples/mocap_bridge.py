"""Feed poses from a motion-capture system to the estimator: mocap_bridge.py PORT [COUNT].

Each UDP datagram on 127.0.0.1:PORT is ``{"position": [x, y, z], "orientation": [w, x, y, z]}``, local NED, body FRD
to NED. Systems that speak ENU and FLU have to be turned first: see `daemon.frames`.
"""

import asyncio
import json
import sys

from daemon.goals.client import FlightClient

STANDARD_DEVIATIONS = (0.002, 0.002, 0.002, 0.01, 0.01, 0.01)


class Poses(asyncio.DatagramProtocol):
    """Keeps the newest pose: an old one is worth nothing."""

    def __init__(self) -> None:
        self.newest: asyncio.Queue[tuple[float, dict[str, list[float]]]] = asyncio.Queue(1)

    def datagram_received(self, data: bytes, _address: object) -> None:
        if self.newest.full():
            self.newest.get_nowait()
        self.newest.put_nowait((asyncio.get_running_loop().time(), json.loads(data)))


async def main(port: int, count: int | None) -> None:
    loop = asyncio.get_running_loop()
    transport, poses = await loop.create_datagram_endpoint(Poses, local_addr=("127.0.0.1", port))
    covariance = [deviation**2 for deviation in STANDARD_DEVIATIONS]
    print(f"listening at {transport.get_extra_info('sockname')[1]}", flush=True)
    async with FlightClient() as flight:
        while count is None or count > 0:
            stamp_s, pose = await poses.newest.get()
            await flight.send_pose(pose["position"], pose["orientation"], covariance=covariance, stamp_s=stamp_s)
            count = None if count is None else count - 1
        await flight.info()  # answered after all that was sent before


if __name__ == "__main__":
    if not 1 <= len(sys.argv) - 1 <= 2:
        sys.exit("usage: mocap_bridge.py PORT [COUNT]")
    asyncio.run(main(int(sys.argv[1]), int(sys.argv[2]) if len(sys.argv) > 2 else None))
