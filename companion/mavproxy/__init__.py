"""A module of MAVProxy: the verdict on IMU and autopilot, of the stream that MAVProxy has. `module load companion`.

It asks the vehicle for nothing and sends nothing. https://ardupilot.org/mavproxy
"""

from companion.mavproxy.module import Companion, init

__all__ = ["Companion", "init"]
