"""Make the pictures of the documentation: python docs/make_pictures.py (needs a Chromium)."""

from pathlib import Path

import pepper_kin as pk
from pepper_kin.jobs import run_demo
from pepper_kin.kinematics.reach_map import reach_map
from pepper_kin.kinematics.reach_picture import save_reach_picture

FOLDER = Path(__file__).parent / "pictures"


def main() -> None:
    """Write the pictures."""
    FOLDER.mkdir(exist_ok=True)
    pepper = pk.load_pepper()
    outcome = run_demo(pepper)
    viewer = pk.Viewer(pepper).add_scene(outcome.scene).add_target("hand", outcome.target)
    at_time = outcome.trajectory.duration
    viewer.save_image(FOLDER / "demo.png", outcome.run, at_time=at_time, size=(1280, 720))
    for name, looks, over in (
        ("looks", "visual", None),
        ("capsules", "visual", "collision"),
        ("spheres", "visual", "spheres"),
    ):
        for view in ("front", "side", "three-quarter"):
            picture = FOLDER / f"{name}_{view}.png"
            pk.Viewer(pepper, looks=looks, over=over).save_image(picture, size=(480, 640), view=view)
    draw_reach()


def draw_reach() -> None:
    """Draw where the left hand can go."""
    pepper = pk.load_pepper(base="planar")
    arm, torso = pepper.joint_group("left_arm"), pepper.joint_group("torso")
    choices = {
        "left arm": arm,
        "with torso": (*torso, *arm),
        "with torso, turning on the spot": ("BaseYaw", *torso, *arm),
    }
    maps = {title: reach_map(pepper, "LArm_effector", joints=joints) for title, joints in choices.items()}
    save_reach_picture(maps, FOLDER / "reach_left.png")


if __name__ == "__main__":
    main()
