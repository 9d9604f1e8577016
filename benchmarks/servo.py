"""Time of one servo tick, and how closely it follows: `python benchmarks/servo.py`.

Times are of the thread's processor time, taken in turn over all cases, so that other load disturbs little.
"""

import time

import numpy as np

import pepper_kin as pk

TICKS, SETTLED = 600, 300
TABLE = pk.Scene().add_box("table", size=(0.4, 0.8, 0.03), position=(0.47, 0.05, 0.715))
CASES = {
    "left hand, gaze": {"collisions": False},
    "both hands, gaze": {"both": True, "collisions": False},
    "both hands, gaze, balance": {"both": True, "balance": 0.02, "collisions": False},
    "left hand, gaze, self-collision": {},
    "both hands, gaze, self-collision": {"both": True},
    "both hands, gaze, self and table": {"both": True, "scene": TABLE},
}


def point_on_circle(seconds):
    angle = 2 * np.pi * seconds / 4.0
    return np.array([0.30, 0.20, 0.95]) + 0.06 * np.array([0.0, np.cos(angle), np.sin(angle)])


def tasks_at(seconds, both):
    point = point_on_circle(seconds)
    tasks = [pk.ik.HandPosition("left", point), pk.ik.LookAt(point)]
    return [*tasks, pk.ik.HandPosition("right", point * (1, -1, 1))] if both else tasks


def main():
    pepper = pk.load_pepper()
    both = {name: options.pop("both", False) for name, options in CASES.items()}
    servos = {
        name: pk.servo.Servo(pepper, pepper.posture("Stand"), **options) for name, options in CASES.items()
    }
    setting, stepping, missing = ({name: [] for name in CASES} for _ in range(3))
    for _ in range(TICKS):
        for name, servo in servos.items():
            tasks = tasks_at(servo.time, both[name])
            begin = time.thread_time()
            servo.set_target(tasks)
            between = time.thread_time()
            state = servo.step()
            stepping[name].append(time.thread_time() - between)
            setting[name].append(between - begin)
            hand = pk.kinematics.frame_pose(pepper, state.q, "LArm_effector")[:3, 3]
            missing[name].append(np.linalg.norm(hand - point_on_circle(state.time)))
    print(f"{'circle of 0.12 m in 4 s at 100 Hz':36}{'step':>9}{'p99':>9}{'target':>9}{'miss':>10}")
    for name in CASES:
        step, slow = np.percentile(stepping[name], (50, 99)) * 1e3
        target, miss = np.median(setting[name]) * 1e3, max(missing[name][SETTLED:]) * 1e3
        print(f"{name:36}{step:6.2f} ms{slow:6.2f} ms{target:6.2f} ms{miss:7.3f} mm")
        assert miss < 0.5


if __name__ == "__main__":
    main()
