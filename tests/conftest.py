"""Property tests draw the same examples in each run, and none fails for what the machine did meanwhile."""

from hypothesis import HealthCheck, settings

settings.register_profile(
    "same_in_each_run", derandomize=True, deadline=None, suppress_health_check=[HealthCheck.too_slow]
)
settings.load_profile("same_in_each_run")
