"""Replacements of the modules that NAOqi's scripts import: `naoqi`, `qi`, `almath`, `motion`, ...

They call a `Broker` in this process; `pepper_kin.naoqi.scripts` installs them while it runs a script.
"""

from pepper_kin.naoqi.shims.futures import current_broker, set_broker

__all__ = ["current_broker", "set_broker"]
