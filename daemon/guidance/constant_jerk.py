"""Motion with a constant jerk: what every step, stretch and extrapolation of a reference is made of."""

from daemon.messages import Vec3

Motion = tuple[Vec3, Vec3, Vec3]  # position, velocity, acceleration


def carried(motion: Motion, jerk: Vec3, dt_s: float) -> Motion:
    """The motion ``dt_s`` later, or earlier when that is negative; metres and seconds in any one frame."""
    (px, py, pz), (vx, vy, vz), (ax, ay, az) = motion
    jx, jy, jz = jerk
    half, sixth = 0.5 * dt_s * dt_s, dt_s * dt_s * dt_s / 6.0
    return (
        (
            px + vx * dt_s + ax * half + jx * sixth,
            py + vy * dt_s + ay * half + jy * sixth,
            pz + vz * dt_s + az * half + jz * sixth,
        ),
        (vx + ax * dt_s + jx * half, vy + ay * dt_s + jy * half, vz + az * dt_s + jz * half),
        (ax + jx * dt_s, ay + jy * dt_s, az + jz * dt_s),
    )
