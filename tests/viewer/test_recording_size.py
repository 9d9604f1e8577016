"""Ten seconds of Pepper in one file that an e-mail can carry."""

import numpy as np

import pepper_kin as pk
from pepper_kin.viewer import JointMotion


def test_ten_seconds_of_pepper_stay_under_six_megabytes(tmp_path, content_of):
    pepper = pk.load_pepper()
    times = np.linspace(0.0, 10.0, 5001)
    reach = np.minimum(pepper.upper_limits - pepper.neutral(), pepper.neutral() - pepper.lower_limits)
    swing = np.sin(times[:, None] * np.linspace(1.0, 3.0, pepper.n)) * 0.9 * np.maximum(reach, 0.0)
    torque = {f"{name} torque [N m]": np.cos(times) for name in pepper.joint_names}
    motion = JointMotion(times, pepper.neutral() + swing, torque)
    path = pk.Viewer(pepper).save_html(tmp_path / "ten.html", motion)
    content = content_of(path)
    assert content["motion"]["times"][-1] == 10.0
    assert len(content["motion"]["times"]) == 401
    assert len(content["motion"]["series"]) == pepper.n
    assert path.stat().st_size < 6e6
