"""What the runner does not decide: the examples of property tests, how long they may take, signals that it ignores."""

import signal

from hypothesis import HealthCheck, settings

settings.register_profile(
    "same_in_each_run", derandomize=True, deadline=None, suppress_health_check=[HealthCheck.too_slow]
)
settings.load_profile("same_in_each_run")

for _number in (signal.SIGINT, signal.SIGHUP):  # ignored under nohup and in the background, by every child as well
    if signal.getsignal(_number) is signal.SIG_IGN:
        signal.signal(_number, lambda *_: None)
