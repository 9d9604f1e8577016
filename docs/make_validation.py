"""Write docs/validation.md from what the check commands find: python docs/make_validation.py [--robot].

With --robot only the part about the robot's logs is made again.  Without the logs, in ../shared/robot_logs or
$PEPPER_KIN_ROBOT_LOGS, that part stays as it is.
"""

import io
import os
import platform
import re
import sys
from pathlib import Path

import numpy as np

import pepper_kin as pk
from pepper_kin import identification
from pepper_kin.jobs import check_dynamics, check_physics
from pepper_kin.paper import check_paper
from pepper_kin.paper.files import paper_figure

FOLDER = Path(__file__).parent

LOGS = Path(os.environ.get("PEPPER_KIN_ROBOT_LOGS", FOLDER.parents[1] / "shared" / "robot_logs"))
DRAWN = ("RShoulderPitch", "RElbowYaw", "RElbowRoll", "LShoulderRoll", "HipPitch")

TITLE = "# Validation\n\n"

ROBOT = """## Beside a real Pepper

The one public recording of a real Pepper that is commanded and measured
([pepper_openpose_teleoperation](https://github.com/FraPorta/pepper_openpose_teleoperation), Apache 2.0; one
robot, NAOqi 2.5, September 2021): `setAngles` of nine joints at 5 Hz with the fraction 0.15, and what the
encoders read. {minutes:.0f} minutes of five persons were at hand. The twin takes the commands the way of
NAOqi's modules, with how the joints follow (`pk.twin.joint_response`) **fitted to the other four persons**
in each case. `pepper-kin check log` prints the same table for logs of yours, with the values that were
fitted to all five; with `--page log.html` it writes a page that plays robot and twin over each other.

```text
{table}
```

![Command, robot and twin; the distribution of the errors](pictures/robot_log.png)

| all nine joints, each person held out | worst | asked |
|---|---|---|
| median of abs(twin - robot) without stretches | {median:.1f} mrad | 4 |
| 95th percentile | {p95:.1f} mrad | 25 |
| rms | {rms:.1f} mrad | 20 |
| delay that is left in fast motion | {delay:.0f} ms | 20 |
| rms(twin - robot) / rms(command - robot), mean, all readings | {ratio:.2f} (kinematic {plain:.2f}) | 0.62 |
| joints whose median of all readings is not below the kinematic model's | {above} | 0 |
| squared error in stretches | {squares:.0f} %, of the joints {worst:.0f} % or more | 80 % |

**Two laws make the difference**, both seen in the log and neither fitted to a person:

- *Each `setAngles` begins a new cubic in time* from position and speed of now to rest at the target, as
  long as the fastest speed of such a cubic from rest is the fraction times the joint's limit. Commands that
  come five times a second and go far are therefore followed slowly, and a joint that turns back does so
  late. With a trapezoid of speed instead, as was assumed before, the right elbow's ratio is 0.24 instead of
  0.15.
- *Arms slide along the body*: where a posture would bring an arm nearer than 3 mm to the body, the robot
  takes the nearest one that does not, by the sum of the squared changes of the arm's joints. That is the
  geometry of the description and no number of the log; distances from 0 to 4 mm and other weights of the
  joints do no better. It takes the mean ratio from 0.51 to 0.37, and LShoulderRoll's from 0.94 to 0.37.
  `naoqi.Broker(mode="robot")` does the same.

**Stretches.** A reading is explained if it is within 20 mrad of where the twin is at some moment from 40 ms
before to 40 ms after it. Two readings or more that are not, over 0.35 s, are a stretch as long as they stay
10 mrad away. {named:.0f} % of the readings are in one. The figures without stretches are about the rest,
and are the better the more is called a stretch. What tells models apart is all readings, and the delay. The
kinds ("beyond a limit", "protected", "blocked") are what the posture suggests; why a robot stopped is not
in the log. To ask in addition for a command that was steady was tried in eight variants. The best of them
(steady for 0.2 s, or protected) names 13.8 % of the readings with 72 % of the squared error (HipPitch
43 %), and leaves a 95th percentile of 25.6 mrad (the others up to 55.8) and an rms of 33 mrad. So it is not
asked.

**What the fit found.** Value and 95 % interval over persons:

```text
{fit}
```

- The cubics are as fast as fraction and velocity limit give, to 12 %: shares of 0.88 to 1.05. Other
  fractions were not recorded.
- Joints follow the interpolation with a time constant of about 0.1 s, and stop 1 to 5 mrad short on either
  side, as with backlash or friction.
- Gravity moves the hip by 1.8 mrad for each N m, a stiffness of about 550 N m/rad. For the other joints the
  torques in the logs are too small to tell.
- The joints of a row were read one after the other. The time of one call is found for each log as what
  brings twin and robot together: {least:.1f} to {most:.1f} ms, and 4 % of what a row took beyond the
  median. Readings that are late and a joint that is slow look alike; that left and right joints lag alike
  tells them apart. The program's own time stamps, which the fit does not use, say 3 to 10 ms.
- Not explained: that single rows come up to 50 ms early or late; why some far commands are followed at half
  the speed that the cubic has (person e's shoulder); single dips of the hip by up to 70 mrad for a fifth of
  a second; both elbows that open by 1 rad for two seconds while no command is logged (person d).

No value changes by more than its interval when one person's logs are left out: `Fit.without` has these, and
`benchmarks/run_all.py reality` prints the largest change over its interval.

`benchmarks/run_all.py reality` prints the numbers by person.

"""

