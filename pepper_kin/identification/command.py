"""Implementation of `pepper-kin check log`."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from pepper_kin.arrays import BriefRepr
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.file_access.atomic_file import PathName
from pepper_kin.identification.log_file import read_log
from pepper_kin.identification.replay import Replay, compared, replay, report_of
from pepper_kin.model import PepperModel, load_pepper


@dataclass(frozen=True, eq=False)
class LogCheck(BriefRepr):
    """Comparison of the twin with a robot over several logs.

    Attributes:
        replays: Replays, one per log.
    """

    replays: tuple[Replay, ...]

    def report(self) -> str:
        """Return the table of the joints and the largest stretches."""
        times = sum(one.log.duration for one in self.replays)
        names = ", ".join(one.log.name for one in self.replays)
        return f"{names}: {times / 60:.1f} minutes\n{report_of(list(self.replays))}"

    def as_dict(self) -> dict[str, Any]:
        """Return joints over all logs, stretches with their log, and each log alone, for JSON."""
        return {
            "joints": {name: found.as_dict() for name, found in compared(list(self.replays)).items()},
            "stretches": [
                {"log": one.log.name, **stretch.as_dict()}
                for one in self.replays
                for stretch in one.stretches
            ],
            "logs": [
                {key: value for key, value in one.as_dict().items() if key != "stretches"}
                for one in self.replays
            ],
        }


def check_logs(
    paths: Sequence[PathName],
    *,
    pepper: PepperModel | None = None,
    share: float | None = None,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> LogCheck:
    """Read logs, replay their commands on the twin, and compare it with the robot.

    Args:
        paths: Log files for `read_log`, with the same joints.
        pepper: The robot; Pepper if omitted.
        share: Ratio of the maximum speed given with the commands; see `read_log`.
        progress: Function that is called with the number of logs done and the number of all logs.

    Raises:
        InvalidValueError: for no file, or logs of different joints.
        FileFormatError: for a file that is not a log; see `read_log`.
    """
    if not paths:
        raise InvalidValueError("logs", "none", "at least one file")
    robot = load_pepper() if pepper is None else pepper
    replays: list[Replay] = []
    for path in paths:
        log = read_log(path, share=share)
        if replays and log.joint_names != replays[0].log.joint_names:
            expected = ", ".join(replays[0].log.joint_names)
            raise InvalidValueError(f"joints of {log.name}", ", ".join(log.joint_names), expected)
        replays.append(replay(robot, log))
        progress(len(replays), len(paths))
    return LogCheck(tuple(replays))
