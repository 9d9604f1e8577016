"""Commands of pages: read whole, or refused by name."""

import json

import numpy as np
import pytest

from pepper_kin.exceptions import InvalidValueError, UnknownNameError
from pepper_kin.viewer.server.protocol import NAMES, parse


def test_a_command_is_read_with_its_fields():
    command = parse('{"do": "target", "name": "gaze", "position": [1, 0.5, 2], "stamp": 7}')
    assert command.name == "target"
    assert command.fields["name"] == "gaze"
    assert command.fields["stamp"] == 7
    np.testing.assert_array_equal(command.fields["position"], [1.0, 0.5, 2.0])
    assert parse('{"do": "release"}').fields == {}
    assert parse('{"do": "plan"}').name in NAMES


def test_what_is_wrong_is_named():
    for content, error, message in [
        ("{", InvalidValueError, "command: got '{', expected JSON text"),
        ("[]", InvalidValueError, r"command: got \[\], expected an object"),
        ('{"do": "explode"}', UnknownNameError, "unknown command 'explode'; available: joint, posture"),
        ('{"do": "joint", "name": "HeadYaw"}', InvalidValueError, "command 'joint': got no 'value'"),
        (
            '{"do": "joint", "name": "HeadYaw", "value": NaN}',
            InvalidValueError,
            "value: got nan, expected a fin",
        ),
        ('{"do": "joint", "name": "HeadYaw", "value": 1e999}', InvalidValueError, "value: got inf"),
        ('{"do": "joint", "name": "HeadYaw", "value": true}', InvalidValueError, "value: got True"),
        ('{"do": "joint", "name": 3, "value": 0}', InvalidValueError, "name: got 3, expected a name"),
        (
            '{"do": "show", "layer": "visual", "on": 1}',
            InvalidValueError,
            "on: got 1, expected true or false",
        ),
        ('{"do": "target", "name": "gaze", "position": [1, 2]}', InvalidValueError, "position: got shape"),
        ('{"do": "target", "name": "gaze", "position": [1, 2, 99]}', InvalidValueError, "within 10 m"),
        ('{"do": "plan", "fast": true}', InvalidValueError, "command 'plan': got a field 'fast'"),
        (json.dumps({"do": "posture", "name": "x" * 9000}), InvalidValueError, "at most 4096 letters"),
        ("[" * 4000, InvalidValueError, "expected JSON text"),
        (b"\x00", InvalidValueError, "JSON text of at most"),
    ]:
        with pytest.raises(error, match=message):
            parse(content)
