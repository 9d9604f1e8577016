"""Drawables: copied, read-only, refused when they cannot be drawn."""

import numpy as np
import pytest

from pepper_kin.exceptions import InvalidValueError
from pepper_kin.model.shapes import Box, Shape
from pepper_kin.viewer import Drawable, marker

WHITE = (1.0, 1.0, 1.0, 1.0)


def test_the_pose_is_a_read_only_copy():
    pose = np.eye(4)
    drawable = Drawable("box", "link", Box((1, 1, 1)), pose, WHITE)
    pose[0, 3] = 5.0
    assert drawable.transform_shape_to_link[0, 3] == 0.0
    with pytest.raises(ValueError, match="read-only"):
        drawable.transform_shape_to_link[0, 3] = 1.0


def test_a_robots_shape_becomes_a_drawable_on_the_same_link():
    shape = Shape("shell", "torso", Box((1, 2, 3)), np.eye(4), (0.1, 0.2, 0.3, 0.4))
    drawable = Drawable.from_shape(shape)
    assert (drawable.name, drawable.link, drawable.geometry) == ("shell", "torso", Box((1, 2, 3)))
    assert drawable.color == (0.1, 0.2, 0.3, 0.4)


def test_a_marker_stands_in_the_world():
    ball = marker("left hand", [0.1, 0.2, 0.3])
    assert ball.link is None
    np.testing.assert_array_equal(ball.transform_shape_to_link[:3, 3], [0.1, 0.2, 0.3])


def test_bad_input_is_refused_by_name():
    for arguments, message in [
        ({"geometry": "cube"}, "geometry of 'box': got str, expected Box"),
        ({"transform_shape_to_link": np.full((4, 4), np.nan)}, "transform_shape_to_link of 'box': got nan"),
        ({"transform_shape_to_link": np.eye(3)}, r"got shape \(3, 3\), expected shape \(4, 4\)"),
        ({"transform_shape_to_link": 2 * np.eye(4)}, "not rigid"),
        ({"transform_shape_to_link": np.diag([1.0, -1.0, 1.0, 1.0])}, "not rigid"),
        ({"color": (0, 0, 0)}, r"color of 'box': got shape \(3,\)"),
        ({"color": (0, 0, 0, 255)}, r"numbers in \[0, 1\]"),
    ]:
        good = {
            "name": "box", "link": "link", "geometry": Box((1, 1, 1)),
            "transform_shape_to_link": np.eye(4), "color": WHITE,
        }  # fmt: skip
        with pytest.raises(InvalidValueError, match=message):
            Drawable(**(good | arguments))


def test_a_marker_at_nan_is_refused():
    with pytest.raises(InvalidValueError, match="position of 'gaze': got nan"):
        marker("gaze", [0.0, np.nan, 0.0])
