"""companion: does this IMU agree with this autopilot, and if not, which of them is wrong?

>>> import companion as c
>>> flight = c.open_log("tlogs/copter-demo-100hz.tlog")[0]
>>> c.examine(flight).assessment.verdict.status
'consistent'
>>> for row in c.drift(flight, horizons=(1, 10)).rows:
...     print(f"{row.horizon_s:g} s: {row.attitude_deg.median:.2f}°, {row.position_m.median:.2f} m")
1 s: 0.04°, 0.02 m
10 s: 0.40°, 0.99 m

Conventions: SI units, seconds of the vehicle's boot clock, body FRD, world NED, Hamilton quaternions wxyz,
body to world.
"""

import warnings
from importlib import import_module
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from companion.api import *  # noqa: F403  (for type checkers, which follow its __all__)


def __getattr__(name: str) -> Any:
    """The names of `companion.api`, loaded when the first is used: the command line has to hear Ctrl-C at once."""
    if name == "__version__":
        from importlib.metadata import version  # noqa: PLC0415  (itself takes a third of the time that NumPy does)

        return version("mavlink-companion")
    if name.startswith("__") and name != "__all__":
        raise AttributeError(f"module 'companion' has no attribute {name!r}")
    if name == "reckon":
        warnings.warn("companion.reckon is now companion.dead_reckon", DeprecationWarning, stacklevel=2)
        name = "dead_reckon"
    if name == "init":  # `module load companion` of MAVProxy, which loads a package by its name
        return import_module("companion.mavproxy").init
    if find_spec(f"{__name__}.{name}"):  # `from companion import frames` asks here first, and must not load the whole
        return import_module(f"{__name__}.{name}")
    return getattr(import_module("companion.api"), name)


def __dir__() -> list[str]:
    return list(import_module("companion.api").__all__)
