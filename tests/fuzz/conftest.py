"""How much is tried: ``make test`` takes the profile "part", ``make fuzz`` the profile "whole"."""

from hypothesis import HealthCheck, settings

_COMMON = dict(deadline=None, database=None, print_blob=True, suppress_health_check=list(HealthCheck))
settings.register_profile("part", max_examples=200, derandomize=True, **_COMMON)
settings.register_profile("whole", max_examples=10_000, **_COMMON)
settings.load_profile("part")
