"""Make the pictures of the documentation: python docs/make_pictures.py [NAME ...] (needs a Chromium).

Without names all are made; a name is the beginning of a picture's name, such as `example_05` or `film`.  The
pictures of the examples are drawn from what the examples compute.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable

from pictures_of import forces, motions, pages, reaching, senses

DRAWERS: dict[str, Callable[[], None]] = {
    "example_01": reaching.draw_01_reach_and_look,
    "example_02": forces.draw_02_check_dynamics,
    "example_03": reaching.draw_03_unreachable,
    "example_04": forces.draw_04_any_robot,
    "example_05": reaching.draw_05_reach_map,
    "example_06": reaching.draw_06_servo,
    "example_07": reaching.draw_07_data_set,
    "example_08": reaching.draw_08_base_placement,
    "example_09": forces.draw_09_gradients,
    "example_10": motions.draw_10_gestures,
    "example_11": motions.draw_11_files,
    "example_12": motions.draw_12_carry_a_tray,
    "example_13": senses.draw_13_push_a_box,
    "example_14": senses.draw_14_sensors,
    "example_15": forces.draw_15_randomized_twins,
    "example_16": motions.draw_16_live_target,
    "example_17": motions.draw_17_jerk_limits,
    "example_18": motions.draw_18_soft_costs,
    "example_19": motions.draw_19_smooth_plan,
    "example_20": motions.draw_20_naoqi_script,
    "example_21": motions.draw_21_ros_client,
    "example_22": motions.draw_22_live_motion,
    "example_23": motions.draw_23_follow_a_path,
    "example_24": motions.draw_24_imitate_reach,
    "example_25": motions.draw_25_policy_on_robots,
    "example_26": motions.draw_26_retarget,
    "example_27": motions.draw_27_make_data_set,
    "learning_frames": motions.draw_learning_frames,
    "learning_policy": motions.draw_learning_policy,
    "learning_tasks": motions.draw_learning_tasks,
    "demo": pages.draw_demo,
    "film": pages.draw_film,
    "live_film": pages.draw_live_film,
    "visual": pages.draw_visual,
    "reach": pages.draw_reach,
    "gestures": pages.draw_gestures,
    "timing": pages.draw_timing,
    "comparison": pages.draw_comparison,
    "live_page": pages.draw_live_page,
    "live_go": pages.draw_live_go,
    "log_page": pages.draw_log_page,
}


def main(names: list[str]) -> int:
    """Draw what is named; return the exit code."""
    chosen = [name for name in DRAWERS if not names or any(name.startswith(part) for part in names)]
    if not chosen:
        print(f"no picture begins like that; there are {', '.join(DRAWERS)}", file=sys.stderr)
        return 2
    for name in chosen:
        begin = time.monotonic()
        DRAWERS[name]()
        print(f"{name}: {time.monotonic() - begin:.1f} s", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
