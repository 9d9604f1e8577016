"""Cycles, calls and pictures of the simulated NAOqi.

Jitter of the 50 Hz cycle while a client polls, and what calls cost.

Asked are 3 ms for the 99th percentile of the delay, with cameras at 10 Hz and one client that polls, and
1 mrad rms between measured and commanded angles after `angleInterpolation`.

Run: python benchmarks/naoqi_host.py [seconds]   (needs pip install "pepper_kin[naoqi]")
"""

import subprocess
import sys

import numpy as np

from pepper_kin.naoqi import Broker, Host

POLLING = """
import sys, time, qi
session = qi.Session()
session.connect(sys.argv[1])
motion, memory = session.service("ALMotion"), session.service("ALMemory")
video = session.service("ALVideoDevice")
handle = video.subscribeCamera("bench", 0, 1, 11, 10)
end, calls, pictures = time.time() + float(sys.argv[2]), [], []
while time.time() < end:
    begun = time.time()
    motion.getAngles("Body", True)
    calls.append(time.time() - begun)
    if len(calls) % 5 == 0:
        begun = time.time()
        video.getImageRemote(handle)
        pictures.append(time.time() - begun)
    time.sleep(0.02)
middle = lambda values: sorted(values)[len(values) // 2] * 1e3
print(f"{middle(calls):.3f} {middle(pictures):.3f}")
"""


def tracking() -> float:
    """Return the rms of measured minus commanded angles after random interpolations [mrad]."""
    rng = np.random.default_rng(0)
    errors = []
    with Broker(real_time=False) as broker:
        motion = broker.motion
        names = motion.getBodyNames("Joints")
        limits = np.array(motion.getLimits("Joints"))
        for _ in range(20):
            share = rng.uniform(0.35, 0.65, len(names))
            goal = limits[:, 0] + share * (limits[:, 1] - limits[:, 0])
            motion.angleInterpolation(names, list(map(float, goal)), 1.5, True)
            errors.append(np.array(motion.getAngles(names, True)) - motion.getAngles(names, False))
    return 1000.0 * float(np.sqrt(np.mean(np.square(errors))))


def main(seconds: float) -> None:
    print(f"angles after angleInterpolation: {tracking():.2f} mrad rms")
    with Broker() as broker, Host(broker, port=0) as host:
        broker.body.time.delays.clear()
        command = [sys.executable, "-c", POLLING, host.url, str(seconds)]
        client = subprocess.run(command, capture_output=True, text=True, check=True)
        delays = 1000.0 * np.array(broker.body.time.delays)[50:]
        call, picture = client.stdout.split()
        late = np.percentile(delays, [50, 99])
        print(f"{len(delays)} cycles: delay median {late[0]:.2f} ms, 99th percentile {late[1]:.2f} ms")
        print(f"getAngles over the wire {call} ms, a QVGA picture drawn and sent {picture} ms")


if __name__ == "__main__":
    main(float(sys.argv[1]) if len(sys.argv) > 1 else 20.0)