HEAD = """What the `check` commands find on Pepper, as they print it. This page is written by `python
docs/make_validation.py`; run the commands to see it on your machine. Each exits with 1 if something is
beyond its limit, takes `--json`, and the last two take `-o DIR` for files.

## `pepper-kin check paper`

The validation of the published digital twin (Sekkat et al., *Heliyon* 2024), made again: joint limits
(table 4), three movements at five frames (table 5), tracking over 1000 iterations (figures 6 and 7), and
joint angles measured by accelerometers on the links (section 3.3). What the paper's formulas print for
roll, pitch and yaw was not at hand; they are taken in their usual form ([API](api/twin.md)). The period of
an iteration is assumed to be 10 ms. The command also prints table 5 frame by frame; the largest errors are
in [Gestures](gestures.md#the-papers-gestures).

"""

PHYSICS = """
## `pepper-kin check physics`

The same model, gains and inputs in MuJoCo (`pip install "pepper_kin[mujoco]"`). The free swing agrees to
rounding, since both engines use semi-implicit Euler there; where servos are at work, MuJoCo takes their
stiffness explicitly and the twin implicitly, and the difference shrinks with the timestep.

"""

DYNAMICS = """
## `pepper-kin check dynamics`

"""


def main() -> None:
    """Run the checks and write page and pictures."""
    page = FOLDER / "validation.md"
    before = page.read_text(encoding="utf-8").removeprefix(TITLE)
    split = before.index(HEAD[:40])
    robot = robot_section() if LOGS.exists() else before[:split]
    rest = before[split:] if "--robot" in sys.argv else checks()
    page.write_text(TITLE + robot + rest, encoding="utf-8")


def robot_section() -> str:
    """Return the part about the robot's logs, and draw its picture."""
    pepper = pk.load_pepper()
    logs = [identification.read_log(file) for file in sorted(LOGS.glob("*.csv*"))]
    fit = identification.fit_actuators(pepper, logs)
    replays = [
        identification.replay(pepper, log, identification.without_person(pepper, fit, log.person))
        for log in logs
    ]
    plain = pk.twin.joint_response(pepper, "ideal")
    kinematic = [identification.replay(pepper, log, plain, round_trip=0.0) for log in logs]
    ideal = identification.compared(kinematic)
    joints = identification.compared(replays)
    error = np.concatenate([one.error[one.judged] for one in replays])
    named = np.concatenate([one.named[one.judged] for one in replays])
    identification.save_replay_picture(replays, FOLDER / "pictures" / "robot_log.png", joints=DRAWN)
    return ROBOT.format(
        minutes=sum(log.duration for log in logs) / 60,
        table=identification.report_of(replays, longest=0),
        median=1e3 * max(one.median for one in joints.values()),
        p95=1e3 * max(one.p95 for one in joints.values()),
        rms=1e3 * max(one.rms for one in joints.values()),
        delay=1e3 * max(abs(one.delay) for one in joints.values()),
        ratio=np.mean([one.ratio for one in joints.values()]),
        plain=np.mean([one.ratio for one in ideal.values()]),
        above=sum(joints[name].median_of_all >= ideal[name].median_of_all for name in joints),
        squares=100 * (error[named] ** 2).sum() / (error**2).sum(),
        named=100 * named.mean(),
        worst=100 * min(one.named_squares for one in joints.values()),
        fit=fit.report(),
        least=1e3 * min(fit.round_trips.values()),
        most=1e3 * max(fit.round_trips.values()),
    )


def checks() -> str:
    """Return what the check commands find, and draw the paper's movements."""
    paper, physics, dynamics = check_paper(), check_physics(), check_dynamics(pk.load_pepper())
    text = HEAD + block(without_frames(paper.report()))
    for movement in paper.movements:
        name = f"paper_{movement.name}.png"
        content = io.BytesIO()
        paper_figure(movement).savefig(content, format="png", dpi=80)
        (FOLDER / "pictures" / name).write_bytes(content.getvalue())
        text += f"\n![{movement.name}: joints, tracking errors, angles from sensors](pictures/{name})\n"
    text += PHYSICS + block(physics.report()) + DYNAMICS + block(dynamics.report())
    return text + f"\nPython {platform.python_version()}, {platform.machine()}.\n"


def without_frames(report: str) -> str:
    """Return the report without the values of table 5 at each frame, which fill three screens."""
    return re.sub(r"== Table 5.*?(?=^== Figures)", "", report, flags=re.DOTALL | re.MULTILINE)


def block(report: str) -> str:
    """Return a report as a block of text."""
    return f"```text\n{report}\n```\n"


if __name__ == "__main__":
    main()
