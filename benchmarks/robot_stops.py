"""Motions over the wire of libqi, with a real clock: followed to their end, and stopped in every way.

    python benchmarks/robot_stops.py --completed 50
    python benchmarks/robot_stops.py --stopped 200 --load 10

The first counts certified Bezier motions that a hosted robot makes to their end.  The second ends motions by
`stop` of another client, Ctrl-C, SIGSTOP and SIGKILL of their client while some processes keep the machine
busy, and counts robots that move after rest was reported, or 1.5 s after their client was killed.
"""

from __future__ import annotations

import argparse
import json
import random
import signal
import subprocess
import sys
import time
from collections import Counter

import numpy as np

from pepper_kin.naoqi import Robot
from pepper_kin.naoqi.hosted_twin import hosted_twin

STILL = 6e-3
"""By how much a robot at rest may move [rad, m]."""

CLIENT = """
import json, sys
import numpy as np
import pepper_kin as pk
from pepper_kin.naoqi import FollowOptions, Robot

pepper = pk.load_pepper().with_requirements("limits")
with Robot(sys.argv[1]) as robot:
    print("ready", flush=True)
    for line in sys.stdin:
        method = line.strip()
        try:
            if method == "drive":
                result = robot.drive([0.2, 0.0, 0.3], 3.0)
            else:
                here = robot.state().of(pepper.joint_names)
                here = np.clip(here, pepper.lower_limits, pepper.upper_limits)
                goal = here.copy()
                k = pepper.joint_index("LShoulderPitch")
                goal[k] = 0.3 if here[k] > 0.8 else 1.3
                trajectory = pk.retime(pepper, np.array([here, goal]), velocity_scale=0.15)
                print("going", flush=True)
                result = robot.follow(trajectory, method=method, options=FollowOptions(silence=1.0))
            print(json.dumps([result.status.value, result.message, result.at_rest]), flush=True)
        except KeyboardInterrupt:
            print(json.dumps(["interrupted", "", True]), flush=True)
        except Exception as error:
            print(json.dumps(["error", f"{type(error).__name__}: {error}", True]), flush=True)
"""


class Client:
    """A client in another process."""

    def __init__(self, url: str) -> None:
        command = [sys.executable, "-c", CLIENT, url]
        self.process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        self.expect("ready")

    def expect(self, text: str) -> str:
        """Return the next line that begins so; libqi's log is passed over."""
        assert self.process.stdout is not None
        while line := self.process.stdout.readline():
            if line.startswith(text):
                return line.strip()
        return ""

    def ask(self, method: str) -> None:
        """Begin a motion."""
        assert self.process.stdin is not None
        self.process.stdin.write(f"{method}\n")
        self.process.stdin.flush()

    def result(self) -> list:
        """Return status, message, and whether rest was measured."""
        return json.loads(self.expect('["') or '["lost", "", false]')


def movement(watcher: Robot, seconds: float) -> float:
    """Return how far the robot moves in some time [rad or m]."""
    first, most = watcher.state().q, 0.0
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        most = max(most, float(np.abs(watcher.state().q - first).max()))
        time.sleep(0.05)
    return most


def completed(count: int) -> None:
    """Print how many certified Bezier motions are followed to their end."""
    found: Counter[str] = Counter()
    with hosted_twin() as (url, _):
        client = Client(url)
        for _ in range(count):
            client.ask("bezier")
            status, message, _ = client.result()
            found[status] += 1
            if status != "completed":
                print(status, message)
        client.process.kill()
    print(f"Bezier motions to their end: {found['completed']} of {count}  {dict(found)}")


def stopped(count: int, load: int, seed: int) -> None:
    """Print how many robots move though they were stopped."""
    rng, wrong, found = random.Random(seed), 0, Counter()
    busy = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(load)]
    try:
        with hosted_twin() as (url, _), Robot(url, timeout=30.0) as watcher:
            client = Client(url)
            for k in range(count):
                method, how = (
                    rng.choice(["bezier", "stream", "drive"]),
                    rng.choice(["stop", "int", "freeze", "kill"]),
                )
                before = watcher.state().q
                client.ask(method)
                end = time.monotonic() + 60.0
                while np.abs(watcher.state().q - before).max() < 0.02 and time.monotonic() < end:
                    time.sleep(0.02)
                time.sleep(rng.uniform(0.0, 0.5))
                if how == "stop":
                    watcher.stop()
                elif how == "int":
                    client.process.send_signal(signal.SIGINT)
                elif how == "freeze":
                    client.process.send_signal(signal.SIGSTOP)
                    time.sleep(2.5)
                    client.process.send_signal(signal.SIGCONT)
                else:
                    client.process.kill()
                    time.sleep(1.5)
                result = ["killed", "", True] if how == "kill" else client.result()
                moved = movement(watcher, 2.0)
                found[f"{how}: {result[0]}"] += 1
                if result[0] == "error" or (moved > STILL and result[2]):
                    wrong += 1
                    print(k, method, how, result, f"moved by {moved:.3f}", flush=True)
                if client.process.poll() is not None:
                    client = Client(url)
            client.process.kill()
    finally:
        for process in busy:
            process.kill()
    print(f"robots that moved after their stop, or raw errors: {wrong} of {count}  {dict(found)}")


def main() -> None:
    """Read the options."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--completed", type=int, default=0, help="motions to their end")
    parser.add_argument("--stopped", type=int, default=0, help="motions that are stopped")
    parser.add_argument("--load", type=int, default=10, help="busy processes meanwhile")
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    if options.completed:
        completed(options.completed)
    if options.stopped:
        stopped(options.stopped, options.load, options.seed)


if __name__ == "__main__":
    main()
